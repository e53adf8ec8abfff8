// The systematic depth error of a camera as a function of range, and a camera that removes it from
// raw depth.
// Time-of-flight cameras are off by up to centimetres, depending on the range (wiggling; see Foix,
// Alenya and Torras, "Lock-in time-of-flight cameras: a survey", IEEE Sensors 2011, section IV).
//
// The table states the bias at some readings. Between them it is linear in the reading, beyond the
// ends it is constant. Corrected = reading - bias, rounded, at least 1 mm.
// 0 and 65535 mean "no reading" and stay. An empty table constructs nothing.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>

#include "config/schema.hpp"
#include "drivers/camera/camera.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

// [[camera.bias]], one point each.
struct DepthBiasPoint {
  double at_mm = 1;    // reading
  double bias_mm = 0;  // reading - true depth there
  void describe(config::Section& s);
};
using DepthBiasTable = std::deque<DepthBiasPoint>;

// A table of all 65536 readings, computed once.
class DepthBias {
 public:
  // Throws std::invalid_argument naming key, value and range unless the readings rise.
  DepthBias(rt::NonRealtime&, const DepthBiasTable& table);
  [[nodiscard]] std::uint16_t corrected(std::uint16_t reading_mm) const noexcept {
    return (*corrected_)[reading_mm];
  }
  void apply(perception::RgbdFrame& frame) const noexcept;

 private:
  std::unique_ptr<std::array<std::uint16_t, 65536>> corrected_;
};

class BiasedCamera final : public Camera {
 public:
  BiasedCamera(rt::NonRealtime& nrt, std::unique_ptr<Camera> camera, const DepthBiasTable& table)
      : camera_(std::move(camera)), bias_(nrt, table) {}
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return camera_->intrinsics();
  }
  [[nodiscard]] double rate_hz() const noexcept override { return camera_->rate_hz(); }
  [[nodiscard]] CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept override {
    const CameraStatus status = camera_->poll(now, out);
    if (status == CameraStatus::kFrame) bias_.apply(out);
    return status;
  }

 private:
  std::unique_ptr<Camera> camera_;
  DepthBias bias_;
};

}  // namespace drivers
