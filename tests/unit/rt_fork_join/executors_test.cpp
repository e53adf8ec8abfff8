// A task with pool workers under both executors: in virtual time by closed forms, on the real clock
// by its books.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <vector>

#include "rt/fault/planned.hpp"
#include "rt/random.hpp"
#include "rt/sched/real_executor.hpp"
#include "rt/sched/virtual_executor.hpp"

namespace {

constexpr std::int64_t kMs = 1'000'000;

// Costs by task id, ms.
class Costs final : public rt::CostModel {
 public:
  explicit Costs(std::vector<double> ms) : ms_(std::move(ms)) {}
  rt::Nanos cost(std::uint16_t task, std::uint64_t, int) noexcept override {
    return rt::Nanos{static_cast<std::int64_t>(ms_[task] * kMs)};
  }

 private:
  std::vector<double> ms_;
};

// Forks `forks` times a job; each part burns `part_cpu_ns`.
class Forking final : public rt::TaskBody {
 public:
  void use(rt::ForkJoin& crew) noexcept override { crew_ = &crew; }
  void latch(const rt::Tick&, rt::JobRecord&) noexcept override {}
  rt::Health step(const rt::Tick& tick, rt::JobRecord& r) noexcept override {
    const bool idle = idle_every > 0 && tick.k % static_cast<std::uint64_t>(idle_every) == 1;
    for (int f = 0; f < forks && !idle; ++f) {
      crew_->for_parts(4, [&](int p) {
        const std::int64_t until = rt::thread_cpu_ns() + part_cpu_ns;
        while (rt::thread_cpu_ns() < until) {
        }
        sum[static_cast<std::size_t>(p)] += 1;
      });
    }
    r.work = 1;
    return rt::Health::ok();
  }
  void commit(const rt::Tick&, rt::JobRecord&) noexcept override { ++committed; }
  int forks = 3, idle_every = 0;
  std::int64_t part_cpu_ns = 0;
  std::array<std::uint64_t, 4> sum{};
  std::uint64_t committed = 0;

