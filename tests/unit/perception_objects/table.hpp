// A table with boxes of known label, seen by a hand-carried camera: images, true masks, true poses.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <tuple>
#include <vector>

#include "perception/objects/object_map.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "rt/random.hpp"

namespace tests {

using namespace perception;  // NOLINT: a test-only header

constexpr int kW = 320, kH = 240;
inline const Intrinsics kCamera{280, 280, 159.5, 119.5, kW, kH};

struct Solid {
  Vec3 low, high;
  Rgb colour;
};

struct Rendered {
  Image<Rgb> rgb{kW, kH};
  Image<std::uint16_t> depth{kW, kH};
  Image<std::uint8_t> truth{kW, kH};  // 0 table, else solid + 1
  Image<double> z{kW, kH};            // true depth, m
  [[nodiscard]] FrameView view() const { return {kCamera, depth.view(), rgb.view()}; }
};

inline double hit_of(const Solid& s, const Vec3& o, const Vec3& d) {
  double t0 = 0, t1 = 1e9;
  for (int k = 0; k < 3; ++k) {
    const double a = (s.low(k) - o(k)) / d(k), b = (s.high(k) - o(k)) / d(k);
    t0 = std::max(t0, std::min(a, b));
    t1 = std::min(t1, std::max(a, b));
  }
  return t0 < t1 ? t0 : 1e9;
}

inline double depth_of(const std::vector<Solid>& solids, const Vec3& eye, const Vec3& d) {
  double t = d.z() < 0 ? -eye.z() / d.z() : 1e9;
  if (d.y() > 0) t = std::min(t, (1.0 - eye.y()) / d.y());
  for (const Solid& s : solids) t = std::min(t, hit_of(s, eye, d));
  return t;
}

// Depth noise at 1 m, growing with z^2; how far the ray of a reading is off (standard deviations);
// share of pixels without one.
struct Noise {
  double depth_mm = 2, lateral_px = 0.5, holes = 0.02;
};

// Table z = 0, a wall behind it; colours are uncertain by 12 steps.
inline void render(const std::vector<Solid>& solids, const Pose& X_WC, const Noise& noise,
                   rt::Random& random, Rendered& out) {
  const Vec3 eye = X_WC.translation();
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) {
      const Vec3 d = X_WC.linear() * kCamera.unproject(u, v, 1.0);
      double t = d.z() < 0 ? -eye.z() / d.z() : 1e9;
      const double wall = d.y() > 0 ? (1.0 - eye.y()) / d.y() : 1e9;
      Rgb c{170, 150, 120};
      if (wall < t) t = wall, c = {120, 120, 125};
      int what = 0;
      for (std::size_t k = 0; k < solids.size(); ++k) {
        const double h = hit_of(solids[k], eye, d);
        if (h < t) t = h, what = static_cast<int>(k) + 1, c = solids[k].colour;
      }
      out.truth.at(u, v) = static_cast<std::uint8_t>(what);
      out.z.at(u, v) = t;
      const auto n = [&](int value) {
        return static_cast<std::uint8_t>(
            std::clamp(value + random.integer(-12, 12), std::int64_t{0}, std::int64_t{255}));
      };
      const Vec3 off =
          X_WC.linear() * kCamera.unproject(u + noise.lateral_px * random.normal(),
                                            v + noise.lateral_px * random.normal(), 1.0);
      t = depth_of(solids, eye, off);
      out.rgb.at(u, v) = {n(c.r), n(c.g), n(c.b)};
      const bool none = t > 4 || random.uniform() < noise.holes;
      out.depth.at(u, v) = static_cast<std::uint16_t>(
          none ? 0 : 1000 * t + noise.depth_mm * t * t * random.normal() + 0.5);
    }
  }
}

// Camera carried about the table: 12 mm and 1 degree a frame at most.
inline Pose carried(int n) {
  const double a = 0.45 * std::sin(0.03 * n);
  const Vec3 eye(0.8 * std::sin(a), -0.8 * std::cos(a) + 0.05, 0.55 + 0.1 * std::sin(0.05 * n));
  const Vec3 z = (Vec3(0, 0.05, 0.03) - eye).normalized(), x = z.cross(Vec3::UnitZ()).normalized();
  Pose X = Pose::Identity();
  X.linear() << x, z.cross(x), z;
  X.translation() = eye;
  return X;
}

