// The check that all these tests rest on: it lets right books pass, and no wrong ones. Made by
// hand, no thread runs.
#include <gtest/gtest-spi.h>

#include "tests/unit/rt_real_threads/rig.hpp"

namespace {

using namespace rig;

// 100 Hz over 100 ms; job 3 runs until 52 ms and over release 4; release 5 comes 4 ms late.
struct Books {
  Body body;
  std::vector<rt::PlacedTask> tasks{placed("task", 100, body, 0)};
  rt::Planned planned{one_fault(rt::FaultKind::kLateRelease, "task", 5, 4 * kMs, 100), {"task"}};
  Outcome o;

  Books() {
    o.plan.epoch_host_ns = 7 * kSecond;
    o.plan.duration = rt::Nanos{100 * kMs};
    o.jobs.resize(1);
    for (std::uint64_t k = 0; k < 10; ++k) {
      if (k == 4) continue;
      rt::JobRecord& r = o.jobs[0].emplace_back();
      r.k = k;
      r.release_ns = release_of(o, tasks[0], k);
      r.deadline_ns = r.release_ns + 10 * kMs;
      r.start_ns = r.release_ns + (k == 5 ? 4 * kMs : 0);
      r.end_ns = k == 3 ? r.release_ns + 22 * kMs : r.start_ns + kMs;
      r.skipped = k == 5 ? 1 : 0;
    }
    auto& totals = o.totals.emplace_back();
    totals.completed = 9;
    totals.skipped = 1;
  }
  // Record of release k; not 4.
  rt::JobRecord& job(std::size_t k) { return o.jobs[0].at(k < 4 ? k : k - 1); }
  template <class Faults>
  [[nodiscard]] int failures(const Faults& faults) const {
    testing::TestPartResultArray found;
    const testing::ScopedFakeTestPartResultReporter reporter(
        testing::ScopedFakeTestPartResultReporter::INTERCEPT_ONLY_CURRENT_THREAD, &found);
    expect_balanced(o, tasks, true, faults);
    return found.size();
  }
};

TEST(Books, ThatAreRightPass) {
  const Books b;
  EXPECT_EQ(b.failures(b.planned), 0);
}

TEST(Books, ThatAreWrongDoNot) {
  const struct {
    const char* what;
    void (*spoil)(Books&);
  } kSpoils[] = {
      {"served before it arrived", [](Books& b) { b.job(5).start_ns -= 1; }},
      {"served before its release", [](Books& b) { b.job(8).start_ns -= 1; }},
      {"arrived before the end, and not dropped",
       [](Books& b) { b.job(3).end_ns = ++b.job(5).start_ns; }},
      {"two at once", [](Books& b) { b.job(6).end_ns += 10 * kMs; }},
      {"ends before it starts", [](Books& b) { b.job(6).end_ns = b.job(6).start_ns - 1; }},
      {"lost", [](Books& b) { b.o.jobs[0].erase(b.o.jobs[0].begin() + 6); }},
      {"dropped and not counted", [](Books& b) { b.job(5).skipped = 0; }},
      {"counted and not dropped", [](Books& b) { b.job(8).skipped = 1; }},
      {"out of order", [](Books& b) { std::swap(b.job(6), b.job(7)); }},
      {"off the grid", [](Books& b) { b.job(7).release_ns += 1; }},
      {"another deadline", [](Books& b) { b.job(7).deadline_ns -= 1; }},
      {"totals lack a job", [](Books& b) { --b.o.totals[0].completed; }},
      {"totals lack a dropped one", [](Books& b) { b.o.totals[0].skipped = 0; }},
      {"totals have a release more", [](Books& b) { ++b.o.totals[0].skipped; }},
      {"aborted and not counted", [](Books& b) { b.job(7).outcome = rt::Outcome::kAborted; }},
      {"a record was dropped", [](Books& b) { b.o.dropped = 1; }}};
  for (const auto& s : kSpoils) {
    Books b;
    s.spoil(b);
    EXPECT_GT(b.failures(b.planned), 0) << s.what;
  }
  // Without the plan release 5 had arrived when job 3 ended.
  const Books b;
  EXPECT_GT(b.failures(rt::Plain{}), 0);
}

}  // namespace
