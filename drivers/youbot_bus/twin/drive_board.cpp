#include "drivers/youbot_bus/twin/drive_board.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/tmcl/youbot_parameters.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr std::uint32_t flag_bit(int bit) { return 1U << static_cast<unsigned>(bit); }
constexpr int kHalted = 4, kPwmMode = 8, kVelocityMode = 9, kPositionMode = 10, kCurrentMode = 11,
              kReached = 14, kReady = 15, kTimedOut = 16, kI2tOver = 17;

// Wraps at 32 bits, as the counter of the real board does.
std::int32_t wrapped(double ticks) noexcept {
  if (!std::isfinite(ticks)) return 0;
  return static_cast<std::int32_t>(
      static_cast<std::uint32_t>(static_cast<std::int64_t>(std::floor(ticks))));
}

bool moves(ControllerMode m) noexcept {
  return m == ControllerMode::kPosition || m == ControllerMode::kVelocity ||
         m == ControllerMode::kPwm || m == ControllerMode::kCurrent;
}

}  // namespace

DriveBoard::DriveBoard(rt::NonRealtime&, const DriveBoardConfig& c,
                       std::unique_ptr<DriveMotor> motor)
    : config_(c), motor_(std::move(motor)), timeout_ms_(c.timeout_ms) {
  power_up(rt::Time{});
}

void DriveBoard::power_up(rt::Time now) noexcept {
  namespace axis = tmcl::axis;
  parameters_.fill(0);
  parameters_[axis::kRampVelocity] = 4000;
  parameters_[axis::kMaxCurrent] = config_.max_current_mA;
  parameters_[axis::kHaltedVelocity] = 5;
  parameters_[axis::kReachedDistance] = 5;
  parameters_[axis::kAcceleration] = 2000;
  parameters_[axis::kThermalTime] = config_.thermal_ms;
  parameters_[axis::kI2tLimit] = config_.rated_mA;
  parameters_[axis::kSupplyVoltage] = 2400;
  parameters_[axis::kTemperature] = 738;  // 25 degrees Celsius
  parameters_[axis::kEncoderSteps] = 4000;
  parameters_[253] = 16;
  parameters_[251] = parameters_[254] = 1;
  user_.fill(0);
  gripper_ = {};
  timeout_ = true;
  i2t_ = initialising_ = unlocked_ = false;
  initialised_ = config_.initialised;
  last_traffic_ = now;
  stop(now);
  encoder_offset_ticks_ = motor_->motion(now).position_ticks;
  stuck_ticks_ = 0;
}

void DriveBoard::stop(rt::Time now) noexcept {
  command_ = {};
  motor_->command(command_, now);
}

void DriveBoard::advance(rt::Time now) noexcept {
  if (initialising_ && now >= initialised_at_) {
    initialising_ = false;
    initialised_ = true;
  }
  const rt::Time silent = last_traffic_ + std::chrono::milliseconds{timeout_ms_};
  if (!timeout_ && now >= silent) {
    timeout_ = true;
    stop(silent);
  }
  if (rt::Time hot{}; motor_->take_trip(now, hot)) trip_i2t(hot, now);
}

void DriveBoard::on_traffic(rt::Time now) noexcept {
  advance(now);
  last_traffic_ = now;
  if (!timeout_) motor_->stop_from(now + std::chrono::milliseconds{timeout_ms_});
}

void DriveBoard::on_state(ethercat::AlState s, rt::Time now) noexcept {
  if (s == ethercat::AlState::kNone) return power_up(now);
  if (s != ethercat::AlState::kOp) stop(now);
}

void DriveBoard::trip_i2t(rt::Time when, rt::Time now) noexcept {
  i2t_ = true;
  tripped_at_ = when;
  ++parameters_[tmcl::axis::kI2tExceeded];
  stop(now);
}

void DriveBoard::time_out(rt::Time now) noexcept {
  timeout_ = true;
  stop(now);
}

