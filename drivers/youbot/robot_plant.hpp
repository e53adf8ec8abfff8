// The simulated youBot base: what the wheels, the floor and the walls do with the setpoints.
//
// Time     Lazy: nothing moves until somebody advances it; then it integrates in fixed sub-steps on
//          a grid that starts at the first access. The state at an instant is the state of the last
//          sub-step not after it, so it does not depend on who asked in between or which clock
//          runs.
// Model    Wheel speeds w with the joint inertia  M = J_w I + F^T diag(m, m, I_zz) F  (F = forward
//          kinematics), a speed loop per motor with a torque limit, no slip between wheel and floor
//          unless the slip effect is named. The base moves with F w, exact on SE(2).
// Walls    A predicate says whether a base pose collides. A motion that would collide does not
//          happen: the base stands, its wheels turn on. Each entry is counted once.
// Effects  slip, wheel_slip, wheel_radius, encoder, dead_time, gear_friction: built only when their
//          config value is not zero. The slip of a wheel is a function of (seed, wheel, time) and
//          of nothing else.
// Numbers  masses and inertias: reference data of the youBot description; 0.0335 Nm/A and 1:25.838
//          of the wheel drives (youbot_driver).
// One owner (the MotorBus twin); no thread safety, no allocation after construction.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "drivers/youbot/mecanum.hpp"
#include "perception/geometry/planar.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace drivers {

// Section [robot.plant].
struct RobotPlantConfig {
  int substep_us = 100;
  int speed_loop_order = 2;          // 0: wheels follow at once; 1: lag; 2: PI loop on the inertia
  double speed_loop_rad_per_s = 50;  // bandwidth of the motors' speed loop
  double speed_loop_damping = 1.0;   // of the second-order loop
  double torque_limit_Nm = 6.9;      // at the wheel: 8 A
  double torque_per_A = 0.8656;      // at the wheel
  double mass_kg = 24.0;             // platform and battery
  double inertia_kg_m2 = 3.683;      // about z
  double wheel_inertia_kg_m2 = 0.024;  // wheel and rotor, at the wheel
  // Effects, off at zero.
  double slip_ratio = 0;  // share of the wheels' travel that the base does not make
  // Share of a wheel's travel that is lost: drawn for each wheel separately, uniformly from 0 to
  // this value.
  double wheel_slip_max = 0;
  double wheel_slip_redraw_s = 0.5;
  std::uint64_t wheel_slip_seed = 1;
  // Relative error of odometry's wheel radius, for each wheel: true rolling radius / assumed radius
  // - 1.
  std::array<double, kWheels> wheel_radius_error{};
  int encoder_ticks_per_motor_turn = 0;
  double dead_time_s = 0;       // setpoint to motor
  double gear_friction_Nm = 0;  // Coulomb, at the wheel

  void describe(config::Section& s) {
    s.integer("substep_us", substep_us, 10, 1000, "integration step");
    s.integer("speed_loop_order", speed_loop_order, 0, 2, "0 ideal, 1 lag, 2 PI loop");
    s.number("speed_loop_rad_per_s", speed_loop_rad_per_s, 1, 500, "bandwidth of the speed loop");
    s.number("speed_loop_damping", speed_loop_damping, 0.3, 3, "damping of the PI loop");
    s.number("torque_limit_Nm", torque_limit_Nm, 0.1, 50, "torque of a motor, at the wheel");
    s.number("torque_per_A", torque_per_A, 0.01, 50, "torque at the wheel per motor current");
    s.number("mass_kg", mass_kg, 1, 500, "moving mass");
    s.number("inertia_kg_m2", inertia_kg_m2, 0.01, 200, "inertia about the vertical");
    s.number("wheel_inertia_kg_m2", wheel_inertia_kg_m2, 1e-4, 10, "one wheel with its rotor");
    s.number("slip_ratio", slip_ratio, 0, 0.9, "effect: travel lost between wheel and floor");
    s.number("wheel_slip_max", wheel_slip_max, 0, 0.9,
             "effect: largest share of its travel that a wheel loses, each wheel drawn by itself");
    s.number("wheel_slip_redraw_s", wheel_slip_redraw_s, 0.01, 60,
             "the slips are drawn anew so often");
    s.seed("wheel_slip_seed", wheel_slip_seed, "of the slips");
    s.numbers("wheel_radius_error", wheel_radius_error, -0.2, 0.2,
              "effect: true radius of a wheel over robot_io.base.wheel_radius_m, less 1");
    s.integer("encoder_ticks_per_motor_turn", encoder_ticks_per_motor_turn, 0, 1 << 20,
              "effect: encoder quantisation (4000 on the youBot)");
    s.number("dead_time_s", dead_time_s, 0, 0.05, "effect: delay from setpoint to motor");
    s.number("gear_friction_Nm", gear_friction_Nm, 0, 5, "effect: Coulomb friction at the wheel");
  }
};

