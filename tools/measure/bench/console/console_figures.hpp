// The arithmetic of `teletact bench console`: what a stop was like, when a task took what was asked
// of it, whether something grows, what open pages change beside closed ones. Pure.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "rt/sched/job_record.hpp"

namespace teletact {

// Speed of the base at an instant, on any clock.
struct SpeedAt {
  double t_ms = 0, v_m_per_s = 0;
};

// What followed a press. NaN: it was not seen.
struct StopSeen {
  double before_m_per_s = 0;  // how fast it went when the stop was pressed
  double falls_ms = 0;        // from the press to the first setpoint that falls
  double slope_m_per_s2 = 0;  // of the ramp, above 0
  double stands_ms = 0;       // from the press to the first sample that stands
  // Time of the ramp over that of a ramp of `deceleration`.
  [[nodiscard]] double ramp_over(double deceleration_m_per_s2) const {
    return deceleration_m_per_s2 / slope_m_per_s2;
  }
};
// The straight line through the samples of the ramp, carried back to the speed before: the samples
// are 10 ms apart, and the line gives the instant between them. What the motors' own speed loop
// lags counts as late. `speeds` rise in time.
[[nodiscard]] StopSeen stop_seen(std::span<const SpeedAt> speeds, double press_ms);

// Start of the first of `jobs`, which rise in time, that starts at or after `ns`: its inputs were
// latched then. None: there is no such job.
[[nodiscard]] std::optional<std::int64_t> first_start(std::span<const rt::JobRecord> jobs,
                                                      std::int64_t ns);

// Of values in order of time: from the median of the second tenth to that of the last.
struct Growth {
  double first = 0, last = 0;  // NaN: fewer than kLeast values
  static constexpr std::size_t kLeast = 20;
  [[nodiscard]] double share() const { return last / first - 1; }
};
[[nodiscard]] Growth growth(std::span<const double> values);
// The median of each tenth, in order: a step once is no growth. Empty: too few values.
[[nodiscard]] std::vector<double> tenths(std::span<const double> values);

}  // namespace teletact
