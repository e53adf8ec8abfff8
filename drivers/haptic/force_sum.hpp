// The force on the hand shares the motors with the weight of the arm: the sum is what saturates.
#pragma once

#include <algorithm>
#include <cmath>

#include "perception/geometry/pose.hpp"

namespace drivers {

// The largest s in [0, 1] with |weight + s f| <= limit, as a force: the arm stays carried and the
// rendered force keeps its direction. Zero when the weight alone is over the limit.
[[nodiscard]] inline perception::Vec3 limited_beside(const perception::Vec3& f,
                                                     const perception::Vec3& weight,
                                                     double limit) noexcept {
  const double a = f.squaredNorm();
  const double c = weight.squaredNorm() - limit * limit;
  if (!(a > 0) || !(c < 0)) return perception::Vec3::Zero();
  const double b = f.dot(weight);
  const double s = (-b + std::sqrt(b * b - a * c)) / a;  // c < 0: real, and the larger root > 0
  return std::min(s, 1.0) * f;
}

}  // namespace drivers
