#include "tools/measure/bench/console/console_bench.hpp"

#include <algorithm>
#include <exception>

#include "tasks/graph/calibration.hpp"
#include "tools/measure/bench/console/foreign_load.hpp"

namespace teletact {

namespace {

constexpr double kStopDeceleration_m_per_s2 = 4;
constexpr double kStopFalls_ms = 30;  // beyond the way there
// A ramp of ten samples is known to some per cent.
constexpr double kRampTolerance = 1.10;

// A part, and what others did meanwhile; what can not come to its end says why.
template <class Part, class Measure>
void run(std::ostream& progress, const ConsoleBenchOptions& options, const char* name,
         std::optional<Part>& out, const Measure& measure) {
  const auto& only = options.only;
  if (!only.empty() && std::find(only.begin(), only.end(), name) == only.end()) return;
  Part& part = out.emplace();
  ForeignLoad others;
  try {
    measure(progress, options, part);
  } catch (const std::exception& e) {
    part.problem = e.what();
  }
  part.others_cores = others.cores();
  part.busy = disturbed(part.others_cores);
  if (!part.problem.empty()) progress << "  " << part.problem << "\n" << std::flush;
}

}  // namespace

const std::vector<std::string>& console_parts() {
  static const std::vector<std::string> all{"stop", "acts", "cost", "growth"};
  return all;
}

// What was not seen to fall is no number, and no number is within a limit.
bool StopPart::in_time(const StopSeen& s) const {
  return s.falls_ms <= one_way_ms + kStopFalls_ms &&
         s.ramp_over(kStopDeceleration_m_per_s2) <= kRampTolerance;
}

ConsoleBenchResult bench_console(std::ostream& progress, const ConsoleBenchOptions& options) {
  ConsoleBenchResult out;
  out.host = tasks::host_id();
  run(progress, options, "stop", out.stop, measure_stop);
  run(progress, options, "acts", out.acts, measure_acts);
  run(progress, options, "cost", out.cost, measure_cost);
  run(progress, options, "growth", out.growth, measure_growth);
  return out;
}

}  // namespace teletact
