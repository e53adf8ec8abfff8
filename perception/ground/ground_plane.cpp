#include "perception/ground/ground_plane.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Eigenvalues>

#include "rt/random.hpp"

namespace perception {

void GroundPlaneConfig::describe(config::Section& s) {
  s.integer("draws", draws, 10, 5000, "RANSAC hypotheses a frame while none is found")
      .integer("frames", frames, 1, 100, "agreeing frames before the ground counts as found")
      .number("inlier_m", inlier_m, 0.001, 0.2, "distance that supports a hypothesis, at range 0")
      .number("inlier_per_m2", inlier_per_m2, 0, 0.1, "and its growth with range squared")
      .number("min_share", min_share, 0.001, 1, "of all points, on the plane")
      .number("max_below_share", max_below_share, 0, 1, "of all points, below the plane")
      .number("up_tolerance_deg", up_tolerance_deg, 0.5, 89, "with a known up direction")
      .number("up_tolerance_blind_deg", up_tolerance_blind_deg, 0.5, 89, "without one")
      .number("min_camera_height_m", min_camera_height_m, 0.01, 10,
              "of the camera above the ground")
      .number("max_camera_height_m", max_camera_height_m, 0.02, 50,
              "of the camera above the ground")
      .number("height_tolerance_m", height_tolerance_m, 0.005, 5, "with a known camera height")
      .seed("seed", seed, "of the hypotheses");
}

namespace {

struct Search {
  std::span<const Vec3f> points;
  Vec3 camera;
  const GroundHint& hint;
  const GroundPlaneConfig& config;

  [[nodiscard]] double gate(const Vec3& p) const noexcept {
    return config.inlier_m + config.inlier_per_m2 * (p - camera).squaredNorm();
  }
  // Could this be ground, whatever the points say?
  [[nodiscard]] bool plausible(const GroundPlane& plane) const noexcept {
    const double tolerance =
        hint.up_known ? config.up_tolerance_deg : config.up_tolerance_blind_deg;
    if (plane.normal.dot(hint.up) < std::cos(tolerance * std::numbers::pi / 180)) return false;
    const double height = plane.height(camera);
    if (hint.camera_height_m) {
      return std::abs(height - *hint.camera_height_m) <= config.height_tolerance_m;
    }
    return height >= config.min_camera_height_m && height <= config.max_camera_height_m;
  }
  // Support of a hypothesis, on every `stride`-th point.
  void support(GroundPlane& plane, std::size_t stride) const noexcept {
    int on = 0, below = 0, all = 0;
    double sum2 = 0;
    for (std::size_t i = 0; i < points.size(); i += stride) {
      const Vec3 p = points[i].cast<double>();
      const double h = plane.height(p), g = gate(p);
      ++all;
      if (std::abs(h) <= g) ++on, sum2 += h * h;
      if (h < -3 * g) ++below;
    }
    plane.inliers = on;
    plane.share = all > 0 ? static_cast<double>(on) / all : 0;
    plane.below = all > 0 ? static_cast<double>(below) / all : 0;
    plane.rms_m = on > 0 ? std::sqrt(sum2 / on) : 0;
  }
  // Least squares through the points within `width` gates, twice smoothed by Tukey's weight.
  [[nodiscard]] bool refine(GroundPlane& plane, double width) const noexcept {
    Vec3 mean = Vec3::Zero();
    Mat3 moment = Mat3::Zero();
    double weight = 0;
    for (const Vec3f& f : points) {
      const Vec3 p = f.cast<double>();
      const double t = plane.height(p) / (width * gate(p));
      if (std::abs(t) >= 1) continue;
      const double k = (1 - t * t) * (1 - t * t);
      const double g = gate(p) / config.inlier_m;
      const double w = k / (g * g);
      mean += w * p;
      moment += w * p * p.transpose();
      weight += w;
    }
    if (!(weight > 0)) return false;
    mean /= weight;
    const Eigen::SelfAdjointEigenSolver<Mat3> solver(moment / weight - mean * mean.transpose());
    // A line of points fixes no plane.
    if (!(solver.eigenvalues()(1) > 1e-4)) return false;
    plane.normal = solver.eigenvectors().col(0).normalized();
    if (plane.normal.dot(hint.up) < 0) plane.normal = -plane.normal;
    plane.offset = plane.normal.dot(mean);
    return plane.normal.allFinite() && std::isfinite(plane.offset);
  }
};

}  // namespace

std::optional<GroundPlane> find_ground(std::span<const Vec3f> points, const Vec3& camera,
                                       const GroundHint& hint, const GroundPlaneConfig& config,
                                       std::uint64_t stream) noexcept {
  if (points.size() < 50 || points.size() > (1U << 20U)) return std::nullopt;
  const Search search{points, camera, hint, config};
  rt::Random random(config.seed, stream);
  const auto last = static_cast<std::int64_t>(points.size()) - 1;
  const std::size_t stride = std::max<std::size_t>(1, points.size() / 1500);
  GroundPlane best;
  double best_score = 0;
  for (int draw = 0; draw < config.draws; ++draw) {
    const auto pick = [&] {
      return Vec3(points[static_cast<std::size_t>(random.integer(0, last))].cast<double>());
    };
    const Vec3 a = pick(), b = pick(), c = pick();
    GroundPlane plane;
    const Vec3 n = (b - a).cross(c - a);
    if (!(n.norm() > 1e-4)) continue;
    plane.normal = n.normalized();
    if (plane.normal.dot(hint.up) < 0) plane.normal = -plane.normal;
    plane.offset = plane.normal.dot(a);
    if (!search.plausible(plane)) continue;
    search.support(plane, stride);
    // What lies below argues against: the ground is the lowest large plane.
    const double score = plane.share - 2 * plane.below;
    if (score > best_score) best = plane, best_score = score;
  }
  if (best_score <= 0) return std::nullopt;
  for (const double width : {3.0, 2.0, 1.5, 1.5}) {
    if (!search.refine(best, width)) return std::nullopt;
  }
  search.support(best, 1);
  if (!search.plausible(best) || best.share < config.min_share ||
      best.below > config.max_below_share) {
    return std::nullopt;
  }
  return best;
}

}  // namespace perception
