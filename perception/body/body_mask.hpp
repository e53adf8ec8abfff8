// Marks the pixels of a depth image that show the robot's own body, from its joint angles
// (docs/body.md).
//
// rule    A pixel is body if its reading lies at or behind the front of a padded capsule on its
//         ray, or if it has no reading and its ray meets one. A reading before the padded front
//         stays: it is a thing before the arm. Flying pixels behind the arm's outline lie behind
//         the padded front and go.
// pad     m, for a capsule whose axis reaches to depth z:
//           the displacement by the joints' errors (ArticulatedBody::reach_of_error)
//           + pad_px z / f + sigmas * sigma(z) + pad_m,
//           sigma(z) = noise_m + noise_per_m2 (z - noise_from_m)^2
//         If a point of the body is displaced by no more than the pad in any direction, the padded
//         capsule still contains it, so its reading lies at or behind the padded front.
// cost    only rows of the padded capsules' outlines; the rest of the image is not read.
//
// If the lens is inside a padded capsule, every pixel is body.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/articulated_body.hpp"
#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/motion/motion_mask.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct BodyPadding {
  double pad_px = 2, sigmas = 3, pad_m = 0;
  double noise_m = 0.0015, noise_per_m2 = 0.004, noise_from_m = 0.8;  // of a reading, 1 sigma
};

// The pad of a capsule in C whose points may be off by `error_m`.
[[nodiscard]] double pad_of(const Capsule& c_C, double error_m, const BodyPadding& padding,
                            const Intrinsics& camera) noexcept;

class BodyMask {
 public:
  static constexpr int kMost = 56;  // capsules
  BodyMask(rt::NonRealtime&, int max_width, int max_height);

  // Sets kBody in `mask` and 0 in `depth_mm` where a pixel is body. Both have the camera's size.
  // Capsules in C with padded radii; only the first kMost are used. Pixels that the last call set
  // in `mask` and this one does not become kPlace again. Returns the number of body pixels.
  int mark(std::span<const Capsule> padded_C, const Intrinsics& camera,
           ImageView<std::uint16_t> depth_mm, ImageView<std::uint8_t> mask) noexcept;
  // Of the last call: rays tried. Deterministic.
  [[nodiscard]] std::uint64_t work() const noexcept { return work_; }

 private:
  struct Outline {  // a capsule's, in pixels: which columns of which rows
    int v0 = 0, v1 = -1;
  };
  void outline(std::size_t n, const Capsule& c, const Intrinsics& k) noexcept;
  void widen(std::size_t n, int v0, int v1, int u0, int u1) noexcept;

  int height_;
  std::vector<Outline> outlines_;      // a capsule
  std::vector<std::int16_t> lo_, hi_;  // kMost rows of max_height: columns of a capsule's row
  std::vector<std::int16_t> set_lo_, set_hi_;  // a row: columns that the last call looked at
  int set_v0_ = 0, set_v1_ = -1;
  std::vector<float> front_, x_;  // a row
  std::uint64_t work_ = 0;
};

}  // namespace perception
