// Every setting of the hard cases: three offsets of the grid, three rotations, three speeds, and on fused fields every
// view with a tip of 0 and 3 mm. One line of progress a setting. Hours: run by tools/test --long alone.
#include <gtest/gtest.h>

#include <vector>

#include "tests/stability/judge.hpp"

namespace {

using hard_cases::kSpeeds_m_per_s;
using hard_cases::Missed;
using stability::Setting;

// What fails: case, fused, check, runs over the limit, the worst figure of them and the optimum's own; where the optimum does not
// fail as far: runs, worst figure, the optimum's.
constexpr Missed kMissed[] = {
    {3, false, "F error p95 N", 1, 0, 0},
};

class FullCase : public testing::TestWithParam<stability::Case> {};
class FullFusedCase : public FullCase {};

TEST_P(FullCase, WithinItsLimits) {
  std::vector<Setting> settings;
  for (const rig::Placement& place : rig::placements()) {
    for (const double speed : kSpeeds_m_per_s) settings.push_back(Setting{place, speed});
  }
  ASSERT_EQ(settings.size(), 27U);
  hard_cases::judge(GetParam(), settings, kMissed, true);
}

TEST_P(FullFusedCase, WithinItsLimits) {
  const auto places = rig::placements();
  const auto views = stability::fused_views();
  std::vector<Setting> settings;
  for (const stability::FusedView& view : views) {
    for (const double radius : {0.0, 0.003}) {
      const std::size_t i = settings.size();
      Setting s{places[(4 * i) % places.size()], kSpeeds_m_per_s[(i + i / 3) % 3]};
      s.fused = &view;
      s.tip_radius_m = radius;
      settings.push_back(s);
    }
  }
  hard_cases::judge(GetParam(), settings, kMissed, true);
}

INSTANTIATE_TEST_SUITE_P(All, FullCase,
                         testing::ValuesIn(stability::cases().begin(), stability::cases().end()),
                         hard_cases::name_of);
INSTANTIATE_TEST_SUITE_P(All, FullFusedCase, testing::ValuesIn(hard_cases::fused_cases()),
                         hard_cases::name_of);

}  // namespace
