// The ground: a robust plane through the points of the first frames, then tracked.
//
// Found by RANSAC (Fischler and Bolles 1981) with our own seeded generator, a fixed number of
// draws, then refined by truncated least squares. Deterministic; fp64 sums in a fixed order.
//
// A plane is accepted as ground when its normal is within up_tolerance_deg of the expected up
// direction, the camera stands above it at the expected height, enough points lie on it, and few
// lie below it (the ground is the lowest large plane: a table top is not). The up direction and the
// height of the camera are optional knowledge; without them up is -y of the first camera (the image
// is upright) with a wide tolerance.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "config/schema.hpp"
#include "perception/geometry/pose.hpp"

namespace perception {

struct GroundPlaneConfig {
  int draws = 200;                     // RANSAC hypotheses a frame while none is found
  int frames = 3;                      // agreeing frames before the ground counts as found
  double inlier_m = 0.02;              // distance that supports a hypothesis, at 1 m range ...
  double inlier_per_m2 = 0.004;        // ... plus this much per range squared
  double min_share = 0.08;             // of all points, on the plane
  double max_below_share = 0.05;       // of all points, more than 3 inlier distances below it
  double up_tolerance_deg = 12;        // with a known up direction
  double up_tolerance_blind_deg = 50;  // without
  double min_camera_height_m = 0.2, max_camera_height_m = 2.5;
  double height_tolerance_m = 0.15;  // with a known camera height
  std::uint64_t seed = 1;
  void describe(config::Section& s);
};

// Unit normal (up, against gravity) and offset: normal . p = offset, in the frame of the points.
struct GroundPlane {
  Vec3 normal = Vec3::UnitZ();
  double offset = 0;
  double rms_m = 0;  // of the inliers
  int inliers = 0;
  double share = 0;  // inliers / points
  double below = 0;  // share of points below
  [[nodiscard]] double height(const Vec3& p) const noexcept { return normal.dot(p) - offset; }
};

struct GroundHint {
  Vec3 up = Vec3::UnitZ();  // unit, in the frame of the points
  bool up_known = false;
  std::optional<double> camera_height_m;
};

// One search in `points` (any frame); `camera` is the camera's position in it, `stream` numbers the
// search (same points, hint and stream: same plane). Empty when nothing passes. At most 2^20
// points.
[[nodiscard]] std::optional<GroundPlane> find_ground(std::span<const Vec3f> points,
                                                     const Vec3& camera, const GroundHint& hint,
                                                     const GroundPlaneConfig& config,
                                                     std::uint64_t stream) noexcept;

}  // namespace perception
