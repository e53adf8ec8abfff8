#include "drivers/camera/scripted_arm.hpp"
#include "rt/effect_count.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>

namespace drivers {

using perception::Pose;

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kPeakOfLeastJerk = 1.875;  // of its mean speed

[[noreturn]] void refuse(std::size_t key, const std::string& what, double value,
                         const std::string& allowed) {
  std::ostringstream os;
  os << "key 'robot.arm.key[" << key << "]." << what << "' = " << value << ": allowed " << allowed;
  throw std::invalid_argument(os.str());
}

std::string range(double lo, double hi) {
  std::ostringstream os;
  os << lo << ".." << hi;
  return os.str();
}

}  // namespace

void ArmKeyConfig::describe(config::Section& s) {
  s.number("time_s", time_s, 0, 86400, "from the start of the run")
      .numbers("angles_deg", angles_deg, -720, 720,
               "of the joints, as the description counts them");
}

void ScriptedArmConfig::describe(config::Section& s) {
  s.text("description", description, {}, "of the robot: a name in config/robots, or a file")
      .list(
          "key", [this](config::Section& item) { keys.emplace_back().describe(item); },
          "effect: an arm that the camera sees, where it is when; none: no arm")
      .number("joint_delay_ms", joint_delay_ms, 0, 1000,
              "effect: the joints reported are those of so long before")
      .number("joint_error_deg", joint_error_deg, -30, 30,
              "effect: each joint is reported so far off")
      .number("stated_age_ms", stated_age_ms, -1, 1000,
              "what the robot says of the delay; -1: what it is")
      .number("stated_error_deg", stated_error_deg, -1, 30,
              "what the robot says of the error; -1: what it is");
  paint.describe(s.section("paint", "of the arm"));
}

ScriptedArm::ScriptedArm(rt::NonRealtime&, const ScriptedArmConfig& config,
                         const perception::RobotDescription& description, rt::Time t0)
    : config_(config), body_(description), t0_(t0) {
  const auto joints = body_.joints();
  if (joints.size() < config.keys.front().angles_deg.size())
    throw std::invalid_argument("key 'robot.arm.description' = \"" + config.description +
                                "\": has " + std::to_string(joints.size()) +
                                " joints, allowed 5 or more");
  for (std::size_t k = 0; k < config.keys.size(); ++k) {
    const ArmKeyConfig& key = config.keys[k];
    if (k > 0 && !(key.time_s > config.keys[k - 1].time_s))
      refuse(k, "time_s", key.time_s, "more than the time of the key before");
    for (std::size_t j = 0; j < key.angles_deg.size(); ++j) {
      const auto& joint = joints[j];
      const std::string what = "angles_deg[" + std::to_string(j) + "]";
      const double q = key.angles_deg[j] * kDegree;
      if (!(q >= joint.lower - 1e-9 && q <= joint.upper + 1e-9))
        refuse(k, what, key.angles_deg[j], range(joint.lower / kDegree, joint.upper / kDegree));
      if (k == 0 || !(joint.max_speed > 0)) continue;
      const ArmKeyConfig& last = config.keys[k - 1];
      const double peak = kPeakOfLeastJerk * std::abs(key.angles_deg[j] - last.angles_deg[j]) /
                          (key.time_s - last.time_s);
      if (peak > joint.max_speed / kDegree)
        refuse(k, what, key.angles_deg[j],
               "what the joint reaches at up to " + std::to_string(joint.max_speed / kDegree) +
                   " deg/s; this way takes " + std::to_string(peak));
    }
  }
  rt::effect_built(rt::Effect::kArm);
  if (config.joint_delay_ms > 0) rt::effect_built(rt::Effect::kJointsLate);
  if (config.joint_error_deg != 0) rt::effect_built(rt::Effect::kJointsWrong);
  Paint paint;
  const auto byte = [](double v) { return static_cast<std::uint8_t>(v + 0.5); };
  paint.colour = {byte(config.paint.colour[0]), byte(config.paint.colour[1]),
                  byte(config.paint.colour[2])};
  paint.texture = config.paint.texture == "plain"     ? Paint::Texture::kPlain
                  : config.paint.texture == "checker" ? Paint::Texture::kChecker
                                                      : Paint::Texture::kNoise;
  paint.cell_m = config.paint.cell_m;
  paint.contrast = config.paint.contrast;
  body_.forward({}, X_BL_);
  for (int i = 0; i < body_.capsules(); ++i) {
    const perception::Capsule c = body_.capsule_B(i, X_BL_);
    shapes_.push_back(make_capsule("arm " + std::to_string(i), c.a, c.b, c.radius, paint));
    derive(shapes_.back());
  }
}

