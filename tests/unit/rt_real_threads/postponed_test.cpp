// A task whose releases are postponed while it runs: its grid moves as a whole, two releases are
// never closer than a period, no job begins before its release, and the other tasks do not notice.
#include "tests/unit/rt_real_threads/rig.hpp"

namespace {

using namespace rig;

// Asks for `by_ns` more at each of these jobs, as another thread may at any time.
class Asks final : public Body {
 public:
  void work(const rt::Tick& tick) noexcept override {
    if (tick.k % 20 == 10) postponed->asked_ns.fetch_add(7 * kMs + 11);
  }
  std::shared_ptr<rt::Postponed> postponed = std::make_shared<rt::Postponed>();
};

TEST(RealThreads, APostponedTaskMovesItsGridAsAWhole) {
  Asks moved;
  Body other;
  std::vector<rt::PlacedTask> tasks{spread("moved", 100, moved, 0), spread("other", 300, other, 1)};
  tasks[0].spec.postponed = moved.postponed;
  const Outcome o = run(tasks, 1'000 * kMs, ordinary());
  ASSERT_GT(o.jobs[0].size(), 1U);
  std::int64_t shift = 0, before = 0;
  for (const rt::JobRecord& r : o.jobs[0]) {
    const std::int64_t now = r.release_ns - release_of(o, tasks[0], r.k);
    EXPECT_GE(now, shift) << "it only grows";
    EXPECT_EQ(now % (7 * kMs + 11), 0) << "by what was asked";
    EXPECT_GE(r.start_ns, r.release_ns);
    if (before != 0) {
      EXPECT_GE(r.release_ns - before, 10 * kMs);
    }
    shift = now;
    before = r.release_ns;
  }
  EXPECT_GT(shift, 0);
  EXPECT_EQ(moved.postponed->applied_ns.load(), moved.postponed->asked_ns.load());
  for (const rt::JobRecord& r : o.jobs[1]) EXPECT_EQ(r.release_ns, release_of(o, tasks[1], r.k));
  const auto& totals = o.totals[0];
  const auto released = static_cast<std::int64_t>(totals.completed + totals.skipped);
  EXPECT_NEAR(static_cast<double>(released),
              static_cast<double>((1'000 * kMs - shift) / (10 * kMs)), 1);
}

}  // namespace
