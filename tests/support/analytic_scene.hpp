// Planes and boxes with exact ray casts: closed-form depth images and vertex/normal maps for tests
// of tracking and mapping. Header only, double precision, slow, shares no code with the product.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/random.hpp"

namespace tests {

using perception::Intrinsics;
using perception::Mat3;
using perception::Pose;
using perception::Vec3;

struct Hit {
  double t = std::numeric_limits<double>::infinity();
  Vec3 normal_W = Vec3::Zero();
};

struct AnalyticScene {
  struct Plane {
    Vec3 point, normal;  // seen from the side the normal points to
  };
  struct Box {
    Pose X_WS;
    Vec3 half;
  };
  std::vector<Plane> planes;
  std::vector<Box> boxes;

  [[nodiscard]] Hit cast(const Vec3& o, const Vec3& d) const;
};

// All rays of an image begin at one point: what depends on it alone is computed once.
class RaysFrom {
 public:
  RaysFrom(const AnalyticScene& scene, const Vec3& o) {
    for (const auto& p : scene.planes) planes_.push_back({p.normal, p.normal.dot(p.point - o)});
    for (const auto& b : scene.boxes) {
      const Pose X_SW = b.X_WS.inverse();
      // Of the ball about it, a little larger: most rays miss that, and need no division to tell.
      const Vec3 to = b.X_WS.translation() - o;
      const double r = 1.001 * b.half.norm() + 1e-6;
      boxes_.push_back(
          {X_SW.linear(), X_SW * o, b.half, b.X_WS.linear(), to, to.squaredNorm() - r * r});
    }
  }

  [[nodiscard]] Hit cast(const Vec3& d) const {
    Hit best;
    for (const Plane& p : planes_) {
      const double s = p.normal.dot(d);
      if (s >= -1e-12) continue;
      const double t = p.reach / s;
      if (t > 1e-6 && t < best.t) best = {t, p.normal};
    }
    const double d2 = d.squaredNorm();
    for (const Box& b : boxes_) {
      const double along = b.to.dot(d);
      if (b.out2 > 0 && (along <= 0 || along * along < b.out2 * d2)) continue;
      meet(b, d, best);
    }
    return best;
  }

 private:
  struct Plane {
    Vec3 normal;
    double reach;
  };
  struct Box {
    Mat3 R_SW;
    Vec3 ol, half;
    Mat3 R_WS;
    Vec3 to;      // its middle, from where the rays begin
    double out2;  // > 0: they begin outside of its ball
  };

  static void meet(const Box& b, const Vec3& d, Hit& best) {
    const Vec3 dl = b.R_SW * d;
    double enter = -1e300, leave = 1e300;
    int axis = 0;
    for (int i = 0; i < 3; ++i) {
      if (std::abs(dl(i)) < 1e-15) {
        if (std::abs(b.ol(i)) > b.half(i)) leave = -1e300;
        continue;
      }
      double t0 = (-b.half(i) - b.ol(i)) / dl(i), t1 = (b.half(i) - b.ol(i)) / dl(i);
      if (t0 > t1) std::swap(t0, t1);
      if (t0 > enter) enter = t0, axis = i;
      leave = std::min(leave, t1);
    }
    if (enter < leave && enter > 1e-6 && enter < best.t) {
      Vec3 n = Vec3::Zero();
      n(axis) = dl(axis) > 0 ? -1 : 1;
      best = {enter, b.R_WS * n};
    }
  }

  std::vector<Plane> planes_;
  std::vector<Box> boxes_;
};

inline Hit AnalyticScene::cast(const Vec3& o, const Vec3& d) const {
  return RaysFrom(*this, o).cast(d);
}

// Floor z = 0, two walls, furniture: every direction of motion is constrained.
inline AnalyticScene test_room() {
  AnalyticScene s;
  s.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()},
              {Vec3(3.2, 0, 0), -Vec3::UnitX()},
              {Vec3(0, 1.6, 0), -Vec3::UnitY()},
              {Vec3(0, -1.7, 0), Vec3::UnitY()}};
  const auto box = [&](double x, double y, double z, double sx, double sy, double sz, double yaw) {
    Pose X = Pose::Identity();
    X.linear() = Eigen::AngleAxisd(yaw, Vec3::UnitZ()).toRotationMatrix();
    X.translation() = Vec3(x, y, z);
    s.boxes.push_back({X, Vec3(sx, sy, sz) / 2});
  };
  box(1.7, 0.5, 0.20, 0.4, 0.5, 0.40, 0.35);
  box(2.3, -0.6, 0.35, 0.5, 0.4, 0.70, -0.5);
  box(1.5, -0.9, 0.10, 0.3, 0.3, 0.20, 0.9);
  return s;
}

