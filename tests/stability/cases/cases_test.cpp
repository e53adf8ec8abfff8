// The hard cases of touch (tools/stability), each placement at one speed, each speed at each
// rotation. `teletact stability` runs all of them and prints the table.
//
// A figure over its limit is printed as FAILED, with the field optimum's own figure. The test fails
// unless the field optimum is over the limit as well (then the samples do not allow better) or the
// figure is listed below as missed: then it may not become worse than its bound, just behind what
// was measured, and an entry whose limit is met in every run has to be taken off the list.
#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "tools/stability/cases.hpp"

namespace {

using stability::Check;
using stability::Setting;

struct Missed {
  int id;
  bool fused;
  const char* check;
  double bound;    // just behind the worst figure of these runs
  double optimum;  // the field optimum's own figure in that run
};
constexpr Missed kMissed[] = {
    // Two rests 0.9 mm apart, a ridge of 5 um between them: what is rendered goes over it, the optimum waits for its end.
    {9, false, "F error p95 N", 0.49, 0},
    // At one place the proxy breaks loose at another time than the optimum's with the definition's cone about it: its places
    // are good to 0.05 mm, and the cone sticks again at 1 um.
    {3, false, "F error p95 N", 0.43, 0},
    // Where it drops off a ridge across several cells.
    {4, false, "ticks of more than 10 iterations", 1, 0},
    // A surface that arrives within one period lifts a soft hand's mass as well.
    {20, false, "injected mJ, hand 100 N/m", 11.1, 9.94},
    // The same ridges, on a run so short that the slew guard's flank behind a drop of several newtons is 5 % of it.
    {2, true, "F error p95 N", 0.32, 0.105},
    {6, true, "F error p95 N", 1.49, 0.36},
};

const Missed* listed(int id, bool fused, const Check& c) {
  for (const Missed& m : kMissed) {
    if (m.id == id && m.fused == fused && c.name == m.check) return &m;
  }
  return nullptr;
}

class HardCase : public testing::TestWithParam<stability::Case> {};
class FusedCase : public HardCase {};

// Runs one case in several settings and judges every check.
void judge(const stability::Case& c, const std::vector<Setting>& settings) {
  int runs = 0, met = 0;
  double margin = 1;
  std::set<const Missed*> seen;
  const bool fused = settings.front().fused != nullptr;
  for (const Setting& setting : settings) {
    for (const stability::Run& run : c.run(setting)) {
      bool all = true;
      for (const Check& check : run.checks) {
        margin = std::min(margin, check.margin());
        if (check.met()) continue;
        all = false;
        std::printf("  %d %s: %s %.4g, limit %.4g, field optimum %.4g  FAILED\n", run.id,
                    run.name.c_str(), check.name.c_str(), check.value, check.limit, check.optimum);
        if (check.field_bound()) continue;
        const Missed* m = listed(run.id, fused, check);
        EXPECT_NE(m, nullptr) << run.name << " " << check.name;
        if (m == nullptr) continue;
        EXPECT_LE(check.value, m->bound) << run.name << " " << check.name;
        seen.insert(m);
      }
      if (!all && !run.note.empty())
        std::printf("  %d %s: %s\n", run.id, run.name.c_str(), run.note.c_str());
      if (run.figures.judged_share < 0.99) {
        std::printf("  %d %s: %.0f %% judged\n", run.id, run.name.c_str(),
                    100 * run.figures.judged_share);
      }
      ++runs;
      met += all ? 1 : 0;
    }
  }
  for (const Missed& m : kMissed) {
    EXPECT_TRUE(m.id != c.id || m.fused != fused || seen.contains(&m))
        << m.check << " is met now: take it off the list";
  }
  std::printf("case %d, %s%s: %d of %d runs within all limits, margin %.2f\n", c.id, c.name,
              fused ? ", fused" : "", met, runs, margin);
}

constexpr double kSpeeds[3] = {0.02, 0.1, 0.2};

TEST_P(HardCase, WithinItsLimits) {
  const auto places = rig::placements();
  std::vector<Setting> settings;
  for (std::size_t i = 0; i < places.size(); ++i) {
    settings.push_back(Setting{places[i], kSpeeds[(i / 3 + i) % 3]});
  }
  judge(GetParam(), settings);
}

// Each angle of view, with and without noise and a tip of 3 mm in turn.
TEST_P(FusedCase, WithinItsLimits) {
  const auto places = rig::placements();
  const auto views = stability::fused_views();
  std::vector<Setting> settings;
  for (std::size_t i = 0; i < views.size(); ++i) {
    Setting s{places[(4 * i) % places.size()], kSpeeds[(i + i / 3) % 3]};
    s.fused = &views[i];
    s.tip_radius_m = i % 4 == 0 || i % 4 == 3 ? 0.003 : 0;
    settings.push_back(s);
  }
  judge(GetParam(), settings);
}

std::vector<stability::Case> fused_cases() {
  std::vector<stability::Case> out;
  for (const stability::Case& c : stability::cases()) {
    if (stability::on_fused_fields(c.id)) out.push_back(c);
  }
  return out;
}

std::string name_of(const testing::TestParamInfo<stability::Case>& each) {
  return "C" + std::to_string(each.param.id);
}

INSTANTIATE_TEST_SUITE_P(All, HardCase,
                         testing::ValuesIn(stability::cases().begin(), stability::cases().end()),
                         name_of);
INSTANTIATE_TEST_SUITE_P(All, FusedCase, testing::ValuesIn(fused_cases()), name_of);

}  // namespace
