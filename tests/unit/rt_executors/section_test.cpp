// The guard can only see what happens inside a section: both executors must open it round step() of
// a hard task, and round nothing else. (The real executor's counts of many jobs are in
// tests/timing.)
#include <gtest/gtest.h>

#include <cstdlib>
#include <vector>

#include "rt/fault/planned.hpp"
#include "rt/memory/section.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/real_executor.hpp"
#include "rt/sched/virtual_executor.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

class Probe final : public rt::TaskBody {
 public:
  explicit Probe(bool allocate = false) : allocate_(allocate) {}
  void latch(const rt::Tick&, rt::JobRecord&) noexcept override {
    outside += rt::Section::active() ? 1 : 0;
  }
  rt::Health step(const rt::Tick&, rt::JobRecord&) noexcept override {
    ++steps;
    inside += rt::Section::active() ? 1 : 0;
    if (allocate_) {
      void* volatile p = std::malloc(16);
      std::free(p);
    }
    return rt::Health::ok();
  }
  void commit(const rt::Tick&, rt::JobRecord&) noexcept override {
    outside += rt::Section::active() ? 1 : 0;
  }
  int steps = 0, inside = 0, outside = 0;

 private:
  bool allocate_;
};

class Costs final : public rt::CostModel {
 public:
  rt::Nanos cost(std::uint16_t, std::uint64_t, int) noexcept override { return rt::Nanos{1000}; }
};

rt::PlacedTask row(Probe& p, rt::TaskClass c, std::uint16_t id) {
  rt::PlacedTask t;
  t.spec.name = id == 0 ? "hard" : "firm";
  t.spec.task_class = c;
  t.spec.rate = {100, 1};
  t.spec.budget = rt::Nanos{2000};
  t.body = &p;
  t.id = id;
  t.priority = 80 - id;
  return t;
}

template <class Faults>
void run_virtual(Probe& hard, Probe& firm, const Faults& faults) {
  Costs costs;
  rt::VirtualExecutor<Faults> executor(
      {row(hard, rt::TaskClass::kHard, 0), row(firm, rt::TaskClass::kFirm, 1)}, costs, faults,
      [](const rt::JobRecord&) {});
  rt::RunPlan plan;
  plan.duration = rt::Nanos{200'000'000};
  executor.run(plan);
}

template <class Faults>
void run_real(Probe& hard, Probe& firm, const Faults& faults) {
  rt::Startup startup;
  rt::RealOptions options;
  options.fifo = options.lock_memory = options.hold_dma_latency = false;
  std::vector<rt::PlacedTask> tasks{row(hard, rt::TaskClass::kHard, 0),
                                    row(firm, rt::TaskClass::kFirm, 1)};
  for (auto& t : tasks) t.core = rt::affinity_cpus().front();
  rt::RealExecutor<Faults> executor(
      startup.token(), tasks, faults, [](const rt::JobRecord&) {}, [](const rt::SentinelRecord&) {},
      options);
  rt::RunPlan plan;
  plan.epoch_host_ns = rt::monotonic_ns() + 10'000'000;
  plan.duration = rt::Nanos{200'000'000};
  executor.run(plan);
}

template <class Run>
void expect_sections(const Run& run) {
  Probe hard, firm;
  run(hard, firm);
  EXPECT_GT(hard.steps, 0);
  EXPECT_GT(firm.steps, 0);
  EXPECT_EQ(hard.inside, hard.steps) << "step() of a hard task is inside a section";
  EXPECT_EQ(firm.inside, 0) << "of a firm one it is not";
  EXPECT_EQ(hard.outside + firm.outside, 0) << "latch() and commit() may call the driver";
  EXPECT_FALSE(rt::Section::active());
}

TEST(Section, VirtualExecutor) {
  expect_sections([](Probe& h, Probe& f) { run_virtual(h, f, rt::Plain{}); });
  expect_sections([](Probe& h, Probe& f) { run_virtual(h, f, rt::Planned{}); });
}

TEST(Section, RealExecutor) {
  expect_sections([](Probe& h, Probe& f) { run_real(h, f, rt::Plain{}); });
  expect_sections([](Probe& h, Probe& f) { run_real(h, f, rt::Planned{}); });
}

// And so the guard sees an allocation in a hard step through either executor, and in a firm one
// not.
TEST(Section, TheGuardSeesThroughTheExecutors) {
  if (!rt_guard::linked()) GTEST_SKIP() << "no guard in this build";
  for (const bool real : {false, true}) {
    Probe bad(true), good, firm_bad(true);
    rt_guard::reset();
    real ? run_real(good, firm_bad, rt::Plain{}) : run_virtual(good, firm_bad, rt::Plain{});
    EXPECT_EQ(rt_guard::counts().total(), 0U) << (real ? "real" : "virtual");
    rt_guard::reset();
    real ? run_real(bad, good, rt::Plain{}) : run_virtual(bad, good, rt::Plain{});
    EXPECT_EQ(rt_guard::counts().allocations, static_cast<std::uint64_t>(bad.steps));
    EXPECT_EQ(rt_guard::counts().frees, static_cast<std::uint64_t>(bad.steps));
  }
}

// What a step takes from the heap is in its job's record, of a firm one too; what latch() and
// commit() take is not.
class Hungry final : public rt::TaskBody {
 public:
  explicit Hungry(int every) : every_(every) {}
  void latch(const rt::Tick&, rt::JobRecord&) noexcept override { take(5); }
  rt::Health step(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    take(every_ * static_cast<int>(tick.k));
    return rt::Health::ok();
  }
  void commit(const rt::Tick&, rt::JobRecord&) noexcept override { take(7); }

 private:
  static void take(int times) noexcept {
    for (int i = 0; i < times; ++i) {
      void* volatile p = i % 2 == 0 ? std::malloc(16) : std::calloc(2, 8);
      p = std::realloc(p, 0) == nullptr ? nullptr : p;
    }
  }
  int every_;
};

TEST(Allocations, AreInEachJobsRecord) {
  if (!rt_guard::linked()) GTEST_SKIP() << "nothing counts in this build";
  for (const bool real : {false, true}) {
    Hungry firm(3);
    rt::PlacedTask t;
    t.spec.name = "firm";
    t.spec.task_class = rt::TaskClass::kFirm;
    t.spec.rate = {100, 1};
    t.spec.budget = rt::Nanos{2000};
    t.body = &firm;
    t.core = real ? rt::affinity_cpus().front() : 0;
    std::vector<rt::JobRecord> jobs;
    const auto keep = [&](const rt::JobRecord& r) { jobs.push_back(r); };
    rt::RunPlan plan;
    plan.duration = rt::Nanos{200'000'000};
    if (real) {
      rt::Startup startup;
      rt::RealOptions options;
      options.fifo = options.lock_memory = options.hold_dma_latency = false;
      rt::RealExecutor<rt::Plain> executor(
          startup.token(), {t}, rt::Plain{}, keep, [](const rt::SentinelRecord&) {}, options);
      plan.epoch_host_ns = rt::monotonic_ns() + 10'000'000;
      executor.run(plan);
    } else {
      Costs costs;
      rt::VirtualExecutor<rt::Plain> executor({t}, costs, rt::Plain{}, keep);
      executor.run(plan);
    }
    ASSERT_GT(jobs.size(), 2U) << (real ? "real" : "virtual");
    for (const rt::JobRecord& r : jobs) {
      // realloc() to nothing frees; it is one of the calls that count.
      EXPECT_EQ(r.allocations, 2 * 3 * static_cast<int>(r.k)) << "job " << r.k;
    }
  }
}

}  // namespace
