// The figures of the haptic bench: against their limits, by name, as text.
#include <cmath>
#include <cstdio>
#include <limits>

#include "tools/measure/haptic/bench_haptic.hpp"

namespace teletact {

std::vector<Limit> HapticBenchResult::limits() const {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const HapticMethodRow& tick = methods.front();
  const std::string no_contact = tick.contact > 0 ? "" : "no tick in contact";
  const std::string no_guard = guarded               ? ""
                               : not_counted.empty() ? "the guard is not linked in"
                                                     : not_counted;
  const bool counted = instructions_512 > 0;
  const auto of = [&](double figure) { return counted ? figure : kNone; };
  const std::string why_not = counted ? "" : not_counted.empty() ? "not counted" : not_counted;
  Limits all;
  all.add("tick, thread CPU p50, us", tick.p50_us, "<=", 3, no_contact);
  all.add("tick, thread CPU p99, us", tick.p99_us, "<=", 25, no_contact);
  all.add("allocations in steps", guarded ? allocations : kNone, "<=", 0, no_guard);
  all.add("locks in steps", guarded ? locks : kNone, "<=", 0, no_guard);
  all.add("instructions a tick", of(instructions_512), "<=", 17500, why_not);
  all.add("instructions of a tick, p99", of(instructions_p99), "<=", 75000, why_not);
  all.add("512^3 over 64^3, apart from 1", of(std::abs(instructions_512 / instructions_64 - 1)),
          "<=", 0.1, why_not);
  all.add("no effect over a build without, instructions", of(std::abs(none_over_plain)), "<=", 8,
          why_not);
  all.add("reduction of force_shading p50, us", reduction_p50_us, "<=", 80, disturbed(other_load));
  return all.all();
}

std::vector<BenchMetric> HapticBenchResult::metrics() const {
  std::vector<BenchMetric> m;
  for (const HapticMethodRow& row : methods) {
    const std::string name = &row == methods.data() ? "haptic.tick_" : "haptic." + row.method + "_";
    m.push_back({name + "p50_us", row.p50_us, "us"});
    m.push_back({name + "p99_us", row.p99_us, "us"});
    m.push_back({name + "max_us", row.max_us, "us"});
  }
  m.push_back({"haptic.tick_free_p50_us", methods.front().free_p50_us, "us"});
  m.push_back({"haptic.clock_us", clock_us, "us"});
  m.push_back({"haptic.reduction_p50_us", reduction_p50_us, "us"});
  m.push_back({"haptic.reduction_p99_us", reduction_p99_us, "us"});
  if (guarded) {
    m.push_back({"haptic.tick_allocations", allocations, "1"});
    m.push_back({"haptic.tick_locks", locks, "1"});
  }
  if (instructions_512 > 0) {
    m.push_back({"haptic.tick_instructions", instructions_512, "1"});
    m.push_back({"haptic.tick_instructions_p99", instructions_p99, "1"});
    m.push_back({"haptic.tick_instructions_64", instructions_64, "1"});
    m.push_back({"haptic.tick_instructions_ratio", instructions_512 / instructions_64, "1"});
    m.push_back({"haptic.effect.none.instructions", none_over_plain, "1"});
    for (const auto& [name, value] : effects) {
      m.push_back({"haptic.effect." + name + ".instructions", value, "1"});
    }
  }
  return m;
}

void HapticBenchResult::print(std::ostream& out) const {
  char line[256];
  std::snprintf(line, sizeof line,
                "thread CPU of a step in contact, blend running, map of 512^3 voxels (%d blocks); "
                "the two clock readings, %.2f us, are in it\n",
                blocks_512, clock_us);
  out << line;
  for (const HapticMethodRow& row : methods) {
    std::snprintf(line, sizeof line,
                  "  %-12s p50 %6.2f  p99 %6.2f  max %7.2f us  (%zu ticks; free p50 %.2f, p99 "
                  "%.2f us)\n",
                  row.method.c_str(), row.p50_us, row.p99_us, row.max_us, row.contact,
                  row.free_p50_us, row.free_p99_us);
    out << line;
  }
  std::snprintf(line, sizeof line,
                "reduction of force_shading over 217088 points: p50 %.1f, p99 %.1f us\n",
                reduction_p50_us, reduction_p99_us);
  out << line;
  if (guarded) {
    std::snprintf(line, sizeof line, "inside of a step: %.0f allocations, %.0f locks\n",
                  allocations, locks);
    out << line;
  } else {
    out << "allocations and locks: not counted, the guard is not linked in\n";
  }
  if (instructions_512 > 0) {
    print_instructions(out);
  } else {
    out << "instructions: not counted, " << not_counted << "\n";
  }
  teletact::print(out, limits());
}

void HapticBenchResult::print_instructions(std::ostream& out) const {
  char line[256];
  std::snprintf(
      line, sizeof line,
      "instructions a tick: %.0f (p99 %.0f) at 512^3 (%d blocks), %.0f at 64^3 (%d blocks), "
      "ratio %.3f\n",
      instructions_512, instructions_p99, blocks_512, instructions_64, blocks_64,
      instructions_512 / instructions_64);
  out << line;
  std::snprintf(line, sizeof line, "  no effect asked for: %+.1f of a build without effects\n",
                none_over_plain);
  out << line;
  for (const auto& [name, value] : effects) {
    std::snprintf(line, sizeof line, "  %-12s %+.0f\n", name.c_str(), value);
    out << line;
  }
}

}  // namespace teletact
