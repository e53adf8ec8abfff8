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

bool touches_plane(const Obb& b, const perception::Pose& X_WS) {
  const Vec3 n = X_WS.linear().col(2);
  const double reach = (b.R.transpose() * n).cwiseAbs().dot(b.half);
  return n.dot(b.centre - X_WS.translation()) <= reach;
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
bool touches_cylinder(const Obb& b, const perception::Pose& X_WS, const Vec3& half) {
  const Vec3 d = X_WS.translation() - b.centre;
  if (std::abs(d.z()) > b.half.z() + half.z()) return false;
  const Vec3 p = b.R.transpose() * d;
  const double ex = std::max(std::abs(p.x()) - b.half.x(), 0.0);
  const double ey = std::max(std::abs(p.y()) - b.half.y(), 0.0);
  return ex * ex + ey * ey <= half.x() * half.x();
}

bool touches_sphere(const Obb& b, const Vec3& centre, double radius) {
  const Vec3 p = b.R.transpose() * (centre - b.centre);
  return (p.cwiseAbs() - b.half).cwiseMax(0.0).squaredNorm() <= radius * radius;
}

// The distance of a convex thing along a line is convex: its slope is halved down to the least one.
bool touches_capsule(const Obb& b, const perception::Pose& X_WS, const Vec3& half) {
  const Vec3 o = b.R.transpose() * (X_WS.translation() - b.centre);
  const Vec3 way = b.R.transpose() * X_WS.linear().col(2);
  const auto outside = [&](double z) {  // from the box to the axis' point, per axis
    const Vec3 p = o + z * way;
    return Vec3(p - p.cwiseMax(-b.half).cwiseMin(b.half));
  };
  double lo = -half.z(), hi = half.z();
  for (int i = 0; i < 60; ++i) {
    const double z = (lo + hi) / 2;
    (outside(z).dot(way) > 0 ? hi : lo) = z;
  }
  return outside((lo + hi) / 2).squaredNorm() <= half.x() * half.x();
}

bool touches(const Obb& b, const Shape& s, const perception::Pose& X_WS) {
  switch (s.kind) {
    case Shape::Kind::kPlane:
      return touches_plane(b, X_WS);
    case Shape::Kind::kBox:
      return touches_box(b, {X_WS.translation(), X_WS.linear(), s.half});
    case Shape::Kind::kCylinder:
      return touches_cylinder(b, X_WS, s.half);
    case Shape::Kind::kSphere:
      return touches_sphere(b, X_WS.translation(), s.half.x());
    case Shape::Kind::kCapsule:
      return touches_capsule(b, X_WS, s.half);
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

int World::robot_collision(double x_m, double y_m, double yaw_rad, rt::Time t) const noexcept {
  return robot_collision(x_m, y_m, yaw_rad, youbot_body(), t);
}

int World::robot_collision(double x_m, double y_m, double yaw_rad, std::span<const BodyBox> body,
                           rt::Time t) const noexcept {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  Mat3 R;
  R << c, -s, 0, s, c, 0, 0, 0, 1;
  perception::Pose moved;
  for (std::size_t i = 0; i < shapes_.size(); ++i) {
    if (shapes_[i].ground) continue;
    const perception::Pose& X_WS = pose(shapes_[i], t, moved);
    for (const BodyBox& part : body) {
      const Obb b{Vec3(x_m, y_m, 0) + R * part.centre_B, R, part.half};
      if (touches(b, shapes_[i], X_WS)) return static_cast<int>(i);
    }
  }
  return -1;
}

}  // namespace drivers
