#include "drivers/youbot_bus/twin/drive_motor.hpp"

#include <algorithm>

namespace drivers::youbot_bus {

namespace {

constexpr std::int64_t kStep_ns = 100'000;
constexpr double kStep_s = 1e-9 * kStep_ns;
// A motor that nobody watched for this long stands where it would stand then: a bound on the work.
constexpr std::int64_t kMostSteps = 100'000;

}  // namespace

void IdealMotor::step() noexcept {
  double wanted = 0;
  double rate = config_.acceleration_rpm_per_s;
  motion_.current_mA = 0;
  switch (command_.mode) {
    case ControllerMode::kVelocity:
      wanted = command_.value;
      break;
    case ControllerMode::kPosition:
      wanted = config_.position_gain_per_s * (command_.value - motion_.position_ticks) * 60 /
               config_.ticks_per_turn;
      break;
    case ControllerMode::kPwm:
      wanted = config_.rpm_per_duty * command_.value;
      break;
    case ControllerMode::kCurrent:
      motion_.current_mA = command_.value;
      rate = config_.rpm_per_s_per_mA * (command_.value < 0 ? -command_.value : command_.value);
      wanted = command_.value < 0 ? -config_.velocity_limit_rpm
                                  : (command_.value > 0 ? config_.velocity_limit_rpm : 0);
      if (command_.value == 0) wanted = motion_.velocity_rpm;
      break;
    default:
      break;
  }
  wanted = std::clamp(wanted, -config_.velocity_limit_rpm, config_.velocity_limit_rpm);
  const double most = rate * kStep_s;
  const double change = std::clamp(wanted - motion_.velocity_rpm, -most, most);
  if (command_.mode != ControllerMode::kCurrent)
    motion_.current_mA = change / kStep_s / config_.rpm_per_s_per_mA;
  motion_.velocity_rpm += change;
  motion_.position_ticks += motion_.velocity_rpm * config_.ticks_per_turn / 60 * kStep_s;
  stop_at_ends();
}

void IdealMotor::stop_at_ends() noexcept {
  const bool high = motion_.position_ticks >= config_.high_stop_ticks && motion_.velocity_rpm > 0;
  const bool low = motion_.position_ticks <= config_.low_stop_ticks && motion_.velocity_rpm < 0;
  if (!high && !low) return;
  motion_.position_ticks = high ? config_.high_stop_ticks : config_.low_stop_ticks;
  motion_.velocity_rpm = 0;
  if (command_.mode != ControllerMode::kCurrent)
    motion_.current_mA = high ? config_.stall_current_mA : -config_.stall_current_mA;
}

void IdealMotor::advance(rt::Time to) noexcept {
  const std::int64_t target = rt::ns_of(to) / kStep_ns;
  if (steps_ < 0) steps_ = target;
  const std::int64_t from = std::max(steps_, target - kMostSteps);
  for (std::int64_t k = from; k < target; ++k) step();
  steps_ = std::max(steps_, target);
}

void IdealMotor::command(const MotorCommand& c, rt::Time at) noexcept {
  advance(at);
  command_ = c;
}

MotorMotion IdealMotor::motion(rt::Time at) noexcept {
  advance(at);
  return motion_;
}

}  // namespace drivers::youbot_bus
