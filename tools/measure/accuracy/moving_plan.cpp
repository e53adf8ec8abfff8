#include "tools/measure/accuracy/moving_plan.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/record/fusion_sequence.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kTurn = 2 * std::numbers::pi, kDegree = std::numbers::pi / 180;
constexpr double kThick_m = 0.04;  // of a door

double log_uniform(rt::Random& rng, double lo, double hi) {
  return lo * std::exp(rng.uniform() * std::log(hi / lo));
}

// Peak speeds of the sines stay below 0.25 m/s and 15 deg/s together; the axes of the turns are not
// quite at right angles.
CameraWay draw_way(rt::Random& rng, Carry carry) {
  CameraWay way;
  way.eye_W = {rng.uniform(-0.3, 0.1), rng.uniform(-0.3, 0.3), rng.uniform(0.85, 1.45)};
  way.yaw_rad = rng.uniform(-0.25, 0.25);
  way.pitch_rad = rng.uniform(0.08, 0.42);
  for (std::size_t i = 0; i < 6; ++i) {
    way.period_s[i] = rng.uniform(3.0, 9.0);
    way.phase_rad[i] = rng.uniform(0, kTurn);
  }
  const auto amplitude = [&](std::size_t i, double peak) {
    way.amplitude[i] = peak * way.period_s[i] / kTurn;
  };
  if (carry == Carry::kByHand) {
    const Vec3 v =
        0.249 * rng.uniform(0.4, 1.0) *
        Vec3(rng.uniform(0.2, 1), rng.uniform(0.2, 1), rng.uniform(0.1, 0.5)).normalized();
    const Vec3 w =
        14.2 * kDegree * rng.uniform(0.3, 1.0) *
        Vec3(rng.uniform(0.3, 1), rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.5)).normalized();
    for (std::size_t i = 0; i < 3; ++i) {
      amplitude(i, v[static_cast<int>(i)]);
      amplitude(3 + i, w[static_cast<int>(i)]);
    }
  } else if (carry == Carry::kDriving) {
    way.eye_W.z() = 0.95;
    way.pitch_rad = rng.uniform(0.2, 0.45);
    way.speed_m_per_s = rng.uniform(0.05, 0.15) * (rng.uniform() < 0.7 ? 1 : -1);
    amplitude(3, rng.uniform(0, 8) * kDegree);
  }
  return way;
}

// Way (m or degrees) of the mover at a frame, from `first` - 1 on with `step`, back and forth over
// `length`.
std::vector<std::pair<int, double>> progress(const MovingPlan& p, int first, double length,
                                             int& last) {
  std::vector<std::pair<int, double>> at{{first - 1, 0.0}};
  const int leg = std::max(1, static_cast<int>(std::lround(length / p.step)));
  const double end = leg * p.step;
  last = first - 1 + (p.end == MoverEnd::kGoesOut ? leg : p.move);
  for (int f = first - 1; f < last;) {
    const int next = std::min(f + leg, last);
    const double from = at.back().second, way = (next - f) * p.step;
    at.emplace_back(next, from > 0.5 * end ? from - way : from + way);
    f = next;
  }
  return at;
}

struct Builder {
  const MovingPlan& p;
  MovingSample s;
  Vec3 heading, right, aim;  // aim: on the view's axis at the plan's distance
  std::vector<std::pair<int, double>> at;