inline const std::vector<Solid> kTable{{{-0.22, -0.05, 0}, {-0.08, 0.04, 0.12}, {40, 80, 170}},
                                       {{0.02, -0.1, 0}, {0.09, -0.03, 0.10}, {180, 40, 40}},
                                       {{0.10, 0.15, 0}, {0.26, 0.22, 0.18}, {60, 150, 60}}};

using Voxels = std::set<std::tuple<int, int, int>>;

struct Rig {
  rt::Startup startup;
  TsdfMap map;
  ObjectMap objects;
  RaycastMaps maps;
  Rendered image;
  Noise noise;
  Pose X_WC = Pose::Identity();

  static TsdfConfig map_config() {
    TsdfConfig c;
    c.voxel_size_m = 0.01;
    c.max_blocks = 6000;
    c.max_chunks = 256;
    c.max_label_blocks = 512;
    return c;
  }
  static ObjectsConfig on() {
    ObjectsConfig c;
    c.enabled = true;
    return c;
  }
  Rig()
      : map(startup.token(), map_config()),
        objects(startup.token(), kW, kH, on()),
        maps(startup.token(), kW, kH) {}

  void look(const std::vector<Solid>& solids, int n, std::uint64_t seed) {
    rt::Random random(seed, static_cast<std::uint64_t>(n));
    X_WC = carried(n);
    render(solids, X_WC, noise, random, image);
    map.integrate(image.view(), X_WC, 1);
  }
  // A point on the surface of solid `what` that the image shows, near the middle of what it shows
  // of it.
  [[nodiscard]] Vec3 surface_point(int what) const {
    double su = 0, sv = 0, m = 0;
    for (int v = 0; v < kH; ++v)
      for (int u = 0; u < kW; ++u)
        if (image.truth.at(u, v) == what) su += u, sv += v, m += 1;
    const int u = static_cast<int>(su / m), v = static_cast<int>(sv / m);
    return X_WC * kCamera.unproject(u, v, image.z.at(u, v));
  }
  [[nodiscard]] double frame_iou(int what, std::uint8_t id) {
    return iou(what, id, objects.label_image());
  }
  // Of the labels cast from the map into the present view.
  [[nodiscard]] double fused_iou(int what, std::uint8_t id) {
    RaycastOptions o;
    o.labels = true;
    raycast(map, kCamera, X_WC, o, maps);
    return iou(what, id, maps.labels());
  }
  // Of the map's labels at the true surface points of the present view.
  [[nodiscard]] double read_iou(int what, std::uint8_t id) {
    MapReader reader(map);
    Image<std::uint8_t> labels(kW, kH);
    for (int v = 0; v < kH; ++v)
      for (int u = 0; u < kW; ++u)
        labels.at(u, v) = reader.label(X_WC * kCamera.unproject(u, v, image.z.at(u, v)));
    return iou(what, id, labels.view());
  }
  [[nodiscard]] double iou(int what, std::uint8_t id, ImageView<const std::uint8_t> labels) const {
    double both = 0, either = 0;
    for (int v = 0; v < kH; ++v)
      for (int u = 0; u < kW; ++u) {
        const bool a = labels.at(u, v) == id, b = image.truth.at(u, v) == what;
        both += a && b ? 1 : 0;
        either += a || b ? 1 : 0;
      }
    return both / either;
  }
  // All voxels with the label, or those within `near_m` of the stored surface.
  [[nodiscard]] Voxels voxels(std::uint8_t id, double near_m = 1) const {
    Voxels out;
    map.for_each_label_block([&](std::int32_t b, std::uint32_t) {
      const BlockCoord at = map.block_coord(b);
      for (int n = 0; n < 512; ++n) {
        const std::uint32_t w = map.block_words(b)[n];
        if (map.block_labels(b)[n].label == id &&
            std::abs(TsdfMap::word_distance(w)) * static_cast<double>(map.metres_per_unit()) <=
                near_m)
          out.insert({8 * at.x + (n >> 6), 8 * at.y + ((n >> 3) & 7), 8 * at.z + (n & 7)});
      }
    });
    return out;
  }
};

// Share of `a`'s voxels by which b differs from it.
inline double change(const Voxels& a, const Voxels& b) {
  double same = 0;
  for (const auto& v : a) same += b.count(v) != 0 ? 1 : 0;
  return (static_cast<double>(a.size() + b.size()) - 2 * same) / static_cast<double>(a.size());
}

}  // namespace tests
