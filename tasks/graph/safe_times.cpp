#include "tasks/graph/safe_times.hpp"

#include <algorithm>
#include <cstdio>

#include "tasks/contract/table.hpp"

namespace tasks {

namespace {

double period_s(TaskId id) { return 1.0 / static_cast<double>(kTaskTable[index_of(id)].rate_hz); }

// Time from the speed limits to a command of zero.
double ramp_s(const TrajectoryConfig& c) {
  return std::max(c.speed_m_per_s / c.ramp_down_deceleration_m_per_s2,
                  c.yaw_rate_rad_per_s / c.ramp_down_yaw_deceleration_rad_per_s2);
}

}  // namespace

SafeTimes safe_times(const GraphConfig& config) {
  const auto& robot = config.robot_io;
  const auto& hand = config.haptic;
  SafeTimes t;
  // Whoever notices first: robot_io itself, or supervision.
  const double noticed_s =
      std::min(robot.link_silence_ms * 1e-3,
               config.supervision.link_liveness_s + period_s(TaskId::kRobotSupervision));
  t.base_stands_s =
      noticed_s + 2 * period_s(TaskId::kRobotIo) + ramp_s(robot.trajectory) + robot.motor_settle_s;
  const double slew_s = hand.guard ? hand.force_limit_N / hand.slew_N_per_s : 0.0;
  t.force_zero_s = config.supervision.link_liveness_s + period_s(TaskId::kSupervision) +
                   std::max(hand.ramp_s, slew_s) + period_s(TaskId::kHaptic);
  return t;
}

std::string check_safe_times(const GraphConfig& config) {
  const SafeTimes t = safe_times(config);
  constexpr double kRounding_s = 1e-9;
  char text[640];
  if (t.base_stands_s > kSafeWithin_s + kRounding_s) {
    const auto& c = config.robot_io.trajectory;
    std::snprintf(text, sizeof text,
                  "robot_io.link_silence_ms = %d, robot_io.trajectory.speed_m_per_s = %g "
                  "(yaw_rate_rad_per_s = "
                  "%g), robot_io.trajectory.ramp_down_deceleration_m_per_s2 = %g "
                  "(ramp_down_yaw_deceleration_rad_per_s2 = %g), robot_io.motor_settle_s = %g: the "
                  "base would "
                  "stand %.0f ms after the link falls silent, allowed are %.0f ms",
                  config.robot_io.link_silence_ms, c.speed_m_per_s, c.yaw_rate_rad_per_s,
                  c.ramp_down_deceleration_m_per_s2, c.ramp_down_yaw_deceleration_rad_per_s2,
                  config.robot_io.motor_settle_s, 1e3 * t.base_stands_s, 1e3 * kSafeWithin_s);
    return text;
  }
  if (t.force_zero_s > kSafeWithin_s + kRounding_s) {
    std::snprintf(
        text, sizeof text,
        "supervision.link_liveness_s = %g, haptic.ramp_s = %g, haptic.force_limit_N = %g, "
        "haptic.slew_N_per_s = %g: the force would be zero %.0f ms after the link falls "
        "silent, allowed are %.0f ms",
        config.supervision.link_liveness_s, config.haptic.ramp_s, config.haptic.force_limit_N,
        config.haptic.slew_N_per_s, 1e3 * t.force_zero_s, 1e3 * kSafeWithin_s);
    return text;
  }
  return {};
}

}  // namespace tasks
