// Closed forms and known vectors of the analysis; random sets are in
// analysis_vs_reference_test.cpp.
#include "rt/sched/analysis.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace {

using rt::AnalysisOptions;
using rt::AnalysisTask;
using rt::Nanos;

const AnalysisOptions kNoSwitch{Nanos{0}, Nanos{100'000'000'000}};

AnalysisTask task(std::int64_t c, std::int64_t t, std::int64_t d, int rank, std::int64_t j = 0,
                  std::int64_t b = 0) {
  return {Nanos{c}, Nanos{t}, Nanos{d}, Nanos{j}, Nanos{b}, rank};
}

TEST(Analysis, LehoczkyHardVectorIsWorstAtTheFifthJob) {
  const std::vector<AnalysisTask> set{task(26, 70, 70, 0), task(62, 100, 1000, 1)};
  const auto a = rt::analyse(set, kNoSwitch);
  EXPECT_EQ(a.tasks[0].R.count(), 26);
  EXPECT_EQ(a.tasks[1].R.count(), 118);
  EXPECT_EQ(a.tasks[1].jobs, 7);  // responses 114 102 116 104 118 106 94
  EXPECT_EQ(a.tasks[1].slack.count(), 882);
  EXPECT_TRUE(a.schedulable);
}

TEST(Analysis, TableOfTheDesignFitsAboveBothBounds) {
  const auto ms = [](double x) { return static_cast<std::int64_t>(x * 1e6); };
  const std::vector<AnalysisTask> set{
      task(ms(0.25), ms(1), ms(1), 0), task(ms(8), 33'333'333, 33'333'333, 1),
      task(ms(15), ms(100), ms(100), 2), task(ms(20), ms(100), ms(100), 3)};
  const auto a = rt::analyse(set, kNoSwitch);
  EXPECT_NEAR(a.utilisation, 0.84, 0.001);
  EXPECT_NEAR(a.liu_layland, 0.757, 0.001);
  EXPECT_NEAR(a.hyperbolic, 2.14, 0.01);
  EXPECT_TRUE(a.bounds_apply);
  EXPECT_FALSE(a.passes_liu_layland);
  EXPECT_FALSE(a.passes_hyperbolic);
  EXPECT_TRUE(a.schedulable);
  // By hand: 8 + 11 jobs of 0.25; 15 + 8 + 31 of 0.25; 43 + 8 + 8 + 79 of 0.25 (three fusion jobs).
  EXPECT_EQ(a.tasks[0].R.count(), ms(0.25));
  EXPECT_EQ(a.tasks[1].R.count(), ms(10.75));
  EXPECT_EQ(a.tasks[2].R.count(), ms(30.75));
  EXPECT_EQ(a.tasks[3].R.count(), ms(78.75));
  // With two switches of 8 us a job: 0.266; 8.016 + 11 of 0.266.
  const auto with = rt::analyse(set, {});
  EXPECT_EQ(with.tasks[0].R.count(), ms(0.266));
  EXPECT_EQ(with.tasks[1].R.count(), ms(10.942));
  EXPECT_LT(with.tasks[3].R.count(), ms(100));
}

TEST(Analysis, SwitchCostIsTwiceAJob) {
  const std::vector<AnalysisTask> set{task(100'000, 1'000'000, 1'000'000, 0),
                                      task(200'000, 5'000'000, 5'000'000, 1)};
  const AnalysisOptions eight;  // default
  EXPECT_EQ(rt::response_time(set, 0, eight).R.count(), 116'000);
  EXPECT_EQ(rt::response_time(set, 1, eight).R.count(), 216'000 + 116'000);
  EXPECT_NEAR(rt::utilisation(set, eight), 0.116 + 0.0432, 1e-12);
}

TEST(Analysis, JitterAndBlockingEnterAsInTindell) {
  // w = B + C = 7; the upper task arrives at 0 and, because of its jitter, again at 6 < 7 + 2.
  const std::vector<AnalysisTask> set{task(2, 8, 8, 0, 2), task(5, 40, 40, 1, 3, 2)};
  EXPECT_EQ(rt::response_time(set, 0, kNoSwitch).R.count(), 4);
  // w: 2 + 5 + ceil((w + 2) / 8) 2 -> 7, 11, 11; R = 11 + 3.
  EXPECT_EQ(rt::response_time(set, 1, kNoSwitch).R.count(), 14);
}

TEST(Analysis, EqualRanksDelayEachOther) {
  const std::vector<AnalysisTask> set{task(3, 20, 20, 5), task(4, 20, 20, 5)};
  EXPECT_EQ(rt::response_time(set, 0, kNoSwitch).R.count(), 7);
  EXPECT_EQ(rt::response_time(set, 1, kNoSwitch).R.count(), 7);
}

TEST(Analysis, OverloadIsReportedAndTerminates) {
  // U = 1.2 below rank 1, U just above 1 by one nanosecond, and exactly 1 with blocking.
  const std::vector<AnalysisTask> over{task(60, 100, 100, 0), task(60, 100, 1000, 1)};
  EXPECT_TRUE(rt::response_time(over, 0, kNoSwitch).bounded());
  const auto r = rt::response_time(over, 1, kNoSwitch);
  EXPECT_FALSE(r.bounded());
  EXPECT_FALSE(r.meets);
  const std::vector<AnalysisTask> hair{task(500'000'000, 1'000'000'000, 1'000'000'000, 0),
                                       task(500'000'001, 1'000'000'000, 9'000'000'000, 1)};
  EXPECT_FALSE(rt::response_time(hair, 1, kNoSwitch).bounded());
  const std::vector<AnalysisTask> full{task(50, 100, 100, 0), task(50, 100, 100, 1)};
  EXPECT_EQ(rt::response_time(full, 1, kNoSwitch).R.count(), 100);
  const std::vector<AnalysisTask> blocked{task(50, 100, 100, 0), task(50, 100, 1000, 1, 0, 1)};
  EXPECT_FALSE(rt::response_time(blocked, 1, kNoSwitch).bounded());
  EXPECT_LT(rt::growth_factor(over, 10.0, kNoSwitch), 1.0);
}

TEST(Analysis, UnboundedSlackIsNoNumberOfAJob) {
  const std::vector<AnalysisTask> over{task(200, 100, 100, 0)};
  const auto r = rt::response_time(over, 0, kNoSwitch);
  EXPECT_EQ(r.R, rt::kUnbounded);
  EXPECT_EQ(r.slack, Nanos::min());
}

TEST(Analysis, GrowthIsExactToOneTenThousandth) {
  const std::vector<AnalysisTask> one{task(100'000, 1'000'000, 1'000'000, 0)};
  EXPECT_DOUBLE_EQ(rt::growth_factor(one, 1.0, kNoSwitch), 10.0);
  EXPECT_DOUBLE_EQ(rt::growth_factor(one, 0.90, kNoSwitch), 9.0);
  // Two switches stay: (1'000'000 - 16'000) / 100'000.
  EXPECT_DOUBLE_EQ(rt::growth_factor(one, 1.0, {}), 9.84);
  const std::vector<AnalysisTask> never{task(10, 1'000, 1'000, 0)};
  EXPECT_DOUBLE_EQ(rt::growth_factor(never, 1.0, {}), 0.0);  // the switches alone are too much
}

TEST(Analysis, GrowthIsTheLastFactorThatFits) {
  const std::vector<AnalysisTask> set{task(250'000, 1'000'000, 1'000'000, 0),
                                      task(8'000'000, 33'333'333, 33'333'333, 1),
                                      task(20'000'000, 100'000'000, 60'000'000, 2)};
  const double f = rt::growth_factor(set, 1.0, {});
  const auto fits = [&](double factor) {
    auto grown = set;
    for (auto& t : grown) {
      t.C = Nanos{static_cast<std::int64_t>(std::ceil(static_cast<double>(t.C.count()) * factor))};
    }
    return rt::analyse(grown, {}).schedulable;
  };
  EXPECT_GT(f, 1.0);
  EXPECT_TRUE(fits(f));
  EXPECT_FALSE(fits(f + 1e-4));
}

TEST(Analysis, EmptySetFits) {
  const auto a = rt::analyse({}, {});
  EXPECT_TRUE(a.schedulable);
  EXPECT_EQ(a.utilisation, 0.0);
}

TEST(Analysis, BoundsDoNotApplyToShortDeadlinesOrOtherOrders) {
  const std::vector<AnalysisTask> short_d{task(1, 10, 5, 0)};
  EXPECT_FALSE(rt::analyse(short_d, kNoSwitch).bounds_apply);
  const std::vector<AnalysisTask> inverted{task(1, 20, 20, 0), task(1, 10, 10, 1)};
  EXPECT_FALSE(rt::analyse(inverted, kNoSwitch).bounds_apply);
}

rt::TaskSpec spec(const char* name, rt::Rate rate, std::int64_t deadline_ns = 0) {
  rt::TaskSpec s;
  s.name = name;
  s.rate = rate;
  s.deadline = Nanos{deadline_ns};
  s.budget = Nanos{1000};
  return s;
}

TEST(Ranks, PeriodThenDeadlineThenRegistration) {
  const std::vector<rt::TaskSpec> specs{
      spec("slow", {10, 1}), spec("fast", {1000, 1}), spec("fast_too", {2000, 2}),
      spec("fast_short", {1000, 1}, 500'000), spec("frames", {30, 1})};
  EXPECT_EQ(rt::rate_monotonic_order(specs), (std::vector<std::size_t>{3, 1, 2, 4, 0}));
  EXPECT_EQ(rt::rate_monotonic_ranks(specs), (std::vector<int>{4, 1, 2, 0, 3}));
}

TEST(Ranks, MinimumDistanceIsTheShortestThatOccurs) {
  for (const rt::Rate rate : {rt::Rate{30, 1}, rt::Rate{1000, 1}, rt::Rate{30000, 1001},
                              rt::Rate{7, 3}, rt::Rate{60, 1}}) {
    Nanos shortest = Nanos::max();
    for (std::uint64_t k = 0; k < 5000; ++k) {
      shortest = std::min(shortest, rate.release(k + 1) - rate.release(k));
    }
    EXPECT_EQ(rt::minimum_distance(rate), shortest) << rate.num << "/" << rate.den;
  }
}

TEST(Ranks, AnalysisRowOfADegradingTaskTakesTheDearestReachableVariant) {
  rt::TaskSpec s = spec("f", {10, 1});
  s.policy = rt::MissPolicy::kDegrade;
  s.variants = {{"full", Nanos{100}}, {"less", Nanos{150}}, {"least", Nanos{50}}};
  EXPECT_EQ(rt::analysis_task(s, 0, 0).C.count(), 150);
  EXPECT_EQ(rt::analysis_task(s, 2, 0).C.count(), 50);
  s.policy = rt::MissPolicy::kSkip;
  EXPECT_EQ(rt::analysis_task(s, 0, 0).C.count(), 100);
}

TEST(Ranks, ASpinLeadIsPaidForByTheTask) {
  rt::TaskSpec s = spec("f", {1000, 1});
  s.budget = Nanos{100'000};
  s.spin_lead = Nanos{30'000};
  EXPECT_EQ(rt::analysis_task(s, 0, 0).C.count(), 130'000);
}

TEST(Ranks, OnlyCatchUpMayRunPastThePeriod) {
  rt::TaskSpec s = spec("f", {10, 1}, 250'000'000);
  EXPECT_EQ(rt::effective_deadline(s).count(), 100'000'000);
  s.policy = rt::MissPolicy::kCatchUp;
  EXPECT_EQ(rt::effective_deadline(s).count(), 250'000'000);
}

}  // namespace
