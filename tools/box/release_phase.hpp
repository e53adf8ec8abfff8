// When a task of a running box is released, that waits for what comes from elsewhere: capture for
// frames of the camera, fusion for decoded pictures. Both are made by a clock that drifts and on
// machines that take their time, so this is looked at for as long as the box runs. On a phase by
// chance what comes would wait for half a period on average; where it comes about the release,
// what is late is found a period later, and often overwritten by the next one until then.
//
// The phase is that of the least cost among the newest arrivals: the mean wait for the next
// release, and kLost periods for each that the next one overwrites.
//
// A release can only be postponed (rt::Postponed): earlier by d is later by a period less d. Then
// the task finds nothing new for up to two periods, once.
//
// Pure; one ordinary thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "rt/time.hpp"

namespace teletact {

class ReleasePhase {
 public:
  // The grid of the task's releases: `first`, and from there on at `rate`.
  ReleasePhase(rt::Rate rate, rt::Time first) : rate_(rate), first_(first) {}

  // Of each, in order: from when on the task can take it.
  void arrived(rt::Time at);
  // By how much more all later releases are to be postponed, mostly zero. It takes it as done.
  [[nodiscard]] rt::Nanos look();

  static constexpr std::size_t kArrivals = 60;  // that are looked at: of 30 Hz two seconds
  static constexpr std::size_t kFirst = 15;     // at first, and of each look so many are new
  // A lost one is a period without news, and the rate falls: one in 60 costs as much as 1.7 ms of
  // waiting of all at 30 Hz. This and the times below:
  // chosen on: the test's arrivals, 29 of 30 are to stay; judged on: the bench of the link
  static constexpr int kLost = 3;
  // After the arrival that is aimed at: what takes it may come between, and clocks drift by 3 ms a
  // minute at 50 ppm.
  static constexpr rt::Nanos kSpare = std::chrono::microseconds{1500};
  // A move is to gain more than this an arrival: a single one that was late moves nothing.
  static constexpr rt::Nanos kGain = std::chrono::milliseconds{2};
  // At once earlier only by this or more, for it costs an arrival.
  static constexpr rt::Nanos kEarlier = std::chrono::milliseconds{3};
  // Less is worth an arrival in the long run: this much, if it was to be gained at every look at so
  // many arrivals.
  static constexpr rt::Nanos kSmallGain = std::chrono::milliseconds{1};
  static constexpr std::size_t kLasting = 150;
  // Where a core is shared, a release that comes earlier can delay what it waits for: fusion that
  // runs before capture of the box beside it has. What was seen then promises too much, and
  // releases go later again. So each time that an earlier release is taken back within kTried
  // arrivals, the next one waits for kMorePatience times as many, up to kLatest, a minute. One that
  // stays makes up for one that did not.
  static constexpr std::size_t kTried = 2 * kArrivals, kMorePatience = 4, kLatest = 1800;
  // After so many periods without an arrival all begins anew: the other end has started again.
  static constexpr int kAnew = 60;

 private:
  struct Arrival {
    std::int64_t release;  // the one at or before it, counted from the window's first
    rt::Nanos after;       // after that one
  };
  [[nodiscard]] rt::Nanos after_release(rt::Time at) const;
  [[nodiscard]] std::vector<Arrival> on_the_grid() const;
  // Of all of them, where releases are postponed by `later`, less than a period.
  [[nodiscard]] rt::Nanos cost(const std::vector<Arrival>& arrivals, rt::Nanos later) const;
  struct Best {
    rt::Nanos later{0};  // by how much later they are best, kSpare behind the arrival aimed at
    rt::Nanos gain{0};   // of an arrival, there
  };
  [[nodiscard]] Best best_of(const std::vector<Arrival>& arrivals) const;
  // Whether that is worth a move; `fresh`: arrivals since the last look.
  [[nodiscard]] bool worth(const Best& best, std::size_t fresh) noexcept;
  // Earlier, and the last earlier one did not stay long enough ago. Else it is counted as a move.
  [[nodiscard]] bool too_soon(rt::Nanos later) noexcept;
  rt::Rate rate_;
  rt::Time first_;
  std::deque<rt::Time> newest_;
  std::size_t fresh_ = 0;                                // since the last look
  std::size_t moved_ago_ = kLatest, patience_ = kFirst;  // arrivals
  std::size_t lasting_ = 0;                              // arrivals, with a small gain at each look
  bool was_earlier_ = false;                             // the last move
};

}  // namespace teletact
