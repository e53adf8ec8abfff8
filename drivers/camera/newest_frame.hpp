// The newest frame of a camera that is filled by a thread of its own, and when each one came.
//
// When frames come is not known before the run: a camera counts from a clock of its own, and a twin
// takes as long to render as its machine lets it. So the box moves capture's release to where they
// come (tools/box/release_phase.hpp).
#pragma once

#include <cstdint>

#include "drivers/camera/camera.hpp"
#include "rt/channel/latest.hpp"

namespace drivers {

class NewestFrame {
 public:
  explicit NewestFrame(rt::NonRealtime& nrt) : frames_(nrt, {1}) {}

  // The camera's thread. The slot to fill, then that its frame is whole, at `now`.
  [[nodiscard]] perception::RgbdFrame& begin_write() noexcept { return frames_.begin_write(); }
  void publish(rt::Time now) noexcept;

  // Capture's thread. True: `out` is the newest frame, not handed out before. Wait-free.
  [[nodiscard]] bool take(perception::RgbdFrame& out) noexcept;

  // One ordinary thread takes them.
  [[nodiscard]] FrameArrivals& arrivals() noexcept { return arrivals_; }

 private:
  rt::Latest<perception::RgbdFrame> frames_;
  std::uint64_t handed_out_ = 0;  // channel sequence
  FrameArrivals arrivals_;
};

}  // namespace drivers
