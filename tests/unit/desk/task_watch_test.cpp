// The timing table of the page: against sums made by hand, and blame of a known story.
#include "tools/desk/task_watch.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "rt/random.hpp"

namespace {

using namespace std::chrono_literals;
using teletact::TaskFigures;
using teletact::TaskWatch;

constexpr std::uint16_t kTask = 3;
constexpr std::int64_t kPeriod = 10'000'000, kBudget = 2'000'000;

rt::RunLog header() {
  rt::RunLog log;
  rt::TaskLog& t = log.tasks.emplace_back();
  t.id = kTask;
  t.core = 1;
  t.spec.name = "planning";
  t.spec.rate = {100, 1};
  t.spec.budget = rt::Nanos{kBudget};
  t.spec.box = rt::Box::kOperator;
  t.work_min = 1, t.work_max = 100;
  return log;
}

rt::JobRecord job(std::uint64_t k, std::int64_t late_ns, std::int64_t cpu_ns) {
  rt::JobRecord r;
  r.k = k;
  r.task = kTask;
  r.release_ns = static_cast<std::int64_t>(k) * kPeriod;
  r.start_ns = r.release_ns + late_ns;
  r.end_ns = r.start_ns + cpu_ns;
  r.deadline_ns = r.release_ns + kPeriod;
  r.cpu_ns = cpu_ns;
  r.work = 50;
  return r;
}

TEST(TaskWatch, LatenessAndCpuAreOfTheNewestFiveSeconds) {
  TaskWatch watch;
  watch.tasks(header());
  rt::Random random(17, 0);
  std::vector<std::int64_t> late;
  double cpu = 0;
  constexpr std::uint64_t kJobs = 1200, kOfWindow = 500;
  for (std::uint64_t k = 1; k <= kJobs; ++k) {
    const auto l = static_cast<std::int64_t>(random.uniform(0, 90000));
    const auto c = static_cast<std::int64_t>(random.uniform(1e5, 1.5e6));
    watch.add(job(k, l, c));
    if (k > kJobs - kOfWindow) late.push_back(l), cpu += static_cast<double>(c);
    if (k % 37 == 0) watch.look();
  }
  watch.look();
  const auto rows = watch.now();
  ASSERT_EQ(rows.size(), 1U);
  const TaskFigures& f = rows.front();
  EXPECT_EQ(f.name, "planning");
  EXPECT_EQ(f.box, "operator");
  EXPECT_DOUBLE_EQ(f.hz, 100);
  EXPECT_EQ(f.jobs, kOfWindow);
  std::sort(late.begin(), late.end());
  EXPECT_DOUBLE_EQ(f.late_p95_us, 1e-3 * static_cast<double>(late[474]));
  EXPECT_NEAR(f.cpu_ms, 1e-6 * cpu / kOfWindow, 1e-9);
  EXPECT_NEAR(f.cpu_share, cpu / kOfWindow / kPeriod, 1e-9);
  EXPECT_EQ(f.misses, 0U);
  EXPECT_EQ(f.blame_text(), "");
}

TEST(TaskWatch, MissesAreOfTheWholeRunAndSayWhoseFault) {
  TaskWatch watch;
  watch.tasks(header());
  // More work than calibration saw: its own fault. It runs over two releases.
  rt::JobRecord slow = job(1, 0, 25'000'000);
  slow.work = 1000;
  watch.add(slow);
  rt::JobRecord after = job(4, 0, 100'000);
  after.skipped = 2;
  watch.add(after);
  // Its core was not to be had, as the sentinel there says: it comes with a later look.
  watch.add(rt::SentinelRecord{10 * kPeriod, 11'000'000, 1});
  watch.look();
  watch.add(job(10, 11'000'000, 100'000));
  // The same lateness, and a sentinel of another core.
  watch.add(rt::SentinelRecord{20 * kPeriod, 11'000'000, 0});
  watch.add(job(20, 11'000'000, 100'000));
  watch.look();
  for (std::uint64_t k = 30; k < 2000; ++k) watch.add(job(k, 1000, 100'000));
  watch.look();
  const TaskFigures f = watch.now().front();
  EXPECT_EQ(f.misses, 5U);
  EXPECT_EQ(f.by_cause[static_cast<std::size_t>(rt::Cause::kOwn)], 3U);
  EXPECT_EQ(f.by_cause[static_cast<std::size_t>(rt::Cause::kPlatform)], 1U);
  EXPECT_EQ(f.by_cause[static_cast<std::size_t>(rt::Cause::kUnknown)], 1U);
  EXPECT_EQ(f.blame_text(), "3 own, 1 platform, 1 unknown");
}

TEST(TaskWatch, WhatNobodyTakesIsBounded) {
  TaskWatch watch;
  watch.tasks(header());
  for (std::uint64_t k = 1; k <= TaskWatch::kMostWaiting + 10; ++k) watch.add(job(k, 0, 1000));
  EXPECT_EQ(watch.dropped(), 10U);
  watch.look();
  EXPECT_EQ(watch.now().front().jobs, 500U);
}

TEST(TaskWatch, ARecordOfNoKnownTaskCountsNowhere) {
  TaskWatch watch;
  watch.add(job(1, 0, 1000));
  watch.look();
  EXPECT_TRUE(watch.now().empty());
  watch.tasks(header());
  watch.look();
  ASSERT_EQ(watch.now().size(), 1U);
  EXPECT_EQ(watch.now().front().jobs, 0U);
}

}  // namespace
