// Statistics for follow.hpp: the standard error of a mean of readings, whether only a part of a
// block's nodes has moved, and the small camera motion that most of the image agrees on. Metres
// along rays.
#pragma once

#include <cstddef>
#include <span>

#include "perception/geometry/pose.hpp"
#include "perception/tsdf/blocks/block_past.hpp"
#include "perception/tsdf/follow/follow_scratch.hpp"

namespace perception::follow {

using Row = Eigen::Matrix<double, 6, 1>;

// chosen on: follow 1000; judged on: follow 2000
inline constexpr double kLeast_m = 0.8e-3, kErrors = 5;  // least motion; and in standard errors
inline constexpr double kFewReadings = 5;                // with fewer a block is not judged
inline constexpr std::size_t kFewNodes = 24, kFewTiles = 12;  // with fewer nothing is judged
// Nodes of one moving surface agree: their scatter is at most this many times their noise, plus
// this share of the distance moved, since the surface may tilt.
inline constexpr double kAgree = 2, kTilt = 0.3;
inline constexpr double kAcross = 0.25;  // of them may be off to the other side

[[nodiscard]] inline Vec3 wide(const float* v) noexcept {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}

// Of a Kinect v2's reading along the axis.
[[nodiscard]] double sigma_m(double z) noexcept;

struct Middle {
  double value, scatter;  // median; from the median distance to it
};
// Orders v; room: as long.
[[nodiscard]] Middle middle_of(std::span<double> v, std::span<double> room) noexcept;
// If some nodes are at rest and the others moved to one side: puts those that moved first, `count`
// of them. False: no two such groups.
[[nodiscard]] bool apart_from_standing(std::span<double> offs, std::span<double> room, double noise,
                                       std::size_t& count, Middle& moved) noexcept;

// Standard error of a mean, m: from the scatter of its values, at least the sensor's noise.
[[nodiscard]] double standard_error(double count, double sum, double squares, double z_m) noexcept;
[[nodiscard]] double threshold_m(double error_m) noexcept;
[[nodiscard]] bool stands_out(const OffsetSums& s, float z_m, double doubt_m) noexcept;

// The small motion of the camera that most of the image agrees on.
struct CommonMotion {
  Row twist = Row::Zero();
  Vec3 about = Vec3::Zero();
  double radius = 1;
  double scatter = 0;  // of the tiles about it, in units of each one's own threshold
  bool told = false;
  [[nodiscard]] Row row(const Vec3& slope, const Vec3& at) const noexcept {
    Row out;
    out << slope, (at - about).cross(slope) / radius;
    return out;
  }
};
// Robust fit with Tukey's weights from a start with equal weights: moving things have no influence
// while they are a minority.
void fit(std::span<const FollowScratch::Tile> tiles, std::span<double> room,
         CommonMotion& out) noexcept;

}  // namespace perception::follow
