#include "tools/measure/stability_table.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace teletact {

using stability::Check;
using stability::Run;

namespace {

void larger(double& most, double v) {
  if (!(v <= most)) most = v;  // NaN: nothing yet
}

std::string text(const char* format, auto... values) {
  char buffer[160];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

// "F error p95 N 0.447, limit 0.3, guarded optimum 0.347".
std::string failure(const Check& c) {
  std::string out = text("%s %.4g, limit %.4g", c.name.c_str(), c.value, c.limit);
  if (!std::isnan(c.optimum)) out += text(", %s %.4g", stability::name_of(c.by), c.optimum);
  if (c.field_bound()) return out + ": the optimum fails too";
  if (!std::isnan(c.alone.ours)) {
    out += text("; %.4g where the optimum has %.4g", c.alone.ours, c.alone.optimum);
  }
  return out;
}

void keep_worse(std::map<std::string, Check>& worst, const Check& c) {
  const auto [it, fresh] = worst.try_emplace(c.name, c);
  if (!fresh && c.margin() < it->second.margin()) it->second = c;
}

// "0.12" or "0.12 to 0.26"; "-" where the case has no such check.
std::string limit_of(const StabilityTally& t, const std::string& check, double unit = 1) {
  const auto it = t.span.find(check);
  if (it == t.span.end()) return "-";
  const auto [lo, hi] = it->second;
  return lo == hi ? text("%.3g", unit * lo) : text("%.2g-%.2g", unit * lo, unit * hi);
}

// The proxy's error where there is an optimum to compare with; else, marked, its distance from the
// surface.
std::string position(const StabilityTally& t) {
  if (!std::isnan(t.position_mm)) return text("%.2f", t.position_mm);
  return std::isnan(t.off_mm) ? "-" : text("~%.2f", t.off_mm);
}

void print_columns(const std::string& name, const std::string& method, const std::string& settings,
                   const std::string& j_raw, const std::string& j, const std::string& guard,
                   const std::string& lag, const std::string& place, const std::string& margin,
                   const std::string& cpu, const std::string& verdict) {
  std::printf("%-26s %-18s %8s %8s %10s %7s %6s %7s %7s %9s  %s\n", name.c_str(), method.c_str(),
              settings.c_str(), j_raw.c_str(), j.c_str(), guard.c_str(), lag.c_str(), place.c_str(),
              margin.c_str(), cpu.c_str(), verdict.c_str());
}

}  // namespace

void StabilityTally::take(const stability::Gated& gated, bool verbose) {
  ++settings;
  bool failed = false, bound = true;
  for (const Run& run : gated.runs) {
    for (const Check& c : run.checks) {
      margin = std::min(margin, c.margin());
      keep_worse(worst, c);
      if (!c.met() && !c.field_bound()) keep_worse(worst_alone, c);
      const auto [limits, first] = span.try_emplace(c.name, c.limit, c.limit);
      if (!first) {
        limits->second.first = std::min(limits->second.first, c.limit);
        limits->second.second = std::max(limits->second.second, c.limit);
      }
      if (c.name == "lag ms") lag_ms = std::max(lag_ms, c.value);
      if (c.met()) continue;
      failed = true;
      bound = bound && c.field_bound();
      if (verbose) {
        std::printf("      %s: FAILED %s\n", run.name.c_str(), failure(c).c_str());
      }
    }
    if (verbose && !run.note.empty()) {
      std::printf("      %s: %s\n", run.name.c_str(), run.note.c_str());
    }
    j_N = std::max(j_N, run.figures.j);
    j_raw_N = std::max(j_raw_N, run.figures.j_raw);
    guard_share = std::max(guard_share, run.figures.guard_share);
    lag_ms = std::max(lag_ms, 1e3 * run.figures.behind_max_s);
    if (!run.optimum.empty()) larger(position_mm, 1e3 * run.figures.p_error_p95);
    larger(off_mm, 1e3 * run.figures.off_p95);
  }
  within += failed ? 0 : 1;
  field_bound += failed && bound ? 1 : 0;
  cpu_p50_us = std::max(cpu_p50_us, gated.gates.cpu_p50_us);
  cpu_p99_us = std::max(cpu_p99_us, gated.gates.cpu_p99_us);
  cpu_max_us = std::max(cpu_max_us, gated.gates.cpu_max_us);
  counted = gated.gates.counted;
  controlled = controlled || gated.gates.controlled;
  energy_min_mJ = std::min(energy_min_mJ, 1e3 * gated.gates.energy_min_J);
  controller_acts += gated.gates.same_without ? 0 : 1;
}

bool StabilityTally::controller_passes() const {
  return controlled && controller_acts == 0 && energy_min_mJ >= 1e3 * stability::kEnergyLeast_J;
}

double StabilityTally::controller_margin() const {
  if (!controlled || controller_acts > 0) return -1;
  return 1 - energy_min_mJ / (1e3 * stability::kEnergyLeast_J);
}

void StabilityTally::take(const StabilityTally& other) {
  settings += other.settings;
  within += other.within;
  field_bound += other.field_bound;
  margin = std::min(margin, other.margin);
  j_N = std::max(j_N, other.j_N);
  j_raw_N = std::max(j_raw_N, other.j_raw_N);
  guard_share = std::max(guard_share, other.guard_share);
  lag_ms = std::max(lag_ms, other.lag_ms);
  if (!std::isnan(other.position_mm)) larger(position_mm, other.position_mm);
  if (!std::isnan(other.off_mm)) larger(off_mm, other.off_mm);
  cpu_p50_us = std::max(cpu_p50_us, other.cpu_p50_us);
  cpu_p99_us = std::max(cpu_p99_us, other.cpu_p99_us);
  cpu_max_us = std::max(cpu_max_us, other.cpu_max_us);
  counted = other.counted;
  controlled = controlled || other.controlled;
  energy_min_mJ = std::min(energy_min_mJ, other.energy_min_mJ);
  controller_acts += other.controller_acts;
}

void print_table_head() {
  print_columns("case", "method", "settings", "J_raw N", "J N", "guard %", "lag ms", "p mm",
                "margin", "p99 us", "");
  std::printf(
      "  J: largest step of the force in a tick, raw before the slew guard. lag: longest the force "
      "sent is 0.1 N off the one\n  before the guard, or the surface's own where the case has such "
      "a limit. p: proxy to field optimum, 95 %% of the\n  ticks; ~ off the blended field's "
      "surface "
      "where there is no optimum. off: without the stability layer.\n");
}

void print_row(const stability::Case& c, const std::string& method, const StabilityTally& t,
               bool fused, bool judged) {
  const std::string name =
      judged ? text("%2d %s%s", c.id, c.name, fused ? ", fused" : "") : std::string();
  const char* verdict = t.within == t.settings ? "pass" : "FAIL";
  print_columns(name, method, text("%d/%d", t.within, t.settings), text("%.3f", t.j_raw_N),
                text("%.3f", t.j_N), text("%.1f", 100 * t.guard_share), text("%.0f", t.lag_ms),
                position(t), text("%+.2f", t.margin), text("%.1f", t.cpu_p99_us),
                judged ? verdict : "");
  if (!judged) return;
  print_columns("", "  limit", "", "-", limit_of(t, "J N"), limit_of(t, "guard use", 100),
                limit_of(t, "lag ms"), limit_of(t, "p error p95 mm"), "0",
                limit_of(t, "gate: step CPU p99 us"), "");
  for (const auto& [check, worst] : t.worst) {
    if (worst.met()) continue;
    std::printf("     FAILED  %s\n", failure(worst).c_str());
    const auto alone = t.worst_alone.find(check);
    if (worst.field_bound() && alone != t.worst_alone.end()) {
      std::printf("     FAILED  %s\n", failure(alone->second).c_str());
    }
  }
  if (t.failed() > 0) {
    std::printf(
        "     of %d settings %d pass, %d fail: %d of them only where the optimum fails too, %d "
        "where "
        "it does not\n",
        t.settings, t.within, t.failed(), t.field_bound, t.failed_alone());
  }
}

void print_published(const stability::Case& c) {
  std::printf("     must      %s\n     published baseline  %s\n     published CHAI3D    %s\n",
              c.must, c.baseline, c.chai3d);
}

}  // namespace teletact