  Builder(const MovingPlan& plan, const drivers::WorldConfig& room) : p(plan) {
    s.plain = room;
    s.world = room;
    const double yaw = p.way.yaw_rad;
    heading = {std::cos(yaw), std::sin(yaw), 0};
    right = {std::sin(yaw), -std::cos(yaw), 0};
  }
  // Point at this distance along the view, off its middle as drawn.
  [[nodiscard]] Vec3 place(double distance_m) const {
    const double half_width = 0.7 * distance_m;  // 512 / 2 / 365
    Vec3 point = p.way.eye_W + distance_m * heading + p.lateral * half_width * right;
    point.z() = std::max(0.0, p.way.eye_W.z() - distance_m * std::tan(p.way.pitch_rad));
    return point;
  }
  void paint(drivers::PaintConfig& c) const {
    c.colour = {200 - 90 * p.ratio[0], 60 + 80 * p.ratio[1], 70 + 100 * p.ratio[2]};
  }
  drivers::BoxConfig& box(const char* name, const Vec3& size, const Vec3& centre, double yaw_rad) {
    auto& b = s.world.boxes.emplace_back();
    b.name = name;
    b.size_m = {size.x(), size.y(), size.z()}, b.position_m = {centre.x(), centre.y(), centre.z()};
    b.yaw_deg = yaw_rad / kDegree;
    paint(b.paint);
    s.movers.emplace_back(name);
    return b;
  }
  void cylinder(const char* name, const Vec3& foot, double radius_m, double height_m, bool moves) {
    auto& c = s.world.cylinders.emplace_back();
    c.name = name;
    c.position_m = {foot.x(), foot.y(), foot.z()}, c.radius_m = radius_m, c.height_m = height_m;
    paint(c.paint);
    if (moves) s.movers.emplace_back(name);
    if (!moves) s.plain.cylinders.push_back(c);
  }
  void sphere(const char* name, const Vec3& centre, double radius_m) {
    auto& c = s.world.spheres.emplace_back();
    c.name = name;
    c.position_m = {centre.x(), centre.y(), centre.z()}, c.radius_m = radius_m;
    paint(c.paint);
    s.movers.emplace_back(name);
  }
  drivers::MoverConfig& mover(const char* name, const std::string& shapes) {
    auto& m = s.world.movers.emplace_back();
    m.name = name, m.shapes = shapes, m.kind = "waypoints";
    return m;
  }
  void slide(const std::string& shapes, const Vec3& direction, double begin) {
    auto& m = mover("mover", shapes);
    for (const auto& [frame, way] : at) {
      auto& w = m.waypoints.emplace_back();
      const Vec3 by = (way - begin) * direction;
      w.at_s = std::max(0, frame) * MovingSample::kFrame_s;
      w.offset_m = {by.x(), by.y(), by.z()};
    }
  }
  void turn(drivers::MoverConfig& m, const Vec3& point, const Vec3& axis, double factor) {
    m.point_m = {point.x(), point.y(), point.z()};
    m.axis = {axis.x(), axis.y(), axis.z()};
    for (const auto& [frame, deg] : at) {
      auto& w = m.waypoints.emplace_back();
      w.at_s = std::max(0, frame) * MovingSample::kFrame_s;
      w.turn_deg = factor * deg;
    }
  }
  void time(double length) {
    s.first_moving = p.from_rest ? p.still : 1;
    at = progress(p, s.first_moving, length, s.last_moving);
    s.frames = s.last_moving + 1 + (p.end == MoverEnd::kComesToRest ? p.rest : 0);
    if (p.end == MoverEnd::kGoesOut) s.frames += 35;
  }

  void sliding(double size);
  void door(double size);
  void drawer(double size);
  void arm(double size);
};

// A box, a ball or a person.
void Builder::sliding(double size) {
  Vec3 d = std::cos(p.phi_rad) * right + std::sin(p.phi_rad) * heading;
  if (p.kind == MoverKind::kBall) d = (d + p.climb * Vec3::UnitZ()).normalized();
  const bool person = p.kind == MoverKind::kPerson;
  const double r = person ? 0.14 * size : size / 2;
  Vec3 centre = place(p.distance_m + r * (p.kind == MoverKind::kBox ? p.ratio[0] : 1));
  double length = std::min(p.excursion, p.move * p.step), begin = p.middle * length;
  if (p.end == MoverEnd::kGoesOut) {
    // Sideways until its near face has left the view, with the camera's own motion to spare.
    const double out = 0.72 * (p.distance_m + r) + r + (p.carry == Carry::kAtRest ? 0.05 : 0.25);
    const double leave = out + 0.7 * p.distance_m * std::abs(p.lateral);
    length = p.enters ? 2 * leave : leave;
    begin = p.enters ? leave : 0;
  }
  time(length);
  if (person) {
    centre.z() = 0.002;
    cylinder("mover_body", centre, r, 0.86 * size, true);
    sphere("mover_head", centre + Vec3(0, 0, 0.92 * size), 0.075 * size);
    return slide("mover_body, mover_head", d, begin);
  }
  if (p.kind == MoverKind::kBall) {
    centre.z() = std::max(centre.z(), r + 0.02 + std::abs(d.z()) * length);
    sphere("mover_ball", centre, r);
    return slide("mover_ball", d, begin);
  }
  const Vec3 edges = size * Vec3(p.ratio[0], p.ratio[1], p.ratio[2]);
  centre.z() = p.on_floor ? edges.z() / 2 + 0.002 : std::max(centre.z(), edges.z() / 2 + 0.02);
  box("mover_box", edges, centre, p.way.yaw_rad + p.turn_rad);
  slide("mover_box", d, begin);
}

