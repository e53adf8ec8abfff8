#include "drivers/world/mover.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace drivers {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

Vec3 vec(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }

// There and back: x rises to `end` and falls to 0 again.
double there_and_back(double x, double end) {
  const double phase = std::fmod(x, 2 * end);
  return phase < end ? phase : 2 * end - phase;
}

[[noreturn]] void refuse(const std::string& name, const std::string& what) {
  throw std::runtime_error("world: mover '" + name + "': " + what);
}

}  // namespace

void WaypointConfig::describe(config::Section& s) {
  s.number("at_s", at_s, 0, 1e6, "waypoints: when, since the world's beginning");
  s.number("wait_s", wait_s, 0, 1e6, "walk: so long it stands there");
  s.numbers("offset_m", offset_m, -kFar_m, kFar_m, "from where the shapes stand");
  s.number("turn_deg", turn_deg, -3600, 3600, "about the axis");
}

void MoverConfig::describe(config::Section& s) {
  s.text("name", name, {}, "unique name of the mover");
  s.text("shapes", shapes, {}, "what it moves: names with commas between");
  s.text("on", on, {}, "mover that carries it; empty: none");
  s.text("kind", kind, {"line", "shuttle", "swing", "hinge", "waypoints", "walk"}, "of motion");
  s.number("start_s", start_s, 0, 1e6, "it stands until then");
  s.number("duration_s", duration_s, 0, 1e6,
           "after which it stops; 0: never. Not of waypoints and walk");
  s.numbers("velocity_m_per_s", velocity_m_per_s, -10, 10, "line: in the world's axes");
  s.numbers("way_m", way_m, -kFar_m, kFar_m, "shuttle: how far it goes before it comes back");
  s.number("speed_m_per_s", speed_m_per_s, 0.001, 10, "shuttle, walk: along its way");
  s.numbers("amplitude_m", amplitude_m, -kFar_m, kFar_m, "swing: to each side");
  s.number("period_s", period_s, 0.05, 1000, "swing: there, back and there again");
  s.numbers("point_m", point_m, -kFar_m, kFar_m, "a point of the axis");
  s.numbers("axis", axis, -1, 1, "direction of the axis; only the vertical one with cylinders");
  s.number("rate_deg_per_s", rate_deg_per_s, 0.001, 720, "hinge: how fast it turns");
  s.number("angle_deg", angle_deg, -3600, 3600, "hinge: how far; swing: to each side");
  s.flag("back", back, "hinge: and back, again and again");
  s.list(
      "waypoint", [this](config::Section& item) { waypoints.emplace_back().describe(item); },
      "waypoints: by rising at_s; walk: one after the other");
}

Mover::Mover(const MoverConfig& c)
    : name_(c.name),
      back_(c.back),
      start_s_(c.start_s),
      duration_s_(c.duration_s > 0 ? c.duration_s : std::numeric_limits<double>::infinity()),
      speed_m_per_s_(c.speed_m_per_s),
      period_s_(c.period_s),
      rate_rad_per_s_(c.rate_deg_per_s * kDegree),
      angle_rad_(c.angle_deg * kDegree),
      way_(Vec3::Zero()),
      point_(vec(c.point_m)),
      axis_(vec(c.axis)) {
  if (!(axis_.norm() > 1e-6)) refuse(name_, "axis has length 0");
  axis_.normalize();
  if (c.kind == "line") {
    kind_ = Kind::kLine, way_ = vec(c.velocity_m_per_s);
  } else if (c.kind == "shuttle") {
    kind_ = Kind::kShuttle, way_ = vec(c.way_m);
    if (!(way_.norm() > 1e-6)) refuse(name_, "way_m has length 0");
  } else if (c.kind == "swing") {
    kind_ = Kind::kSwing, way_ = vec(c.amplitude_m), turns_ = c.angle_deg != 0;
  } else if (c.kind == "hinge") {
    kind_ = Kind::kHinge, turns_ = true;
  } else if (c.kind == "walk") {
    kind_ = Kind::kWaypoints;
    double at_s = start_s_;
    waypoints_.push_back({at_s, 0, Vec3::Zero()});
    for (const WaypointConfig& w : c.waypoints) {
      if (w.at_s != 0) refuse(name_, "waypoint.at_s: a walk has speed_m_per_s and wait_s");
      const double way = (vec(w.offset_m) - waypoints_.back().offset).norm();
      if (!(way > 1e-6)) refuse(name_, "waypoint.offset_m is that of the one before");
      at_s += way / speed_m_per_s_;
      waypoints_.push_back({at_s, w.turn_deg * kDegree, vec(w.offset_m)});
      turns_ |= w.turn_deg != 0;
      if (w.wait_s > 0)
        waypoints_.push_back({at_s += w.wait_s, w.turn_deg * kDegree, vec(w.offset_m)});
    }
    if (c.waypoints.empty()) refuse(name_, "no waypoint");
  } else {
    kind_ = Kind::kWaypoints;
    for (const WaypointConfig& w : c.waypoints) {
      if (!waypoints_.empty() && !(w.at_s > waypoints_.back().at_s)) {
        refuse(name_, "waypoint at " + std::to_string(w.at_s) + " s is not after the one before");
      }
      waypoints_.push_back({w.at_s, w.turn_deg * kDegree, vec(w.offset_m)});
      turns_ |= w.turn_deg != 0;
    }
    if (waypoints_.empty()) refuse(name_, "no waypoint");
  }
}

Mover::Where Mover::along_waypoints(double t_s) const noexcept {
  const auto after = std::upper_bound(waypoints_.begin(), waypoints_.end(), t_s,
                                      [](double t, const Waypoint& w) { return t < w.at_s; });
  if (after == waypoints_.begin()) return {after->offset, after->turn_rad};
  const Waypoint& a = *(after - 1);
  if (after == waypoints_.end()) return {a.offset, a.turn_rad};
  const double f = (t_s - a.at_s) / (after->at_s - a.at_s);
  return {a.offset + f * (after->offset - a.offset),
          a.turn_rad + f * (after->turn_rad - a.turn_rad)};
}

Mover::Where Mover::where(double t_s) const noexcept {
  if (kind_ == Kind::kWaypoints) return along_waypoints(t_s);
  const double t = std::clamp(t_s - start_s_, 0.0, duration_s_);
  switch (kind_) {
    case Kind::kLine:
      return {t * way_, 0};
    case Kind::kShuttle: {
      const double length = way_.norm();
      return {there_and_back(speed_m_per_s_ * t, length) / length * way_, 0};
    }
    case Kind::kSwing: {
      const double s = std::sin(2 * std::numbers::pi * t / period_s_);
      return {s * way_, s * angle_rad_};
    }
    default: {
      const double end = std::abs(angle_rad_), turn = rate_rad_per_s_ * t;
      const double by = back_ && end > 0 ? there_and_back(turn, end) : std::min(turn, end);
      return {Vec3::Zero(), std::copysign(by, angle_rad_)};
    }
  }
}

Pose Mover::moved(double t_s) const noexcept {
  const Where w = where(t_s);
  Pose X = Pose::Identity();
  if (w.turn_rad != 0) X.linear() = Eigen::AngleAxisd(w.turn_rad, axis_).toRotationMatrix();
  X.translation() = w.offset + point_ - X.linear() * point_;
  return X;
}

}  // namespace drivers
