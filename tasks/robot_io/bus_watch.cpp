#include "tasks/robot_io/bus_watch.hpp"

#include <cmath>

#include "drivers/youbot/motor_flags.hpp"

namespace tasks {

namespace {

using drivers::BusStatus;
using drivers::BusTrouble;
using rt::Health;
using rt::Severity;

constexpr rt::Nanos kStandsFor = std::chrono::milliseconds{100};
constexpr double kToldLeast_rad_per_s = 0.5, kTurnedLeast_rad = 1e-3;

rt::FaultId name_of(BusStatus read, BusTrouble t) noexcept {
  if (read != BusStatus::kDown)
    return t == BusTrouble::kWorkingCounter ? robot_io_fault::kWorkingCounter
                                            : robot_io_fault::kFrameLost;
  switch (t) {
    case BusTrouble::kLinkDown:
      return robot_io_fault::kBusLinkDown;
    case BusTrouble::kSlavesMissing:
      return robot_io_fault::kSlavesMissing;
    case BusTrouble::kSlaveState:
      return robot_io_fault::kSlaveState;
    case BusTrouble::kNotReady:
      return robot_io_fault::kNotCommutated;
    case BusTrouble::kBusOff:
      return robot_io_fault::kBusOff;
    case BusTrouble::kModuleSilent:
      return robot_io_fault::kModuleSilent;
    case BusTrouble::kQueueFull:
      return robot_io_fault::kQueueFull;
    case BusTrouble::kInterfaceDown:
      return robot_io_fault::kInterfaceDown;
    case BusTrouble::kModuleRefuses:
      return robot_io_fault::kModuleRefuses;
    default:
      return robot_io_fault::kBusDown;
  }
}

bool of_joint(BusTrouble t) noexcept {
  return t == BusTrouble::kJointNotCommutated || t == BusTrouble::kJointTimeout ||
         t == BusTrouble::kJointI2t || t == BusTrouble::kJointFault;
}

}  // namespace

Health BusWatch::cycle(BusStatus read, BusStatus sent, const drivers::BusDetail& d) noexcept {
  report_ = {};
  const bool good = read == BusStatus::kOk && sent == BusStatus::kOk;
  takes_setpoints_ = good && d.trouble == BusTrouble::kNone;
  if (good) {
    bad_in_row_ = 0;
    if (d.trouble == BusTrouble::kMadeSafe)
      report_ = {robot_io_fault::kMadeSafe, d, -1, 0};
    else if (of_joint(d.trouble))
      report_ = {robot_io_fault::kJointUnable, d, -1, 0};
    else
      return Health::ok();
    return Health::of(Severity::kSafeStop, report_.fault);
  }
  ++bad_;
  ++bad_in_row_;
  const bool many = bad_in_row_ >= limit_;
  report_ = {name_of(read, d.trouble), d, -1, 0};
  if (read == BusStatus::kDown) {
    bad_in_row_ = limit_;
  } else if (many) {
    bad_in_row_ = limit_;
    report_.fault = robot_io_fault::kBusDown;
  }
  const bool stops = read == BusStatus::kDown || many;
  return Health::of(stops ? Severity::kSafeStop : Severity::kCounted, report_.fault);
}

Health BusWatch::motors(const rt::Tick& tick, const drivers::MotorStates& m) noexcept {
  const int stands = standing_wheel(tick, m);
  struct Kind {
    std::uint32_t bits;
    rt::FaultId fault;
  };
  constexpr std::array kinds{Kind{drivers::motor_flag::kFaults, robot_io_fault::kMotorFault},
                             Kind{drivers::motor_flag::kI2tExceeded, robot_io_fault::kI2tExceeded},
                             Kind{drivers::motor_flag::kTimeout, robot_io_fault::kMotorTimeout}};
  for (const Kind& k : kinds) {
    for (std::size_t w = 0; w < m.flags.size(); ++w) {
      if ((m.flags[w] & k.bits) == 0) continue;
      if (report_.fault != rt::kNoFault) return Health::ok();  // of the cycle: that one first
      report_ = {k.fault, {}, static_cast<int>(w), m.flags[w]};
      return Health::of(Severity::kSafeStop, k.fault);
    }
  }
  if (stands < 0) return Health::ok();
  report_ = {robot_io_fault::kEncoderStands, {}, stands, m.flags[static_cast<std::size_t>(stands)]};
  return Health::of(Severity::kSafeStop, robot_io_fault::kEncoderStands);
}

// A wheel whose setpoints may not have reached it, or do not count yet, begins anew.
int BusWatch::standing_wheel(const rt::Tick& tick, const drivers::MotorStates& m) noexcept {
  int stands = -1;
  const bool turns = takes_setpoints_ && told_.mode == drivers::MotorMode::kVelocity;
  for (std::size_t w = 0; w < standing_.size(); ++w) {
    Standing& s = standing_[w];
    if (!turns || !(std::abs(told_.wheel_rad_per_s[w]) >= kToldLeast_rad_per_s)) {
      s.told_for = rt::Nanos{-1};
      continue;
    }
    if (s.told_for.count() < 0 || !(std::abs(m.wheel_rad[w] - s.anchor_rad) < kTurnedLeast_rad)) {
      s = {m.wheel_rad[w], rt::Nanos{0}};
      continue;
    }
    s.told_for += tick.period * (1 + static_cast<int>(tick.skipped));
    if (s.told_for >= kStandsFor && stands < 0) stands = static_cast<int>(w);
  }
  return stands;
}

}  // namespace tasks
