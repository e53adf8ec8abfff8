// The reference judged by hand: each rule of its header on a schedule small enough to draw.
#include "tests/support/reference_sim.hpp"

#include <gtest/gtest.h>

#include <cstdio>

#include "rt/random.hpp"

namespace {

using support::SimConfig;
using support::SimOutcome;
using support::SimPolicy;
using support::SimTask;
using support::Ticks;

SimTask task(const char* name, Ticks cost, Ticks period, Ticks deadline, int priority,
             SimPolicy policy = SimPolicy::kSkip) {
  SimTask t;
  t.name = name;
  t.cost = cost;
  t.period = period;
  t.deadline = deadline;
  t.priority = priority;
  t.policy = policy;
  return t;
}

rt::FaultEntry fault(rt::FaultKind kind, const char* target, std::uint64_t first, Ticks magnitude,
                     std::uint64_t count = 1) {
  rt::FaultEntry e;
  e.kind = kind;
  e.target = target;
  e.first = first;
  e.count = count;
  e.magnitude = rt::Nanos{magnitude};
  return e;
}

SimConfig config(std::vector<SimTask> tasks, Ticks horizon,
                 std::vector<rt::FaultEntry> faults = {}) {
  SimConfig c;
  c.tasks = std::move(tasks);
  c.horizon = horizon;
  c.plan.entries = std::move(faults);
  return c;
}

std::vector<Ticks> ends(const support::SimTaskResult& r) {
  std::vector<Ticks> out;
  for (const auto& j : r.jobs) out.push_back(j.end);
  return out;
}

TEST(Reference, PreemptsAndResumes) {
  // low: 0-.. ; high takes [0,1) and [4,5).
  const auto r = simulate(config({task("high", 1, 4, 4, 2), task("low", 5, 12, 12, 1)}, 12));
  EXPECT_EQ(ends(r.tasks[0]), (std::vector<Ticks>{1, 5, 9}));
  EXPECT_EQ(ends(r.tasks[1]), (std::vector<Ticks>{7}));
  EXPECT_EQ(r.tasks[1].jobs[0].start, 1);
}

TEST(Reference, LehoczkyVectorRespondsAsPublished) {
  auto low = task("low", 62, 100, 1000, 1, SimPolicy::kCatchUp);
  low.catch_up_max = 100;
  const auto r = simulate(config({task("high", 26, 70, 70, 2), low}, 700));
  std::vector<Ticks> responses;
  for (const auto& j : r.tasks[1].jobs) responses.push_back(j.end - j.release);
  EXPECT_EQ(responses, (std::vector<Ticks>{114, 102, 116, 104, 118, 106, 94}));
  EXPECT_EQ(r.tasks[1].worst_response, 118);
}

TEST(Reference, RateReleasesAreTheIntegerFormula) {
  SimTask t = task("frames", 1, 0, 33'333'333, 1);
  t.rate_num = 30;
  const auto r = simulate(config({t}, 1'000'000'001));
  ASSERT_EQ(r.tasks[0].releases, 31U);
  EXPECT_EQ(r.tasks[0].jobs[1].release, 33'333'333);
  EXPECT_EQ(r.tasks[0].jobs[3].release, 100'000'000);
  EXPECT_EQ(r.tasks[0].jobs[30].release, 1'000'000'000);
}

TEST(Reference, SkipAfterATheftOfSevenPointSevenPeriods) {
  // One late job and seven skipped ones, and the phase is kept (figure of the design).
  const auto r = simulate(config({task("haptic", 100, 1000, 1000, 1)}, 20'000,
                                 {fault(rt::FaultKind::kTheft, "haptic", 5, 7700)}));
  const auto& t = r.tasks[0];
  EXPECT_EQ(t.late, 1U);
  EXPECT_EQ(t.skipped, 7U);
  EXPECT_EQ(t.completed, 13U);
  EXPECT_EQ(t.releases, t.completed + t.skipped + t.aborted + t.open);
  EXPECT_EQ(t.jobs[5].start, 12'700);
  EXPECT_EQ(t.jobs[12].outcome, SimOutcome::kSkipped);
  EXPECT_EQ(t.jobs[12].end, 12'800);
  EXPECT_EQ(t.jobs[13].start, 13'000);
}

TEST(Reference, CatchUpOneMakesTwoLateJobs) {
  auto t = task("fusion", 100, 1000, 1000, 1, SimPolicy::kCatchUp);
  t.catch_up_max = 1;
  const auto r = simulate(config({t}, 20'000, {fault(rt::FaultKind::kTheft, "fusion", 5, 7700)}));
  EXPECT_EQ(r.tasks[0].skipped, 6U);
  EXPECT_EQ(r.tasks[0].late, 1U);  // release 12 is caught up within its own deadline
  EXPECT_EQ(r.tasks[0].jobs[12].start, 12'800);
  EXPECT_EQ(r.tasks[0].jobs[12].end, 12'900);
  EXPECT_EQ(r.tasks[0].jobs[13].start, 13'000);
}

TEST(Reference, CatchUpKeepsTheNewest) {
  auto t = task("x", 1, 10, 100, 1, SimPolicy::kCatchUp);
  t.catch_up_max = 2;
  const auto r = simulate(config({t}, 100, {fault(rt::FaultKind::kExtraCpu, "x", 0, 54)}));
  // Job 0 ends at 55; 1..5 are pending, 1..3 dropped, 4 and 5 back to back.
  EXPECT_EQ(r.tasks[0].skipped, 3U);
  EXPECT_EQ(r.tasks[0].jobs[3].end, 55);
  EXPECT_EQ(r.tasks[0].jobs[4].end, 56);
  EXPECT_EQ(r.tasks[0].jobs[5].end, 57);
  EXPECT_EQ(r.tasks[0].late, 0U);
}

TEST(Reference, AReleaseExactlyAtTheEndIsNotDropped) {
  const auto r = simulate(
      config({task("x", 1, 10, 10, 1)}, 60, {fault(rt::FaultKind::kExtraCpu, "x", 1, 19)}));
  // Job 1: 10..30. Release 2 (20) is dropped, release 3 (30) starts at once.
  EXPECT_EQ(r.tasks[0].skipped, 1U);
  EXPECT_EQ(r.tasks[0].late, 1U);
  EXPECT_EQ(r.tasks[0].jobs[3].start, 30);
}

TEST(Reference, EndingExactlyAtTheDeadlineIsNoMiss) {
  const auto r = simulate(config({task("x", 10, 10, 10, 1)}, 50));
  EXPECT_EQ(r.tasks[0].completed, 5U);
  EXPECT_EQ(r.tasks[0].misses(), 0U);
  const auto a = simulate(config({task("x", 10, 10, 10, 1, SimPolicy::kAbort)}, 50));
  EXPECT_EQ(a.tasks[0].completed, 5U);
  EXPECT_EQ(a.tasks[0].aborted, 0U);
}

TEST(Reference, AbortEndsAtTheDeadlineAndTheNextStartsNormally) {
  const auto r = simulate(config({task("p", 3, 10, 8, 1, SimPolicy::kAbort)}, 40,
                                 {fault(rt::FaultKind::kExtraCpu, "p", 1, 50)}));
  EXPECT_EQ(r.tasks[0].aborted, 1U);
  EXPECT_EQ(r.tasks[0].jobs[1].end, 18);
  EXPECT_EQ(r.tasks[0].jobs[2].start, 20);
  EXPECT_EQ(r.tasks[0].misses(), 1U);
}

TEST(Reference, AbortReachesAJobThatNeverGotTheCore) {
  const auto r = simulate(config({task("p", 3, 10, 8, 1, SimPolicy::kAbort)}, 40,
                                 {fault(rt::FaultKind::kTheft, "p", 1, 9)}));
  EXPECT_EQ(r.tasks[0].jobs[1].outcome, SimOutcome::kAborted);
  EXPECT_EQ(r.tasks[0].jobs[1].start, -1);
  EXPECT_EQ(r.tasks[0].jobs[1].end, 18);
}

TEST(Reference, AJobThatArrivesAtItsDeadlineIsAbortedThere) {
  const auto r = simulate(config({task("p", 3, 10, 8, 1, SimPolicy::kAbort)}, 40,
                                 {fault(rt::FaultKind::kLateRelease, "p", 1, 8)}));
  EXPECT_EQ(r.tasks[0].jobs[1].outcome, SimOutcome::kAborted);
  EXPECT_EQ(r.tasks[0].jobs[1].start, -1);
  EXPECT_EQ(r.tasks[0].jobs[1].end, 18);
}

TEST(Reference, ALateReleaseKeepsItsDeadlineAndTheOthersTheirPhase) {
  const auto r = simulate(
      config({task("x", 2, 10, 6, 1)}, 40, {fault(rt::FaultKind::kLateRelease, "x", 1, 5)}));
  EXPECT_EQ(r.tasks[0].jobs[1].start, 15);
  EXPECT_TRUE(r.tasks[0].jobs[1].late);
  EXPECT_EQ(r.tasks[0].jobs[2].start, 20);
}

TEST(Reference, ALateReleaseBeyondTheNextOneSkipsIt) {
  const auto r = simulate(
      config({task("x", 2, 10, 10, 1)}, 60, {fault(rt::FaultKind::kLateRelease, "x", 1, 25)}));
  // Release 1 arrives at 35; 2 and 3 wait behind it and are dropped at 37.
  EXPECT_EQ(r.tasks[0].jobs[1].start, 35);
  EXPECT_EQ(r.tasks[0].skipped, 2U);
  EXPECT_EQ(r.tasks[0].jobs[3].end, 37);
  EXPECT_EQ(r.tasks[0].jobs[4].start, 40);
}

TEST(Reference, BlockGivesTheCoreAwayAtOnce) {
  const auto r = simulate(config({task("high", 2, 20, 20, 2), task("low", 3, 20, 20, 1)}, 20,
                                 {fault(rt::FaultKind::kBlock, "high", 0, 2)}));
  EXPECT_EQ(r.tasks[0].jobs[0].start, 0);
  EXPECT_EQ(r.tasks[1].jobs[0].start, 0);
  EXPECT_EQ(r.tasks[0].jobs[0].end, 4);  // back at 2, preempts
  EXPECT_EQ(r.tasks[1].jobs[0].end, 5);
}

TEST(Reference, HogQueuesBehindATheftAndAboveAllTasks) {
  const auto r = simulate(config(
      {task("x", 2, 50, 50, 1)}, 50,
      {fault(rt::FaultKind::kTheft, "x", 0, 4), fault(rt::FaultKind::kPriorityHog, "x", 0, 3)}));
  EXPECT_EQ(r.tasks[0].jobs[0].start, 7);
  EXPECT_EQ(r.tasks[0].jobs[0].end, 9);
}

TEST(Reference, OneCoresTheftLeavesTheOtherAlone) {
  auto other = task("other", 1, 10, 10, 1);
  other.core = 1;
  auto c = config({task("x", 1, 10, 10, 1), other}, 50, {fault(rt::FaultKind::kTheft, "x", 1, 25)});
  c.cores = 2;
  const auto r = simulate(c);
  EXPECT_GT(r.tasks[0].misses(), 0U);
  EXPECT_EQ(r.tasks[1].misses(), 0U);
}

TEST(Reference, DegradeWaitsForAnIdleBoundaryAndComesBack) {
  auto t = task("fusion", 1, 10, 10, 1, SimPolicy::kDegrade);
  t.last_level = 2;
  t.cost_of = [](std::uint64_t, int level) { return Ticks{6 - 2 * level}; };
  auto c = config({t}, 300, {fault(rt::FaultKind::kExtraCpu, "fusion", 1, 30)});
  c.hyperperiod = 20;
  c.clean_hyperperiods = 3;
  const auto r = simulate(c);
  // Job 1 runs 10..46 over the boundaries 20 and 40, so the switch is at 60, the way back at 120.
  const auto& jobs = r.tasks[0].jobs;
  EXPECT_EQ(jobs[1].end, 46);
  EXPECT_EQ(jobs[5].level, 0);
  EXPECT_EQ(jobs[6].level, 1);
  EXPECT_EQ(jobs[6].end - jobs[6].start, 4);
  EXPECT_EQ(jobs[11].level, 1);
  EXPECT_EQ(jobs[12].level, 0);
  EXPECT_EQ(r.tasks[0].degraded, 1U);
  EXPECT_EQ(r.tasks[0].restored, 1U);
}

TEST(Reference, DegradeStopsAtTheLastLevel) {
  auto t = task("f", 25, 10, 10, 1, SimPolicy::kDegrade);
  t.last_level = 1;
  auto c = config({t}, 400);
  c.hyperperiod = 10;
  const auto r = simulate(c);  // always 25 long: never idle but at multiples of 30 from the start
  EXPECT_LE(r.tasks[0].level, 1);
  EXPECT_EQ(r.tasks[0].degraded, r.tasks[0].level == 1 ? 1U : 0U);
}

TEST(Reference, ADeadThreadSkipsForEver) {
  const auto r = simulate(
      config({task("x", 2, 10, 10, 1)}, 100, {fault(rt::FaultKind::kDeadThread, "x", 4, 0, 0)}));
  EXPECT_EQ(r.tasks[0].completed, 4U);
  EXPECT_EQ(r.tasks[0].skipped, 6U);
}

TEST(Reference, ALockedSectionIsNotPreemptedOnceBegun) {
  auto low = task("low", 6, 50, 50, 1);
  low.locked = 4;
  auto high = task("high", 1, 50, 50, 2);
  high.offset = 1;
  const auto r = simulate(config({high, low}, 50));
  EXPECT_EQ(r.tasks[0].jobs[0].start, 4);
  EXPECT_EQ(r.tasks[1].jobs[0].end, 7);
}

// ---- jumping to the next event against visiting every tick ----

SimConfig random_config(std::uint64_t seed) {
  rt::Random rng(seed, 17);
  SimConfig c;
  c.cores = static_cast<int>(rng.integer(1, 2));
  c.horizon = rng.integer(150, 400);
  c.hyperperiod = rng.integer(10, 60);
  c.clean_hyperperiods = static_cast<int>(rng.integer(1, 3));
  c.ticks_per_second = 1000;
  c.plan.seed = seed;
  const auto n = rng.integer(1, 4);
  for (std::int64_t i = 0; i < n; ++i) {
    SimTask t;
    t.name = std::string("t").append(std::to_string(i));
    if (rng.integer(0, 1) == 0) {
      t.period = rng.integer(4, 40);
    } else {
      t.rate_num = rng.integer(30, 200);
      t.rate_den = rng.integer(1, 3);
    }
    t.offset = rng.integer(0, 10);
    t.deadline = rng.integer(2, 60);
    t.priority = static_cast<int>(100 - i);
    t.core = static_cast<int>(rng.integer(0, c.cores - 1));
    t.policy = static_cast<SimPolicy>(rng.integer(0, 3));
    t.catch_up_max = static_cast<int>(rng.integer(0, 3));
    t.last_level = static_cast<int>(rng.integer(0, 2));
    t.locked = rng.integer(0, 3);
    const Ticks base = rng.integer(3, 12);
    t.cost_of = [base, seed, i](std::uint64_t k, int level) {
      return base - level * (base / 4) +
             static_cast<Ticks>(rt::mix64(seed + static_cast<std::uint64_t>(i), k) % 4U);
    };
    const Ticks jitter = rng.integer(0, 5);
    t.jitter_of = [jitter, seed](std::uint64_t k) {
      return static_cast<Ticks>(rt::mix64(seed, k) % static_cast<std::uint64_t>(jitter + 1));
    };
    c.tasks.push_back(t);
  }
  const auto faults = rng.integer(0, 6);
  for (std::int64_t f = 0; f < faults; ++f) {
    rt::FaultEntry e;
    e.kind = static_cast<rt::FaultKind>(rng.integer(0, 5));
    if (rng.integer(0, 19) == 0) e.kind = rt::FaultKind::kDeadThread;
    e.target = std::string("t").append(std::to_string(rng.integer(0, n - 1)));
    e.first = static_cast<std::uint64_t>(rng.integer(0, 10));
    e.every = static_cast<std::uint64_t>(rng.integer(1, 5));
    e.count = static_cast<std::uint64_t>(rng.integer(0, 4));
    e.probability = rng.integer(0, 1) == 0 ? 1.0 : rng.uniform();
    e.seed = static_cast<std::uint64_t>(f);
    e.magnitude = rt::Nanos{rng.integer(1, 30)};
    c.plan.entries.push_back(e);
  }
  return c;
}

TEST(Reference, JumpingEqualsEveryTick) {
  std::uint64_t jobs = 0, misses = 0, degraded = 0;
  for (std::uint64_t seed = 1; seed <= 3000; ++seed) {
    SimConfig c = random_config(seed);
    const auto jump = simulate(c);
    c.every_tick = true;
    const auto walk = simulate(c);
    for (std::size_t i = 0; i < c.tasks.size(); ++i) {
      ASSERT_EQ(jump.tasks[i].jobs, walk.tasks[i].jobs) << "seed " << seed << " task " << i;
      ASSERT_EQ(jump.tasks[i].level, walk.tasks[i].level) << "seed " << seed << " task " << i;
      const auto& t = jump.tasks[i];
      ASSERT_EQ(t.releases, t.completed + t.skipped + t.aborted + t.open) << "seed " << seed;
      ASSERT_EQ(t.jobs.size(), t.releases) << "seed " << seed;
      jobs += t.releases;
      misses += t.misses();
      degraded += t.degraded;
    }
  }
  std::printf("seeds 1..3000: %llu jobs, %llu misses, %llu degradations, equal job by job\n",
              static_cast<unsigned long long>(jobs), static_cast<unsigned long long>(misses),
              static_cast<unsigned long long>(degraded));
  EXPECT_GT(misses, jobs / 20);
  EXPECT_GT(degraded, 100U);
}

}  // namespace
