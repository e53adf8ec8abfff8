// A thread that a plan ends, on the virtual clock: what is counted, and when its output is made
// safe.
#include <gtest/gtest.h>

#include "rt/fault/planned.hpp"
#include "rt/sched/cost_model.hpp"
#include "rt/sched/virtual_executor.hpp"

namespace {

class Body final : public rt::TaskBody {
 public:
  void latch(const rt::Tick&, rt::JobRecord&) noexcept override {}
  rt::Health step(const rt::Tick&, rt::JobRecord&) noexcept override { return rt::Health::ok(); }
  void commit(const rt::Tick&, rt::JobRecord&) noexcept override { ++committed; }
  void make_safe() noexcept override {
    if (safe++ == 0) committed_before = committed;
  }
  int committed = 0, safe = 0, committed_before = -1;
};

class OneNanosecond final : public rt::CostModel {
 public:
  rt::Nanos cost(std::uint16_t, std::uint64_t, int) noexcept override { return rt::Nanos{1}; }
};

rt::TaskTotals run(Body& body, rt::MissPolicy policy, int miss_limit, std::uint64_t dead_from) {
  rt::PlacedTask t;
  t.spec.name = "task";
  t.spec.rate = {1000, 1};
  t.spec.policy = policy;
  t.spec.consecutive_miss_limit = miss_limit;
  t.spec.variants = {{"full", rt::Nanos{1}}, {"half", rt::Nanos{1}}, {"least", rt::Nanos{1}}};
  t.body = &body;
  rt::FaultPlan plan;
  rt::FaultEntry e;
  e.kind = rt::FaultKind::kDeadThread;
  e.target = "task";
  e.first = dead_from;
  plan.entries.push_back(e);
  OneNanosecond costs;
  const rt::Planned planned(plan, {"task"});
  rt::VirtualExecutor<rt::Planned> executor({t}, costs, planned, [](const rt::JobRecord&) {}, {});
  rt::RunPlan how;
  how.duration = rt::Nanos{1'000'000'000};
  executor.run(how);
  return executor.totals().front();
}

TEST(DeadThread, LostReleasesAreCountedAndTheOutputIsMadeSafeAtTheFirst) {
  Body body;
  const auto t = run(body, rt::MissPolicy::kSkip, 0, 300);
  EXPECT_EQ(t.completed, 300U);
  EXPECT_EQ(t.skipped, 700U);
  EXPECT_EQ(t.lost, 700U);
  EXPECT_EQ(body.committed_before, 300);
  EXPECT_EQ(body.safe, 1) << "without a limit of misses: once, when the thread is gone";
}

// Each lost release is a miss to the bucket: above the limit it forces the safe output again and
// again.
TEST(DeadThread, LostReleasesFillTheBucket) {
  Body body;
  const auto t = run(body, rt::MissPolicy::kSkip, 5, 300);
  EXPECT_EQ(t.lost, 700U);
  EXPECT_EQ(body.safe, 1 + (700 - 5));
}

TEST(DeadThread, NoPlanNoLoss) {
  Body body;
  const auto t = run(body, rt::MissPolicy::kDegrade, 5, 1'000'000);
  EXPECT_EQ(t.completed, 1000U);
  EXPECT_EQ(t.lost, 0U);
  EXPECT_EQ(t.level, 0);
  EXPECT_EQ(body.safe, 0);
}

TEST(DeadThread, LostReleasesDegrade) {
  Body body;
  EXPECT_EQ(run(body, rt::MissPolicy::kDegrade, 0, 300).level, 2);
}

}  // namespace
