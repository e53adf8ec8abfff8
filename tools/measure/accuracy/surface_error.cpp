#include "tools/measure/accuracy/surface_error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <set>
#include <unordered_map>

#include "rt/quantile.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kCell_m = 0.04, kNear_m = 0.4, kFar_m = 3.5, kCovered_m = 0.01, kStray_m = 0.01;
constexpr int kPixelStep = 8, kFrames = 5;

std::array<std::int64_t, 3> cell_of(const Vec3& p, double edge) {
  const auto at = [edge](double x) { return static_cast<std::int64_t>(std::floor(x / edge)); };
  return {at(p.x()), at(p.y()), at(p.z())};
}

std::uint64_t key_of(const std::array<std::int64_t, 3>& c) {
  constexpr std::int64_t kShift = 1 << 20;
  return static_cast<std::uint64_t>((c[0] + kShift) << 42 | (c[1] + kShift) << 21 |
                                    (c[2] + kShift));
}

bool sees(const drivers::World& world, const perception::Intrinsics& k, const Pose& X_WC,
          const Vec3& p_W) {
  const Vec3 p = X_WC.inverse(Eigen::Isometry) * p_W;
  if (p.z() < kNear_m || p.z() > kFar_m) return false;
  const Eigen::Vector2d px = k.project(p);
  if (!(px.x() >= 0 && px.y() >= 0 && px.x() <= k.width - 1 && px.y() <= k.height - 1)) {
    return false;
  }
  const Vec3 eye = X_WC.translation();
  const drivers::RayHit hit = world.ray_cast(eye, p_W - eye);
  return hit && hit.t > 1 - 1e-6;
}

}  // namespace

std::vector<Vec3> seen_surface(const drivers::World& world, const perception::Intrinsics& k,
                               std::span<const Pose> poses) {
  std::vector<Vec3> points;
  std::set<std::pair<int, std::uint64_t>> taken;
  for (const Pose& X_WC : poses) {
    for (int v = 0; v < k.height; v += kPixelStep) {
      for (int u = 0; u < k.width; u += kPixelStep) {
        const Vec3 ray = k.unproject(u, v, 1.0);
        const drivers::RayHit hit = world.ray_cast(X_WC.translation(), X_WC.linear() * ray);
        if (!hit || hit.t < kNear_m || hit.t > kFar_m) continue;
        const Vec3 p = X_WC * (hit.t * ray);
        if (taken.emplace(hit.shape, key_of(cell_of(p, kCell_m))).second) points.push_back(p);
      }
    }
  }
  std::erase_if(points, [&](const Vec3& p) {
    int frames = 0;
    for (const Pose& X_WC : poses) {
      frames += sees(world, k, X_WC, p) ? 1 : 0;
      if (frames == kFrames) return false;
    }
    return true;
  });
  return points;
}

SurfaceError surface_error(const perception::Mesh& mesh, const drivers::World& world,
                           std::span<const Vec3> seen_W) {
  SurfaceError e;
  e.vertices = mesh.vertices_W.size();
  std::vector<double> off;
  off.reserve(e.vertices);
  std::unordered_multimap<std::uint64_t, std::size_t> cells;
  double squares = 0;
  for (std::size_t i = 0; i < mesh.vertices_W.size(); ++i) {
    const Vec3 p = mesh.vertices_W[i].cast<double>();
    const double d = std::abs(world.signed_distance(p));
    squares += d * d;
    e.stray += d > kStray_m ? 1 : 0;
    off.push_back(d);
    cells.emplace(key_of(cell_of(p, kCovered_m)), i);
  }
  if (!off.empty()) {
    std::sort(off.begin(), off.end());
    e.median_mm = 1e3 * rt::quantile_of_sorted(std::span(off), 0.5);
    e.p95_mm = 1e3 * rt::quantile_of_sorted(std::span(off), 0.95);
    e.rmse_mm = 1e3 * std::sqrt(squares / static_cast<double>(off.size()));
    e.max_mm = 1e3 * off.back();
  }
  const auto covered = [&](const Vec3& p) {
    const auto c = cell_of(p, kCovered_m);
    for (int n = 0; n < 27; ++n) {
      const auto [from, to] =
          cells.equal_range(key_of({c[0] + n / 9 - 1, c[1] + n / 3 % 3 - 1, c[2] + n % 3 - 1}));
      for (auto it = from; it != to; ++it) {
        if ((mesh.vertices_W[it->second].cast<double>() - p).norm() <= kCovered_m) return true;
      }
    }
    return false;
  };
  if (!seen_W.empty()) {
    e.completeness = static_cast<double>(std::count_if(seen_W.begin(), seen_W.end(), covered)) /
                     static_cast<double>(seen_W.size());
  }
  return e;
}

}  // namespace teletact
