#include "drivers/world/world.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "perception/geometry/no_colour.hpp"
#include "rt/random.hpp"

namespace drivers {

using perception::Mat3;
using perception::Pose;
using perception::Rgb;
using perception::Vec3;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Vec3 to_vector(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }

double radians(double degrees) { return degrees * std::numbers::pi / 180.0; }

Paint make_paint(const PaintConfig& c) {
  const auto byte = [](double v) { return static_cast<std::uint8_t>(v + 0.5); };
  Paint p;
  p.colour = {byte(c.colour[0]), byte(c.colour[1]), byte(c.colour[2])};
  p.texture = c.texture == "plain"     ? Paint::Texture::kPlain
              : c.texture == "checker" ? Paint::Texture::kChecker
                                       : Paint::Texture::kNoise;
  p.cell_m = c.cell_m;
  p.contrast = c.contrast;
  return p;
}

Shape make_plane(std::string name, const Vec3& point, const Vec3& normal, bool ground,
                 const PaintConfig& paint) {
  const double length = normal.norm();
  if (!(length > 1e-6)) {
    throw std::runtime_error("world: plane '" + name + "': normal has length 0");
  }
  const Vec3 z = normal / length;
  const Vec3 helper = std::abs(z.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitY();
  const Vec3 x = helper.cross(z).normalized();
  Shape s;
  s.kind = Shape::Kind::kPlane;
  s.name = std::move(name);
  s.X_WS.linear().col(0) = x;
  s.X_WS.linear().col(1) = z.cross(x);
  s.X_WS.linear().col(2) = z;
  s.X_WS.translation() = point;
  s.ground = ground;
  s.paint = make_paint(paint);
  return s;
}

// Shift of the lattice along one axis that keeps faces at +-half farthest from cell borders.
double lattice_offset(double half, double cell) {
  double best = 0, best_distance = -1;
  for (int k = 0; k < 8; ++k) {
    const double offset = cell * k / 8.0;
    double distance = 1;
    for (const double face : {half, -half}) {
      const double f = (face + offset) / cell;
      const double part = f - std::floor(f);
      distance = std::min({distance, part, 1 - part});
    }
    if (distance > best_distance) best_distance = distance, best = offset;
  }
  return best;
}

// 1/d, with a huge finite value for 0 so that no slab product is NaN.
double safe_inverse(double d) {
  return 1.0 / (std::abs(d) > 1e-30 ? d : (std::signbit(d) ? -1e-30 : 1e-30));
}

struct Entry {
  double t = -1;  // <= 0: no entry in front
  Vec3 normal_S = Vec3::Zero();
};

Entry enter_box(const Vec3& o, const Vec3& d, const Vec3& half) {
  double t_near = -kInfinity, t_far = kInfinity;
  int axis = 0;
  for (int a = 0; a < 3; ++a) {
    const double inverse = safe_inverse(d[a]);
    const double t0 = (-half[a] - o[a]) * inverse, t1 = (half[a] - o[a]) * inverse;
    if (std::min(t0, t1) > t_near) t_near = std::min(t0, t1), axis = a;
    t_far = std::min(t_far, std::max(t0, t1));
  }
  if (t_near > t_far) return {};
  Vec3 normal = Vec3::Zero();
  normal[axis] = d[axis] > 0 ? -1 : 1;
  return {t_near, normal};
}

Entry enter_cylinder(const Vec3& o, const Vec3& d, double radius, double half_z) {
  const double a = std::max(d.x() * d.x() + d.y() * d.y(), 1e-30);
  const double b = o.x() * d.x() + o.y() * d.y();
  const double c = o.x() * o.x() + o.y() * o.y() - radius * radius;
  const double disc = b * b - a * c;
  if (disc < 0) return {};
  const double root = std::sqrt(disc);
  const double inverse_z = safe_inverse(d.z());
  const double z0 = (-half_z - o.z()) * inverse_z, z1 = (half_z - o.z()) * inverse_z;
  const double side = (-b - root) / a, cap = std::min(z0, z1);
  const double t_near = std::max(side, cap);
  const double t_far = std::min((-b + root) / a, std::max(z0, z1));
  if (t_near > t_far) return {};
  if (side > cap) {
    const Vec3 p = o + side * d;
    return {t_near, Vec3(p.x(), p.y(), 0) / radius};
  }
  return {t_near, Vec3(0, 0, d.z() > 0 ? -1 : 1)};
}

Entry enter_sphere(const Vec3& o, const Vec3& d, double radius) {
  const double a = d.squaredNorm(), b = o.dot(d);
  const double disc = b * b - a * (o.squaredNorm() - radius * radius);
  if (disc < 0 || !(a > 0)) return {};
  const double t = (-b - std::sqrt(disc)) / a;
  return {t, (o + t * d) / radius};
}

// Side and two balls; of a convex thing the first entry from outside is the least of theirs.
Entry enter_capsule(const Vec3& o, const Vec3& d, double radius, double half_z) {
  const double along = std::clamp(o.z(), -half_z, half_z);
  if (Vec3(o.x(), o.y(), o.z() - along).norm() < radius) return {};  // from inside
  Entry best;
  const auto offer = [&best](const Entry& e) {
    if (e.t > 0 && (best.t <= 0 || e.t < best.t)) best = e;
  };
  for (const double z : {-half_z, half_z}) offer(enter_sphere(o - Vec3(0, 0, z), d, radius));
  const double a = d.x() * d.x() + d.y() * d.y();
  const double b = o.x() * d.x() + o.y() * d.y();
  const double disc = b * b - a * (o.x() * o.x() + o.y() * o.y() - radius * radius);
  if (a > 0 && disc >= 0) {
    const double t = (-b - std::sqrt(disc)) / a;
    const Vec3 p = o + t * d;
    if (std::abs(p.z()) <= half_z) offer({t, Vec3(p.x(), p.y(), 0) / radius});
  }
  return best;
}

Entry enter(const Shape& s, const Vec3& o, const Vec3& d) {
  switch (s.kind) {
    case Shape::Kind::kPlane:
      if (o.z() <= 0 || d.z() >= 0) return {};
      return {-o.z() / d.z(), Vec3::UnitZ()};
    case Shape::Kind::kBox:
      return enter_box(o, d, s.half);
    case Shape::Kind::kCylinder:
      return enter_cylinder(o, d, s.half.x(), s.half.z());
    case Shape::Kind::kSphere:
      return enter_sphere(o, d, s.half.x());
    case Shape::Kind::kCapsule:
      return enter_capsule(o, d, s.half.x(), s.half.z());
  }
  return {};
}

// Outside part plus inside part of the distance to a box-like set with excess e per axis.
template <int N>
double from_excess(const Eigen::Matrix<double, N, 1>& e) {
  return e.cwiseMax(0.0).norm() + std::min(e.maxCoeff(), 0.0);
}

void add_room(const RoomConfig& room, std::vector<Shape>& shapes) {
  const double x0 = room.x_m[0], x1 = room.x_m[1], y0 = room.y_m[0], y1 = room.y_m[1];
  const Vec3 middle{(x0 + x1) / 2, (y0 + y1) / 2, 0};
  shapes.push_back(make_plane("floor", middle, Vec3::UnitZ(), true, room.floor));
  if (room.height_m > 0) {
    shapes.push_back(make_plane("ceiling", middle + Vec3(0, 0, room.height_m), -Vec3::UnitZ(),
                                false, room.walls));
  }
  shapes.push_back(make_plane("wall_x_min", {x0, middle.y(), 0}, Vec3::UnitX(), false, room.walls));
  shapes.push_back(
      make_plane("wall_x_max", {x1, middle.y(), 0}, -Vec3::UnitX(), false, room.walls));
  shapes.push_back(make_plane("wall_y_min", {middle.x(), y0, 0}, Vec3::UnitY(), false, room.walls));
  shapes.push_back(
      make_plane("wall_y_max", {middle.x(), y1, 0}, -Vec3::UnitY(), false, room.walls));
}

Shape make_box(const BoxConfig& c) {
  Shape s;
  s.kind = Shape::Kind::kBox;
  s.name = c.name;
  s.X_WS.linear() = (Eigen::AngleAxisd(radians(c.yaw_deg), Vec3::UnitZ()) *
                     Eigen::AngleAxisd(radians(c.pitch_deg), Vec3::UnitY()) *
                     Eigen::AngleAxisd(radians(c.roll_deg), Vec3::UnitX()))
                        .toRotationMatrix();
  s.X_WS.translation() = to_vector(c.position_m);
  s.half = to_vector(c.size_m) / 2;
  s.paint = make_paint(c.paint);
  return s;
}

Shape make_cylinder(const CylinderConfig& c) {
  Shape s;
  s.kind = Shape::Kind::kCylinder;
  s.name = c.name;
  s.X_WS.translation() = to_vector(c.position_m) + Vec3(0, 0, c.height_m / 2);
  s.half = {c.radius_m, c.radius_m, c.height_m / 2};
  s.paint = make_paint(c.paint);
  return s;
}

Shape make_capsule(const CapsuleShapeConfig& c) {
  return make_capsule(c.name, to_vector(c.from_m), to_vector(c.to_m), c.radius_m,
                      make_paint(c.paint));
}

Shape make_sphere(const SphereConfig& c) {
  Shape s;
  s.kind = Shape::Kind::kSphere;
  s.name = c.name;
  s.X_WS.translation() = to_vector(c.position_m);
  s.half = Vec3::Constant(c.radius_m);
  s.paint = make_paint(c.paint);
  return s;
}

}  // namespace

void place_capsule(const Vec3& a_W, const Vec3& b_W, Pose& X_WS) noexcept {
  const Vec3 way = b_W - a_W;
  X_WS.linear() = Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(),
                                                     way.norm() > 1e-9 ? way : Vec3(Vec3::UnitZ()))
                      .toRotationMatrix();
  X_WS.translation() = (a_W + b_W) / 2;
}

