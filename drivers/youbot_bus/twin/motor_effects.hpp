// Effects of the virtual youBot's motors and joints, each built only when its section stands in a
// file (config/effects/youbot.toml shows them all). Without any of them the motors are ideal ones.
// Values are of the four wheels, and of arm joints 1 to 5 of each arm.
//
// What the defaults are: published are k_t and gears (youbot_driver) and masses (the robot's
// description). Inertias of wheel and rotor are those of [robot.plant]. Everything else is a guess
// of the right size until it is measured on a robot.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "config/schema.hpp"
#include "drivers/youbot_bus/chain_layout.hpp"
#include "drivers/youbot_bus/twin/loaded_motors.hpp"
#include "rt/result.hpp"

namespace drivers::youbot_bus {

struct DriveValues {
  double wheel = 0;
  std::array<double, kArmJoints> joint{};
  [[nodiscard]] double of(const BoardPlace& b) const noexcept {
    return b.kind == BoardKind::kJoint ? joint[static_cast<std::size_t>(b.number - 1)] : wheel;
  }
  // Keys wheel_NAME and joint_NAME.
  void describe(config::Section&, const std::string& name, double lowest, double highest,
                const std::string& doc);
};

struct InertiaEffect {
  DriveValues rotor_kg_m2{1.35e-5, {1.35e-5, 1.35e-5, 1.35e-5, 0.92e-5, 0.92e-5}};
  DriveValues load_kg_m2{0.0152, {0.1, 0.25, 0.1, 0.03, 0.001}};  // at wheel or joint
  double current_loop_s = 0.0005;
  void describe(config::Section&);
};

struct FrictionEffect {  // at the motor's shaft
  DriveValues coulomb_Nm{0.01, {0.01, 0.01, 0.01, 0.01, 0.01}};
  DriveValues viscous_Nm_s{2e-5, {2e-5, 2e-5, 2e-5, 2e-5, 2e-5}};
  void describe(config::Section&);
};

struct BacklashEffect {  // at wheel or joint
  DriveValues gap_deg{0.5, {0.1, 0.1, 0.1, 0.2, 0.3}};
  DriveValues friction_Nm{0.1, {0.3, 0.3, 0.2, 0.1, 0.05}};
  void describe(config::Section&);
};

struct GravityEffect {
  double gripper_kg = 0.245, payload_kg = 0;
  void describe(config::Section&);
};

struct CurrentLimitEffect {
  DriveValues limit_A{8, {4, 4, 4, 2, 2}};
  void describe(config::Section&);
};

struct I2tEffect {
  DriveValues rated_A{2.3, {2.3, 2.3, 2.3, 1.1, 1.1}};
  double winding_s = 4;
  void describe(config::Section&);
};

struct MotorEffects {
  bool stop_brakes = false;
  std::optional<InertiaEffect> inertia;
  std::optional<FrictionEffect> friction;
  std::optional<BacklashEffect> backlash;
  std::optional<GravityEffect> gravity;
  std::optional<CurrentLimitEffect> current_limit;
  std::optional<I2tEffect> i2t;

  [[nodiscard]] bool any() const noexcept {
    return inertia || friction || backlash || gravity || current_limit || i2t;
  }
  // "friction, gravity"; empty: none.
  [[nodiscard]] std::string names() const;
};

// The error has one line: file, key, value and range.
[[nodiscard]] rt::Result<MotorEffects> load_motor_effects(const std::string& path);
[[nodiscard]] rt::Result<MotorEffects> read_motor_effects(const std::string& text,
                                                          const std::string& name);

// A drive under these effects, around what the chain states of it: ends of travel, start, encoder.
[[nodiscard]] LoadedDriveConfig loaded_config(const BoardPlace&, const MotorEffects&,
                                              const IdealMotorConfig&);
// The weight that the joints of an arm bear; its zero is where each joint's high stop is, or the
// place where it starts.
[[nodiscard]] std::optional<ArmWeight> arm_weight(const MotorEffects&,
                                                  const std::vector<LoadedDriveConfig>& joints);

}  // namespace drivers::youbot_bus