ScriptedArm::Joints ScriptedArm::at(rt::Time t) const noexcept {
  const double s = rt::seconds(t - t0_);
  Joints out;
  const auto joints = body_.joints();
  body_.rest(out.q);
  const auto& keys = config_.keys;
  std::size_t next = 0;
  while (next < keys.size() && keys[next].time_s <= s) ++next;
  const ArmKeyConfig& from = keys[next == 0 ? 0 : next - 1];
  const ArmKeyConfig& to = keys[std::min(next, keys.size() - 1)];
  const double length = to.time_s - from.time_s;
  const double u = length > 0 ? std::clamp((s - from.time_s) / length, 0.0, 1.0) : 0.0;
  const double way = u * u * u * (10 + u * (-15 + 6 * u));
  const double rate = length > 0 ? 30 * u * u * (1 - u) * (1 - u) / length : 0.0;
  for (std::size_t j = 0; j < std::min(joints.size(), from.angles_deg.size()); ++j) {
    const double a = from.angles_deg[j] * kDegree, b = to.angles_deg[j] * kDegree;
    out.q[j] = a + (b - a) * way;
    out.speed[j] = (b - a) * rate;
  }
  return out;
}

std::span<const Shape> ScriptedArm::place(rt::Time t, const Pose& X_WB) noexcept {
  rt::effect_ran(rt::Effect::kArm);
  body_.forward(at(t).q, X_BL_);
  for (int i = 0; i < body_.capsules(); ++i) {
    const perception::Capsule c = body_.capsule_B(i, X_BL_);
    place_capsule(X_WB * c.a, X_WB * c.b, shapes_[static_cast<std::size_t>(i)].X_WS);
  }
  return shapes_;
}

perception::JointAngles ScriptedArm::reported(rt::Time exposure) const noexcept {
  if (config_.joint_delay_ms > 0) rt::effect_ran(rt::Effect::kJointsLate);
  if (config_.joint_error_deg != 0) rt::effect_ran(rt::Effect::kJointsWrong);
  const Joints then = at(exposure - rt::nanos_from_seconds(config_.joint_delay_ms * 1e-3));
  perception::JointAngles out;
  out.count = static_cast<int>(body_.joints().size());
  for (std::size_t j = 0; j < body_.joints().size(); ++j) {
    out.position[j] = static_cast<float>(then.q[j] + config_.joint_error_deg * kDegree);
    out.speed[j] = static_cast<float>(then.speed[j]);
  }
  const double age_ms = config_.stated_age_ms < 0 ? config_.joint_delay_ms : config_.stated_age_ms;
  const double error_deg =
      config_.stated_error_deg < 0 ? std::abs(config_.joint_error_deg) : config_.stated_error_deg;
  out.age_s = static_cast<float>(age_ms * 1e-3);
  out.error = static_cast<float>(error_deg * kDegree);
  return out;
}

std::vector<std::string> ScriptedArm::effects() const {
  std::vector<std::string> out{"an arm before the camera"};
  if (config_.joint_delay_ms > 0) out.emplace_back("joints reported late");
  if (config_.joint_error_deg != 0) out.emplace_back("joints reported wrong");
  return out;
}

}  // namespace drivers
