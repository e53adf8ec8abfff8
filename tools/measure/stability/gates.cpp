#include "tools/measure/stability/gates.hpp"

#include <algorithm>

#include "rt/quantile.hpp"
#include "tools/measure/support/haptic_witness.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace stability {

namespace {

constexpr double kStepCpu_us = 25, kForce_N = 12;
constexpr int kMorePasses = 6;

// What the passes say together; CPU times apart.
Gates gates_of(const rig::Witness& first, const rig::Witness& again) {
  Gates out;
  out.ticks = first.ticks;
  out.contact_ticks = first.cpu_us.size();
  out.not_finite = first.not_finite + again.not_finite;
  out.force_max_N = std::max(first.force_max_N, again.force_max_N);
  out.counted = rt_guard::linked();
  out.allocations = first.allocations + again.allocations;
  out.locks = first.locks + again.locks;
  out.controlled = first.controlled;
  out.energy_min_J = first.energy_min_J;
  out.digest = first.digest();
  out.digest_again = again.digest();
  return out;
}

// Of each tick the smaller time; only of passes that did the same.
void smaller(std::vector<float>& cpu, const std::vector<float>& other) {
  for (std::size_t i = 0; i < cpu.size(); ++i) cpu[i] = std::min(cpu[i], other[i]);
}

void take_times(Gates& gates, const std::vector<float>& cpu,
                const std::vector<std::uint32_t>& work) {
  gates.cpu_p50_us = static_cast<double>(rt::quantile(cpu, 0.5));
  gates.cpu_p99_us = static_cast<double>(rt::quantile(cpu, 0.99));
  gates.cpu_max_us = static_cast<double>(rt::quantile(cpu, 1));
  gates.work_p99 = rt::quantile(work, 0.99);
  gates.work_max = rt::quantile(work, 1);
}

}  // namespace

const char* name_of(Yardstick by) {
  switch (by) {
    case Yardstick::kField:
      return "field optimum";
    case Yardstick::kGuarded:
      return "guarded optimum";
    case Yardstick::kExact:
      return "exact";
  }
  return "";
}

void add_gates(Run& run, const Gates& gates) {
  const std::size_t own = run.checks.size();
  if (!gates.counted) {
    add(run, "gate: step CPU p99 us", gates.cpu_p99_us, kStepCpu_us);
  } else {
    add(run, "gate: step instructions p99", instructions_of(gates.work_p99), kStepInstructions);
    add(run, "gate: allocations in steps", static_cast<double>(gates.allocations), 0);
    add(run, "gate: locks in steps", static_cast<double>(gates.locks), 0);
  }
  add(run, "gate: trace differs", gates.digest == gates.digest_again ? 0 : 1, 0);
  add(run, "gate: ticks not finite", static_cast<double>(gates.not_finite), 0);
  add(run, "gate: force N", gates.force_max_N, kForce_N);
  if (gates.controlled) {
    add(run, "gate: E + booked + credit below zero mJ", -1e3 * gates.energy_min_J,
        -1e3 * kEnergyLeast_J);
    add(run, "gate: controller changes the trace", gates.same_without ? 0 : 1, 0);
  }
  for (std::size_t i = own; i < run.checks.size(); ++i) run.checks[i].gate = true;
}

Gated run_gated(const Case& c, const Setting& s, bool twice) {
  Gated out;
  rig::Witness first;
  out.runs = c.run(s);
  Setting bare = s;
  bare.judged = false;
  if (!twice) {
    out.gates = gates_of(first, rig::Witness{});
    out.gates.digest_again = out.gates.digest;
  } else {
    rig::Witness again;  // stands before `first` does
    (void)c.run(bare);
    out.gates = gates_of(first, again);
    if (again.digest() == first.digest()) smaller(first.cpu_us, again.cpu_us);
  }
  constexpr int kLastAlike = 18;  // of 19 and 20 the controller is part
  if (out.gates.controlled && c.id <= kLastAlike && s.method == "constrained") {
    Setting without = bare;
    without.controller = false;
    rig::Witness off;
    (void)c.run(without);
    out.gates.same_without = off.digest() == first.digest();
  }
  take_times(out.gates, first.cpu_us, first.work);
  // A method that is slow at the median is slow; else it may have been disturbed.
  for (int more = 0; more < kMorePasses && !out.gates.counted; ++more) {
    if (out.gates.cpu_p99_us <= kStepCpu_us || out.gates.cpu_p50_us > 0.5 * kStepCpu_us) break;
    rig::Witness again;
    (void)c.run(bare);
    if (again.digest() != first.digest()) break;
    smaller(first.cpu_us, again.cpu_us);
    take_times(out.gates, first.cpu_us, first.work);
  }
  for (Run& run : out.runs) add_gates(run, out.gates);
  return out;
}

}  // namespace stability
