// Blame on records whose truth is known by construction: the test decides what happens to a job and
// writes down what the kernel and the sentinel would have counted.
#include "rt/audit/blame.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <numeric>
#include <string>

#include "rt/random.hpp"

namespace {

using rt::Cause;
using rt::JobRecord;
using rt::Outcome;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kUs = 1000;

std::uint64_t count(const std::array<std::uint64_t, rt::kCauses>& by, Cause c) {
  return by[static_cast<std::size_t>(c)];
}

// A 1000 Hz task on core 0 with a budget of 200 us and work calibrated to 100 .. 1000.
class Story {
 public:
  Story() {
    rt::TaskLog t;
    t.spec.name = "haptic";
    t.spec.rate = {1000, 1};
    t.spec.budget = rt::Nanos{200 * kUs};
    t.work_min = 100;
    t.work_max = 1000;
    log_.tasks.push_back(t);
  }
  // A job that starts after `wait`, uses `cpu`, ends at start + wall.
  JobRecord& job(std::int64_t wait, std::int64_t cpu, std::int64_t wall = 0) {
    JobRecord r;
    r.k = k_++;
    r.release_ns = release(r.k);
    r.deadline_ns = r.release_ns + kMs;
    r.start_ns = r.release_ns + wait;
    r.cpu_ns = cpu;
    r.end_ns = r.start_ns + std::max(cpu, wall);
    r.work = 500;
    r.voluntary = 1;
    task().jobs.push_back(r);
    return task().jobs.back();
  }
  void skip_to(std::uint64_t k) { k_ = k; }
  void sentinel(std::uint64_t k, std::int64_t late, int core = 0) {
    log_.sentinels.push_back({release(k), late, static_cast<std::uint16_t>(core)});
  }
  rt::TaskLog& task() { return log_.tasks[0]; }
  rt::RunLog& log() { return log_; }
  rt::TaskBlame judge() const { return rt::blame(log_, log_.tasks[0]); }
  static std::int64_t release(std::uint64_t k) {
    return 10'000 * kMs + static_cast<std::int64_t>(k) * kMs;
  }

