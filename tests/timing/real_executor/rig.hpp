// Runs the real executor on trivial bodies and keeps everything that it says. Nothing here asserts
// a time: on a loaded machine jobs come late, and the books must still balance.
#pragma once

#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "rt/fault/planned.hpp"
#include "rt/memory/section.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/real_executor.hpp"

namespace rig {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1'000'000'000;

// May a thread of this process have SCHED_FIFO?
inline bool fifo_allowed() {
  static const bool allowed = [] {
    bool ok = false;
    std::thread([&ok] {
      sched_param p{};
      p.sched_priority = 10;
      ok = pthread_setschedparam(pthread_self(), SCHED_FIFO, &p) == 0;
    }).join();
    return ok;
  }();
  return allowed;
}

inline void burn_until(std::int64_t host_ns) {
  while (rt::monotonic_ns() < host_ns) {
  }
}

class Body : public rt::TaskBody {
 public:
  void latch(const rt::Tick&, rt::JobRecord& r) noexcept override { r.input_seq[0] = ++latched; }
  rt::Health step(const rt::Tick& tick, rt::JobRecord& r) noexcept override {
    in_step = true;
    if (rt::Section::active()) ++in_section;
    ++stepped;
    told_skipped += tick.skipped;
    r.work = 1;
    work(tick);
    in_step = false;
    return rt::Health::ok();
  }
  void commit(const rt::Tick&, rt::JobRecord&) noexcept override {
    if (rt::Section::active()) ++commit_in_section;
    ++committed;
  }
  void abandon(const rt::Tick&) noexcept override { ++abandoned; }
  void make_safe() noexcept override {
    // In this order: a job that waits for `safe` ends its step when it sees it.
    if (in_step) ++safe_during_step;
    ++safe;
  }
  virtual void work(const rt::Tick&) noexcept {}

