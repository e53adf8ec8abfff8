// One virtual motor with what it has to move: current loop, rotor, gear with its play, load,
// winding. Every effect is off at its value here.
//
// Control   the loops of the board, ours: velocity by a PI loop at 100 rad/s on the whole inertia,
//           position as in the ideal motor above it, duty as a speed. The current that they ask for
//           is limited, and comes by a first-order lag.
// Motion    torque = k_t * current. Coulomb friction takes at most what would stop the shaft, so it
//           also holds a shaft at rest. Speeds by Euler, viscous friction implicit, positions by
//           the mean of both speeds: exact under a constant torque.
// Play      `gap_rad` of the output between two flanks. A flank that does not push lets go; in the
//           gap rotor and load move each by itself; where they meet they go on together, and no
//           momentum is lost. The load has a friction of its own, which makes it lag.
// Winding   the mean of current squared with `thermal_s` as time constant. Above rated_A squared it
//           trips: no current until the next command that moves, and a note of the instant.
// Stop      motor stop takes the current away, or (`brakes`) asks for velocity 0. Which of them the
//           real boards do is not published.
// Nothing allocates or throws.
#pragma once

#include <limits>

#include "drivers/youbot_bus/twin/drive_motor.hpp"

namespace drivers::youbot_bus {

struct LoadedDriveConfig {
  double gear = 1;  // turns of the motor for one of the output
  double torque_Nm_per_A = 0.0335;
  double rotor_kg_m2 = 3.2e-5;  // free acceleration as that of the ideal motor
  double load_kg_m2 = 0;        // at the output
  double current_loop_s = 0;
  double current_limit_A = 8;               // the boards' own, axis parameter 6
  double coulomb_Nm = 0, viscous_Nm_s = 0;  // at the shaft
  double gap_rad = 0, load_coulomb_Nm = 0;  // at the output
  double rated_A = 0, thermal_s = 1;        // rated 0: never warm
  bool brakes = false;
  double start_rad = 0;  // of the output
  double low_stop_rad = -std::numeric_limits<double>::infinity();
  double high_stop_rad = std::numeric_limits<double>::infinity();
  IdealMotorConfig control;  // encoder, limits and gains alone
};

class LoadedDrive {
 public:
  explicit LoadedDrive(const LoadedDriveConfig&) noexcept;
  void command(const MotorCommand&) noexcept;
  void limit_current(double limit_A) noexcept { config_.current_limit_A = limit_A; }
  // The load's weight acts on the output. True: the winding has tripped in this step.
  [[nodiscard]] bool step(double dt_s, double load_Nm) noexcept;

  [[nodiscard]] MotorMotion motion() const noexcept;
  [[nodiscard]] double output_rad() const noexcept { return load_rad_; }
  // The winding's mean of current squared, A^2.
  [[nodiscard]] double heat_A2() const noexcept { return heat_A2_; }

 private:
  [[nodiscard]] double wanted_A(double dt_s) noexcept;
  [[nodiscard]] double velocity_loop(double wanted_rad_per_s, double dt_s) noexcept;
  [[nodiscard]] bool warm(double dt_s) noexcept;
  void move_together(double torque_Nm, double load_Nm, double dt_s) noexcept;
  void move_apart(double torque_Nm, double load_Nm, double dt_s) noexcept;
  void meet() noexcept;
  void stop_at_end() noexcept;
  [[nodiscard]] double load_alone(double load_Nm, double dt_s) const noexcept;

  LoadedDriveConfig config_;
  double inertia_ = 0, load_inertia_ = 0;  // of all at the shaft; of the load, never 0 with play
  MotorCommand command_;
  bool off_ = true;  // no current
  double integral_rad_ = 0, current_A_ = 0, heat_A2_ = 0;
  double rotor_rad_ = 0, rotor_rad_per_s_ = 0, load_rad_ = 0, load_rad_per_s_ = 0;
  int flank_ = 0;  // that pushes: 1 forward, -1 backward, 0 in the gap
};

}  // namespace drivers::youbot_bus
