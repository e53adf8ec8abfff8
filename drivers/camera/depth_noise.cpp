#include "drivers/camera/depth_noise.hpp"
#include "rt/effect_count.hpp"

#include <cmath>

namespace drivers {

namespace {

// exp(-x^2/2) and the normal distribution's integral by series (Marsaglia, "Evaluating the normal
// distribution", JSS 2004), in plain arithmetic: a math library's last bit may differ between
// machines, and with it a pixel.
double gauss(double x) {
  const double y = -0.5 * x * x / 64.0;
  double sum = 1, term = 1;
  for (int k = 1; k < 20; ++k) {
    term *= y / k;
    sum += term;
  }
  for (int k = 0; k < 6; ++k) sum *= sum;
  return sum;
}

double normal_integral(double x) {  // from -infinity to x
  double sum = x, term = x;
  for (int k = 3; std::abs(term) > 1e-18 * std::abs(sum) && k < 400; k += 2) {
    term *= x * x / k;
    sum += term;
  }
  return 0.5 + sum * gauss(x) * 0.3989422804014327;
}

}  // namespace

void DepthNoiseConfig::describe(config::Section& s) {
  s.number("axial", axial, 0, 100, "factor on the Kinect v2's sigma along the axis; 0: none");
  s.number("lateral_px", lateral_px, 0, 3, "sigma of a pixel's ray, pixels; 0: none");
  s.number("edge_dropout", edge_dropout, 0, 1, "share of edge pixels without a reading; 0: none");
  s.number("incidence", incidence, 0, 100,
           "factor on the growth of sigma with the angle of incidence; 0: none");
  s.number("flying", flying, 0, 1, "share of edge pixels between the two sides; 0: none");
}

NormalTable::NormalTable() {
  std::array<double, kCells + 1> q{};
  double x = 0;
  for (int i = kCells / 2; i < kCells; ++i) {
    const double p = static_cast<double>(i) / kCells;
    for (int k = 0; k < 8; ++k) x -= (normal_integral(x) - p) / (0.3989422804014327 * gauss(x));
    q[static_cast<std::size_t>(i)] = x;
    q[static_cast<std::size_t>(kCells - i)] = -x;
  }
  // The last knot, infinite by right, is put where the table's variance becomes 1: a cell between
  // a and b, filled evenly, holds (a^2 + a b + b^2) / 3.
  double sum = 0;
  for (std::size_t i = kCells / 2; i + 2 <= kCells; ++i) {
    sum += (q[i] * q[i] + q[i] * q[i + 1] + q[i + 1] * q[i + 1]) / 3;
  }
  const double a = q[kCells - 1], rest = 3 * (kCells / 2.0 - sum);  // a^2 + a b + b^2
  q[kCells] = (-a + std::sqrt(a * a - 4 * (a * a - rest))) / 2;
  q[0] = -q[kCells];
  for (std::size_t i = 0; i <= kCells; ++i) q_[i] = static_cast<float>(q[i]);
}

// With r the square root of 1 - cos t: t = 2 asin(r / sqrt 2), by its series.
IncidenceTable::IncidenceTable() {
  constexpr double kHalfPi = 1.5707963267948966, kHalfRoot = 0.7071067811865476;
  for (int i = 0; i <= kCells; ++i) {
    const double s = kHalfRoot * kMostRoot * i / kCells;
    double term = s, asin = s;
    for (int k = 1; k < 200; ++k) {
      term *= s * s * (2 * k - 1) / (2 * k);
      asin += term / (2 * k + 1);
    }
    const double t = 2 * asin;
    q_[static_cast<std::size_t>(i)] = static_cast<float>(t * t / ((kHalfPi - t) * (kHalfPi - t)));
  }
  q_[kCells + 1] = q_[kCells];
}

DepthNoise::DepthNoise(rt::NonRealtime&, const DepthNoiseConfig& c) {
  using rt::Effect;
  if (c.axial > 0 || c.incidence > 0) {
    rt::effect_built(Effect::kAxial);
    axial_ = std::make_unique<const AxialNoise>(AxialNoise{c.axial, {}, c.incidence, {}});
  }
  if (c.lateral_px > 0) {
    rt::effect_built(Effect::kLateral);
    lateral_ = std::make_unique<const LateralJitter>(LateralJitter{c.lateral_px, {}});
  }
  if (c.edge_dropout > 0) {
    rt::effect_built(Effect::kEdgeDropout);
    dropout_ = std::make_unique<const EdgeDropout>(EdgeDropout{c.edge_dropout});
  }
  if (c.flying > 0) {
    rt::effect_built(Effect::kFlying);
    flying_ = std::make_unique<const FlyingPixels>(FlyingPixels{c.flying});
  }
}

std::vector<std::string> DepthNoise::constructed() const {
  std::vector<std::string> names;
  if (axial_) names.emplace_back("axial");
  if (lateral_) names.emplace_back("lateral_px");
  if (dropout_) names.emplace_back("edge_dropout");
  if (flying_) names.emplace_back("flying");
  return names;
}

}  // namespace drivers
