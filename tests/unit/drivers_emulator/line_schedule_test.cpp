// The line over time, against a reference that walks through time in small steps.
#include "drivers/emulator/line_schedule.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "rt/random.hpp"

namespace {

using drivers::LineSchedule;
using drivers::NetworkConfig;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kEpoch = 7 * kSecond + 123;

// What the configuration says of one instant, read anew from its words.
double mbit_per_s_at(const NetworkConfig& c, double t_s) {
  for (const auto& s : c.stalls) {
    double into = t_s - s.at_s;
    if (into < 0) continue;
    if (s.every_s > 0) into = std::fmod(into, s.every_s);
    if (into < 1e-3 * s.for_ms) return 0;
  }
  double rate = c.rate_Mbit_per_s;
  for (const auto& r : c.rate_changes)
    if (r.at_s <= t_s) rate = r.rate_Mbit_per_s;
  return rate;
}

TEST(LineSchedule, CarriesWhatTheReferenceDoes) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    rt::Random random(seed);
    NetworkConfig c;
    c.rate_Mbit_per_s = random.uniform(0.5, 20);
    double at = 0;
    for (std::int64_t i = random.integer(0, 3); i > 0; --i)
      c.rate_changes.push_back({at += random.uniform(0.1, 1), random.uniform(0.5, 20)});
    for (std::int64_t i = random.integer(0, 2); i > 0; --i) {
      const double every = random.integer(0, 1) == 0 ? 0 : random.uniform(0.5, 2);
      c.stalls.push_back(
          {random.uniform(0, 2), random.uniform(1, every > 0 ? 400 * every : 800), every});
    }
    ASSERT_EQ(c.wrong(), "");
    const LineSchedule line(c, kEpoch);
    const double start_s = random.uniform(-0.5, 3);
    const auto bytes = static_cast<std::size_t>(random.integer(1, 400000));
    const std::int64_t start = kEpoch + static_cast<std::int64_t>(start_s * 1e9);
    const std::int64_t done = line.carried_at(start, bytes);
    constexpr double kStep_s = 1e-5;
    double bits = 8.0 * static_cast<double>(bytes), t = start_s;
    for (; bits > 0; t += kStep_s) bits -= 1e6 * kStep_s * mbit_per_s_at(c, t + kStep_s / 2);
    // Each border, of a rate or a stall, costs the reference up to a step.
    EXPECT_NEAR(1e-9 * static_cast<double>(done - kEpoch), t, 30 * kStep_s);
    EXPECT_GT(done, start);
  }
}

TEST(LineSchedule, WithoutABottleneckOnlyAStallTakesTime) {
  NetworkConfig c;
  c.stalls.push_back({1, 400, 4});
  const LineSchedule line(c, 0);
  EXPECT_EQ(line.carried_at(500 * kMs, 1000000), 500 * kMs);
  EXPECT_EQ(line.carried_at(1000 * kMs, 1), 1400 * kMs);
  EXPECT_EQ(line.carried_at(1399 * kMs, 1), 1400 * kMs);
  EXPECT_EQ(line.carried_at(1400 * kMs, 1), 1400 * kMs);
  EXPECT_EQ(line.carried_at(9100 * kMs, 1), 9400 * kMs) << "the third one";
}

TEST(LineSchedule, StallsThatOverlapAreOneLongStall) {
  NetworkConfig c;
  c.rate_Mbit_per_s = 8;
  c.stalls.push_back({1, 500, 0});
  c.stalls.push_back({1.4, 300, 0});
  c.stalls.push_back({1.7, 100, 0});  // begins as the second one ends
  const LineSchedule line(c, 0);
  EXPECT_EQ(line.stalled_until(1200 * kMs), 1800 * kMs);
  EXPECT_EQ(line.carried_at(999 * kMs, 2000), 1801 * kMs) << "1 ms before, 1 ms behind";
}

// A flap begins in the first half of its part of the minute, at another place each time.
TEST(LineSchedule, FlapsComeAtTheirRateWithoutARhythm) {
  NetworkConfig c;
  c.flaps_per_minute = 10;
  c.flap_down_ms = 500;
  c.flap_from_s = 5;
  ASSERT_EQ(c.wrong(), "");
  const LineSchedule line(c, kEpoch), again(c, kEpoch);
  std::uint64_t begun = 0;
  double down_ms = 0;
  std::set<std::int64_t> places;
  for (std::int64_t t = 0; t < 65000; ++t) {
    const auto f = line.flap_at(kEpoch + t * kMs);
    EXPECT_EQ(f.next_begin_ns, again.flap_at(kEpoch + t * kMs).next_begin_ns);
    EXPECT_GT(f.next_begin_ns, kEpoch + t * kMs);
    if (f.count != begun) {
      EXPECT_EQ(f.count, begun + 1);
      EXPECT_TRUE(f.down);
      EXPECT_LE((t - 5000) % 6000, 3000);
      places.insert((t - 5000) % 6000);
      begun = f.count;
    }
    down_ms += f.down ? 1 : 0;
    if (t < 5000) {
      EXPECT_EQ(f.count, 0U);
    }
  }
  EXPECT_EQ(begun, 10U);
  EXPECT_NEAR(down_ms, 5000, 10);
  EXPECT_GE(places.size(), 8U);
  c.seed = 2;
  EXPECT_NE(LineSchedule(c, kEpoch).flap_at(kEpoch).next_begin_ns,
            line.flap_at(kEpoch).next_begin_ns);
}

}  // namespace
