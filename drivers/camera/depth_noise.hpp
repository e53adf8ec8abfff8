// Depth noise of a Kinect v2, as four effects. Section [camera.noise] of a scene: an effect that is
// not named there (or is 0) is not constructed, and its stage of the renderer does not run.
//
//   axial         sigma(z) = axial * max(1.2, 1.5 - 0.5 z + 0.3 z^2) mm, z in m: the usual fit for
//                 Kinect v2 (docs: drivers/camera/README.md)
//   incidence     of the axial noise: sigma grows by incidence * 0.1 z^1.5 t^2 / (pi/2 - t)^2 mm
//                 with the angle t between ray and surface normal (Fankhauser, Bloesch, Rodriguez,
//                 Kaestner, Hutter, Siegwart, ICAR 2015), beyond 80 degrees as at 80. The angle is
//                 that of the depth image over four pixels
//   lateral_px    the ray of a pixel is shifted by a normal deviate of this sigma in u and in v
//   edge_dropout  share of the pixels beside a depth edge that give no reading
//   flying        share of the pixels beside a depth edge that read somewhere between the two sides
//
// Depth edge: 1/z is linear in the image on any plane, so the edge measure is its second difference
// times z, over the left-right and the up-down neighbours; above kEdgeStep the pixel is beside an
// edge. (A first difference would call a grazing floor an edge.)
//
// Every deviate is a function of (seed, frame number, row of the image, place in the row).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

struct DepthNoiseConfig {
  double axial = 0;
  double lateral_px = 0;
  double edge_dropout = 0;
  double flying = 0;
  double incidence = 0;
  void describe(config::Section& s);
};

// Standard deviation of the axial noise, in m, at depth z_m.
[[nodiscard]] constexpr double kinect_v2_sigma_m(double z_m) noexcept {
  const double mm = 1.5 - 0.5 * z_m + 0.3 * z_m * z_m;
  return (mm > 1.2 ? mm : 1.2) * 1e-3;
}

// Quantiles of the normal distribution: deviates from 32 random bits by one table look-up with
// linear interpolation, exact in mean and variance to 1e-3 and cut at 4.1 sigma.
class NormalTable {
 public:
  static constexpr int kCells = 4096;
  NormalTable();
  [[nodiscard]] float operator()(std::uint32_t bits) const noexcept {
    const std::uint32_t i = bits >> 20U;
    const float f = static_cast<float>(bits & 0xfffffU) * 0x1.0p-20F;
    return q_[i] + f * (q_[i + 1] - q_[i]);
  }

 private:
  std::array<float, kCells + 1> q_{};
};

// t^2 / (pi/2 - t)^2 by cos t, by plain arithmetic: linear in the square root of 1 - cos t
// between knots, constant from 80 degrees on.
class IncidenceTable {
 public:
  static constexpr int kCells = 512;
  IncidenceTable();
  [[nodiscard]] float operator()(float cosine) const noexcept {
    const float lack = 1 - cosine;
    const float x = std::sqrt(lack > 0 ? lack : 0.0F) * kPerRoot;
    const float at = x < kCells ? x : static_cast<float>(kCells);
    const int i = static_cast<int>(at);
    return q_[static_cast<std::size_t>(i)] +
           (at - static_cast<float>(i)) *
               (q_[static_cast<std::size_t>(i) + 1] - q_[static_cast<std::size_t>(i)]);
  }

 private:
  static constexpr double kMostRoot = 0.90905845;  // of 1 - cos 80 degrees
  static constexpr auto kPerRoot = static_cast<float>(kCells / kMostRoot);
  std::array<float, kCells + 2> q_{};
};

struct AxialNoise {
  double scale;
  NormalTable normal;
  double incidence = 0;
  IncidenceTable tilt{};
};
struct LateralJitter {
  double sigma_px;
  NormalTable normal;
};
struct EdgeDropout {
  double share;
};
struct FlyingPixels {
  double share;
};

class DepthNoise {
 public:
  static constexpr double kEdgeStep = 0.04;  // relative: 4 cm at 1 m

  DepthNoise() = default;  // none of the effects
  DepthNoise(rt::NonRealtime&, const DepthNoiseConfig& config);

  [[nodiscard]] const AxialNoise* axial() const noexcept { return axial_.get(); }
  [[nodiscard]] const LateralJitter* lateral() const noexcept { return lateral_.get(); }
  [[nodiscard]] const EdgeDropout* dropout() const noexcept { return dropout_.get(); }
  [[nodiscard]] const FlyingPixels* flying() const noexcept { return flying_.get(); }
  // Names of the effects that exist, for the run's report.
  [[nodiscard]] std::vector<std::string> constructed() const;

 private:
  std::unique_ptr<const AxialNoise> axial_;
  std::unique_ptr<const LateralJitter> lateral_;
  std::unique_ptr<const EdgeDropout> dropout_;
  std::unique_ptr<const FlyingPixels> flying_;
};

}  // namespace drivers
