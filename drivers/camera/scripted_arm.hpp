// The robot's arm as the synthetic camera sees it. It is an effect of the scene, built only if the
// scene asks for it.
//
//   [robot.arm]
//   description = "youbot"          # config/robots/youbot.toml
//   [[robot.arm.key]]
//   time_s = 2.0
//   angles_deg = [169, 65, -146, 102.5, 167.5]
//
// Between two keys each joint follows the minimum-jerk polynomial of fifth order, at rest at both
// ends. Before the first and after the last key it is at rest. The camera sees the capsules of the
// description.
//
// Frames: W world, B the robot's base.
#pragma once

#include <array>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "drivers/world/world.hpp"
#include "perception/geometry/articulated_body.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace drivers {

struct ArmKeyConfig {
  double time_s = 0;                   // from the start of the run
  std::array<double, 5> angles_deg{};  // of the first joints, as the description counts them
  void describe(config::Section& s);
};

// Section [robot.arm].
struct ScriptedArmConfig {
  std::string description = "youbot";
  std::deque<ArmKeyConfig> keys;
  // Effects on the reported joints; the picture shows the true ones.
  double joint_delay_ms = 0;   // reported joints are this much older than the exposure
  double joint_error_deg = 0;  // error of each reported joint
  // Age and error that the robot states; -1: the true ones.
  double stated_age_ms = -1, stated_error_deg = -1;
  PaintConfig paint{{225, 110, 25}, "checker", 0.04, 0.3};
  [[nodiscard]] bool present() const noexcept { return !keys.empty(); }
  void describe(config::Section& s);
};

class ScriptedArm {
 public:
  // Throws std::invalid_argument naming the key: times that do not rise, angles beyond the limits,
  // motion faster than a joint's limit.
  ScriptedArm(rt::NonRealtime&, const ScriptedArmConfig& config,
              const perception::RobotDescription& description, rt::Time t0);

  struct Joints {
    std::array<double, perception::JointAngles::kMost> q{}, speed{};
  };
  [[nodiscard]] Joints at(rt::Time t) const noexcept;
  // Shapes of the arm at t on a robot at X_WB. Valid until the next call.
  [[nodiscard]] std::span<const Shape> place(rt::Time t, const perception::Pose& X_WB) noexcept;
  [[nodiscard]] perception::JointAngles reported(rt::Time exposure) const noexcept;
  [[nodiscard]] const perception::ArticulatedBody& body() const noexcept { return body_; }
  [[nodiscard]] std::size_t shapes() const noexcept { return shapes_.size(); }
  [[nodiscard]] std::vector<std::string> effects() const;

 private:
  ScriptedArmConfig config_;
  perception::ArticulatedBody body_;
  rt::Time t0_;
  perception::ArticulatedBody::Links X_BL_;
  std::vector<Shape> shapes_;  // one a capsule
};

}  // namespace drivers
