// The arithmetic of the console's bench on inputs whose answers are known in closed form.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rt/quantile.hpp"
#include "tools/measure/bench/console/console_figures.hpp"
#include "tools/measure/bench/paired.hpp"

namespace teletact {
namespace {

// 0.3 m/s until `falls_ms`, then a ramp; a sample every 10 ms.
std::vector<SpeedAt> ramp(double falls_ms, double slope_m_per_s2, double v0 = 0.3) {
  std::vector<SpeedAt> all;
  for (double t = 0; t < 1000; t += 10)
    all.push_back({t, std::max(0.0, v0 - 1e-3 * slope_m_per_s2 * std::max(0.0, t - falls_ms))});
  return all;
}

TEST(ConsoleFigures, AFallingSetpointIsFoundBetweenTheSamples) {
  for (const double falls : {541.0, 543.7, 549.999}) {
    const StopSeen s = stop_seen(ramp(falls, 4), 500.3);
    EXPECT_NEAR(s.before_m_per_s, 0.3, 1e-12);
    EXPECT_NEAR(s.falls_ms, falls - 500.3, 1e-6);
    EXPECT_NEAR(s.slope_m_per_s2, 4, 1e-9);
    EXPECT_NEAR(s.ramp_over(4), 1, 1e-9);
    EXPECT_NEAR(s.stands_ms, falls - 500.3 + 75, 10);
  }
}

TEST(ConsoleFigures, ARampThatIsTooSlowIsSeenAsSlow) {
  const StopSeen s = stop_seen(ramp(540, 2), 500);
  EXPECT_NEAR(s.falls_ms, 40, 1e-6);
  EXPECT_NEAR(s.ramp_over(4), 2, 1e-9);
}

TEST(ConsoleFigures, WhatDoesNotFallWasNotSeen) {
  const StopSeen on = stop_seen(ramp(5000, 4), 500);
  EXPECT_NEAR(on.before_m_per_s, 0.3, 1e-12);
  EXPECT_TRUE(std::isnan(on.falls_ms));
  EXPECT_TRUE(std::isnan(on.stands_ms));
  // Falls, and never stands: no stop either.
  auto half = ramp(540, 4);
  for (SpeedAt& s : half) s.v_m_per_s = std::max(s.v_m_per_s, 0.1);
  EXPECT_TRUE(std::isnan(stop_seen(half, 500).falls_ms));
  EXPECT_TRUE(std::isnan(stop_seen(ramp(540, 4, 0), 500).falls_ms)) << "it stood before";
  EXPECT_TRUE(std::isnan(stop_seen({}, 500).before_m_per_s));
}

TEST(ConsoleFigures, TheFirstJobThatStartsAtAnInstantOrAfterIt) {
  std::vector<rt::JobRecord> jobs(3);
  for (std::size_t i = 0; i < jobs.size(); ++i)
    jobs[i].start_ns = 100 * static_cast<std::int64_t>(i + 1);
  EXPECT_EQ(first_start(jobs, 0), 100);
  EXPECT_EQ(first_start(jobs, 200), 200);
  EXPECT_EQ(first_start(jobs, 201), 300);
  EXPECT_EQ(first_start(jobs, 301), std::nullopt);
}

TEST(ConsoleFigures, GrowthIsFromTheSecondTenthToTheLast) {
  std::vector<double> flat(100, 50.0);
  for (std::size_t i = 0; i < 10; ++i) flat[i] = 1 + static_cast<double>(i);
  EXPECT_DOUBLE_EQ(growth(flat).share(), 0) << "the first tenth is warm-up";
  std::vector<double> leak(100);
  for (std::size_t i = 0; i < leak.size(); ++i) leak[i] = 100 + static_cast<double>(i);
  // Medians of 10 are the lower of the two in the middle: 114 and 194.
  EXPECT_DOUBLE_EQ(growth(leak).first, 114);
  EXPECT_DOUBLE_EQ(growth(leak).last, 194);
  EXPECT_GT(growth(leak).share(), 0.05) << "a leak that must be seen";
  EXPECT_TRUE(std::isnan(growth(std::vector<double>(19, 1.0)).share()));
  const auto each = teletact::tenths(leak);
  ASSERT_EQ(each.size(), 10U);
  EXPECT_DOUBLE_EQ(each[1], growth(leak).first);
  EXPECT_DOUBLE_EQ(each[9], growth(leak).last);
  EXPECT_TRUE(teletact::tenths(std::vector<double>(19, 1.0)).empty());
}

TEST(ConsoleFigures, PairsGiveAMedianAndItsInterval) {
  // Differences 1 .. 10: with ten pairs the second from either end, 1 - 2 * 11 / 1024.
  std::vector<double> with, without;
  for (int i = 1; i <= 10; ++i) without.push_back(100 * i), with.push_back(100 * i + i);
  const PairedDifference d = paired(with, without);
  EXPECT_EQ(d.pairs, 10);
  EXPECT_DOUBLE_EQ(d.median, 5);
  EXPECT_DOUBLE_EQ(d.low, 2);
  EXPECT_DOUBLE_EQ(d.high, 9);
  EXPECT_DOUBLE_EQ(d.coverage, 1 - 2 * 11.0 / 1024);
  const PairedDifference few = paired(std::vector<double>{3, 5}, std::vector<double>{1, 1});
  EXPECT_DOUBLE_EQ(few.low, 2);
  EXPECT_DOUBLE_EQ(few.high, 4);
  EXPECT_DOUBLE_EQ(few.coverage, 0.5);
  EXPECT_TRUE(std::isnan(paired({}, {}).median));
}

TEST(ConsoleFigures, AQuantileOfNothingIsNoNumber) {
  EXPECT_TRUE(std::isnan(rt::quantile_or_nan({}, 0.95)));
  std::vector<double> v;
  for (int i = 1; i <= 20; ++i) v.push_back(i);
  EXPECT_DOUBLE_EQ(rt::quantile_or_nan(v, 0.95), 19);
}

}  // namespace
}  // namespace teletact