 private:
  rt::RunLog log_;
  std::uint64_t k_ = 0;
};

void expect_total(const rt::TaskBlame& b) {
  EXPECT_EQ(std::accumulate(b.misses.begin(), b.misses.end(), std::uint64_t{0}), b.miss_total);
  EXPECT_EQ(std::accumulate(b.late.begin(), b.late.end(), std::uint64_t{0}), b.late_total);
  EXPECT_EQ(b.releases, b.completed + b.aborted + b.skipped);
}

TEST(Blame, AQuietRunHasNothingToBlame) {
  Story s;
  for (int i = 0; i < 100; ++i) {
    s.sentinel(static_cast<std::uint64_t>(i), 5 * kUs);
    s.job(20 * kUs, 100 * kUs);
  }
  const auto b = s.judge();
  EXPECT_EQ(b.miss_total, 0U);
  EXPECT_EQ(b.late_total, 0U);
  EXPECT_EQ(b.completed, 100U);
  expect_total(b);
}

// Ten releases run, two are dropped before the last, then the thread ends: of the totals' skips
// beyond the records, the lost ones are its own.
TEST(Blame, WhatAnEndedThreadLostIsItsOwn) {
  Story s;
  for (int i = 0; i < 9; ++i) s.job(20 * kUs, 100 * kUs);
  s.skip_to(11);
  s.job(20 * kUs, 100 * kUs).skipped = 2;
  EXPECT_EQ(s.judge().miss_total, 2U) << "the records alone say no more";
  s.task().totals = rt::TaskTotals{10, 0, 0, 2 + 3 + 40, 0, 40};
  const auto b = s.judge();
  EXPECT_EQ(count(b.misses, Cause::kOwn), 40U);
  EXPECT_EQ(count(b.misses, Cause::kUnknown), 2U + 3U);
  EXPECT_EQ(b.miss_total, 45U);
  EXPECT_EQ(b.releases, 55U);
  expect_total(b);
  s.task().totals = rt::TaskTotals{10, 0, 0, 2, 0, 0};
  EXPECT_EQ(s.judge().miss_total, 2U) << "what the records told is not counted twice";
}

TEST(Blame, LateOnTheLimitIsNotLate) {
  Story s;
  s.job(150 * kUs, 10 * kUs);
  s.job(150 * kUs + 1, 10 * kUs);
  EXPECT_EQ(s.judge().late_total, 1U);
}

TEST(Blame, PlatformBySentinelGap) {
  Story s;
  s.sentinel(0, 950 * kUs);
  s.job(960 * kUs, 100 * kUs);
  const auto b = s.judge();
  EXPECT_EQ(count(b.late, Cause::kPlatform), 1U);
  EXPECT_EQ(count(b.misses, Cause::kPlatform), 1U);
  EXPECT_EQ(b.jobs[0].platform, 950 * kUs);
  expect_total(b);
}

TEST(Blame, ASentinelOfAnotherCoreProvesNothing) {
  Story s;
  s.sentinel(0, 950 * kUs, 1);
  s.job(960 * kUs, 100 * kUs);
  const auto b = s.judge();
  EXPECT_EQ(count(b.late, Cause::kUnknown), 1U);
  EXPECT_EQ(count(b.misses, Cause::kUnknown), 1U);
}

TEST(Blame, QueuedWhenRunnableAndTheSentinelOnTime) {
  Story s;
  s.sentinel(0, 5 * kUs);
  s.job(950 * kUs, 100 * kUs).run_delay_ns = 940 * kUs;
  const auto b = s.judge();
  EXPECT_EQ(count(b.late, Cause::kQueued), 1U);
  EXPECT_EQ(count(b.misses, Cause::kQueued), 1U);
}

// Pre-empted in the middle: started in time, then waited for a higher task.
TEST(Blame, QueuedInsideTheJob) {
  Story s;
  s.job(10 * kUs, 100 * kUs, 1200 * kUs).run_delay_ns = 1110 * kUs;
  const auto b = s.judge();
  EXPECT_EQ(b.late_total, 0U);
  EXPECT_EQ(count(b.misses, Cause::kQueued), 1U);
}

TEST(Blame, OwnByCpuOverBudgetWithMoreWork) {
  Story s;
  s.job(10 * kUs, 2000 * kUs).work = 1001;
  const auto b = s.judge();
  EXPECT_EQ(count(b.misses, Cause::kOwn), 1U);
  EXPECT_EQ(b.jobs[0].own, 1800 * kUs);
}

TEST(Blame, ChargedWhenTheWorkIsInsideCalibration) {
  Story s;
  s.job(10 * kUs, 2000 * kUs).work = 1000;
  const auto b = s.judge();
  EXPECT_EQ(count(b.misses, Cause::kCharged), 1U);
  EXPECT_EQ(b.jobs[0].charged, 1800 * kUs);
}

TEST(Blame, WithoutCalibrationOverBudgetIsOwn) {
  Story s;
  s.task().work_min = s.task().work_max = 0;
  s.job(10 * kUs, 2000 * kUs);
  EXPECT_EQ(count(s.judge().misses, Cause::kOwn), 1U);
}

TEST(Blame, OwnByAVoluntaryWait) {
  Story s;
  s.job(10 * kUs, 100 * kUs, 2000 * kUs).voluntary = 2;
  EXPECT_EQ(count(s.judge().misses, Cause::kOwn), 1U);
}

TEST(Blame, WallWithoutCpuOrDelayIsThePlatform) {
  Story s;
  s.job(10 * kUs, 100 * kUs, 2000 * kUs);
  EXPECT_EQ(count(s.judge().misses, Cause::kPlatform), 1U);
}

TEST(Blame, CarriedFromThePreviousJob) {
  Story s;
  s.job(10 * kUs, 1880 * kUs).work = 5000;       // ends 110 us before the deadline of the next
  s.job(890 * kUs, 150 * kUs).run_delay_ns = 0;  // runs at once when the first one ends
  const auto b = s.judge();
  EXPECT_EQ(count(b.misses, Cause::kOwn), 1U);
  EXPECT_EQ(count(b.misses, Cause::kCarried), 1U);
  EXPECT_EQ(count(b.late, Cause::kCarried), 1U);
  EXPECT_EQ(b.jobs[1].carried, 890 * kUs);
}

TEST(Blame, UnknownWhenHalfIsNotExplained) {
  for (const auto& [explained, cause] :
       {std::pair{470 * kUs, Cause::kUnknown}, std::pair{500 * kUs, Cause::kPlatform}}) {
    Story s;
    s.sentinel(0, explained);
    s.job(950 * kUs, 100 * kUs);
    const auto b = s.judge();
    EXPECT_EQ(count(b.late, cause), 1U) << explained;
    EXPECT_EQ(count(b.misses, cause), 1U) << explained;
    expect_total(b);
  }
}

// What comes after the start can not have made the start late.
TEST(Blame, ALateStartIsNotBlamedOnTheJobItself) {
  Story s;
  s.job(400 * kUs, 3000 * kUs).work = 9999;
  s.task().jobs[0].run_delay_ns = 390 * kUs;
  const auto b = s.judge();
  EXPECT_EQ(count(b.late, Cause::kQueued), 1U);
  EXPECT_EQ(count(b.misses, Cause::kOwn), 1U);
}

TEST(Blame, SkippedReleasesTakeTheCauseOfTheJobThatRanOverThem) {
  Story s;
  s.job(10 * kUs, 5500 * kUs).work = 9999;  // runs over releases 1 to 5
  s.skip_to(6);
  s.job(10 * kUs, 100 * kUs).skipped = 5;
  s.sentinel(7, 3200 * kUs);
  s.job(3210 * kUs, 100 * kUs);  // runs over 8, 9 and 10
  s.skip_to(11);
  s.job(10 * kUs, 100 * kUs).skipped = 3;
  const auto b = s.judge();
  EXPECT_EQ(count(b.misses, Cause::kOwn), 6U);
  EXPECT_EQ(count(b.misses, Cause::kPlatform), 4U);
  EXPECT_EQ(b.skipped, 8U);
  EXPECT_EQ(b.miss_total, 10U);
  EXPECT_EQ(b.releases, 12U);
  expect_total(b);
}

TEST(Blame, AbortedJobsAreMisses) {
  Story s;
  auto& r = s.job(10 * kUs, 980 * kUs);
  r.outcome = Outcome::kAborted;
  r.end_ns = r.deadline_ns;
  r.work = 2000;
  const auto b = s.judge();
  EXPECT_EQ(b.aborted, 1U);
  EXPECT_EQ(b.completed, 0U);
  EXPECT_EQ(count(b.misses, Cause::kOwn), 1U);
  expect_total(b);
}

TEST(Blame, TheBudgetIsThatOfTheLevelInForce) {
  Story s;
  s.task().spec.variants = {{"full", rt::Nanos{3 * kMs}}, {"small", rt::Nanos{200 * kUs}}};
  auto& a = s.job(10 * kUs, 2000 * kUs);
  a.work = 9999;
  a.level = 1;
  EXPECT_EQ(s.judge().jobs[0].own, 1800 * kUs);
  s.task().jobs[0].level = 0;
  EXPECT_EQ(s.judge().jobs[0].own, 0);
}

// The run delay since the last job's end can be more than this job was off the CPU: the rest fell
// between the two. A job that burned its own time may not hide behind it.
TEST(Blame, RunDelayBetweenJobsIsNotQueueingInsideThisOne) {
  Story s;
  s.job(10 * kUs, 2000 * kUs).work = 9999;
  s.task().jobs[0].run_delay_ns = 3000 * kUs;
  const auto b = s.judge();
  EXPECT_EQ(count(b.misses, Cause::kOwn), 1U);
  EXPECT_LE(b.jobs[0].queued, 10 * kUs);
}

// A theft that hides several releases: the samples overlap, one lies inside another, and the gap is
// still seen as a whole.
TEST(Blame, OverlappingSentinelSamplesUnite) {
  Story s;
  s.sentinel(0, 5000 * kUs);
  s.sentinel(1, 100 * kUs);  // wholly inside the first
  s.sentinel(2, 3200 * kUs);
  s.skip_to(3);
  s.job(2150 * kUs, 100 * kUs);  // released inside the gap, started at its end
  const auto b = s.judge();
  EXPECT_EQ(b.jobs[0].platform, 2150 * kUs);
  EXPECT_EQ(count(b.misses, Cause::kPlatform), 1U);
}

// Against brute force: a microsecond grid that says for each cell whether any gap covers it.
TEST(Blame, PlatformPartEqualsBruteForceOnRandomGaps) {
  constexpr std::uint64_t kSeed = 808;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 500; ++n) {
    Story s;
    std::vector<bool> covered(30000, false);
    for (std::uint64_t k = 0; k < 12; ++k) {
      if (r.uniform() < 0.4) continue;
      const std::int64_t late = r.uniform() < 0.3 ? r.integer(0, 9000) : r.integer(0, 300);
      s.sentinel(k, late * kUs);
      for (std::int64_t us = 0; us < late; ++us)
        covered[static_cast<std::size_t>(static_cast<std::int64_t>(k) * 1000 + us)] = true;
    }
    const auto k = static_cast<std::uint64_t>(r.integer(0, 11));
    const std::int64_t wait = r.integer(0, 8000);
    s.skip_to(k);
    s.job(wait * kUs, 10 * kUs);
    std::int64_t want = 0;
    for (std::int64_t us = 0; us < wait; ++us)
      want += covered[static_cast<std::size_t>(static_cast<std::int64_t>(k) * 1000 + us)] ? 1 : 0;
    ASSERT_EQ(s.judge().jobs[0].platform, want * kUs) << "seed " << kSeed << " case " << n;
  }
}