 private:
  rt::ForkJoin* crew_ = &rt::serial();
};

rt::PlacedTask row(const char* name, std::uint16_t id, int core, int priority, int hz,
                   const char* parent = "") {
  rt::PlacedTask t;
  t.spec.name = name;
  t.spec.parent = parent;
  t.spec.task_class = rt::TaskClass::kFirm;
  t.spec.rate = {hz, 1};
  t.id = id;
  t.core = core;
  t.priority = priority;
  return t;
}

struct Job {
  double release, start, end, cpu;  // ms
  rt::Outcome outcome;
};

std::map<int, std::vector<Job>> run_virtual(const std::vector<rt::PlacedTask>& tasks, Costs& costs,
                                            double seconds,
                                            std::vector<rt::TaskTotals>* totals = nullptr) {
  std::map<int, std::vector<Job>> jobs;
  const rt::Plain none;
  rt::VirtualExecutor<rt::Plain> executor(tasks, costs, none, [&](const rt::JobRecord& r) {
    const auto ms = [](std::int64_t ns) { return 1e-6 * static_cast<double>(ns); };
    jobs[r.task].push_back(
        {ms(r.release_ns), ms(r.start_ns), ms(r.end_ns), ms(r.cpu_ns), r.outcome});
  });
  rt::RunPlan plan;
  plan.duration = rt::nanos_from_seconds(seconds);
  executor.run(plan);
  if (totals != nullptr) *totals = executor.totals();
  return jobs;
}

TEST(VirtualPool, TheParentEndsWithTheLastOfItsOwn) {
  // Own 10 ms; workers 14 and 6 ms on cores of their own.
  const std::vector<rt::PlacedTask> tasks{row("fusion", 0, 0, 70, 30),
                                          row("w1", 1, 1, 70, 30, "fusion"),
                                          row("w2", 2, 2, 70, 30, "fusion")};
  Costs costs({10, 14, 6});
  std::vector<rt::TaskTotals> totals;
  const auto jobs = run_virtual(tasks, costs, 0.099, &totals);
  ASSERT_EQ(jobs.at(0).size(), 3U);
  ASSERT_EQ(jobs.at(1).size(), 3U);
  for (std::size_t n = 0; n < 3; ++n) {
    const double r = static_cast<double>(n) * 1000.0 / 30;
    EXPECT_NEAR(jobs.at(0)[n].end, r + 14, 1e-3);
    EXPECT_NEAR(jobs.at(0)[n].cpu, 10, 1e-9);
    EXPECT_NEAR(jobs.at(1)[n].end, r + 14, 1e-3);
    EXPECT_NEAR(jobs.at(1)[n].cpu, 14, 1e-9);
    EXPECT_NEAR(jobs.at(2)[n].end, r + 6, 1e-3);
    EXPECT_NEAR(jobs.at(2)[n].release, r, 1e-3);
  }
  EXPECT_EQ(totals[0].completed, 3U);
  EXPECT_EQ(totals[1].completed, 3U);
}

TEST(VirtualPool, WhatHoldsAWorkerUpHoldsItsParentUp) {
  // On core 0 a task of 2 ms every 10 ms above fusion, on core 1 one of 5 ms every 10 ms above the
  // worker.
  const std::vector<rt::PlacedTask> tasks{row("worker", 1, 1, 70, 30, "fusion"),
                                          row("fusion", 0, 0, 70, 30), row("quick", 2, 0, 79, 100),
                                          row("heavy", 3, 1, 79, 100)};
  Costs costs({8, 8, 2, 5});
  const auto jobs = run_virtual(tasks, costs, 0.0333);
  // fusion begins at 2; own 8 served 2..10; the worker: released at 2, runs 5..10 and 15..18.
  ASSERT_EQ(jobs.at(0).size(), 1U);
  EXPECT_NEAR(jobs.at(0)[0].start, 2, 1e-6);
  EXPECT_NEAR(jobs.at(1)[0].release, 2, 1e-6);
  EXPECT_NEAR(jobs.at(1)[0].start, 5, 1e-6);
  EXPECT_NEAR(jobs.at(1)[0].end, 18, 1e-6);
  EXPECT_NEAR(jobs.at(0)[0].end, 18, 1e-6);
  // While it waits its core is another's.
  EXPECT_EQ(jobs.at(2).size(), 4U);
}

TEST(VirtualPool, ATaskBelowRunsWhileTheParentWaits) {
  const std::vector<rt::PlacedTask> tasks{row("fusion", 0, 0, 70, 30),
                                          row("worker", 1, 1, 70, 30, "fusion"),
                                          row("below", 2, 0, 60, 30)};
  Costs costs({4, 12, 6});
  const auto jobs = run_virtual(tasks, costs, 0.0333);
  EXPECT_NEAR(jobs.at(2)[0].start, 4, 1e-6);
  EXPECT_NEAR(jobs.at(2)[0].end, 10, 1e-6);
  EXPECT_NEAR(jobs.at(0)[0].end, 12, 1e-6);
}

TEST(VirtualPool, AnAbortTakesTheWorkersWithIt) {
  std::vector<rt::PlacedTask> tasks{row("fusion", 0, 0, 70, 25),
                                    row("worker", 1, 1, 70, 25, "fusion")};
  for (auto& t : tasks) t.spec.policy = rt::MissPolicy::kAbort;
  Costs costs({4, 50});
  std::vector<rt::TaskTotals> totals;
  const auto jobs = run_virtual(tasks, costs, 0.1199, &totals);
  ASSERT_EQ(jobs.at(0).size(), 2U);
  EXPECT_EQ(jobs.at(0)[0].outcome, rt::Outcome::kAborted);
  EXPECT_EQ(jobs.at(1)[0].outcome, rt::Outcome::kAborted);
  EXPECT_NEAR(jobs.at(1)[0].end, 40, 1e-6);
  EXPECT_EQ(totals[1].aborted, totals[0].aborted);
}

TEST(VirtualPool, AJobThatForksNothingLeavesAnEmptyRecord) {
  Forking body;
  body.idle_every = 2;
  std::vector<rt::PlacedTask> tasks{row("fusion", 0, 0, 70, 30),
                                    row("worker", 1, 1, 70, 30, "fusion")};
  tasks[0].body = &body;
  Costs costs({4, 9});
  const auto jobs = run_virtual(tasks, costs, 0.0999);
  ASSERT_EQ(jobs.at(1).size(), 3U);
  EXPECT_NEAR(jobs.at(0)[0].end - jobs.at(0)[0].start, 9, 1e-6);
  EXPECT_NEAR(jobs.at(0)[1].end - jobs.at(0)[1].start, 4, 1e-6);
  EXPECT_EQ(jobs.at(1)[1].cpu, 0);
  EXPECT_EQ(body.sum, (std::array<std::uint64_t, 4>{6, 6, 6, 6}));
}

// Random sets: a parent's job ends when its own CPU and each worker's have been served, never
// before.
TEST(VirtualPool, RandomSetsKeepTheirOrder) {
  const std::uint64_t seed = 20;
  std::printf("  seed %llu\n", static_cast<unsigned long long>(seed));
  rt::Random random(seed);
  for (int trial = 0; trial < 60; ++trial) {
    std::vector<rt::PlacedTask> tasks{row("fusion", 0, 0, 70, 30),
                                      row("w1", 1, 1, 70, 30, "fusion"),
                                      row("w2", 2, 2, 70, 30, "fusion")};
    std::vector<double> ms{1 + 8 * random.uniform(), 1 + 12 * random.uniform(),
                           1 + 12 * random.uniform()};
    for (std::uint16_t id = 3; id < 7; ++id) {
      const bool above = random.uniform() < 0.5;
      tasks.push_back(row("other", id, static_cast<int>(3 * random.uniform()),
                          (above ? 72 : 62) + id, above ? 100 : 20));
      ms.push_back(above ? 2.5 * random.uniform() + 0.01 : 8 * random.uniform() + 0.01);
    }
    Costs costs(ms);
    const auto jobs = run_virtual(tasks, costs, 0.5);
    const auto& parent = jobs.at(0);
    for (std::size_t n = 0; n < parent.size(); ++n) {
      double last = parent[n].start + ms[0];
      for (const int w : {1, 2}) {
        const Job& j = jobs.at(w)[n];
        EXPECT_EQ(j.release, parent[n].start);
        EXPECT_NEAR(j.cpu, ms[static_cast<std::size_t>(w)], 1e-6);
        EXPECT_LE(j.end, parent[n].end);
        last = std::max(last, j.end);
      }
      EXPECT_GE(parent[n].end, last - 1e-6);
      EXPECT_NEAR(parent[n].cpu, ms[0], 1e-6);
    }
  }
}

TEST(RealPool, TheBooksOfAParentAndItsWorkers) {
  Forking body;
  body.part_cpu_ns = 200'000;
  body.idle_every = 5;
  std::vector<rt::PlacedTask> tasks{row("fusion", 0, 0, 70, 100),
                                    row("w1", 1, 1, 70, 100, "fusion"),
                                    row("w2", 2, 1, 70, 100, "fusion")};
  tasks[0].body = &body;
  std::map<int, std::vector<rt::JobRecord>> jobs;
  rt::Startup startup;
  const rt::Plain none;
  rt::RealOptions options;
  options.fifo = options.lock_memory = options.hold_dma_latency = options.sentinel = false;
  rt::RealExecutor<rt::Plain> executor(
      startup.token(), tasks, none, [&](const rt::JobRecord& r) { jobs[r.task].push_back(r); },
      [](const rt::SentinelRecord&) {}, options);
  rt::RunPlan plan;
  plan.epoch_host_ns = rt::monotonic_ns() + 20 * kMs;
  plan.duration = rt::Nanos{500 * kMs};
  executor.run(plan);
  const auto totals = executor.totals();
  ASSERT_GE(jobs[0].size(), 1U);  // a loaded machine lets few through
  EXPECT_EQ(body.committed, jobs[0].size());
  std::uint64_t forked = 0;
  for (const int w : {1, 2}) {
    ASSERT_EQ(jobs[w].size(), jobs[0].size());
    EXPECT_EQ(totals[static_cast<std::size_t>(w)].completed, totals[0].completed);
    EXPECT_EQ(totals[static_cast<std::size_t>(w)].skipped, totals[0].skipped);
    for (std::size_t n = 0; n < jobs[w].size(); ++n) {
      const rt::JobRecord& j = jobs[w][n];
      const rt::JobRecord& parent = jobs[0][n];
      EXPECT_EQ(j.k, parent.k);
      EXPECT_EQ(j.deadline_ns, parent.deadline_ns);
      EXPECT_LE(parent.start_ns, j.release_ns);
      EXPECT_LE(j.end_ns, parent.end_ns);
      const bool idle = parent.k % 5 == 1;
      forked += idle ? 0 : 1;
      // Four parts a fork, three members: worker 1 has one of them, worker 2 one.
      EXPECT_EQ(j.work, idle ? 0U : 3U);
      EXPECT_GE(j.cpu_ns, idle ? 0 : 3 * 200'000);
      EXPECT_GE(parent.cpu_ns, idle ? 0 : 6 * 200'000);
      // Its own parts alone, not the workers'.
      if (!idle) {
        EXPECT_LE(j.release_ns, j.start_ns);
        EXPECT_LT(j.start_ns, j.end_ns);
      }
    }
  }
  EXPECT_EQ(forked % 2, 0U);
  EXPECT_EQ(body.sum[0], 3 * forked / 2);
  EXPECT_EQ(body.sum[3], 3 * forked / 2);
}

}  // namespace