  std::uint64_t latched = 0, stepped = 0, committed = 0, abandoned = 0, told_skipped = 0;
  std::uint64_t in_section = 0, commit_in_section = 0;
  std::atomic<bool> in_step{false};
  std::atomic<int> safe{0}, safe_during_step{0};
};

inline rt::PlacedTask placed(std::string name, std::int64_t hz, Body& body, std::uint16_t id) {
  rt::PlacedTask t;
  t.spec.name = std::move(name);
  t.spec.rate = {hz, 1};
  t.spec.budget = rt::Nanos{200'000};
  t.body = &body;
  t.id = id;
  t.core = rt::affinity_cpus().back();
  t.priority = 80 - id;
  return t;
}

struct Outcome {
  std::vector<std::vector<rt::JobRecord>> jobs;  // by id
  std::vector<rt::SentinelRecord> sentinels;
  std::vector<rt::TaskTotals> totals;
  std::vector<std::string> missing;
  std::uint64_t dropped = 0, hangs = 0;
  rt::RunPlan plan;
};

inline rt::RealOptions light() {
  rt::RealOptions o;
  o.fifo = fifo_allowed();
  o.lock_memory = false;
  o.hold_dma_latency = false;
  return o;
}

template <class Faults = rt::Plain>
Outcome run(const std::vector<rt::PlacedTask>& tasks, std::int64_t duration_ns,
            rt::RealOptions options = light(), const Faults& faults = {},
            std::int64_t stop_after_ns = 0, std::int64_t* stopped_ns = nullptr,
            const std::atomic<bool>* stop_when = nullptr) {
  rt::Startup startup;
  Outcome out;
  std::size_t ids = 0;
  for (const auto& t : tasks) ids = std::max<std::size_t>(ids, t.id + 1U);
  out.jobs.resize(ids);
  rt::RealExecutor<Faults> executor(
      startup.token(), tasks, faults,
      [&](const rt::JobRecord& r) { out.jobs.at(r.task).push_back(r); },
      [&](const rt::SentinelRecord& s) { out.sentinels.push_back(s); }, options);
  out.plan.epoch_host_ns = rt::monotonic_ns() + 50 * kMs;
  out.plan.duration = rt::Nanos{duration_ns};
  out.plan.clock[1] = {1000 * kSecond, 50};
  std::thread stopper;
  std::atomic<bool> over{false};
  if (stop_after_ns > 0 || stop_when != nullptr) {
    stopper = std::thread([&] {
      std::this_thread::sleep_for(rt::Nanos{stop_after_ns});
      while (stop_when != nullptr && !*stop_when && !over)
        std::this_thread::sleep_for(rt::Nanos{kMs});
      executor.request_stop();
      if (stopped_ns != nullptr) *stopped_ns = rt::monotonic_ns();
    });
  }
  executor.run(out.plan);
  over = true;
  if (stopper.joinable()) stopper.join();
  out.totals = executor.totals();
  out.missing = executor.missing();
  out.dropped = executor.dropped_records();
  out.hangs = executor.hangs();
  return out;
}

// Release k in the box's clock, by the formula of the specification.
inline std::int64_t release_of(const Outcome& o, const rt::PlacedTask& t, std::uint64_t k) {
  const auto epoch =
      rt::ns_of(o.plan.clock[static_cast<std::size_t>(t.spec.box)].from_host(o.plan.epoch_host_ns));
  return epoch + t.spec.offset.count() +
         static_cast<std::int64_t>(k * 1'000'000'000ULL *
                                   static_cast<std::uint64_t>(t.spec.rate.den) /
                                   static_cast<std::uint64_t>(t.spec.rate.num));
}

// The books of one task: every release is accounted for, every record is on the grid and in order.
// `whole`: the run was neither stopped nor was a thread lost. `faults`: of the run; a release
// arrives as much later as its plan says, and never before the one before it.
template <class Faults = rt::Plain>
void expect_balanced(const Outcome& o, const std::vector<rt::PlacedTask>& tasks, bool whole = true,
                     const Faults& faults = {}) {
  EXPECT_EQ(o.dropped, 0U);
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const auto& t = tasks[i];
    const auto& jobs = o.jobs[t.id];
    const auto& totals = o.totals[i];
    SCOPED_TRACE(t.spec.name);
    EXPECT_EQ(jobs.size(), totals.completed + totals.aborted) << "a record a job";
    std::uint64_t next = 0, arrived = 0, skipped = 0, aborted = 0;
    std::int64_t end = 0, arrival = 0;
    for (const auto& r : jobs) {
      skipped += r.skipped;
      ASSERT_EQ(r.k, next + r.skipped) << "sorted, no release lost between two records";
      next = r.k + 1;
      ASSERT_EQ(r.release_ns, release_of(o, t, r.k));
      ASSERT_EQ(r.deadline_ns, r.release_ns + t.spec.relative_deadline().count());
      for (; arrived <= r.k; ++arrived) {
        const std::int64_t late = faults.job(t.id, arrived).late.count();
        arrival = std::max(arrival, release_of(o, t, arrived) + late);
      }
      ASSERT_GE(r.start_ns, arrival) << "never early";
      ASSERT_GE(r.end_ns, r.start_ns);
      ASSERT_GE(r.start_ns, end) << "one job at a time";
      // Phase kept: what had arrived when the job before ended was dropped with the others.
      if (r.skipped > 0 && t.spec.policy != rt::MissPolicy::kCatchUp) {
        ASSERT_GE(arrival, end);
      }
      ASSERT_GE(r.cpu_ns, 0);
      aborted += r.outcome == rt::Outcome::kAborted ? 1 : 0;
      end = r.end_ns;
    }
    EXPECT_EQ(aborted, totals.aborted);
    EXPECT_LE(skipped, totals.skipped);
    if (whole) {
      std::uint64_t releases = 0;
      while (t.spec.offset.count() + t.spec.rate.release(releases).count() <
             o.plan.duration.count())
        ++releases;
      // 50 ppm of a run in the faster clock may fit one more release.
      const std::uint64_t spare = t.spec.box == rt::Box::kRobot ? 1 : 0;
      const std::uint64_t sum = totals.completed + totals.aborted + totals.skipped;
      EXPECT_GE(sum, releases);
      EXPECT_LE(sum, releases + spare);
    }
  }
}

}  // namespace rig
