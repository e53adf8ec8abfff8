// The audit of a store against the audit of every record, by brute force.
#include <gmock/gmock.h>

#include "rt/audit/blame.hpp"
#include "rt/audit/task_past.hpp"
#include "rt/quantile.hpp"
#include "rt/store/memory_log.hpp"
#include "rt/store/read_store.hpp"
#include "tests/unit/rt_store/support.hpp"

namespace {

using store_test::Folder;
using store_test::MadeUpRun;

struct Brute {
  std::vector<std::int64_t> lateness, response, cpu, slack;
  std::uint64_t frames = 0, newest = 0;
};
Brute brute(const rt::TaskLog& task) {
  Brute b;
  for (const auto& r : task.jobs) {
    b.lateness.push_back(r.start_ns - r.release_ns);
    b.response.push_back(r.end_ns - r.release_ns);
    b.cpu.push_back(r.cpu_ns);
    b.slack.push_back(r.deadline_ns - r.end_ns);
    if (r.input_seq[0] > b.newest) {
      b.newest = r.input_seq[0];
      ++b.frames;
    }
  }
  for (auto* v : {&b.lateness, &b.response, &b.cpu, &b.slack}) std::sort(v->begin(), v->end());
  return b;
}

void expect_quantiles(const rt::Histogram& got, const std::vector<std::int64_t>& sorted,
                      const std::string& what) {
  ASSERT_EQ(got.count(), sorted.size()) << what;
  EXPECT_EQ(got.min(), sorted.front()) << what;
  EXPECT_EQ(got.max(), sorted.back()) << what;
  for (const double q : {0.01, 0.5, 0.9, 0.99, 0.999, 0.9999}) {
    const auto rank = static_cast<std::size_t>(
        std::max(1.0, std::ceil(q * static_cast<double>(sorted.size()) - 1e-6)));
    const std::int64_t exact = sorted[rank - 1];
    EXPECT_GE(got.quantile(q), exact) << what << ' ' << q;
    EXPECT_LE(got.quantile(q), exact + exact / 64 + 1) << what << ' ' << q;
  }
}

// `task`: of a log whose past and records together are all of `all`.
void expect_same(const rt::RunLog& log, const rt::TaskLog& task, const rt::RunLog& all_log,
                 const rt::TaskLog& all) {
  const std::string& name = all.spec.name;
  rt::TaskPast whole = task.past ? *task.past : rt::TaskPast{};
  rt::BlameWalk walk;
  fold_jobs(whole, walk, task, task.jobs, rt::CoreGaps({}, 0));
  const Brute b = brute(all);
  ASSERT_EQ(whole.jobs, all.jobs.size()) << name;
  expect_quantiles(whole.lateness, b.lateness, name + " lateness");
  expect_quantiles(whole.response, b.response, name + " response");
  expect_quantiles(whole.cpu, b.cpu, name + " cpu");
  EXPECT_EQ(whole.slack.least(), b.slack.front()) << name;
  EXPECT_EQ(whole.newest_input, b.newest) << name;
  EXPECT_EQ(whole.inputs_seen, b.frames) << name;
  const rt::TaskBlame got = rt::blame(log, task), want = rt::blame(all_log, all);
  EXPECT_EQ(got.misses, want.misses) << name;
  EXPECT_EQ(got.late, want.late) << name;
  EXPECT_EQ(got.miss_total, want.miss_total) << name;
  EXPECT_EQ(got.late_total, want.late_total) << name;
  EXPECT_EQ(got.completed, want.completed) << name;
  EXPECT_EQ(got.aborted, want.aborted) << name;
  EXPECT_EQ(got.skipped, want.skipped) << name;
}

TEST(StoreOracle, CountsAreExactAndQuantilesWithinABucketHoweverThin) {
  for (const std::uint64_t seed : {1U, 2U}) {
    RecordProperty("seed", static_cast<int>(seed));
    const Folder folder;
    MadeUpRun run(seed);
    rt::StoreOptions options;
    options.cap_bytes = rt::StoreOptions::kLeastCap;
    options.segment_s = 1;
    rt::RunStore store(folder.path(), run.all(), options);
    run.run(store, 260);
    store.finish({}, 3);
    EXPECT_EQ(store.problem(), "");
    EXPECT_LE(store.use().most_bytes, options.cap_bytes);
    EXPECT_LE(rt::store_bytes(folder.path()), options.cap_bytes);
    EXPECT_EQ(rt::store_bytes(folder.path()),
              store.use().bytes + std::filesystem::file_size(folder.path() + "/end"));

    const auto got = rt::read_store(folder.path());
    ASSERT_TRUE(got) << got.error();
    const rt::RunLog& log = got.value().log;
    EXPECT_EQ(log.dropped, 3U);
    EXPECT_EQ(got.value().whole_records + got.value().part_records, run.jobs());
    EXPECT_GT(got.value().whole_records, 20000U);
    EXPECT_GT(got.value().part_records, 20000U) << "the test is of thinned records";
    EXPECT_FALSE(folder.names("part-00000000-00000005").empty()) << "and of merged parts";
    std::uint64_t samples = log.sentinels.size();
    for (const auto& [core, h] : log.past_sentinels) samples += h.count();
    EXPECT_EQ(samples, run.all().sentinels.size());
    for (std::size_t i = 0; i < log.tasks.size(); ++i)
      expect_same(log, log.tasks[i], run.all(), run.all().tasks[i]);
  }
}

TEST(StoreOracle, LatenessBeyondTheSentinelIsThatOfEveryRecord) {
  const Folder folder;
  MadeUpRun run(3);
  rt::StoreOptions options;
  options.cap_bytes = rt::StoreOptions::kLeastCap;
  options.segment_s = 2;
  rt::RunStore store(folder.path(), run.all(), options);
  run.run(store, 40);
  store.finish({}, 0);
  for (const auto& name : folder.names("whole-"))
    std::filesystem::remove(folder.path() + "/" + name);
  const auto got = rt::read_store(folder.path());
  ASSERT_TRUE(got) << got.error();
  for (std::size_t i = 0; i < 3; ++i) {
    const rt::TaskLog& all = run.all().tasks[i];
    ASSERT_TRUE(got.value().log.tasks[i].past);
    const rt::SignedHistogram& h = got.value().log.tasks[i].past->late_minus_sentinel;
    auto want = rt::late_minus_sentinel(run.all(), all);
    ASSERT_EQ(h.count(), want.size()) << all.spec.name;
    std::sort(want.begin(), want.end());
    EXPECT_EQ(h.least(), want.front());
    for (const double q : {0.01, 0.5, 0.99}) {
      const std::int64_t exact = want[rt::quantile_rank(q, want.size()) - 1];
      EXPECT_NEAR(static_cast<double>(h.quantile(q)), static_cast<double>(exact),
                  std::abs(static_cast<double>(exact)) / 64 + 1)
          << all.spec.name << ' ' << q;
    }
  }
}

TEST(StoreOracle, EventsAreWholeUpToTheirNumber) {
  const Folder folder;
  MadeUpRun run(4);
  rt::RunStore store(folder.path(), run.all(), {});
  run.run(store, 12);
  store.event(store_test::kEpoch + 1000000000, "mode engaged");
  store.finish({}, 0);
  for (const auto& name : folder.names("whole-"))
    std::filesystem::remove(folder.path() + "/" + name);
  const auto got = rt::read_store(folder.path());
  ASSERT_TRUE(got) << got.error();
  ASSERT_EQ(got.value().events.size(), 1U);
  EXPECT_EQ(got.value().events[0].text, "mode engaged");
  for (const rt::TaskLog& t : got.value().log.tasks) {
    ASSERT_TRUE(t.past);
    std::vector<std::uint64_t> want, have;
    const rt::JobRecord* before = nullptr;
    for (const auto& r : run.all().tasks[&t - got.value().log.tasks.data()].jobs) {
      const bool change =
          before != nullptr && (before->level != r.level || before->fault != r.fault);
      if (r.missed() || r.skipped > 0 || change || (before == nullptr && r.fault != rt::kNoFault) ||
          r.cpu_ns > t.spec.budget_of(r.level).count())
        want.push_back(r.k);
      before = &r;
    }
    for (const auto& r : t.past->events) have.push_back(r.k);
    EXPECT_EQ(have.size() + t.past->events_left_out, want.size()) << t.spec.name;
    want.resize(have.size());
    EXPECT_EQ(have, want) << t.spec.name;
    EXPECT_LE(have.size(), rt::TaskPast::kMaxEvents);
  }
}

TEST(StoreOracle, InMemoryTheSameWithinItsNumber) {
  MadeUpRun run(5);
  struct Memory {
    rt::RunLog log = store_test::header();
    rt::MemoryLog keeper{log, 5000};
    void add(const rt::JobRecord& r) { keeper.add(r); }
    void add(const rt::SentinelRecord&) {}
  } memory;
  run.run(memory, 60);
  rt::RunLog all = run.all();
  all.sentinels.clear();  // this one keeps none
  std::size_t held = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    held += memory.log.tasks[i].jobs.size();
    ASSERT_TRUE(memory.log.tasks[i].past);
    expect_same(memory.log, memory.log.tasks[i], all, all.tasks[i]);
  }
  EXPECT_LE(held, 5000U);
  EXPECT_GE(held, 2000U);
}

}  // namespace
