#include "perception/geometry/articulated_body.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>

namespace perception {

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kFar = 10;  // m, a robot's largest dimension

Vec3 vec(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }

// R = Rz(yaw) Ry(pitch) Rx(roll), as URDF has it.
Pose pose_of(const std::array<double, 3>& p, const std::array<double, 3>& rpy_deg) {
  Pose X = Pose::Identity();
  X.linear() = (Eigen::AngleAxisd(rpy_deg[2] * kDegree, Vec3::UnitZ()) *
                Eigen::AngleAxisd(rpy_deg[1] * kDegree, Vec3::UnitY()) *
                Eigen::AngleAxisd(rpy_deg[0] * kDegree, Vec3::UnitX()))
                   .toRotationMatrix();
  X.translation() = vec(p);
  return X;
}

std::string quoted(const std::string& s) { return "\"" + s.substr(0, 60) + "\""; }

std::string text(double v) {
  std::ostringstream os;
  os << v;
  return os.str();
}

}  // namespace

void CapsuleConfig::describe(config::Section& s) {
  s.numbers("from_m", from_m, -kFar, kFar, "one end of the axis, in the link's frame")
      .numbers("to_m", to_m, -kFar, kFar, "the other end; the same: a ball")
      .number("radius_m", radius_m, 0.001, kFar, "about the axis");
}

void LinkConfig::describe(config::Section& s) {
  s.text("name", name, {}, "unique name of the link")
      .text("parent", parent, {}, "link that carries it, stands before it; empty: the base")
      .text("joint", joint, {"fixed", "revolute", "prismatic"}, "how it moves against its parent")
      .numbers("origin_m", origin_m, -kFar, kFar, "of the joint in the parent's frame")
      .numbers("rpy_deg", rpy_deg, -360, 360, "turn of the joint's frame: Rz(y) Ry(p) Rx(r)")
      .numbers("axis", axis, -1, 1, "of the joint, in its own frame")
      .number("lower", lower, -1000, 1000, "least coordinate, rad or m")
      .number("upper", upper, -1000, 1000, "largest coordinate, rad or m")
      .number("zero", zero, -1000, 1000,
              "coordinate at which the link stands as origin_m and rpy_deg say, rad or m")
      .number("max_speed", max_speed, 0, 1000, "rad/s or m/s")
      .number("max_effort", max_effort, 0, 1e5, "N m or N; 0: not known")
      .number("mass_kg", mass_kg, 0, 1e4, "0: not known")
      .list(
          "capsule", [this](config::Section& item) { capsules.emplace_back().describe(item); },
          "what is solid of the link");
}

void BaseBoxConfig::describe(config::Section& s) {
  s.text("name", name, {}, "what it is")
      .numbers("centre_m", centre_m, -kFar, kFar, "in B")
      .numbers("size_m", size_m, 0.001, kFar, "edges along B's x, y, z");
}

void RobotDescription::describe(config::Section& s) {
  s.text("name", name, {}, "of the robot")
      .text("gripper", gripper, {}, "link that holds things; empty: none")
      .list(
          "link", [this](config::Section& item) { links.emplace_back().describe(item); },
          "links, a parent before its children")
      .list(
          "base_box", [this](config::Section& item) { base_boxes.emplace_back().describe(item); },
          "what of the base can bump, upright in B");
  s.section("camera", "mount of the RGB-D camera")
      .numbers("position_m", camera_position_m, -kFar, kFar, "of the lens in B")
      .number("yaw_deg", camera_yaw_deg, -180, 180, "positive: looks to the left")
      .number("pitch_deg", camera_pitch_deg, -90, 90, "positive: looks down");
}

rt::Result<bool> RobotDescription::check() const {
  std::size_t joints = 0, capsules = 0;
  for (std::size_t i = 0; i < links.size(); ++i) {
    const LinkConfig& l = links[i];
    const std::string at = "link[" + std::to_string(i) + "].";
    const auto before = [&](const std::string& n) {
      return std::any_of(links.begin(), links.begin() + static_cast<std::ptrdiff_t>(i),
                         [&n](const LinkConfig& o) { return o.name == n; });
    };
    if (l.name.empty()) return rt::Error{"key '" + at + "name' = \"\": allowed a name"};
    if (before(l.name))
      return rt::Error{"key '" + at + "name' = " + quoted(l.name) +
                       ": allowed a name that no link before it has"};
    if (!l.parent.empty() && !before(l.parent))
      return rt::Error{"key '" + at + "parent' = " + quoted(l.parent) +
                       ": allowed the name of a link before it, or \"\" for the base"};
    if (l.joint != "fixed") {
      ++joints;
      if (!(vec(l.axis).norm() > 1e-6))
        return rt::Error{"key '" + at + "axis' = [0, 0, 0]: allowed any length but 0"};
      if (!(l.lower <= l.upper))
        return rt::Error{"key '" + at + "lower' = " + text(l.lower) +
                         ": allowed up to upper = " + text(l.upper)};
    }
    capsules += l.capsules.size();
  }
  if (links.size() > ArticulatedBody::kMostLinks)
    return rt::Error{"key 'link' = " + std::to_string(links.size()) + " links: allowed 0.." +
                     std::to_string(ArticulatedBody::kMostLinks)};
  if (joints > JointAngles::kMost)
    return rt::Error{"key 'link' = " + std::to_string(joints) + " joints that move: allowed 0.." +
                     std::to_string(JointAngles::kMost)};
  if (capsules > ArticulatedBody::kMostCapsules)
    return rt::Error{"key 'link.capsule' = " + std::to_string(capsules) + " capsules: allowed 0.." +
                     std::to_string(ArticulatedBody::kMostCapsules)};
  if (!gripper.empty() && std::none_of(links.begin(), links.end(),
                                       [this](const LinkConfig& l) { return l.name == gripper; }))
    return rt::Error{"key 'gripper' = " + quoted(gripper) +
                     ": allowed the name of a link, or \"\" for none"};
  return true;
}

