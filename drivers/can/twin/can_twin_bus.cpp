#include "drivers/can/twin/can_twin_bus.hpp"

#include <cmath>
#include <numbers>

namespace drivers::can {

namespace {
constexpr double kRadPerTurn = 2 * std::numbers::pi;
}

std::vector<TmclModule> CanTwinBus::modules_of(const CanMotorConfig& c) {
  std::vector<TmclModule> modules(kWheels);
  for (std::size_t i = 0; i < kWheels; ++i) {
    modules[i].id = static_cast<std::uint32_t>(c.request_ids[i]);
    modules[i].address = static_cast<std::uint8_t>(c.module_addresses[i]);
    modules[i].reply_id = static_cast<std::uint32_t>(c.reply_id);
  }
  return modules;
}

CanTwinBus::CanTwinBus(rt::NonRealtime& nrt, MotorBus& robot, const CanMotorConfig& config)
    : robot_(robot), config_(config), port_(nrt, modules_of(config)), bus_(nrt, port_, config) {}

BusStatus CanTwinBus::sense(rt::Time now, MotorStates& states) noexcept {
  const std::int64_t cpu = cpu_clock_ != nullptr ? cpu_clock_() : 0;
  port_.advance(now);  // what was sent in the last job, with what the motors did then
  turn_motors(now);
  if (cpu_clock_ != nullptr) twin_cpu_ns_ += cpu_clock_() - cpu;
  return bus_.sense(now, states);
}

BusStatus CanTwinBus::act(rt::Time now, const MotorSetpoints& setpoints) noexcept {
  return bus_.act(now, setpoints);
}

void CanTwinBus::turn_motors(rt::Time now) noexcept {
  MotorSetpoints s;
  const double rad_per_s_per_rpm = kRadPerTurn / 60 / config_.gear_ratio;
  bool any = false;
  for (std::size_t i = 0; i < kWheels; ++i) {
    TmclModule& m = port_.modules()[i];
    m.turning = m.turning && !m.silent && !m.timed_out && !m.tripped;
    any = any || m.turning;
    s.wheel_rad_per_s[i] = m.turning ? m.target_rpm * rad_per_s_per_rpm : 0;
  }
  s.mode = any ? MotorMode::kVelocity : MotorMode::kStop;
  if (robot_.exchange(now, s, robot_states_) != BusStatus::kOk) return;
  const double ticks_per_rad = config_.ticks_per_motor_turn * config_.gear_ratio / kRadPerTurn;
  for (std::size_t i = 0; i < kWheels; ++i) {
    TmclModule& m = port_.modules()[i];
    const auto ticks =
        static_cast<std::int64_t>(std::floor(robot_states_.wheel_rad[i] * ticks_per_rad));
    m.position = static_cast<std::int32_t>(static_cast<std::uint32_t>(ticks));
    m.rpm = static_cast<std::int32_t>(
        std::lround(robot_states_.wheel_rad_per_s[i] / rad_per_s_per_rpm));
    m.current_mA = static_cast<std::int32_t>(std::lround(robot_states_.current_A[i] * 1000));
    m.flags = robot_states_.flags[i];
  }
}

void CanTwinBus::rearm() noexcept {
  robot_.rearm();
  bus_.rearm();
}

void CanTwinBus::make_safe() noexcept { bus_.make_safe(); }

}  // namespace drivers::can
