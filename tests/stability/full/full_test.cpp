// Every setting of the hard cases: three offsets of the grid, three rotations, three speeds, and on fused fields every
// view with a tip of 0 and 3 mm. One line of progress a setting. Hours: run by tools/test --long alone.
#include <gtest/gtest.h>

#include <vector>

#include "tests/stability/judge.hpp"

namespace {

using hard_cases::Missed;
using stability::Setting;

// What fails: case, fused, check, runs over the limit, the worst figure of them and the optimum's own; where the optimum does not
// fail as far: runs, worst figure, the optimum's.
constexpr Missed kMissed[] = {
    {3, false, "F error p95 N", 1, 0, 0},
};

class FullCase : public testing::TestWithParam<stability::Case> {};
class FullFusedCase : public FullCase {};

TEST_P(FullCase, FailsAsListed) {
  const std::vector<Setting> settings = hard_cases::on_samples(true);
  ASSERT_EQ(settings.size(), 27U);
  hard_cases::judge(GetParam(), settings, kMissed, true);
}

TEST_P(FullFusedCase, FailsAsListed) {
  const auto views = stability::fused_views();
  hard_cases::judge(GetParam(), hard_cases::on_fused(views, true), kMissed, true);
}

INSTANTIATE_TEST_SUITE_P(All, FullCase,
                         testing::ValuesIn(stability::cases().begin(), stability::cases().end()),
                         hard_cases::name_of);
INSTANTIATE_TEST_SUITE_P(All, FullFusedCase, testing::ValuesIn(hard_cases::fused_cases()),
                         hard_cases::name_of);

}  // namespace
