// When fusion is released, on a box that does not share its epoch with the other one: soon after
// pictures typically arrive. On a phase by chance a picture would lie in the cell for half a period
// on average, and a whole one at worst. The clocks drift apart, and either box may start again, so
// this is looked at for as long as the box runs.
//
// A release can only be postponed (rt::Postponed): earlier by d is later by a period less d. Then
// there is no new patch for up to two periods, once: less than the 100 ms after which one counts
// as stale.
//
// Pure; one ordinary thread.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "rt/time.hpp"

namespace teletact {

class PicturePhase {
 public:
  explicit PicturePhase(rt::Nanos period) : period_(period) {}

  // Of each picture that arrived, in order, before it is decoded.
  void arrived(rt::Time at, rt::Time exposure);
  // Of each job that took a picture, in order: the one of this exposure.
  void taken(rt::Time start, rt::Time exposure);
  // By how much more all later releases are to be postponed; mostly zero.
  [[nodiscard]] rt::Nanos look();

  // A picture is decoded first: one that arrives in time but is not decoded in time waits for the
  // next release, a period. Where that happens to more than a few, releases go kStep later; to
  // kAtOnce, without waiting for the other pictures of a look. What is early by chance is no reason
  // to be earlier.
  static constexpr rt::Nanos kStep = std::chrono::milliseconds{3};
  static constexpr std::size_t kAtOnce = 5;
  static constexpr rt::Nanos kLeast = std::chrono::milliseconds{4};
  static constexpr rt::Nanos kGood = std::chrono::milliseconds{7};
  static constexpr rt::Nanos kMost = std::chrono::milliseconds{12};
  static constexpr std::size_t kPictures = 60;  // that are looked at: two seconds

 private:
  struct Arrival {
    rt::Time at, exposure;
  };
  rt::Nanos period_;
  std::deque<Arrival> waiting_;  // arrived, taken by no job yet
  std::vector<rt::Nanos> waits_;
  std::size_t missed_ = 0;  // overwritten by the next one before a job came
  std::size_t passed_ = 0;  // there before a job that did not take it, not yet decoded
};

}  // namespace teletact
