// The gates that every run of a hard case keeps beside its own limits, judged over every tick of
// the setting, those included that no row is kept of:
//
//   step CPU p99     at most 25 us of thread CPU, contact ticks; of each tick the smallest of all
//                    passes counts
//   step instructions p99   in tests instead of it: at most 75,000, what 25 us are at 3 a ns
//   allocations, locks in a step: none. Counted where the guard is linked
//   (tools/measure/support/rt_guard.hpp), so in tests
//   trace differs    the setting is run twice; every answer of every tick is the same, bit by bit
//   not finite       no tick
//   force            at most 12 N
//   E + booked + credit   at least -1 mJ at every tick under the passivity controller
//   controller changes the trace   cases 1 to 18, credited with b 2: the same answers bit by bit
//                                  without it
//
// All passes do the same work tick by tick, so what one of them took more than another was the
// machine's. Where two do not say enough, up to six more are made. A test may run beside anything:
// where the guard is linked, instructions are judged instead, by the 99th percentile of the field
// samples of a tick, which is the same on any machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/measure/stability/cases.hpp"

namespace stability {

// chosen on: corners; judged on: case 3 on samples and on fused fields (docs/haptic_rendering.md, Cost)
// Most that a tick of so many field samples takes, by callgrind; held to by
// tests/timing/haptic_tick.
inline constexpr double kInstructionsOfATick = 42000, kInstructionsOfASample = 250;
[[nodiscard]] constexpr double instructions_of(std::uint32_t work) {
  return kInstructionsOfATick + kInstructionsOfASample * work;
}
// 25 us at 3 instructions a ns.
inline constexpr double kStepInstructions = 75000;
inline constexpr double kEnergyLeast_J = -1e-3;

struct Gates {
  std::size_t ticks = 0, contact_ticks = 0, not_finite = 0;
  double force_max_N = 0;
  double cpu_p50_us = 0, cpu_p99_us = 0, cpu_max_us = 0;
  std::uint32_t work_p99 = 0, work_max = 0;  // field samples of a tick: the deterministic cost
  bool counted = false;                      // the guard is linked
  std::uint64_t allocations = 0, locks = 0;
  std::uint64_t digest = 0, digest_again = 0;
  bool controlled = false;   // there are ticks under the controller
  double energy_min_J = 0;   // in those
  bool same_without = true;  // the answers without the controller; true where it was not asked
};

struct Gated {
  std::vector<Run> runs;  // each with the gates among its checks
  Gates gates;
};
// The case in this setting, twice or more; from the second time on without the optimum. Not
// `again`: once, and its gates "trace differs" sees nothing.
[[nodiscard]] Gated run_gated(const Case& c, const Setting& s, bool again = true);

// As checks of a run.
void add_gates(Run& run, const Gates& gates);

}  // namespace stability
