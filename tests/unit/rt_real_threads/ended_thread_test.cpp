// Threads that end before the run does, and where the watchdog that looks after them runs.
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/unit/rt_real_threads/rig.hpp"

namespace {

using namespace rig;

constexpr auto kDead = rt::FaultKind::kDeadThread;

TEST(RealExecutorEnds, TheWatchdogMakesTheOutputOfADeadThreadSafe) {
  Body a, b;
  std::vector<rt::PlacedTask> tasks{spread("alive", 100, a, 0), spread("dead", 100, b, 1)};
  const rt::Planned planned(one_fault(kDead, "dead", 20), {"alive", "dead"});
  const Outcome o = run(tasks, kSecond, ordinary(), planned);
  expect_balanced(o, tasks);
  // Release 20 itself may have been run over before.
  EXPECT_LE(o.totals[1].lost, 80U);
  EXPECT_GE(o.totals[1].lost, 1U);
  EXPECT_EQ(o.totals[0].lost, 0U);
  EXPECT_EQ(b.safe, 1) << "the thread itself is gone";
  EXPECT_EQ(a.safe, 0);
  EXPECT_EQ(o.hangs, 0U);
}

// Each lost release is a miss to degrade too, as on the virtual clock.
TEST(RealExecutorEnds, LostReleasesDegrade) {
  Body a, b;
  std::vector<rt::PlacedTask> tasks{spread("alive", 100, a, 0), spread("dead", 100, b, 1)};
  tasks[1].spec.policy = rt::MissPolicy::kDegrade;
  tasks[1].spec.variants = {
      {"full", rt::Nanos{kMs}}, {"half", rt::Nanos{kMs}}, {"least", rt::Nanos{kMs}}};
  const rt::Planned planned(one_fault(kDead, "dead", 5), {"alive", "dead"});
  const Outcome o = run(tasks, kSecond, ordinary(), planned);
  expect_balanced(o, tasks);
  EXPECT_GE(o.totals[1].lost, 1U);
  EXPECT_EQ(o.totals[1].level, 2) << "a level a boundary, two boundaries are enough";
}

// What a run that was stopped did not reach is not lost.
TEST(RealExecutorEnds, ADeadThreadLosesNothingAfterTheStop) {
  class Stops final : public Body {
   public:
    void make_safe() noexcept override {
      Body::make_safe();
      if (safe >= 5) now = true;
    }
    std::atomic<bool> now{false};
  };
  Body a;
  Stops b;
  std::vector<rt::PlacedTask> tasks{spread("alive", 100, a, 0), spread("dead", 100, b, 1)};
  tasks[1].spec.consecutive_miss_limit = 3;
  const rt::Planned planned(one_fault(kDead, "dead", 5), {"alive", "dead"});
  std::int64_t stopped_ns = 0;
  const Outcome o = run(tasks, 60 * kSecond, ordinary(), planned, 0, &stopped_ns, &b.now);
  // Releases before the stop, counted from the plan; the stop itself lies within one of them.
  const std::int64_t before = (stopped_ns - o.plan.epoch_host_ns) / (10 * kMs);
  EXPECT_GT(o.totals[1].lost, 3U);
  EXPECT_LE(o.totals[1].lost + 5U, static_cast<std::uint64_t>(before + 1));
  EXPECT_GT(b.safe, 1) << "the bucket too";
}

// On the CPU by which admission charges it (PlatformWakes::kOnceABox).
TEST(RealExecutorEnds, TheWatchdogIsPinnedToTheLastCoreOfItsTasks) {
  class Looks final : public Body {
   public:
    void work(const rt::Tick& tick) noexcept override {
      if (tick.k < 3) return;
      // The last look that sees one counts: a thread has its name before its CPU, and the last job
      // may be looking when it has ended already.
      int seen = 0;
      for (const auto& t : std::filesystem::directory_iterator("/proc/self/task")) {
        std::string name;
        std::ifstream(t.path() / "comm") >> name;
        if (name != "watchdog") continue;
        ++seen;
        ok = ::sched_getaffinity(std::stoi(t.path().filename()), sizeof set, &set) == 0;
      }
      if (seen > 0) watchdogs = seen;
    }
    int watchdogs = 0;
    bool ok = false;
    cpu_set_t set{};
  };
  const std::vector<int> cpus = rt::affinity_cpus();
  Looks body;
  Body other;
  std::vector<rt::PlacedTask> tasks{placed("last", 100, body, 0), placed("first", 100, other, 1)};
  tasks[0].spec.task_class = rt::TaskClass::kFirm;  // it reads files
  tasks[1].core = cpus.front();
  const Outcome o = run(tasks, 300 * kMs, ordinary());
  ASSERT_TRUE(body.ok);
  EXPECT_EQ(body.watchdogs, 1);
  EXPECT_EQ(CPU_COUNT(&body.set), 1);
  EXPECT_TRUE(CPU_ISSET(static_cast<std::size_t>(cpus.back()), &body.set));
}

}  // namespace
