#include "rt/sched/policy.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <vector>

#include "rt/random.hpp"
#include "rt/sched/task.hpp"

namespace {

using rt::LevelControl;
using rt::MissBucket;
using rt::MissPolicy;
using rt::Time;

TEST(NextRelease, EqualsAListOfArrivals) {
  constexpr std::uint64_t kSeed = 900;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 20000; ++n) {
    // Releases 10 apart, some injected late; an arrival never overtakes the one before.
    std::vector<std::int64_t> raw(60), arrival(60);
    for (std::size_t i = 0; i < raw.size(); ++i) {
      raw[i] = static_cast<std::int64_t>(i) * 10 + (r.uniform() < 0.2 ? r.integer(0, 40) : 0);
      arrival[i] = i == 0 ? raw[i] : std::max(raw[i], arrival[i - 1]);
    }
    rt::TaskSpec spec;
    spec.policy = static_cast<MissPolicy>(r.integer(0, 3));
    spec.catch_up_max = static_cast<int>(r.integer(0, 5));
    const auto k = static_cast<std::uint64_t>(r.integer(0, 20));
    const std::int64_t end = arrival[k] + r.integer(1, 120);
    const auto next =
        rt::next_release(spec, k, rt::time_from_ns(arrival[k]), rt::time_from_ns(end),
                         [&](std::uint64_t i) { return rt::time_from_ns(raw.at(i)); });
    std::vector<std::uint64_t> pending;
    std::uint64_t i = k + 1;
    for (; arrival[i] < end; ++i) pending.push_back(i);
    std::size_t keep = spec.policy == MissPolicy::kCatchUp
                           ? std::min(pending.size(), static_cast<std::size_t>(spec.catch_up_max))
                           : 0;
    ASSERT_EQ(next.skipped, pending.size() - keep) << n;
    ASSERT_EQ(next.k, keep > 0 ? pending[pending.size() - keep] : i) << n;
    if (keep > 0) {
      ASSERT_LE(rt::ns_of(next.arrival), end) << "a kept one has arrived already";
    } else {
      ASSERT_EQ(rt::ns_of(next.arrival), arrival[i]) << n;
    }
  }
}

TEST(NextRelease, AnArrivalExactlyAtTheEndIsServed) {
  rt::TaskSpec spec;
  const auto raw = [](std::uint64_t i) {
    return rt::time_from_ns(static_cast<std::int64_t>(i) * 10);
  };
  auto next = rt::next_release(spec, 3, rt::time_from_ns(30), rt::time_from_ns(50), raw);
  EXPECT_EQ(next.k, 5U);
  EXPECT_EQ(next.skipped, 1U);
  next = rt::next_release(spec, 3, rt::time_from_ns(30), rt::time_from_ns(51), raw);
  EXPECT_EQ(next.k, 6U);
  EXPECT_EQ(next.skipped, 2U);
}

TEST(LevelControl, DownAfterAMissUpAfterCleanOnes) {
  LevelControl c(0, 2, 4);
  EXPECT_FALSE(c.at_boundary(false));
  c.on_miss();
  c.on_miss();
  EXPECT_FALSE(c.at_boundary(true)) << "never while a job is pending";
  EXPECT_EQ(c.level(), 0);
  EXPECT_TRUE(c.at_boundary(false));
  EXPECT_EQ(c.level(), 1) << "one level, however many misses";
  c.on_miss();
  EXPECT_TRUE(c.at_boundary(false));
  c.on_miss();
  EXPECT_FALSE(c.at_boundary(false)) << "there is no smaller one";
  EXPECT_EQ(c.level(), 2);
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(c.at_boundary(false));
  EXPECT_TRUE(c.at_boundary(false));
  EXPECT_EQ(c.level(), 1);
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(c.at_boundary(false));
  c.on_miss();  // starts the count anew
  EXPECT_TRUE(c.at_boundary(false));
  for (int i = 0; i < 8; ++i) (void)c.at_boundary(false);
  EXPECT_EQ(c.level(), 0);
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(c.at_boundary(false)) << "never above the start level";
}

TEST(LevelControl, NeverAboveTheLevelThatAdmissionChose) {
  LevelControl c(1, 2, 1);
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(c.at_boundary(false));
  EXPECT_EQ(c.level(), 1);
}

TEST(LevelControl, NeverBeyondTheLastLevelThatAdmissionReckonedWith) {
  LevelControl c(0, 1, 1);
  for (int i = 0; i < 5; ++i) {
    c.on_miss();
    (void)c.at_boundary(false);
  }
  EXPECT_EQ(c.level(), 1);
  rt::PlacedTask t;
  EXPECT_EQ(t.lowest_level(), 0) << "one level";
  t.spec.variants.resize(3);
  EXPECT_EQ(t.lowest_level(), 2) << "unless told, the smallest there is";
  t.last_level = 1;
  EXPECT_EQ(t.lowest_level(), 1);
}

TEST(MissBucket, LeaksAndForces) {
  MissBucket b(3);
  EXPECT_FALSE(b.on_job(true, 0));
  EXPECT_FALSE(b.on_job(true, 0));
  EXPECT_FALSE(b.on_job(false, 0));
  EXPECT_FALSE(b.on_job(true, 0));
  EXPECT_FALSE(b.on_job(true, 0));
  EXPECT_TRUE(b.on_job(true, 0));
  EXPECT_FALSE(b.on_job(false, 0)) << "back at the limit";
  for (int i = 0; i < 9; ++i) (void)b.on_job(false, 0);
  EXPECT_EQ(b.level(), 0);
  EXPECT_TRUE(b.on_job(false, 3)) << "skipped releases count, one each";
  for (int i = 0; i < 9; ++i) (void)b.on_job(false, 0);
  EXPECT_EQ(b.level(), 0) << "and nothing stays of them";
  MissBucket never(0);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(never.on_job(true, 9));
}

// A process that was stopped for 2 s, or a machine that slept for an hour: at 1 kHz that many
// releases are skipped at once.
TEST(MissBucket, IsWellAfterAsManyJobsInTimeAsItsLimit) {
  for (const std::uint32_t skipped : {101U, 2000U, 3'600'000U, 4'294'967'295U}) {
    MissBucket b(100);
    EXPECT_TRUE(b.on_job(true, skipped));
    EXPECT_TRUE(b.on_job(true, skipped));
    int forced = 0;
    while (b.on_job(false, 0)) ++forced;
    EXPECT_EQ(forced, 99) << skipped;
  }
}

}  // namespace