void DriveBoard::set_commutated(bool known, rt::Time now) noexcept {
  initialised_ = known;
  if (!known) stop(now);
}

void DriveBoard::set_faults(std::uint32_t bits, rt::Time now) noexcept {
  faults_ = bits;
  if (bits != 0) stop(now);
}

std::int32_t DriveBoard::position(rt::Time now) noexcept {
  if (!stuck_) stuck_ticks_ = wrapped(motor_->motion(now).position_ticks - encoder_offset_ticks_);
  return stuck_ticks_;
}

void DriveBoard::on_outputs(std::span<const std::uint8_t> bytes, rt::Time now) noexcept {
  DriveOutputs o;
  if (!decode(bytes, o)) return stop(now);
  obey(o, now);
}

void DriveBoard::obey(const DriveOutputs& o, rt::Time now) noexcept {
  advance(now);
  const bool finds = o.mode == ControllerMode::kInitialise ||
                     (config_.firmware >= 200 && o.mode == ControllerMode::kVelocity);
  if (finds && !initialised_ && !initialising_ && !timeout_) {
    initialising_ = true;
    initialised_at_ = now + config_.initialise_time;
  }
  if (o.mode == ControllerMode::kNoAction) return;
  if (o.mode == ControllerMode::kSetPosition) {
    encoder_offset_ticks_ = motor_->motion(now).position_ticks - o.value;
    return stop(now);
  }
  if (!moves(o.mode) || timeout_ || i2t_ || !initialised_ || faults_ != 0) return stop(now);
  command_ = {o.mode, static_cast<double>(o.value)};
  MotorCommand physical = command_;
  if (o.mode == ControllerMode::kPosition) physical.value += encoder_offset_ticks_;
  motor_->command(physical, now);
}

std::uint32_t DriveBoard::flags(rt::Time now) noexcept {
  advance(now);
  const MotorMotion m = motor_->motion(now);
  std::uint32_t word = faults_;
  if (std::abs(m.velocity_rpm) < parameters_[tmcl::axis::kHaltedVelocity])
    word |= flag_bit(kHalted);
  if (command_.mode == ControllerMode::kPwm) word |= flag_bit(kPwmMode);
  if (command_.mode == ControllerMode::kVelocity) word |= flag_bit(kVelocityMode);
  if (command_.mode == ControllerMode::kCurrent) word |= flag_bit(kCurrentMode);
  if (command_.mode == ControllerMode::kPosition) {
    word |= flag_bit(kPositionMode);
    const double away = command_.value - (m.position_ticks - encoder_offset_ticks_);
    if (std::abs(away) <= parameters_[tmcl::axis::kReachedDistance]) word |= flag_bit(kReached);
  }
  if (initialised_) word |= flag_bit(kReady);
  if (timeout_) word |= flag_bit(kTimedOut);
  if (i2t_) word |= flag_bit(kI2tOver);
  return word;
}

void DriveBoard::fill_inputs(std::span<std::uint8_t> into, rt::Time now) noexcept {
  DriveInputs in;
  in.flags = flags(now);
  const MotorMotion m = motor_->motion(now);
  in.position_ticks = position(now);
  in.current_mA = static_cast<std::int32_t>(std::lround(m.current_mA));
  in.velocity_rpm = stuck_ ? 0 : static_cast<std::int32_t>(std::lround(m.velocity_rpm));
  in.temperature_adc = parameters_[tmcl::axis::kTemperature];
  const auto target = static_cast<std::int32_t>(command_.value);
  if (command_.mode == ControllerMode::kPwm) in.pwm = target;
  if (command_.mode == ControllerMode::kPosition) in.target_position_ticks = target;
  if (command_.mode == ControllerMode::kCurrent) in.target_current_mA = target;
  if (command_.mode == ControllerMode::kVelocity)
    in.target_velocity_rpm = in.ramp_velocity_rpm = target;
  (void)encode(in, into);
}

}  // namespace drivers::youbot_bus
