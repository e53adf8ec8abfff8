// When capture is released, on a box of its own: soon after frames of the camera come. A camera
// counts from a clock of its own, which drifts, and a twin renders as long as its machine lets it,
// so this is looked at for as long as the box runs. On a phase by chance a frame would wait for
// half a period on average; where frames come about the release, late ones are passed over.
//
// A release can only be postponed (rt::Postponed): earlier by d is later by a period less d, and
// costs one frame.
//
// Pure; one ordinary thread.
#pragma once

#include <deque>

#include "rt/time.hpp"

namespace teletact {

class CapturePhase {
 public:
  // The grid of capture's releases: `first`, and from there on at `rate`.
  CapturePhase(rt::Rate rate, rt::Time first) : rate_(rate), first_(first) {}

  // Of each frame, in order: when it was there.
  void arrived(rt::Time at);
  // By how much more all later releases are to be postponed, mostly zero. It takes it as done.
  [[nodiscard]] rt::Nanos look();

  static constexpr std::size_t kFrames = 60;  // that are looked at: two seconds; at first kFirst
  static constexpr std::size_t kFirst = 15;
  // One frame of so many may come after its release: it is found by the next one, a period later,
  // and the one after it is then often there already. Waiting for the last one of all costs every
  // frame what only that one needs.
  static constexpr std::size_t kOneLateOf = 60;
  // Behind the last frame that counts.
  static constexpr rt::Nanos kSpare = std::chrono::microseconds{500};
  // Later at once; earlier only for so much, for it costs a frame.
  static constexpr rt::Nanos kLater = std::chrono::microseconds{500};
  static constexpr rt::Nanos kEarlier = std::chrono::milliseconds{3};
  // Where no third of the period is free of frames, they have no phase, and nothing moves.
  static constexpr int kQuietPart = 3;
  // Free parts that differ by less than a sixth of the period are alike: of a camera of 60 or 20
  // frames a second there are two, and where capture follows either it stays.
  static constexpr int kAlikePart = 6;

 private:
  [[nodiscard]] rt::Nanos after_release(rt::Time at) const;  // of the release before `at`
  rt::Rate rate_;
  rt::Time first_;
  std::deque<rt::Time> frames_;
  std::size_t fresh_ = 0;  // since the last look
};

}  // namespace teletact