// Optical frame of a camera at `eye` looking at `target`, image upright against world z.
inline Pose look_at(const Vec3& eye, const Vec3& target) {
  const Vec3 z = (target - eye).normalized();
  const Vec3 x = z.cross(Vec3::UnitZ()).normalized();
  Pose X = Pose::Identity();
  X.linear().col(0) = x;
  X.linear().col(1) = z.cross(x);
  X.linear().col(2) = z;
  X.translation() = eye;
  return X;
}

inline Intrinsics small_camera() { return {182.5, 182.5, 127.5, 105.5, 256, 212}; }
inline Intrinsics kinect2_camera() { return {365, 365, 255.5, 211.5, 512, 424}; }

// Depth in metres, row-major, 0 = none.
inline std::vector<double> cast_depth(const AnalyticScene& scene, const Intrinsics& k,
                                      const Pose& X_WC) {
  std::vector<double> z(static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height),
                        0.0);
  const RaysFrom rays(scene, X_WC.translation());
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const Hit h = rays.cast(X_WC.linear() * k.unproject(u, v, 1.0));
      if (std::isfinite(h.t)) z[static_cast<std::size_t>(v * k.width + u)] = h.t;
    }
  }
  return z;
}

// Depth in mm with normal noise of sigma(z) = sigma_m (1 + z^2) / 2 on each reading.
inline std::vector<std::uint16_t> to_mm(const std::vector<double>& z, double sigma_m,
                                        rt::Random& random) {
  std::vector<std::uint16_t> mm(z.size(), 0);
  for (std::size_t i = 0; i < z.size(); ++i) {
    if (z[i] <= 0) continue;
    const double noise = sigma_m > 0 ? sigma_m * (1 + z[i] * z[i]) / 2 * random.normal() : 0;
    mm[i] = static_cast<std::uint16_t>(std::lround((z[i] + noise) * 1000));
  }
  return mm;
}

// Interleaved records (nx, ny, nz, depth) in the camera frame.
inline std::vector<float> cast_model(const AnalyticScene& scene, const Intrinsics& k,
                                     const Pose& X_WC) {
  std::vector<float> m(static_cast<std::size_t>(k.width * k.height) * 4, 0.0F);
  const RaysFrom rays(scene, X_WC.translation());
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const Vec3 ray_C = k.unproject(u, v, 1.0);
      const Hit h = rays.cast(X_WC.linear() * ray_C);
      if (!std::isfinite(h.t)) continue;
      const Vec3 n = X_WC.linear().transpose() * h.normal_W;
      float* r = m.data() + 4 * (static_cast<std::ptrdiff_t>(v) * k.width + u);
      for (int i = 0; i < 3; ++i) r[i] = static_cast<float>(n(i));
      r[3] = static_cast<float>(h.t);
    }
  }
  return m;
}

inline void fill_frame(const AnalyticScene& scene, const Intrinsics& k, const Pose& X_WC,
                       double sigma_m, rt::Random& random, perception::RgbdFrame& out) {
  const auto mm = to_mm(cast_depth(scene, k, X_WC), sigma_m, random);
  out.intrinsics = k;
  out.has_colour = true;
  for (std::size_t i = 0; i < mm.size(); ++i) {
    out.depth_mm[i] = mm[i];
    out.colour[i] = {static_cast<std::uint8_t>(mm[i] / 16), 120, 90};
  }
}

inline Pose random_motion(rt::Random& random, double translation_m, double rotation_rad) {
  const Vec3 axis = Vec3(random.normal(), random.normal(), random.normal()).normalized();
  const Vec3 dir = Vec3(random.normal(), random.normal(), random.normal()).normalized();
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(rotation_rad * random.uniform(), axis).toRotationMatrix();
  X.translation() = translation_m * random.uniform() * dir;
  return X;
}

}  // namespace tests
