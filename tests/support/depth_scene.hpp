// A room as a depth camera sees it, with and without the sensor's noise: floor, walls, boxes and a
// ball, cast ray by ray. For tests of codecs: small, and without a world or a camera driver.
//
// W: z up; the camera stands 1 m above the floor and looks 30 degrees down. Noise: axial, the
// Kinect v2's sigma(z); lateral, the ray of a pixel goes beside it; dropout, no reading beside an
// edge.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "rt/random.hpp"

namespace test_support {

struct DepthSceneNoise {
  double axial = 1;       // times sigma(z)
  double lateral_px = 0;  // sigma
  double dropout = 0.3;   // share of the pixels beside an edge
};

class DepthScene {
 public:
  using Image = std::vector<std::uint16_t>;  // mm along the optical axis, row-major; 0 = no reading
  DepthScene(int width, int height) : width_(width), height_(height), truth_(pixels()) {}

  [[nodiscard]] std::size_t pixels() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }
  // The camera goes 0.3 m/s and turns; time 0 and a constant time are a camera at rest.
  void look(double t_s) {
    yaw_ = 0.3 * std::sin(0.8 * t_s);
    eye_ = {0.3 * t_s, 0.1 * std::sin(t_s), 1.0};
    for (int v = 0; v < height_; ++v)
      for (int u = 0; u < width_; ++u) truth_[index(u, v)] = cast(u, v);
    edge_.assign(pixels(), false);
    for (int v = 1; v + 1 < height_; ++v) {
      for (int u = 1; u + 1 < width_; ++u) {
        const double z = truth_[index(u, v)];
        if (z == 0) continue;
        const auto bend = [&](std::size_t a, std::size_t b) {
          return truth_[a] == 0 || truth_[b] == 0
                     ? 1
                     : z * std::abs(1 / truth_[a] + 1 / truth_[b] - 2 / z);
        };
        edge_[index(u, v)] = bend(index(u - 1, v), index(u + 1, v)) > 0.04 ||
                             bend(index(u, v - 1), index(u, v + 1)) > 0.04;
      }
    }
  }
  // Without noise, m.
  [[nodiscard]] const std::vector<double>& truth_m() const { return truth_; }
  [[nodiscard]] bool edge(std::size_t i) const { return edge_[i]; }

  [[nodiscard]] Image image(const DepthSceneNoise& noise, std::uint64_t seed,
                            std::uint64_t frame) const {
    rt::Random random(seed, frame);
    Image out(pixels());
    for (int v = 0; v < height_; ++v) {
      for (int u = 0; u < width_; ++u) {
        const std::size_t i = index(u, v);
        double z = truth_[i];
        if (noise.lateral_px > 0) {
          z = cast(u + noise.lateral_px * random.normal(), v + noise.lateral_px * random.normal());
        }
        if (z == 0 || (edge_[i] && random.uniform() < noise.dropout)) continue;
        z += noise.axial * sigma_m(z) * random.normal();
        out[i] = static_cast<std::uint16_t>(std::clamp(z * 1000 + 0.5, 1.0, 65535.0));
      }
    }
    return out;
  }
  [[nodiscard]] static double sigma_m(double z_m) {
    return std::max(1.2, 1.5 - 0.5 * z_m + 0.3 * z_m * z_m) * 1e-3;
  }

 private:
  using Point = std::array<double, 3>;
  struct Box {
    Point low, high;
  };
  [[nodiscard]] std::size_t index(int u, int v) const {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(u);
  }
  [[nodiscard]] double cast(double u, double v) const {
    const double f = 365.0 * width_ / 512;
    const double right = (u - width_ / 2.0 + 0.5) / f, down = (v - height_ / 2.0 + 0.5) / f;
    constexpr double kSin = 0.5, kCos = 0.8660254037844386;  // 30 degrees down
    const double ahead = kCos - kSin * down, rise = -kSin - kCos * down;
    const Point d{std::cos(yaw_) * ahead + std::sin(yaw_) * right,
                  std::sin(yaw_) * ahead - std::cos(yaw_) * right, rise};
    double best = 5.0;  // range; d is scaled so that the parameter is the depth
    const auto plane = [&](std::size_t axis, double at) {
      const double t = (at - eye_[axis]) / d[axis];
      if (t > 0.4 && t < best) best = t;
    };
    plane(2, 0.0), plane(0, 4.2), plane(1, 1.6), plane(1, -2.0);
    for (const Box& b : kBoxes) {
      double in = 0, out = 1e9;
      for (std::size_t a = 0; a < 3; ++a) {
        const double t0 = (b.low[a] - eye_[a]) / d[a], t1 = (b.high[a] - eye_[a]) / d[a];
        in = std::max(in, std::min(t0, t1));
        out = std::min(out, std::max(t0, t1));
      }
      if (in < out && in > 0.4 && in < best) best = in;
    }
    const Point o{eye_[0] - 1.3, eye_[1] + 0.3, eye_[2] - 0.25};  // from the ball's middle
    const double dd = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    const double od = o[0] * d[0] + o[1] * d[1] + o[2] * d[2];
    const double oo = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - 0.25 * 0.25;
    if (const double root = od * od - dd * oo; root > 0) {
      const double t = (-od - std::sqrt(root)) / dd;
      if (t > 0.4 && t < best) best = t;
    }
    return best < 5.0 ? best : 0;
  }

  static constexpr std::array<Box, 4> kBoxes{
      Box{{1.6, 0.2, 0.0}, {2.2, 0.8, 0.7}}, Box{{2.4, -1.2, 0.0}, {2.8, -0.5, 1.1}},
      Box{{0.9, 0.3, 0.0}, {1.1, 0.5, 0.3}}, Box{{2.0, -0.35, 0.0}, {2.05, -0.3, 1.5}}};
  int width_, height_;
  double yaw_ = 0;
  Point eye_{0, 0, 1.0};
  std::vector<double> truth_;
  std::vector<bool> edge_;
};

}  // namespace test_support
