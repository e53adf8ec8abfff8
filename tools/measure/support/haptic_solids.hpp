// Exact signed distances of the solids of the hard cases, positive outside, frame S, metres.
#pragma once

#include <algorithm>
#include <cmath>

#include "perception/geometry/pose.hpp"

namespace solids {

using perception::Vec3;

inline double floor(const Vec3& p) { return p.z(); }
inline double sphere(const Vec3& p, double radius) { return p.norm() - radius; }

// Solid quarter space x < 0 and z < 0: a convex edge along y.
inline double convex_edge(const Vec3& p) {
  const double x = p.x(), z = p.z();
  return x <= 0 || z <= 0 ? std::max(x, z) : std::hypot(x, z);
}
// Solid where z < 0 or x > 0: floor meets wall, free space x < 0, z > 0.
inline double concave_edge(const Vec3& p) {
  const double a = -p.x(), b = p.z();  // free quadrant: both positive
  return a >= 0 || b >= 0 ? std::min(a, b) : -std::hypot(a, b);
}
// Free octant x < 0, y < 0, z > 0.
inline double room_corner(const Vec3& p) {
  const Vec3 a(-p.x(), -p.y(), p.z());
  if (a.minCoeff() >= 0) return a.minCoeff();
  return -a.cwiseMin(0.0).norm();
}
inline double plate(const Vec3& p, double thickness) { return std::abs(p.z()) - thickness / 2; }
// Groove along y, full angle `angle`, opening upwards, apex at the origin.
inline double groove(const Vec3& p, double angle) {
  const double s = std::sin(angle / 2), c = std::cos(angle / 2);
  const double x = std::abs(p.x()), z = p.z();
  // Distance to the right wall, which runs from the apex along (s, c): normal (-c, s).
  const double d = -c * x + s * z;
  if (d >= 0) return d;
  const double along = s * x + c * z;
  return along >= 0 ? d : -std::hypot(x, z);
}
// z = k (x^2 - y^2), first order distance refined by Newton on the foot point.
inline double saddle(const Vec3& p, double k) {
  double u = p.x(), v = p.y();
  for (int i = 0; i < 20; ++i) {
    const double r = k * (u * u - v * v) - p.z();
    const double gu = u - p.x() + 2 * k * u * r, gv = v - p.y() - 2 * k * v * r;
    const double huu = 1 + 2 * k * r + 4 * k * k * u * u, hvv = 1 - 2 * k * r + 4 * k * k * v * v,
                 huv = -4 * k * k * u * v;
    const double det = huu * hvv - huv * huv;
    u -= (hvv * gu - huv * gv) / det;
    v -= (huu * gv - huv * gu) / det;
  }
  const double above = p.z() - k * (p.x() * p.x() - p.y() * p.y());
  return std::copysign((Vec3(u, v, k * (u * u - v * v)) - p).norm(), above);
}

// The same sheet for rays: of its sign, and never farther than the sheet is. Newton above finds a
// foot, but far from the middle not always the nearest one, and a ray that steps so far is through.
// f = z - k (x^2 - y^2) changes by at most sqrt(1 + 4 k^2 (r + d)^2) a metre within d of a point r
// from the axis.
inline double saddle_bound(const Vec3& p, double k) {
  const double f = p.z() - k * (p.x() * p.x() - p.y() * p.y()), r = std::hypot(p.x(), p.y());
  double d = std::abs(f);
  for (int i = 0; i < 3; ++i) {  // from above, below, above the root: an odd count ends below it
    d = std::abs(f) / std::hypot(1.0, 2 * k * (r + d));
  }
  return std::copysign(d, f);
}

}  // namespace solids
