#include "drivers/youbot_bus/twin/motor_effects.hpp"

#include <cmath>
#include <numbers>

#include "drivers/youbot_bus/youbot_setup.hpp"

namespace drivers::youbot_bus {

namespace {

// Source: youbot_driver, config files: torque per current at the motor's shaft.
const DriveValues kTorque_Nm_per_A{0.0335, {0.0335, 0.0335, 0.0335, 0.051, 0.049}};

// What the file's sections are read into, and which of them it names.
struct EffectsFile {
  std::string motor_stop = "off";
  InertiaEffect inertia;
  FrictionEffect friction;
  BacklashEffect backlash;
  GravityEffect gravity;
  CurrentLimitEffect current_limit;
  I2tEffect i2t;

  void describe(config::Section& s) {
    s.text("motor_stop", motor_stop, {"off", "brake"},
           "mode 0 of a drive with effects: no current, or velocity 0");
    inertia.describe(s.section("inertia", "effect: rotor and load, and the current loop's lag"));
    friction.describe(s.section("friction", "effect: friction at the motor's shaft"));
    backlash.describe(s.section("backlash", "effect: play of the gear"));
    gravity.describe(s.section("gravity", "effect: the arm's weight"));
    current_limit.describe(s.section("current_limit", "effect: most current of a drive"));
    i2t.describe(s.section("i2t", "effect: a winding that gets warm, and trips"));
  }
  [[nodiscard]] MotorEffects named(const config::Section& s) const {
    MotorEffects out;
    out.stop_brakes = motor_stop == "brake";
    if (s.named("inertia")) out.inertia = inertia;
    if (s.named("friction")) out.friction = friction;
    if (s.named("backlash")) out.backlash = backlash;
    if (s.named("gravity")) out.gravity = gravity;
    if (s.named("current_limit")) out.current_limit = current_limit;
    if (s.named("i2t")) out.i2t = i2t;
    return out;
  }
};

template <class Load>
rt::Result<MotorEffects> read_effects(const Load& load) {
  EffectsFile file;
  config::Section schema;
  file.describe(schema);
  if (const auto read = load(schema); !read) return rt::Error{read.error()};
  return file.named(schema);
}

}  // namespace

void DriveValues::describe(config::Section& s, const std::string& name, double lowest,
                           double highest, const std::string& doc) {
  s.number("wheel_" + name, wheel, lowest, highest, doc + ", of a wheel's drive");
  s.numbers("joint_" + name, joint, lowest, highest, doc + ", of the drives of joints 1 to 5");
}

void InertiaEffect::describe(config::Section& s) {
  rotor_kg_m2.describe(s, "rotor_kg_m2", 1e-7, 1e-2, "inertia of the rotor");
  load_kg_m2.describe(s, "load_kg_m2", 0, 100, "inertia behind the gear, at wheel or joint");
  s.number("current_loop_s", current_loop_s, 0, 0.05, "time constant of the current loop; 0: none");
}

void FrictionEffect::describe(config::Section& s) {
  coulomb_Nm.describe(s, "coulomb_Nm", 0, 10, "Coulomb friction at the motor's shaft");
  viscous_Nm_s.describe(s, "viscous_Nm_s", 0, 0.1, "viscous friction at the motor's shaft");
}

void BacklashEffect::describe(config::Section& s) {
  gap_deg.describe(s, "gap_deg", 0, 10, "play from flank to flank, at wheel or joint");
  friction_Nm.describe(s, "friction_Nm", 0, 50, "friction behind the gear, at wheel or joint");
}

void GravityEffect::describe(config::Section& s) {
  s.number("gripper_kg", gripper_kg, 0, 2, "mass of the gripper, at the palm");
  s.number("payload_kg", payload_kg, 0, 5, "mass that it holds");
}

void CurrentLimitEffect::describe(config::Section& s) {
  limit_A.describe(s, "limit_A", 0.01, 20, "most current");
}

void I2tEffect::describe(config::Section& s) {
  rated_A.describe(s, "rated_A", 0.01, 20, "current that a winding bears for ever");
  s.number("winding_s", winding_s, 0.001, 1000, "thermal time constant of a winding");
}

std::string MotorEffects::names() const {
  std::string out;
  const auto add = [&](bool on, const char* name) {
    if (on) out += (out.empty() ? "" : ", ") + std::string(name);
  };
  add(inertia.has_value(), "inertia");
  add(friction.has_value(), "friction");
  add(backlash.has_value(), "backlash");
  add(gravity.has_value(), "gravity");
  add(current_limit.has_value(), "current_limit");
  add(i2t.has_value(), "i2t");
  return out;
}

rt::Result<MotorEffects> load_motor_effects(const std::string& path) {
  return read_effects([&](config::Section& s) { return config::load_file(path, s); });
}

rt::Result<MotorEffects> read_motor_effects(const std::string& text, const std::string& name) {
  return read_effects([&](config::Section& s) { return config::load_text(text, name, s); });
}

LoadedDriveConfig loaded_config(const BoardPlace& b, const MotorEffects& e,
                                const IdealMotorConfig& ideal) {
  constexpr double kTurn_rad = 2 * std::numbers::pi;
  LoadedDriveConfig c;
  c.control = ideal;
  c.gear = gear_of(b);
  c.torque_Nm_per_A = kTorque_Nm_per_A.of(b);
  // Without the effect of inertia it accelerates by a current as the ideal motor.
  c.rotor_kg_m2 = c.torque_Nm_per_A * 1e-3 / (ideal.rpm_per_s_per_mA * kTurn_rad / 60);
  c.brakes = e.stop_brakes;
  if (e.inertia) {
    c.rotor_kg_m2 = e.inertia->rotor_kg_m2.of(b);
    c.load_kg_m2 = e.inertia->load_kg_m2.of(b);
    c.current_loop_s = e.inertia->current_loop_s;
  }
  if (e.friction) {
    c.coulomb_Nm = e.friction->coulomb_Nm.of(b);
    c.viscous_Nm_s = e.friction->viscous_Nm_s.of(b);
  }
  if (e.backlash) {
    c.gap_rad = e.backlash->gap_deg.of(b) * kTurn_rad / 360;
    c.load_coulomb_Nm = e.backlash->friction_Nm.of(b);
  }
  if (e.current_limit) c.current_limit_A = e.current_limit->limit_A.of(b);
  if (e.i2t) {
    c.rated_A = e.i2t->rated_A.of(b);
    c.thermal_s = e.i2t->winding_s;
  }
  const double rad_per_tick = kTurn_rad / ideal.ticks_per_turn / c.gear;
  c.start_rad = ideal.start_ticks * rad_per_tick;
  c.low_stop_rad = ideal.low_stop_ticks * rad_per_tick;
  c.high_stop_rad = ideal.high_stop_ticks * rad_per_tick;
  return c;
}

std::optional<ArmWeight> arm_weight(const MotorEffects& e,
                                    const std::vector<LoadedDriveConfig>& joints) {
  if (!e.gravity || joints.size() != static_cast<std::size_t>(kArmJoints)) return std::nullopt;
  ArmWeight w;
  w.masses.gripper_kg = e.gravity->gripper_kg;
  w.masses.payload_kg = e.gravity->payload_kg;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    w.sign[j] = joint_facts(static_cast<int>(j) + 1).sign;
    const double stop = joints[j].high_stop_rad;
    w.zero_rad[j] = std::isfinite(stop) ? stop : joints[j].start_rad;
  }
  return w;
}

}  // namespace drivers::youbot_bus
