#include <array>
#include <cmath>

#include "drivers/world/world.hpp"

namespace drivers {

using perception::Mat3;
using perception::Vec3;

namespace {

struct Obb {
  Vec3 centre;
  Mat3 R;  // columns are the axes
  Vec3 half;
};

bool touches_plane(const Obb& b, const Shape& plane) {
  const Vec3 n = plane.X_WS.linear().col(2);
  const double reach = (b.R.transpose() * n).cwiseAbs().dot(b.half);
  return n.dot(b.centre - plane.X_WS.translation()) <= reach;
}

// Separating axes: Gottschalk, Lin, Manocha, "OBBTree" (SIGGRAPH 1996).
bool touches_box(const Obb& a, const Obb& b) {
  const Mat3 R = a.R.transpose() * b.R;  // b's axes in a's frame
  const Vec3 t = a.R.transpose() * (b.centre - a.centre);
  const auto separated = [&](const Vec3& axis) {  // axis in a's frame, any length
    const double reach =
        axis.cwiseAbs().dot(a.half) + (R.transpose() * axis).cwiseAbs().dot(b.half);
    return std::abs(axis.dot(t)) > reach;
  };
  for (int i = 0; i < 3; ++i) {
    if (separated(Vec3::Unit(i)) || separated(R.col(i))) return false;
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const Vec3 axis = Vec3::Unit(i).cross(R.col(j));
      // Parallel edges: the face normals have said it already, and rounding would decide here.
      if (axis.squaredNorm() > 1e-12 && separated(axis)) return false;
    }
  }
  return true;
}

// Both are upright, so height and plan view separate.
bool touches_cylinder(const Obb& b, const Shape& c) {
  const Vec3 d = c.X_WS.translation() - b.centre;
  if (std::abs(d.z()) > b.half.z() + c.half.z()) return false;
  const Vec3 p = b.R.transpose() * d;
  const double ex = std::max(std::abs(p.x()) - b.half.x(), 0.0);
  const double ey = std::max(std::abs(p.y()) - b.half.y(), 0.0);
  return ex * ex + ey * ey <= c.half.x() * c.half.x();
}

bool touches_sphere(const Obb& b, const Shape& s) {
  const Vec3 p = b.R.transpose() * (s.X_WS.translation() - b.centre);
  return (p.cwiseAbs() - b.half).cwiseMax(0.0).squaredNorm() <= s.half.x() * s.half.x();
}

// The distance of a convex thing along a line is convex: its slope is halved down to the least one.
bool touches_capsule(const Obb& b, const Shape& s) {
  const Vec3 o = b.R.transpose() * (s.X_WS.translation() - b.centre);
  const Vec3 way = b.R.transpose() * s.X_WS.linear().col(2);
  const auto outside = [&](double z) {  // from the box to the axis' point, per axis
    const Vec3 p = o + z * way;
    return Vec3(p - p.cwiseMax(-b.half).cwiseMin(b.half));
  };
  double lo = -s.half.z(), hi = s.half.z();
  for (int i = 0; i < 60; ++i) {
    const double z = (lo + hi) / 2;
    (outside(z).dot(way) > 0 ? hi : lo) = z;
  }
  return outside((lo + hi) / 2).squaredNorm() <= s.half.x() * s.half.x();
}

bool touches(const Obb& b, const Shape& s) {
  switch (s.kind) {
    case Shape::Kind::kPlane:
      return touches_plane(b, s);
    case Shape::Kind::kBox:
      return touches_box(b, {s.X_WS.translation(), s.X_WS.linear(), s.half});
    case Shape::Kind::kCylinder:
      return touches_cylinder(b, s);
    case Shape::Kind::kSphere:
      return touches_sphere(b, s);
    case Shape::Kind::kCapsule:
      return touches_capsule(b, s);
  }
  return false;
}

}  // namespace

std::span<const BodyBox> youbot_body() noexcept {
  static const std::array<BodyBox, 3> body{{
      {{0.0, 0.0, 0.07}, {0.29, 0.188, 0.07}},   // base with wheels, down to the floor
      {{0.143, 0.0, 0.33}, {0.14, 0.10, 0.19}},  // arm, folded
      {{-0.20, 0.0, 0.57}, {0.04, 0.04, 0.43}},  // camera mast
  }};
  return body;
}

int World::robot_collision(double x_m, double y_m, double yaw_rad) const noexcept {
  return robot_collision(x_m, y_m, yaw_rad, youbot_body());
}

int World::robot_collision(double x_m, double y_m, double yaw_rad,
                           std::span<const BodyBox> body) const noexcept {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  Mat3 R;
  R << c, -s, 0, s, c, 0, 0, 0, 1;
  for (std::size_t i = 0; i < shapes_.size(); ++i) {
    if (shapes_[i].ground) continue;
    for (const BodyBox& part : body) {
      const Obb b{Vec3(x_m, y_m, 0) + R * part.centre_B, R, part.half};
      if (touches(b, shapes_[i])) return static_cast<int>(i);
    }
  }
  return -1;
}

}  // namespace drivers
