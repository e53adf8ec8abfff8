// Every thread that the real executor starts, at work at once. What is waited for is an event of
// the other thread, never a time: a cap ends a run in which it does not come, and the books then
// tell.
#include "tests/unit/rt_real_threads/rig.hpp"

namespace {

using namespace rig;

constexpr std::int64_t kCap = 60 * kSecond;

TEST(RealThreads, TasksSentinelsWatchdogAndDrainAtOnce) {
  Body fast, slow, robot;
  std::vector<rt::PlacedTask> tasks{spread("fast", 1000, fast, 0), spread("slow", 100, slow, 1),
                                    spread("robot", 300, robot, 2)};
  tasks[2].spec.box = rt::Box::kRobot;
  tasks[2].spec.spin_lead = rt::Nanos{100'000};
  rt::RealOptions options = ordinary();
  options.watchdog_period = rt::Nanos{kMs};
  const Outcome o = run(tasks, 500 * kMs, options);
  expect_balanced(o, tasks);
  EXPECT_EQ(fast.committed, o.totals[0].completed);
  EXPECT_EQ(slow.committed, o.totals[1].completed);
  EXPECT_EQ(robot.committed, o.totals[2].completed);
}

// Hangs until its output was made safe.
class Hung final : public Body {
 public:
  void work(const rt::Tick&) noexcept override {
    if (done) return;
    done = true;
    const std::int64_t cap = rt::monotonic_ns() + kCap;
    while (safe == 0 && rt::monotonic_ns() < cap) {
    }
  }
  bool done = false;
};

TEST(RealThreads, TheWatchdogForcesTheSafeOutputOfAHungJob) {
  Hung hung;
  Body other;
  std::vector<rt::PlacedTask> tasks{spread("hung", 100, hung, 0), spread("other", 100, other, 1)};
  rt::RealOptions options = ordinary();
  options.hang_limit = rt::Nanos{50 * kMs};
  const Outcome o = run(tasks, 400 * kMs, options);
  expect_balanced(o, tasks);
  EXPECT_TRUE(hung.done);
  EXPECT_GE(o.hangs, 1U);
  EXPECT_GE(hung.safe_during_step, 1) << "while the job still hangs, not after it";
}

// Asks for the stop from one of its jobs.
class Stops final : public Body {
 public:
  explicit Stops(std::uint64_t at) : at_(at) {}
  void work(const rt::Tick& tick) noexcept override {
    if (tick.k >= at_) now = true;
  }
  std::atomic<bool> now{false};

 private:
  std::uint64_t at_;
};

TEST(RealThreads, RequestStopEndsTheRun) {
  Stops fast(50);
  Body slow;
  std::vector<rt::PlacedTask> tasks{spread("fast", 1000, fast, 0), spread("slow", 10, slow, 1)};
  const Outcome o = run(tasks, kCap, ordinary(), rt::Plain{}, 0, nullptr, &fast.now);
  expect_balanced(o, tasks, false);
  EXPECT_GT(fast.committed, 0U);
  EXPECT_EQ(fast.committed, o.totals[0].completed);
  EXPECT_LT(o.totals[0].completed + o.totals[0].skipped, 60'000U) << "before its planned end";
}

// Works until its token is set at the deadline.
class Slow final : public Body {
 public:
  void work(const rt::Tick& tick) noexcept override {
    if (tick.k % 5 != 2) return;
    const std::int64_t cap = rt::monotonic_ns() + kCap;
    while (!tick.cancelled()) {
      if (rt::monotonic_ns() > cap) {
        ++capped;
        return;
      }
    }
  }
  int capped = 0;
};

TEST(RealThreads, AbortCommitsNothingAndCallsAbandon) {
  Slow body;
  Body other;
  std::vector<rt::PlacedTask> tasks{spread("abort", 50, body, 0), spread("other", 500, other, 1)};
  tasks[0].spec.policy = rt::MissPolicy::kAbort;
  tasks[0].spec.deadline = rt::Nanos{10 * kMs};
  const Outcome o = run(tasks, 600 * kMs, ordinary());
  expect_balanced(o, tasks);
  EXPECT_EQ(body.capped, 0);
  EXPECT_EQ(body.abandoned, o.totals[0].aborted);
  EXPECT_EQ(body.committed, o.totals[0].completed);
  EXPECT_EQ(body.stepped, body.abandoned + body.committed);
}

TEST(RealThreads, InjectedFaultsBesideTheTasks) {
  for (const auto kind :
       {rt::FaultKind::kLateRelease, rt::FaultKind::kTheft, rt::FaultKind::kPriorityHog,
        rt::FaultKind::kBlock, rt::FaultKind::kExtraCpu, rt::FaultKind::kPageFault}) {
    SCOPED_TRACE(std::string(rt::name_of(kind)));
    Body body, other;
    std::vector<rt::PlacedTask> tasks{spread("task", 100, body, 0), spread("other", 500, other, 1)};
    const rt::Planned planned(one_fault(kind, "task", 2, 2 * kMs, 3), {"task", "other"});
    const Outcome o = run(tasks, 300 * kMs, ordinary(), planned);
    expect_balanced(o, tasks, true, planned);
    for (const auto& r : o.jobs[0])
      EXPECT_EQ(r.injected, r.k >= 2 && (r.k - 2) % 3 == 0 ? 1 : 0) << r.k;
    for (const auto& r : o.jobs[1]) EXPECT_EQ(r.injected, 0) << r.k;
  }
}

// Every tenth release comes 4 ms late, and the job before runs until 2 ms after its nominal
// instant: it drops the one between and no more.
class RunsOver final : public Body {
 public:
  void work(const rt::Tick& tick) noexcept override {
    if (tick.k % 10 == 5 && tick.skipped > 0) seen = true;
    if (tick.k % 10 == 3) burn_until(rt::ns_of(tick.release) + 22 * kMs);
  }
  std::atomic<bool> seen{false};
};

TEST(RealThreads, ALateReleaseIsNotDroppedByAJobThatEndsBeforeItArrives) {
  RunsOver body;
  std::vector<rt::PlacedTask> tasks{spread("late", 100, body, 0)};
  const rt::Planned planned(one_fault(rt::FaultKind::kLateRelease, "late", 5, 4 * kMs, 10),
                            {"late"});
  const Outcome o = run(tasks, kCap, ordinary(), planned, 0, nullptr, &body.seen);
  expect_balanced(o, tasks, false, planned);
  EXPECT_TRUE(body.seen) << "in none of 600 rounds";
}

}  // namespace