void Builder::door(double size) {
  const double width = 0.5 * size, height = size;
  time(std::min(p.excursion, p.move * p.step));
  // Across the view, at an end of which it hangs; it opens away from the camera, or towards it.
  const double side = p.lateral < 0 ? -1 : 1, away = p.bend[0] < 1 ? -1 : 1;
  Vec3 hinge = place(p.distance_m + (away < 0 ? 0.6 * width : 0.0));
  hinge += side * 0.4 * width * right;
  hinge.z() = 0;
  const double yaw = std::atan2(-side * right.y(), -side * right.x()) + 0.3 * p.turn_rad;
  const Vec3 along(std::cos(yaw), std::sin(yaw), 0);
  const Vec3 centre = hinge + (width / 2 + 0.045) * along + Vec3(0, 0, height / 2 + 0.01);
  cylinder("mover_post", hinge, 0.03, height + 0.1, false);
  box("mover_door", {width, kThick_m, height}, centre, yaw);
  // Turning anticlockwise carries its free end along z x along.
  const double sign = Vec3::UnitZ().cross(along).dot(heading) > 0 ? away : -away;
  turn(mover("mover", "mover_door"), hinge, Vec3::UnitZ(), sign);
  s.hinge_W = hinge;
  s.door_width_m = width + 0.045;
}

void Builder::drawer(double size) {
  const double length = std::min({p.excursion, p.move * p.step, 0.45});
  time(length);
  const double depth = 0.5, height = size * (0.35 + 0.45 * p.ratio[2]);
  Vec3 front = place(p.distance_m + length);
  front.z() = std::max(front.z(), height / 2 + 0.05);
  const double yaw = p.way.yaw_rad;
  const Vec3 into = (depth / 2 - 0.015) * heading;
  box("mover_drawer", {depth, size, height}, front + into, yaw);
  slide("mover_drawer", -heading, 0);
  auto cabinet = s.world.boxes.back();
  cabinet.name = "mover_cabinet";
  const double top = front.z() + height / 2 + 0.04;
  cabinet.size_m = {depth + 0.02, size + 0.08, top};
  const Vec3 at_W = front + (depth / 2 + 0.01) * heading;
  cabinet.position_m = {at_W.x(), at_W.y(), top / 2};
  cabinet.paint.colour = {140, 110, 80};
  s.world.boxes.push_back(cabinet);
  s.plain.boxes.push_back(cabinet);
}

void Builder::arm(double size) {
  time(std::min(p.excursion, p.move * p.step));
  const double length = size / p.links, thick = size * (0.1 + 0.08 * p.ratio[1]);
  const Vec3 axis = p.vertical_axis ? Vec3::UnitZ() : Vec3(-heading);
  // The shoulder beside the middle of the view, so that the links swing through it.
  Vec3 joint = place(p.distance_m + (p.vertical_axis ? 0.5 * size : thick));
  joint += (p.lateral < 0 ? 0.35 : -0.35) * size * right;
  joint.z() = std::max(joint.z(), p.vertical_axis ? thick : 0.2);
  const Vec3 first = p.lateral < 0 ? Vec3(-right) : right;
  const Vec3 second = axis.cross(first);
  cylinder("mover_post", {joint.x(), joint.y(), 0}, 0.04, std::max(0.02, joint.z() - thick), false);
  double angle = 0.4 * p.turn_rad;
  static constexpr std::array<const char*, 3> kLinks{"mover_link_1", "mover_link_2",
                                                     "mover_link_3"};
  static constexpr std::array<const char*, 3> kJoints{"joint_1", "joint_2", "joint_3"};
  for (std::size_t i = 0; i < static_cast<std::size_t>(p.links); ++i) {
    const Vec3 along = std::cos(angle) * first + std::sin(angle) * second;
    auto& b = box(kLinks[i], {length + thick, thick * (1 - 0.2 * static_cast<double>(i)), thick},
                  joint + length / 2 * along, 0);
    // Yaw for a vertical axis; yaw and pitch where the link swings upright.
    b.yaw_deg = std::atan2(along.y(), along.x()) / kDegree;
    b.pitch_deg = -std::asin(std::clamp(along.z(), -1.0, 1.0)) / kDegree;
    auto& m = mover(kJoints[i], kLinks[i]);
    if (i > 0) m.on = kJoints[i - 1];
    turn(m, joint, axis, p.bend[i]);
    joint += length * along;
    angle += 0.5 * p.bend[i];
  }
}

}  // namespace

Pose CameraWay::X_WC(double t_s) const {
  std::array<double, 6> by{};
  for (std::size_t i = 0; i < 6; ++i) {
    const double w = kTurn / period_s[i];
    by[i] = amplitude[i] * (std::sin(w * t_s + phase_rad[i]) - std::sin(phase_rad[i]));
  }
  // Driving: the way along a heading that sways, by its first order.
  const double way = speed_m_per_s * t_s;
  const Vec3 eye =
      eye_W + Vec3(by[0], by[1], by[2]) + way * Vec3(std::cos(yaw_rad), std::sin(yaw_rad), 0);
  return looking(eye, yaw_rad + by[3], pitch_rad + by[4], by[5]);
}

