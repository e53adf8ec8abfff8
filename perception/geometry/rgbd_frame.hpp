// One RGB-D image pair as it travels camera -> codec -> link -> codec -> fusion.
// Fixed capacity, so it lives in a prefaulted channel slot. Depth is along the optical axis.
#pragma once

#include <array>
#include <cstdint>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/joint_angles.hpp"
#include "rt/time.hpp"

namespace perception {

struct Rgb {
  std::uint8_t r = 0, g = 0, b = 0;
  friend bool operator==(const Rgb&, const Rgb&) = default;
};

struct RgbdFrame {
  static constexpr int kMaxWidth = 640;
  static constexpr int kMaxHeight = 480;
  static constexpr std::size_t kMaxPixels =
      static_cast<std::size_t>(kMaxWidth) * static_cast<std::size_t>(kMaxHeight);

  rt::Time exposure{};      // middle of the exposure, in the reader's box clock
  std::uint64_t seq = 0;    // camera's frame number; gaps are lost frames
  Intrinsics intrinsics{};  // of the depth image; colour is registered to it when has_colour
  bool has_colour = false;
  JointAngles joints{};  // of the robot that carries the camera, at the exposure
  std::array<std::uint16_t, kMaxPixels> depth_mm{};  // row-major, width x height; 0 = no reading
  std::array<Rgb, kMaxPixels> colour{};              // exactly black: none there (no_colour.hpp)

  [[nodiscard]] ImageView<std::uint16_t> depth() noexcept {
    return {depth_mm.data(), intrinsics.width, intrinsics.height, intrinsics.width};
  }
  [[nodiscard]] ImageView<const std::uint16_t> depth() const noexcept {
    return {depth_mm.data(), intrinsics.width, intrinsics.height, intrinsics.width};
  }
  [[nodiscard]] ImageView<Rgb> rgb() noexcept {
    return {colour.data(), intrinsics.width, intrinsics.height, intrinsics.width};
  }
  [[nodiscard]] ImageView<const Rgb> rgb() const noexcept {
    return {colour.data(), intrinsics.width, intrinsics.height, intrinsics.width};
  }
};

}  // namespace perception
