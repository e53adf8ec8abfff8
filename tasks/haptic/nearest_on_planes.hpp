// The point nearest to h that satisfies up to three half-spaces n_i . x >= d_i: the small quadratic
// programme of the proxy, solved exactly by trying the seven active sets.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "perception/geometry/pose.hpp"

namespace tasks {

struct HalfSpace {
  perception::Vec3 n = perception::Vec3::UnitZ();  // unit
  double d = 0;                                    // inside: n . x >= d
  [[nodiscard]] double distance(const perception::Vec3& x) const noexcept { return n.dot(x) - d; }
};

struct PlanesResult {
  perception::Vec3 x = perception::Vec3::Zero();
  unsigned active = 0;  // bit i: half-space i carries a positive multiplier
  bool solved = false;  // false: no feasible active set (opposed or parallel planes); x = h
};

// The point common to all three, if the programme's solution is there; else `out` stays as it is.
inline void nearest_on_three(const std::array<HalfSpace, 3>& planes, const perception::Vec3& h,
                             PlanesResult& out) noexcept {
  perception::Mat3 n;
  n << planes[0].n.transpose(), planes[1].n.transpose(), planes[2].n.transpose();
  const double det = n.determinant();
  if (std::abs(det) > 1e-6) {
    const perception::Vec3 d(planes[0].d, planes[1].d, planes[2].d);
    const perception::Mat3 inverse = n.inverse();
    const perception::Vec3 x = inverse * d;
    const perception::Vec3 lambda = inverse.transpose() * (x - h);
    if (lambda.minCoeff() >= 0) {
      out.x = x;
      out.active = 7U;
      out.solved = true;
    }
  }
}

// size <= 3. Exact to 1e-9 m; near-parallel pairs (sine below 1e-4) are not combined.
[[nodiscard]] inline PlanesResult nearest_on_planes(const std::array<HalfSpace, 3>& planes,
                                                    std::size_t size,
                                                    const perception::Vec3& h) noexcept {
  constexpr double kEps = 1e-9;
  PlanesResult out;
  out.x = h;
  std::array<double, 3> need{};  // how far h lies behind plane i
  bool inside = true;
  for (std::size_t i = 0; i < size; ++i) {
    need[i] = -planes[i].distance(h);
    inside = inside && need[i] <= 0;
  }
  if (inside) {
    out.solved = true;
    return out;
  }
  const auto feasible = [&](const perception::Vec3& x) {
    for (std::size_t i = 0; i < size; ++i) {
      if (planes[i].distance(x) < -kEps) return false;
    }
    return true;
  };
  for (std::size_t i = 0; i < size; ++i) {
    if (need[i] <= 0) continue;
    const perception::Vec3 x = h + need[i] * planes[i].n;
    if (feasible(x)) {
      out.x = x;
      out.active = 1U << i;
      out.solved = true;
      return out;
    }
  }
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t j = i + 1; j < size; ++j) {
      const double c = planes[i].n.dot(planes[j].n), det = 1 - c * c;
      if (det < 1e-8) continue;
      const double li = (need[i] - c * need[j]) / det, lj = (need[j] - c * need[i]) / det;
      if (li < 0 || lj < 0) continue;
      const perception::Vec3 x = h + li * planes[i].n + lj * planes[j].n;
      if (feasible(x)) {
        out.x = x;
        out.active = (1U << i) | (1U << j);
        out.solved = true;
        return out;
      }
    }
  }
  if (size == 3) nearest_on_three(planes, h, out);
  return out;
}

}  // namespace tasks
