// Simulated time is never ahead of the real one, catches up a little, and forgives what is more.
#include "tools/host/pacer.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace {

using teletact::Pacer;
constexpr std::int64_t kMs = 1'000'000;

struct Clock {
  std::int64_t now = 777'000 * kMs;  // any
  std::int64_t late = 0;             // of every sleep
  int sleeps = 0;
};

Pacer pacer(Clock& c, std::int64_t start) {
  return {start, [&c] { return c.now; },
          [&c](std::int64_t until) {
            ++c.sleeps;
            c.now = until + c.late;
          }};
}

TEST(Pacer, SimulatedTimeIsNeverAheadAndKeepsUp) {
  Clock c;
  c.late = kMs / 10;
  Pacer p = pacer(c, 1000 * kMs);
  const std::int64_t began = c.now;
  std::int64_t before = 0;
  for (int i = 0; i < 5000; ++i) {
    const std::int64_t at = p.next_host_ns();
    ASSERT_GT(at, before);
    before = at;
    p.act(at);
    c.now += kMs / 2;  // the work of a millisecond
    // The latest instant that may be simulated before the next look.
    ASSERT_GE(c.now - began, p.next_host_ns() - 1000 * kMs) << "look " << i;
  }
  EXPECT_EQ(p.lag_ns(), 0);
  EXPECT_NEAR(static_cast<double>(p.wall_ns()), 5000.0 * kMs, 2.0 * kMs);
  EXPECT_GT(c.sleeps, 4900);
}

TEST(Pacer, AShortDelayIsCaughtUpWith) {
  Clock c;
  Pacer p = pacer(c, 0);
  for (int i = 0; i < 300; ++i) {
    p.act(p.next_host_ns());
    if (i == 100) c.now += 80 * kMs;
  }
  EXPECT_EQ(p.lag_ns(), 0);
  EXPECT_EQ(p.wall_ns(), 300 * kMs);
}

TEST(Pacer, ALongOneIsForgivenAndTimeDoesNotRunFast) {
  Clock c;
  Pacer p = pacer(c, 0);
  for (int i = 0; i <= 100; ++i) p.act(p.next_host_ns());
  c.now += 3000 * kMs;
  const std::int64_t behind = c.now;
  for (int i = 0; i < 1000; ++i) p.act(p.next_host_ns());
  EXPECT_NEAR(static_cast<double>(p.lag_ns()), 3000.0 * kMs, 2.0 * kMs);
  EXPECT_GE(c.now - behind, 998 * kMs) << "a second of simulated time took a second";
}

TEST(Pacer, ASlowMachineLags) {
  Clock c;
  Pacer p = pacer(c, 0);
  for (int i = 0; i < 2000; ++i) {
    p.act(p.next_host_ns());
    c.now += 2 * kMs;
  }
  EXPECT_NEAR(static_cast<double>(p.wall_ns()), 4000.0 * kMs, 5.0 * kMs);
  EXPECT_GT(p.lag_ns(), 1800 * kMs);
}

TEST(Pacer, ASleepCutShortIsNoError) {
  std::int64_t now = 0;
  Pacer p(
      0, [&] { return now; }, [](std::int64_t) {});
  for (int i = 0; i < 10; ++i) p.act(p.next_host_ns());
  EXPECT_EQ(p.next_host_ns(), 10 * kMs);
}

}  // namespace
