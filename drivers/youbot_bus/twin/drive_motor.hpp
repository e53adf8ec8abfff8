// What turns behind a virtual motor controller. The board asks for motion at an instant and gives
// commands; who stands behind is the caller's choice.
#pragma once

#include <cstdint>
#include <limits>

#include "drivers/youbot_bus/process_data.hpp"
#include "rt/time.hpp"

namespace drivers::youbot_bus {

struct MotorCommand {
  ControllerMode mode = ControllerMode::kStop;
  double value = 0;  // in the unit of the mode: ticks, rpm, duty, mA
};

struct MotorMotion {
  double position_ticks = 0, velocity_rpm = 0, current_mA = 0;
};

class DriveMotor {
 public:
  virtual ~DriveMotor() = default;
  // From `at` on. Not before the instant of the last call.
  virtual void command(const MotorCommand&, rt::Time at) noexcept = 0;
  [[nodiscard]] virtual MotorMotion motion(rt::Time at) noexcept = 0;

  // ---- motors with effects (loaded_motors.hpp); others have none of it
  // Motor stop from `at` on, unless another call says another instant.
  virtual void stop_from(rt::Time) noexcept {}
  // True, once: its winding got too hot, at `when`, and has no current since.
  [[nodiscard]] virtual bool take_trip(rt::Time, rt::Time&) noexcept { return false; }
  [[nodiscard]] virtual double heat_A2() const noexcept { return 0; }
  virtual void limit_current(double) noexcept {}
};

struct IdealMotorConfig {
  int ticks_per_turn = 4000;
  double acceleration_rpm_per_s = 100000;  // of the velocity loop
  double position_gain_per_s = 20;         // velocity asked for, per ticks of error
  double velocity_limit_rpm = 4000;
  double rpm_per_s_per_mA = 10;  // current mode: acceleration of a free motor
  double rpm_per_duty = 2;       // PWM mode: speed of a free motor
  double start_ticks = 0;
  // Effect: ends of the travel. A motor that pushes against one stands and takes its most current.
  double low_stop_ticks = -std::numeric_limits<double>::infinity();
  double high_stop_ticks = std::numeric_limits<double>::infinity();
  double stall_current_mA = 3000;
};

// A motor without load: its velocity goes to what the mode asks for at a constant rate. Lazy, in
// sub-steps of 100 us on a grid from time 0, so its motion does not depend on who asks.
class IdealMotor final : public DriveMotor {
 public:
  explicit IdealMotor(const IdealMotorConfig& c = {}) noexcept : config_(c) {
    motion_.position_ticks = c.start_ticks;
  }
  void command(const MotorCommand&, rt::Time at) noexcept override;
  [[nodiscard]] MotorMotion motion(rt::Time at) noexcept override;

 private:
  void step() noexcept;
  void stop_at_ends() noexcept;
  void advance(rt::Time to) noexcept;
  IdealMotorConfig config_;
  MotorCommand command_;
  MotorMotion motion_;
  std::int64_t steps_ = -1;  // sub-steps since time 0; -1: not begun
};

}  // namespace drivers::youbot_bus
