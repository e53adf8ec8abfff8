// What stands between a task and its device's twin: the twin as it is, or one of these faults.
#pragma once

#include <algorithm>
#include <limits>

#include "drivers/camera/camera.hpp"
#include "drivers/haptic/haptic_device.hpp"

namespace walk {

class FaultyHand final : public drivers::HapticDevice {
 public:
  enum class Fault : std::uint8_t { kNone, kSilent, kNotFinite };
  Fault fault = Fault::kNone;

  explicit FaultyHand(drivers::HapticDevice& twin) : twin_(twin) {}
  [[nodiscard]] drivers::DeviceProperties properties() const noexcept override {
    return twin_.properties();
  }
  [[nodiscard]] bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    if (fault == Fault::kSilent) return false;
    const bool told = twin_.sense(now, out);
    if (fault == Fault::kNotFinite) out.p_DH.x() = std::numeric_limits<double>::quiet_NaN();
    return told;
  }
  void act(rt::Time now, const drivers::ForceCommand& command) noexcept override {
    twin_.act(now, command);
  }
  void request_enable() noexcept override { twin_.request_enable(); }
  void make_safe() noexcept override { twin_.make_safe(); }

 private:
  drivers::HapticDevice& twin_;
};

class FaultyCamera final : public drivers::Camera {
 public:
  enum class Fault : std::uint8_t {
    kNone,
    kInvalid,    // of no size
    kDark,       // no depth anywhere
    kElsewhere,  // another place
    kWall,       // one flat surface
    kStale,      // of the same instant again and again
    kNoJoints,   // the arm's angles are missing
  };
  Fault fault = Fault::kNone;

  explicit FaultyCamera(drivers::Camera& twin) : twin_(twin) {}
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return twin_.intrinsics();
  }
  [[nodiscard]] double rate_hz() const noexcept override { return twin_.rate_hz(); }
  [[nodiscard]] drivers::CameraStatus poll(rt::Time now,
                                           perception::RgbdFrame& out) noexcept override {
    const drivers::CameraStatus status = twin_.poll(now, out);
    if (status == drivers::CameraStatus::kFrame) spoil(out);
    return status;
  }
  [[nodiscard]] drivers::FrameArrivals* arrivals() noexcept override { return twin_.arrivals(); }

 private:
  void spoil(perception::RgbdFrame& out) noexcept {
    const auto pixels = static_cast<std::ptrdiff_t>(out.intrinsics.width * out.intrinsics.height);
    const auto end = out.depth_mm.begin() + pixels;
    if (fault == Fault::kNone) last_ = out.exposure;
    if (fault == Fault::kInvalid) out.intrinsics.width = 0;
    if (fault == Fault::kDark) std::fill(out.depth_mm.begin(), end, std::uint16_t{0});
    if (fault == Fault::kWall) std::fill(out.depth_mm.begin(), end, std::uint16_t{1500});
    if (fault == Fault::kElsewhere) std::reverse(out.depth_mm.begin(), end);
    if (fault == Fault::kStale) out.exposure = last_;
    if (fault == Fault::kNoJoints) out.joints = {};
  }
  drivers::Camera& twin_;
  rt::Time last_{};
};

}  // namespace walk
