// Runs hard cases of touch and judges every check of every run. What is over its limit is printed as FAILED, with the
// optimum's own figure; the test fails unless that optimum is over the limit as well and nearly as far (then the samples do
// not allow better), or the figure is listed as missed. A listed miss is compared: its worst figure and the optimum's
// own in that run have to be what the list says, so it gets neither worse nor better unnoticed.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "tests/support/rt_guard.hpp"
#include "tools/stability/gates.hpp"

namespace hard_cases {

using stability::Check;
using stability::Setting;

struct Missed {
  int id;
  bool fused;
  const char* check;
  double value;    // the worst of these runs
  double optimum;  // the optimum's own figure in that run; 0: it has none
};

// To three digits, as listed.
inline bool as_listed(double value, double listed) {
  return std::abs(value - listed) <= std::max(0.01 * std::abs(listed), 0.005);
}

inline const Missed* listed(std::span<const Missed> list, int id, bool fused, const Check& c) {
  for (const Missed& m : list) {
    if (m.id == id && m.fused == fused && c.name == m.check) return &m;
  }
  return nullptr;
}

// One case in several settings. `progress`: a line for each setting.
inline void judge(const stability::Case& c, const std::vector<Setting>& settings,
                  std::span<const Missed> list, bool progress = false) {
  int runs = 0, met = 0, bound = 0;
  double margin = 1, cpu = 0;
  std::map<const Missed*, Check> worst;
  const bool fused = settings.front().fused != nullptr;
  for (const Setting& setting : settings) {
    const stability::Gated gated = stability::run_gated(c, setting);
    EXPECT_EQ(gated.gates.counted, rt_guard::linked());
    EXPECT_GT(gated.gates.ticks, 0U);
    cpu = std::max(cpu, gated.gates.cpu_p99_us);
    for (const stability::Run& run : gated.runs) {
      bool all = true, all_bound = true;
      for (const Check& check : run.checks) {
        margin = std::min(margin, check.margin());
        if (check.met()) continue;
        all = false;
        std::printf("  %d %s: %s %.4g, limit %.4g, %s %.4g  FAILED\n", run.id, run.name.c_str(),
                    check.name.c_str(), check.value, check.limit, stability::name_of(check.by),
                    check.optimum);
        if (check.field_bound()) continue;
        all_bound = false;
        const Missed* m = listed(list, run.id, fused, check);
        EXPECT_NE(m, nullptr) << run.name << " " << check.name << " " << check.value;
        if (m == nullptr) continue;
        const auto [it, fresh] = worst.try_emplace(m, check);
        if (!fresh && check.value > it->second.value) it->second = check;
      }
      if (!all && !run.note.empty())
        std::printf("  %d %s: %s\n", run.id, run.name.c_str(), run.note.c_str());
      if (run.figures.judged_share < 0.99) {
        std::printf("  %d %s: %.0f %% judged\n", run.id, run.name.c_str(),
                    100 * run.figures.judged_share);
      }
      ++runs;
      met += all ? 1 : 0;
      bound += !all && all_bound ? 1 : 0;
    }
    if (progress) {
      std::printf("case %d%s, %s %.0f mm/s: %d runs so far, %d within, %d field bound\n", c.id,
                  fused ? ", fused" : "", setting.place.name.c_str(), 1e3 * setting.speed, runs,
                  met, bound);
      std::fflush(stdout);
    }
  }
  for (const Missed& m : list) {
    if (m.id != c.id || m.fused != fused) continue;
    const auto it = worst.find(&m);
    EXPECT_NE(it, worst.end()) << m.check << " is met now: take it off the list";
    if (it == worst.end()) continue;
    const Check& check = it->second;
    EXPECT_TRUE(as_listed(check.value, m.value))
        << m.check << ": measured " << check.value << ", listed " << m.value;
    EXPECT_TRUE(as_listed(std::isnan(check.optimum) ? 0 : check.optimum, m.optimum))
        << m.check << ": optimum " << check.optimum << ", listed " << m.optimum;
  }
  std::printf(
      "case %d, %s%s: %d of %d runs within all limits, %d more field bound, margin %.2f, step p99 "
      "%.1f us\n",
      c.id, c.name, fused ? ", fused" : "", met, runs, bound, margin, cpu);
}

inline constexpr double kSpeeds_m_per_s[3] = {0.02, 0.1, 0.2};

inline std::vector<stability::Case> fused_cases() {
  std::vector<stability::Case> out;
  for (const stability::Case& c : stability::cases()) {
    if (stability::on_fused_fields(c.id)) out.push_back(c);
  }
  return out;
}

inline std::string name_of(const testing::TestParamInfo<stability::Case>& each) {
  return "C" + std::to_string(each.param.id);
}

}  // namespace hard_cases
