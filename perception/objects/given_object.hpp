// An object as a person has accepted it: boxes that hold its surface and hardly any other. A mask
// of one picture becomes such boxes (boxes_of), and ObjectMap takes them instead of a touch. Boxes
// are few and plain numbers, so they pass through the tasks' edges and a recording holds them.
//
// Frames: W world (= map), C camera (optical). SI.
#pragma once

#include <array>
#include <span>

#include "perception/segmentation/click.hpp"
#include "perception/tsdf/image/frame_view.hpp"

namespace perception {

struct GivenObject {
  static constexpr int kMost = 12;
  std::array<Eigen::AlignedBox3d, kMost> boxes_W;
  int count = 0;
  Vec3 p_W = Vec3::Zero();  // of its surface, in one of the boxes: what the person pointed at

  [[nodiscard]] std::span<const Eigen::AlignedBox3d> boxes() const noexcept {
    return {boxes_W.data(), static_cast<std::size_t>(count)};
  }
  [[nodiscard]] bool contains(const Vec3& at_W) const noexcept;
  [[nodiscard]] Eigen::AlignedBox3d bounds() const noexcept;
};

// Of the readings where `mask` is not 0, seen from X_WC. `at`: a pixel of the mask. The boxes fit
// its readings, cut where readings beside the mask lie between them, and are widened by what poses
// and readings are wrong by, but not into what is beside it. Allocates; by an ordinary thread. No
// boxes: hardly anything of the mask was measured.
[[nodiscard]] GivenObject boxes_of(const FrameView& frame, ImageView<const std::uint8_t> mask,
                                   const Pose& X_WC, const Click& at);

}  // namespace perception
