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
  // Of each job, in order: the one of this exposure that it took, or that it found none.
  void taken(rt::Time start, rt::Time exposure);
  void found_none(rt::Time start);
  // By how much more all later releases are to be postponed; mostly zero.
  [[nodiscard]] rt::Nanos look();

  // A picture is decoded first: one that arrives in time but is not decoded in time waits for the
  // next release, a period. Where that happens to more than a few, releases go kStep later; to
  // kAtOnce, without waiting for the other pictures of a look. What is early by chance is no reason
  // to be earlier.
  static constexpr rt::Nanos kStep = std::chrono::microseconds{1500};
  static constexpr std::size_t kAtOnce = 5;
  static constexpr rt::Nanos kLeast = std::chrono::milliseconds{3};
  static constexpr rt::Nanos kGood = std::chrono::milliseconds{4};
  static constexpr rt::Nanos kMost = std::chrono::microseconds{6500};
  static constexpr std::size_t kPictures = 60;  // that are looked at: two seconds
  // The first look is at fewer, and each look that finds nothing to do is followed by one at kMore
  // more: a box that has just begun is far off, and a connection's first pictures are late. What is
  // seen of few is done from kFar on.
  static constexpr std::size_t kFirst = 15, kMore = 5;
  static constexpr rt::Nanos kFar = std::chrono::milliseconds{1};
  // Where pictures were passed, good is kStep longer on this machine, up to kSlowest. Else the
  // short wait would be tried again at the next look. It is kTry less after so many pictures of
  // which few were passed: kSoonest at first, for a box that has just begun decodes slowly, and
  // twice as many each time that some were passed after it was lessened, up to kLatest, a minute.
  // chosen on: the test's pictures, an idle machine of two cores; judged on: nothing else
  static constexpr rt::Nanos kSlowest = std::chrono::milliseconds{9};
  static constexpr rt::Nanos kTry = std::chrono::milliseconds{1};
  static constexpr std::size_t kSoonest = 90, kLatest = 1800;

 private:
  [[nodiscard]] rt::Nanos good() const { return kGood + slower_; }
  [[nodiscard]] rt::Nanos most() const { return kMost + slower_; }
  [[nodiscard]] rt::Nanos decide();
  [[nodiscard]] rt::Nanos after_passed(rt::Nanos shortest);
  void try_less() noexcept;
  struct Arrival {
    rt::Time at, exposure;
  };
  rt::Nanos period_;
  std::size_t pictures_ = kFirst;  // that the next look is at
  std::deque<Arrival> waiting_;    // arrived, taken by no job yet
  rt::Time job_{};                 // the newest
  std::vector<rt::Nanos> waits_;
  rt::Nanos slower_{0};  // than the fastest: what kGood and kMost are longer by
  std::size_t calm_ = 0, patience_ = kSoonest;  // pictures since some were passed or kTry was tried
  bool tries_ = false;                          // the newest change of slower_ was kTry less
  std::size_t missed_ = 0;                      // overwritten by the next one before a job came
  std::size_t passed_ = 0;  // there before a job that did not take it, not yet decoded
};

}  // namespace teletact
