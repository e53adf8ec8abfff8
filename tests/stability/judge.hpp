// Runs hard cases of touch and judges every check of every run. What is over its limit is failed,
// and printed as FAILED with the optimum's own figure, whether the optimum is over the limit as
// well or not. The test passes only if what failed is what is listed: of each check how many runs,
// in how many of these the optimum does not fail as far, the worst figure and the optimum's own in
// that run, and the same of the worst one that the optimum does not fail as far. So nothing new
// fails unnoticed, and nothing on the list is met unnoticed.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "tools/measure/stability/gates.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace hard_cases {

using stability::Check;
using stability::Setting;

struct Missed {
  int id;
  bool fused;
  const char* check;
  int runs;               // that are over the limit
  double value, optimum;  // of the worst, and the optimum's own in that run; 0: it has none
  int alone = 0;          // of these runs, where the optimum does not fail, or less far
  double alone_value = 0, alone_optimum = 0;  // of the worst of those
};

// To three digits, as listed.
inline bool as_listed(double value, double listed) {
  return std::abs(value - listed) <= std::max(0.01 * std::abs(listed), 0.005);
}

// What is over its limit of one check of one case.
struct Tally {
  int runs = 0, alone = 0;
  Check worst, worst_alone;
  void take(const Check& c) {
    if (runs++ == 0 || worse(c, worst)) worst = c;
    if (!c.field_bound() && (alone++ == 0 || worse(c, worst_alone))) worst_alone = c;
  }
  static bool worse(const Check& c, const Check& than) {  // NaN is the worst
    return std::isnan(c.value) || c.value > than.value;
  }
};

inline double or_zero(double v) { return std::isnan(v) ? 0 : v; }

// As an entry of a list.
inline std::string entry(int id, bool fused, const std::string& check, const Tally& t) {
  char out[256];
  std::size_t n = static_cast<std::size_t>(std::snprintf(
      out, sizeof out, "{%d, %s, \"%s\", %d, %.4g, %.4g", id, fused ? "true" : "false",
      check.c_str(), t.runs, t.worst.value, or_zero(t.worst.optimum)));
  if (t.alone > 0) {
    n += static_cast<std::size_t>(std::snprintf(out + n, sizeof out - n, ", %d, %.4g, %.4g",
                                                t.alone, t.worst_alone.value,
                                                or_zero(t.worst_alone.optimum)));
  }
  return std::string(out, n) + "},";
}

// Empty, or what is not as it stands in the list.
inline std::string off_list(std::span<const Missed> list, int id, bool fused,
                            const std::map<std::string, Tally>& failed) {
  std::string out;
  for (const auto& [check, t] : failed) {
    const auto m = std::ranges::find_if(list, [&](const Missed& each) {
      return each.id == id && each.fused == fused && check == each.check;
    });
    const bool same =
        m != list.end() && m->runs == t.runs && m->alone == t.alone &&
        as_listed(t.worst.value, m->value) && as_listed(or_zero(t.worst.optimum), m->optimum) &&
        (t.alone == 0 || (as_listed(t.worst_alone.value, m->alone_value) &&
                          as_listed(or_zero(t.worst_alone.optimum), m->alone_optimum)));
    if (!same) out += (m == list.end() ? "new: " : "changed: ") + entry(id, fused, check, t) + "\n";
  }
  for (const Missed& m : list) {
    if (m.id == id && m.fused == fused && !failed.contains(m.check)) {
      out += std::string("met now, take it off: ") + m.check + "\n";
    }
  }
  return out;
}

// One case in several settings; each `again_each`-th of them twice, for the same trace. `progress`:
// a line for each setting.
inline void judge(const stability::Case& c, const std::vector<Setting>& settings,
                  std::span<const Missed> list, bool progress = false, std::size_t again_each = 1) {
  int runs = 0, met = 0, bound = 0;
  double margin = 1, cpu = 0;
  std::uint32_t samples_p99 = 0, samples_max = 0;
  std::map<std::string, Tally> failed;
  const bool fused = settings.front().fused != nullptr;
  std::size_t count = 0;
  for (const Setting& setting : settings) {
    const stability::Gated gated = stability::run_gated(c, setting, count++ % again_each == 0);
    EXPECT_EQ(gated.gates.counted, rt_guard::linked());
    EXPECT_GT(gated.gates.ticks, 0U);
    cpu = std::max(cpu, gated.gates.cpu_p99_us);
    samples_p99 = std::max(samples_p99, gated.gates.work_p99);
    samples_max = std::max(samples_max, gated.gates.work_max);
    for (const stability::Run& run : gated.runs) {
      bool all = true, all_bound = true;
      for (const Check& check : run.checks) {
        margin = std::min(margin, check.margin());
        if (check.met()) continue;
        all = false;
        all_bound = all_bound && check.field_bound();
        failed[check.name].take(check);
        std::printf("  %d %s: %s %.4g, limit %.4g, %s %.4g  FAILED%s\n", run.id, run.name.c_str(),
                    check.name.c_str(), check.value, check.limit, stability::name_of(check.by),
                    check.optimum, check.field_bound() ? ", and so is the optimum" : "");
        if (!std::isnan(check.alone.ours)) {
          std::printf("      %.4g where the optimum has %.4g\n", check.alone.ours,
                      check.alone.optimum);
        }
      }
      if (!all && !run.note.empty())
        std::printf("  %d %s: %s\n", run.id, run.name.c_str(), run.note.c_str());
      ++runs;
      met += all ? 1 : 0;
      bound += !all && all_bound ? 1 : 0;
    }
    if (progress) {
      std::printf("case %d%s, %s %.0f mm/s: %d runs so far, %d pass, %d fail\n", c.id,
                  fused ? ", fused" : "", setting.place.name.c_str(), 1e3 * setting.speed, runs,
                  met, runs - met);
      std::fflush(stdout);
    }
  }
  for (const auto& [check, t] : failed) {
    std::printf("    %s\n", entry(c.id, fused, check, t).c_str());
  }
  EXPECT_EQ(off_list(list, c.id, fused, failed), "");
  std::printf(
      "case %d, %s%s: %d of %d runs pass, %d fail, %d of them only where the optimum fails too, "
      "margin %.2f, step p99 %.1f us, samples p99 %u, max %u\n",
      c.id, c.name, fused ? ", fused" : "", met, runs, runs - met, bound, margin, cpu, samples_p99,
      samples_max);
}

inline constexpr double kSpeeds_m_per_s[3] = {0.02, 0.1, 0.2};

// Every placement: at one speed, each speed at each rotation, or at all.
inline std::vector<Setting> on_samples(bool every_speed) {
  const auto places = rig::placements();
  std::vector<Setting> out;
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (every_speed || k == (i / 3 + i) % 3) out.push_back({places[i], kSpeeds_m_per_s[k]});
    }
  }
  return out;
}

// Every view: with a tip of 0 and of 3 mm, or one of them in turn. The settings point into `views`.
inline std::vector<Setting> on_fused(const std::vector<stability::FusedView>& views,
                                     bool both_tips) {
  const auto places = rig::placements();
  std::vector<Setting> out;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const bool round = v % 4 == 0 || v % 4 == 3;
    for (const bool tip : {false, true}) {
      if (!both_tips && tip != round) continue;
      const std::size_t i = out.size();
      Setting s{places[(4 * i) % places.size()], kSpeeds_m_per_s[(i + i / 3) % 3]};
      s.fused = &views[v];
      s.tip_radius_m = tip ? 0.003 : 0;
      out.push_back(s);
    }
  }
  return out;
}

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