rt::Result<RobotDescription> load_robot(const std::string& path) {
  RobotDescription d;
  config::Section schema;
  d.describe(schema);
  if (auto ok = config::load_file(path, schema); !ok) return rt::Error{ok.error()};
  if (auto ok = d.check(); !ok) return rt::Error{path + ": " + ok.error()};
  return d;
}

ArticulatedBody::ArticulatedBody(const RobotDescription& d) {
  if (auto ok = d.check(); !ok) throw std::invalid_argument("robot " + d.name + ": " + ok.error());
  for (const LinkConfig& l : d.links) {
    Link link;
    link.name = l.name;
    link.parent = l.parent.empty() ? -1 : find(l.parent);
    link.X_PJ = pose_of(l.origin_m, l.rpy_deg);
    if (l.joint != "fixed") {
      link.joint = static_cast<int>(joints_.size());
      link.axis = vec(l.axis).normalized();
      link.zero = l.zero;
      link.prismatic = l.joint == "prismatic";
      joints_.push_back({link.prismatic ? Joint::Kind::kPrismatic : Joint::Kind::kRevolute,
                         static_cast<int>(links_.size()), l.name, l.lower, l.upper, l.max_speed});
    }
    for (const CapsuleConfig& c : l.capsules)
      capsules_.push_back(
          {static_cast<int>(links_.size()), {vec(c.from_m), vec(c.to_m), c.radius_m}});
    links_.push_back(std::move(link));
  }
  gripper_ = d.gripper.empty() ? -1 : find(d.gripper);
}

int ArticulatedBody::find(std::string_view link) const noexcept {
  for (std::size_t i = 0; i < links_.size(); ++i)
    if (links_[i].name == link) return static_cast<int>(i);
  return -1;
}

void ArticulatedBody::rest(std::span<double> q) const noexcept {
  for (const Link& l : links_) {
    const auto j = static_cast<std::size_t>(l.joint);
    if (l.joint >= 0 && j < q.size()) q[j] = l.zero;
  }
}

void ArticulatedBody::forward(std::span<const double> q, Links& X_BL) const noexcept {
  for (std::size_t i = 0; i < links_.size(); ++i) {
    const Link& l = links_[i];
    Pose X = l.X_PJ;
    if (l.joint >= 0) {
      const auto j = static_cast<std::size_t>(l.joint);
      const double move = (j < q.size() ? q[j] : l.zero) - l.zero;
      if (l.prismatic)
        X.translation() += X.linear() * (move * l.axis);
      else
        X.linear() = (X.linear() * Eigen::AngleAxisd(move, l.axis)).eval();
    }
    X_BL[i] = l.parent < 0 ? X : X_BL[static_cast<std::size_t>(l.parent)] * X;
  }
}

Capsule ArticulatedBody::capsule_B(int i, const Links& X_BL) const noexcept {
  const LinkCapsule& l = capsules_[static_cast<std::size_t>(i)];
  const Pose& X = X_BL[static_cast<std::size_t>(l.link)];
  return {X * l.c.a, X * l.c.b, l.c.radius};
}

double ArticulatedBody::reach_of_error(const Capsule& c_B, int link, const Links& X_BL,
                                       std::span<const double> speed, double error,
                                       double age_s) const noexcept {
  double off = 0;
  Vec3 v_a = Vec3::Zero(), v_b = Vec3::Zero();  // of the ends, in B
  double spin = 0;
  for (int at = link; at >= 0; at = links_[static_cast<std::size_t>(at)].parent) {
    const Link& l = links_[static_cast<std::size_t>(at)];
    if (l.joint < 0) continue;
    const Pose& X = X_BL[static_cast<std::size_t>(at)];
    const Vec3 axis = X.linear() * l.axis;  // turning about it leaves it where it is
    const auto j = static_cast<std::size_t>(l.joint);
    const double rate = j < speed.size() ? speed[j] : 0;
    if (l.prismatic) {
      off += error;
      v_a += rate * axis, v_b += rate * axis;
      continue;
    }
    const Vec3 turn_a = axis.cross(c_B.a - X.translation());
    const Vec3 turn_b = axis.cross(c_B.b - X.translation());
    // The farthest point of a convex thing lies at an end.
    off += error * (std::max(turn_a.norm(), turn_b.norm()) + c_B.radius);
    v_a += rate * turn_a, v_b += rate * turn_b;
    spin += std::abs(rate);
  }
  return off + age_s * (std::max(v_a.norm(), v_b.norm()) + spin * c_B.radius);
}

}  // namespace perception