// One dominating truth a job, with a little of everything else mixed in: the verdict names it.
TEST(Blame, TheDominatingCauseWinsInAMixture) {
  constexpr std::uint64_t kSeed = 809;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  std::array<int, 5> seen{};
  for (int n = 0; n < 5000; ++n) {
    Story s;
    const auto truth = static_cast<Cause>(r.integer(0, 4));
    const std::int64_t main = r.integer(1100, 4000) * kUs;
    std::array<std::int64_t, 5> part{};
    for (auto& p : part) p = r.integer(0, 200) * kUs;
    part[static_cast<std::size_t>(truth)] = main;
    const auto [carried, platform, queued, own, charged] = part;
    if (carried > 0) {
      s.job(0, 0);
      s.task().jobs[0].end_ns = Story::release(1) + carried;
      s.task().jobs[0].release_ns = Story::release(1) - kMs;
    }
    s.skip_to(1);
    // The sentinel of this release fires late by the carried span and the platform's.
    if (platform > 0) s.log().sentinels.push_back({Story::release(1) + carried, platform, 0});
    const bool by_wait = r.uniform() < 0.3;
    // One job's excess of CPU is either own or charged; the other one of the two does not happen.
    const bool excess_own = truth == Cause::kOwn || (truth != Cause::kCharged && r.uniform() < 0.5);
    const std::int64_t excess = excess_own ? own : charged;
    const std::int64_t cpu = 200 * kUs + (by_wait && excess_own ? 0 : excess);
    const std::int64_t wall = cpu + (by_wait && excess_own ? excess : 0);
    auto& job = s.job(carried + platform + queued, cpu, wall);
    job.run_delay_ns = queued;
    job.work = excess_own && !by_wait ? 1500 : 700;
    job.voluntary = by_wait && excess_own ? 2 : 1;
    const auto b = s.judge();
    ASSERT_TRUE(b.jobs.back().missed);
    ASSERT_EQ(b.jobs.back().miss_cause, truth)
        << "seed " << kSeed << " case " << n << " got " << rt::name_of(b.jobs.back().miss_cause);
    ++seen[static_cast<std::size_t>(truth)];
    expect_total(b);
  }
  for (const int v : seen) EXPECT_GT(v, 500);
}