Shape make_capsule(std::string name, const Vec3& a_W, const Vec3& b_W, double radius,
                   const Paint& paint) {
  Shape s;
  s.kind = Shape::Kind::kCapsule;
  s.name = std::move(name);
  place_capsule(a_W, b_W, s.X_WS);
  s.half = {radius, radius, (b_W - a_W).norm() / 2};
  s.paint = paint;
  return s;
}

void derive(Shape& s) {
  for (int a = 0; a < 3; ++a) {
    s.lattice_offset_m[a] = lattice_offset(s.half[a], s.paint.cell_m);
  }
  s.bound_radius_m = s.kind == Shape::Kind::kPlane      ? kInfinity
                     : s.kind == Shape::Kind::kSphere   ? s.half.x()
                     : s.kind == Shape::Kind::kCylinder ? std::hypot(s.half.x(), s.half.z())
                     : s.kind == Shape::Kind::kCapsule  ? s.half.x() + s.half.z()
                                                        : s.half.norm();
  // By name, not by place in the file: adding a shape leaves the others' colours as they were.
  std::uint64_t h = 0;
  for (const char c : s.name) h = rt::mix64(h, static_cast<unsigned char>(c));
  s.paint_seed = static_cast<std::uint32_t>(h);
}

World::World(rt::NonRealtime&, const WorldConfig& config, rt::Time t0) : t0_(t0) {
  std::vector<Shape> shapes;
  if (config.room.present()) add_room(config.room, shapes);
  for (const auto& c : config.planes) {
    shapes.push_back(
        make_plane(c.name, to_vector(c.point_m), to_vector(c.normal), c.ground, c.paint));
  }
  for (const auto& c : config.boxes) shapes.push_back(make_box(c));
  for (const auto& c : config.cylinders) shapes.push_back(make_cylinder(c));
  for (const auto& c : config.spheres) shapes.push_back(make_sphere(c));
  for (const auto& c : config.capsules) shapes.push_back(make_capsule(c));
  for (auto& s : shapes) add(std::move(s));
  for (const auto& c : config.movers) add(c);
}