MovingKind draw_kind(rt::Random& rng, MoverKind kind, bool low) {
  MovingKind k;
  k.kind = kind, k.low = low;
  const double carry = rng.uniform(), end = rng.uniform();
  k.carry = carry < 0.35 ? Carry::kAtRest : carry < 0.75 ? Carry::kByHand : Carry::kDriving;
  k.from_rest = rng.uniform() < 0.6;
  const bool angular = kind == MoverKind::kDoor || kind == MoverKind::kArm;
  const bool stays = angular || kind == MoverKind::kDrawer;
  k.end = !stays && end < 0.3 ? MoverEnd::kGoesOut
          : end < 0.7         ? MoverEnd::kComesToRest
                              : MoverEnd::kBackAndForth;
  // What leaves the view within the run is not slow.
  const double slowest = k.end == MoverEnd::kGoesOut ? 0.025 : 0.002;
  k.step = angular ? log_uniform(rng, 0.5, 5.0) : log_uniform(rng, slowest, 0.1);
  return k;
}

MovingPlan draw_plan(rt::Random& rng, const MovingKind& of) {
  MovingPlan p;
  const MoverKind kind = p.kind = of.kind;
  const bool low = of.low;
  p.carry = of.carry, p.end = of.end, p.from_rest = of.from_rest, p.step = of.step;
  const bool angular = kind == MoverKind::kDoor || kind == MoverKind::kArm;
  const double least = kind == MoverKind::kPerson ? 0.05 : 0.02;
  p.share = low ? log_uniform(rng, least, 0.30) : rng.uniform(0.30, 0.60);
  p.person_m = rng.uniform(1.5, 1.95);
  p.enters = p.end == MoverEnd::kGoesOut && p.step > 0.045 && rng.uniform() < 0.6;
  p.still = 60;
  p.move = static_cast<int>(rng.integer(50, 70)) + (p.from_rest ? 0 : 20);
  if (p.end == MoverEnd::kBackAndForth) p.move += 30;
  p.rest = 50;
  p.distance_m = rng.uniform(0.5, low ? 3.0 : 1.6);
  p.lateral = rng.uniform(-0.5, 0.5) * (low ? 1 : 0.5);
  p.phi_rad = p.end == MoverEnd::kGoesOut ? rng.uniform(-0.4, 0.4) : rng.uniform(0, kTurn);
  if (p.end == MoverEnd::kGoesOut && rng.uniform() < 0.5) p.phi_rad += std::numbers::pi;
  p.climb = rng.uniform(-0.5, 0.5);
  p.turn_rad = rng.uniform(-1, 1);
  p.middle = rng.uniform(0.2, 0.8);
  p.excursion = angular ? rng.uniform(40, 100) : rng.uniform(0.3, 1.4);
  for (double& r : p.ratio) r = rng.uniform(0.45, 1.0);
  p.ratio[static_cast<std::size_t>(rng.integer(0, 2))] = 1;
  p.links = static_cast<int>(rng.integer(2, 3));
  for (double& b : p.bend) b = rng.uniform(0.4, 1.0) * (rng.uniform() < 0.5 ? -1 : 1);
  p.bend[0] = p.bend[0] < 0 ? -1 : 1;
  p.vertical_axis = rng.uniform() < 0.5;
  p.on_floor = rng.uniform() < 0.5;
  p.way = draw_way(rng, p.carry);
  return p;
}

MovingSample build_sample(const MovingPlan& plan, const drivers::WorldConfig& room, double size_m) {
  Builder b(plan, room);
  switch (plan.kind) {
    case MoverKind::kDoor:
      b.door(size_m);
      break;
    case MoverKind::kDrawer:
      b.drawer(size_m);
      break;
    case MoverKind::kArm:
      b.arm(size_m);
      break;
    default:
      b.sliding(size_m);
  }
  MovingSample& s = b.s;
  s.kind = plan.kind, s.carry = plan.carry, s.end = plan.end, s.from_rest = plan.from_rest;
  s.distance_m = plan.distance_m, s.size_m = size_m, s.way = plan.way;
  const bool angular = plan.kind == MoverKind::kDoor || plan.kind == MoverKind::kArm;
  s.step = angular ? plan.step : 1e3 * plan.step;
  return s;
}

}  // namespace teletact
