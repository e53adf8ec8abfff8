// An RGB-D camera, polled by the capture task.
#pragma once

#include <cstdint>

#include "perception/geometry/rgbd_frame.hpp"
#include "rt/channel/ring.hpp"
#include "rt/time.hpp"

namespace drivers {

enum class CameraStatus : std::uint8_t { kNoFrame, kFrame, kEnd, kFault };

// When each frame came, whether a poll took it or not.
using FrameArrivals = rt::Ring<rt::Time, 256>;  // eight seconds of them

class Camera {
 public:
  virtual ~Camera() = default;
  [[nodiscard]] virtual perception::Intrinsics intrinsics() const noexcept = 0;
  [[nodiscard]] virtual double rate_hz() const noexcept = 0;
  // Fills `out` with the newest frame that is complete at `now` and was not handed out before.
  // Never waits. kEnd: a replay has no more frames.
  [[nodiscard]] virtual CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept = 0;
  // Of a camera whose frames come by themselves; for one ordinary thread. Null: frames are made, or
  // were read, for the poll.
  [[nodiscard]] virtual FrameArrivals* arrivals() noexcept { return nullptr; }
};

}  // namespace drivers
