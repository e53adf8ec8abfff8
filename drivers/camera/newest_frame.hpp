// The newest frame of a camera that is filled by a thread of its own, and what each poll found.
//
// A camera that counts from a clock of its own gives frames at a phase of capture's period that
// nobody knows before the run. What the polls found tells how long frames wait for capture, and
// which were passed over, so that the box can move capture's release (tools/box/kept_phase.hpp).
#pragma once

#include <cstdint>

#include "drivers/camera/camera.hpp"
#include "rt/channel/latest.hpp"

namespace drivers {

class NewestFrame {
 public:
  explicit NewestFrame(rt::NonRealtime& nrt) : frames_(nrt, {1}) {}

  // The camera's thread. The slot to fill, then that its frame has been whole since `whole`.
  [[nodiscard]] perception::RgbdFrame& begin_write() noexcept { return frames_.begin_write(); }
  void publish(rt::Time whole) noexcept { frames_.publish(whole); }

  // Capture's thread. True: `out` is the newest frame, not handed out before. Wait-free.
  [[nodiscard]] bool poll(rt::Time now, perception::RgbdFrame& out) noexcept;

  // One ordinary thread takes them.
  [[nodiscard]] CameraPolls& polls() noexcept { return polls_; }

 private:
  rt::Latest<perception::RgbdFrame> frames_;
  std::uint64_t handed_out_ = 0;  // channel sequence
  CameraPolls polls_;
};

}  // namespace drivers
