// One frame as it is fused: views of images that the caller keeps for the call, no copies.
#pragma once

#include <cstdint>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace perception {

// What is fused. Colour is registered to depth; empty (data == nullptr) where there is none.
struct FrameView {
  Intrinsics intrinsics{};
  ImageView<const std::uint16_t> depth_mm{};  // 0 and 65535 = no reading
  ImageView<const Rgb> colour{};
  ImageView<const std::uint8_t> moving{};  // not 0: carves, is not fused; empty: nothing moves
  bool follow = true;                      // surfaces that move slowly (follow/follow.hpp)
  Eigen::AlignedBox3d follow_W{};          // in this box; empty: everywhere

  [[nodiscard]] static FrameView of(const RgbdFrame& f) noexcept {
    return {f.intrinsics, f.depth(), f.has_colour ? f.rgb() : ImageView<const Rgb>{}};
  }
};

}  // namespace perception