void World::add(Shape s) {
  if (s.name.empty()) {
    throw std::runtime_error("world: shape number " + std::to_string(shapes_.size()) +
                             " has no name");
  }
  if (find(s.name) >= 0) throw std::runtime_error("world: two shapes are named '" + s.name + "'");
  derive(s);
  shapes_.push_back(std::move(s));
}

int World::find(std::string_view name) const noexcept {
  for (std::size_t i = 0; i < shapes_.size(); ++i) {
    if (shapes_[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

Rgb surface_colour(const Shape& s, const Vec3& p_S) noexcept {
  const double inverse = 1.0 / s.paint.cell_m;
  const std::uint32_t level = paint_level(lattice_index(p_S.x(), s.lattice_offset_m.x(), inverse),
                                          lattice_index(p_S.y(), s.lattice_offset_m.y(), inverse),
                                          lattice_index(p_S.z(), s.lattice_offset_m.z(), inverse),
                                          s.paint.texture, pattern_depth(s.paint), s.paint_seed);
  const auto dim = [level](std::uint8_t c) { return static_cast<std::uint8_t>(c * level >> 8U); };
  return perception::lifted({dim(s.paint.colour.r), dim(s.paint.colour.g), dim(s.paint.colour.b)});
}

RayHit World::ray_cast(const Vec3& origin_W, const Vec3& dir_W, rt::Time t) const noexcept {
  RayHit hit;
  Pose moved;
  for (std::size_t i = 0; i < shapes_.size(); ++i) {
    const Shape& s = shapes_[i];
    const Pose& X_WS = pose(s, t, moved);
    const Vec3 o = X_WS.linear().transpose() * (origin_W - X_WS.translation());
    const Vec3 d = X_WS.linear().transpose() * dir_W;
    const Entry e = enter(s, o, d);
    if (!(e.t > 0) || (hit && e.t >= hit.t)) continue;
    hit.shape = static_cast<int>(i);
    hit.t = e.t;
    hit.normal_W = X_WS.linear() * e.normal_S;
    hit.colour = surface_colour(s, o + e.t * d);
  }
  return hit;
}

double World::signed_distance(const Vec3& p_W, int shape, rt::Time t) const noexcept {
  const Shape& s = shapes_[static_cast<std::size_t>(shape)];
  Pose moved;
  const Pose& X_WS = pose(s, t, moved);
  const Vec3 p = X_WS.linear().transpose() * (p_W - X_WS.translation());
  switch (s.kind) {
    case Shape::Kind::kPlane:
      return p.z();
    case Shape::Kind::kBox:
      return from_excess<3>(p.cwiseAbs() - s.half);
    case Shape::Kind::kCylinder:
      return from_excess<2>({std::hypot(p.x(), p.y()) - s.half.x(), std::abs(p.z()) - s.half.z()});
    case Shape::Kind::kSphere:
      return p.norm() - s.half.x();
    case Shape::Kind::kCapsule:
      return Vec3(p.x(), p.y(), p.z() - std::clamp(p.z(), -s.half.z(), s.half.z())).norm() -
             s.half.x();
  }
  return kInfinity;
}

double World::signed_distance(const Vec3& p_W, rt::Time t) const noexcept {
  double best = kInfinity;
  for (int i = 0; i < static_cast<int>(shapes_.size()); ++i) {
    best = std::min(best, signed_distance(p_W, i, t));
  }
  return best;
}

}  // namespace drivers