// True if the base at pose X_WB touches something at this instant. Pure; called at most once a
// millisecond.
using CollisionTest = std::function<bool(const perception::Pose2& X_WB, rt::Time t)>;

struct PlantState {
  rt::Time time{};          // of the last sub-step
  perception::Pose2 X_WB;   // true pose, not what odometry thinks
  perception::Twist2 v_B;   // true velocity, body frame
  WheelVector wheel_rad{};  // true
  WheelVector wheel_rad_per_s{};
  WheelVector torque_Nm{};
  std::uint32_t collisions = 0;  // entries into contact so far
  bool in_contact = false;
  double path_m = 0;  // distance driven
};

class RobotPlant {
 public:
  // Throws std::invalid_argument if the start pose is not finite or collides.
  RobotPlant(rt::NonRealtime&, const RobotPlantConfig&, const MecanumConfig&,
             const perception::Pose2& start_X_WB, CollisionTest collides = {});

  // Integrates up to `now`; the first call sets the zero of the sub-step grid. Going back is a
  // no-op.
  void advance(rt::Time now) noexcept;
  // From the first sub-step not before `at` (>= the last access), plus the dead time, these speeds
  // hold. `powered` false: motors stop (speed loop to zero, setpoints ignored).
  void command(rt::Time at, const WheelVector& wheel_rad_per_s, bool powered) noexcept;
  // Tells the plant that obstacles move. Then collisions are also tested while the robot is at
  // rest.
  void things_move() noexcept { things_move_ = true; }
  // Fault: a wheel that does not turn, or -1.
  void set_stuck_wheel(int wheel) noexcept { stuck_wheel_ = wheel; }

  [[nodiscard]] const PlantState& state() const noexcept { return state_; }
  // What the encoders say: quantised when the effect is built.
  [[nodiscard]] WheelVector encoder_rad() const noexcept;
  [[nodiscard]] WheelVector encoder_rad_per_s() const noexcept;
  [[nodiscard]] double current_A(int wheel) const noexcept {
    return state_.torque_Nm[wheel] / config_.torque_per_A;
  }
  [[nodiscard]] const Mecanum& kinematics() const noexcept { return kinematics_; }
  // Names of the effects that were built.
  [[nodiscard]] std::vector<std::string> effects() const;

 private:
  struct Slip {
    double ratio;
  };
  struct WheelSlip {
    std::int64_t redraw_steps;
    std::int64_t drawn = -1;  // number of the interval that `share` is of
    WheelVector share{};
  };
  struct Encoder {
    double rad_per_tick;
  };
  struct GearFriction {
    double torque;
  };
  struct Pending {
    std::int64_t step = 0;
    WheelVector speed{};
    bool powered = false;
  };
  // Setpoints on their way to the motor. 128 hold 50 ms of a 2 kHz bus; a full queue lets the
  // oldest act early.
  struct CommandQueue {
    std::array<Pending, 128> slots{};
    std::size_t head = 0, size = 0;
  };

  void substep() noexcept;
  void wheel_step() noexcept;
  void draw_slip() noexcept;
  void move_step(const perception::Twist2& v) noexcept;

  RobotPlantConfig config_;
  Mecanum kinematics_;
  CollisionTest collides_;
  Eigen::Matrix4d mass_, mass_inverse_;
  double kp_ = 0, ki_ = 0, dt_ = 0;
  rt::Nanos step_ns_;
  std::optional<Slip> slip_;
  std::optional<WheelSlip> wheel_slip_;
  std::optional<WheelVector> radius_;  // true over nominal
  std::optional<Encoder> encoder_;
  std::optional<GearFriction> friction_;
  std::int64_t dead_steps_ = 0;

  bool started_ = false, things_move_ = false;
  rt::Time epoch_{};
  std::int64_t steps_ = 0;
  CommandQueue queue_;
  WheelVector setpoint_{};
  Eigen::Vector4d integral_ = Eigen::Vector4d::Zero();
  int stuck_wheel_ = -1;
  perception::Pose2 checked_X_WB_;  // last pose known to be free
  std::int64_t check_every_ = 10;
  PlantState state_;
};

}  // namespace drivers