// Any records at all: every miss and late start has exactly one cause, and nothing is lost.
TEST(Blame, RandomRecordsEachMissHasExactlyOneCause) {
  constexpr std::uint64_t kSeed = 810;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 400; ++n) {
    Story s;
    std::uint64_t late = 0, missed = 0, skipped = 0, aborted = 0, k = 0;
    std::int64_t end = 0;
    for (int i = 0; i < 50; ++i) {
      if (r.uniform() < 0.7) s.sentinel(k, r.integer(0, 3000) * kUs);
      s.skip_to(k);
      const std::int64_t wait =
          std::max<std::int64_t>(end - Story::release(k), r.integer(0, 1500) * kUs);
      auto& job = s.job(std::max<std::int64_t>(0, wait), r.integer(0, 2000) * kUs,
                        r.integer(0, 2500) * kUs);
      job.run_delay_ns = r.integer(0, 3000) * kUs;
      job.twin_cpu_ns = r.integer(0, 100) * kUs;
      job.work = static_cast<std::uint64_t>(r.integer(0, 2000));
      job.voluntary = static_cast<std::uint32_t>(r.integer(0, 3));
      job.skipped = static_cast<std::uint32_t>(i == 0 ? 0 : r.integer(0, 3));
      if (r.uniform() < 0.1) job.outcome = Outcome::kAborted;
      late += job.start_ns - job.release_ns > 150 * kUs ? 1 : 0;
      missed += job.outcome == Outcome::kAborted || job.end_ns > job.deadline_ns ? 1 : 0;
      skipped += job.skipped;
      aborted += job.outcome == Outcome::kAborted ? 1 : 0;
      end = job.end_ns;
      k += 1 + static_cast<std::uint64_t>(r.integer(0, 3));
    }
    const auto b = s.judge();
    ASSERT_EQ(b.jobs.size(), 50U);
    ASSERT_EQ(b.late_total, late);
    ASSERT_EQ(b.miss_total, missed + skipped);
    ASSERT_EQ(b.skipped, skipped);
    ASSERT_EQ(b.aborted, aborted);
    ASSERT_EQ(b.completed, 50U - aborted);
    expect_total(b);
    for (const auto& j : b.jobs) {
      for (const std::int64_t v : {j.carried, j.platform, j.queued, j.own, j.charged})
        ASSERT_GE(v, 0);
    }
  }
}

TEST(Blame, NamesAreDistinct) {
  EXPECT_EQ(rt::name_of(Cause::kCarried), "carried");
  EXPECT_EQ(rt::name_of(Cause::kUnknown), "unknown");
}

TEST(LateMinusSentinel, OnlyCleanStartsWithASample) {
  Story s;
  s.sentinel(0, 30 * kUs);
  s.job(50 * kUs, 10 * kUs);
  s.job(60 * kUs, 2000 * kUs);  // no sample
  s.sentinel(2, 10 * kUs);
  s.job(1070 * kUs, 10 * kUs);  // carried
  s.sentinel(3, 90 * kUs, 1);   // another core
  s.skip_to(4);
  s.sentinel(4, 25 * kUs);
  s.job(20 * kUs, 10 * kUs);
  EXPECT_EQ(rt::late_minus_sentinel(s.log(), s.task()),
            (std::vector<std::int64_t>{20 * kUs, -5 * kUs}));
}

}  // namespace
