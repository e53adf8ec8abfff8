// Closed-form scenes for the tests of mapping: exact rays, exact distances. Slow and plain.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "perception/tsdf/tsdf_map.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "rt/random.hpp"

namespace tests {

using namespace perception;  // NOLINT: a test-only header

// Union of half-spaces, spheres and axis-aligned boxes.
struct Scene {
  struct Plane {
    Vec3 point, normal;
  };  // solid behind the normal
  struct Sphere {
    Vec3 centre;
    double radius;
  };
  struct Box {
    Vec3 lo, hi;
  };
  std::vector<Plane> planes;
  std::vector<Sphere> spheres;
  std::vector<Box> boxes;

  struct Hit {
    double t = std::numeric_limits<double>::infinity();
    Vec3 normal = Vec3::Zero();
  };

  // First surface of o + t d, t > 0, entered from outside.
  [[nodiscard]] Hit cast(const Vec3& o, const Vec3& d) const {
    Hit best;
    for (const Plane& p : planes) {
      const double s = p.normal.dot(d);
      if (s >= 0) continue;
      const double t = p.normal.dot(p.point - o) / s;
      if (t > 0 && t < best.t) best = {t, p.normal};
    }
    for (const Sphere& s : spheres) {
      const Vec3 m = o - s.centre;
      const double a = d.squaredNorm(), b = m.dot(d), c = m.squaredNorm() - s.radius * s.radius;
      const double disc = b * b - a * c;
      if (disc < 0) continue;
      const double t = (-b - std::sqrt(disc)) / a;
      if (t > 0 && t < best.t) best = {t, (m + t * d) / s.radius};
    }
    for (const Box& b : boxes) {
      double in = -1e300, out = 1e300;
      int axis = 0;
      for (int a = 0; a < 3; ++a) {
        const double t0 = (b.lo(a) - o(a)) / d(a), t1 = (b.hi(a) - o(a)) / d(a);
        if (std::min(t0, t1) > in) in = std::min(t0, t1), axis = a;
        out = std::min(out, std::max(t0, t1));
      }
      if (in < out && in > 0 && in < best.t)
        best = {in, d(axis) > 0 ? Vec3(-Vec3::Unit(axis)) : Vec3(Vec3::Unit(axis))};
    }
    return best;
  }

  // Signed distance to the union, exact outside.
  [[nodiscard]] double distance(const Vec3& p) const {
    double best = 1e300;
    for (const Plane& q : planes) best = std::min(best, q.normal.dot(p - q.point));
    for (const Sphere& s : spheres) best = std::min(best, (p - s.centre).norm() - s.radius);
    for (const Box& b : boxes) {
      const Vec3 q = (p - 0.5 * (b.lo + b.hi)).cwiseAbs() - 0.5 * (b.hi - b.lo);
      best = std::min(best, q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0));
    }
    return best;
  }
};

// Camera at `eye` looking at `target`; image y goes against world z.
inline Pose look_at(const Vec3& eye, const Vec3& target) {
  const Vec3 z = (target - eye).normalized();
  const Vec3 x = z.cross(Vec3::UnitZ()).normalized();
  Pose X = Pose::Identity();
  X.linear() << x, z.cross(x), z;
  X.translation() = eye;
  return X;
}

struct Frame {
  Intrinsics k;
  Image<std::uint16_t> depth;
  Image<Rgb> colour;
  [[nodiscard]] FrameView view(bool with_colour = false) const {
    return {k, depth.view(), with_colour ? colour.view() : ImageView<const Rgb>{}};
  }
};

// Depth rounded to mm; noise: standard deviation at 1 m, growing with z^2; holes: share of no
// reading.
inline Frame render(const Scene& scene, const Intrinsics& k, const Pose& X_WC, double noise_m = 0,
                    double holes = 0, rt::Random random = rt::Random(1)) {
  Frame f{k, Image<std::uint16_t>(k.width, k.height), Image<Rgb>(k.width, k.height)};
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u) {
      const auto hit = scene.cast(X_WC.translation(), X_WC.linear() * k.unproject(u, v, 1.0));
      if (!std::isfinite(hit.t) || hit.t > 20) continue;
      double z = hit.t;
      if (noise_m > 0) z += noise_m * z * z * random.normal();
      if (holes > 0 && random.uniform() < holes) continue;
      f.depth.at(u, v) = static_cast<std::uint16_t>(std::lround(z * 1000));
      const auto shade = [](double n) {
        return static_cast<std::uint8_t>(std::lround(128 + 100 * n));
      };
      f.colour.at(u, v) = {shade(hit.normal.x()), shade(hit.normal.y()), shade(hit.normal.z())};
    }
  return f;
}

inline Intrinsics kinect2() { return {365, 365, 255.5, 211.5, 512, 424}; }
inline Intrinsics small_camera() { return {91.25, 91.25, 63.5, 52.5, 128, 106}; }

// A room 5 x 4 x 2.5 m about the origin, seen from inside, with a sphere and two boxes.
inline Scene room() {
  Scene s;
  s.planes = {{{0, 0, 0}, Vec3::UnitZ()},    {{0, 0, 2.5}, -Vec3::UnitZ()},
              {{2.5, 0, 0}, -Vec3::UnitX()}, {{-2.5, 0, 0}, Vec3::UnitX()},
              {{0, 2, 0}, -Vec3::UnitY()},   {{0, -2, 0}, Vec3::UnitY()}};
  s.spheres = {{{1.2, 0.3, 0.9}, 0.3}};
  s.boxes = {{{0.6, -1.0, 0.0}, {1.1, -0.4, 0.6}}, {{1.6, 0.9, 0.0}, {2.1, 1.5, 1.1}}};
  return s;
}

inline double thread_cpu_ms() { return 1e-6 * static_cast<double>(rt::thread_cpu_ns()); }

inline double quantile(const std::vector<double>& v, double q) { return rt::quantile_or_nan(v, q); }

inline TsdfConfig small_map(double voxel = 0.02) {
  TsdfConfig c;
  c.voxel_size_m = voxel;
  c.max_blocks = 8192;
  c.max_chunks = 512;
  return c;
}

// A sphere and a box before a wall, all inside [-0.64, 0.64]^3, seen from about 1.2 m.
inline Scene table_top() {
  Scene s;
  s.planes = {{{0.45, 0, 0}, -Vec3::UnitX()}};
  s.spheres = {{{0.05, 0.15, 0.1}, 0.15}};
  s.boxes = {{{0.0, -0.35, -0.3}, {0.2, -0.12, 0.0}}};
  return s;
}

inline Pose around(int n) {
  const double a = 0.35 * std::sin(0.9 * n), b = 0.3 * std::cos(0.7 * n);
  return look_at(Vec3(-0.95 * std::cos(a), 0.95 * std::sin(a), b), Vec3(0.1, 0, 0));
}

}  // namespace tests
