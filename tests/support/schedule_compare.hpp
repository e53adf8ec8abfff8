// The virtual executor's records beside the reference's jobs, and plans to run both on.
#pragma once

#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "rt/clock/box_time.hpp"
#include "rt/random.hpp"
#include "rt/sched/executor.hpp"
#include "rt/sched/job_record.hpp"
#include "tests/support/reference_sim.hpp"

namespace support {

inline rt::MissPolicy policy_of(SimPolicy p) {
  switch (p) {
    case SimPolicy::kSkip:
      return rt::MissPolicy::kSkip;
    case SimPolicy::kCatchUp:
      return rt::MissPolicy::kCatchUp;
    case SimPolicy::kAbort:
      return rt::MissPolicy::kAbort;
    case SimPolicy::kDegrade:
      return rt::MissPolicy::kDegrade;
  }
  return rt::MissPolicy::kSkip;
}

// By what a record tells its times: the host's epoch and the clock of the task's box.
struct Told {
  std::int64_t epoch_host_ns = 0;
  rt::BoxTime clock;
  [[nodiscard]] std::int64_t operator()(Ticks t) const {
    return rt::ns_of(clock.from_host(epoch_host_ns + t));
  }
};

inline std::string differs(const SimJob& want, const rt::JobRecord& got, const Told& told) {
  const Ticks start = want.start < 0 ? want.end : want.start;  // how a record says "never started"
  const bool aborted = want.outcome == SimOutcome::kAborted;
  // A release lies on the grid of the box's clock, which the host's nanoseconds may straddle.
  const std::int64_t release = told(want.release);
  const bool released = got.release_ns == release ||
                        (got.release_ns < release && got.release_ns > told(want.release - 1));
  if (released && got.start_ns == told(start) && got.end_ns == told(want.end) &&
      got.level == want.level && (got.outcome == rt::Outcome::kAborted) == aborted &&
      got.missed() == (want.late || aborted)) {
    return {};
  }
  return "job " + std::to_string(want.k) + ": reference " + std::to_string(told(start)) + ".." +
         std::to_string(told(want.end)) + " level " + std::to_string(want.level) + ", executor " +
         std::to_string(got.start_ns) + ".." + std::to_string(got.end_ns) + " level " +
         std::to_string(got.level);
}

// The first difference, or empty.
inline std::string compare_task(const SimTaskResult& want, const rt::TaskTotals& totals,
                                const std::map<std::uint64_t, rt::JobRecord>& jobs,
                                const Told& told = {}) {
  if (want.completed != totals.completed || want.late != totals.late ||
      want.aborted != totals.aborted || want.skipped != totals.skipped ||
      want.level != totals.level) {
    return "totals: reference completed " + std::to_string(want.completed) + " late " +
           std::to_string(want.late) + " aborted " + std::to_string(want.aborted) + " skipped " +
           std::to_string(want.skipped) + " level " + std::to_string(want.level) + ", executor " +
           std::to_string(totals.completed) + " " + std::to_string(totals.late) + " " +
           std::to_string(totals.aborted) + " " + std::to_string(totals.skipped) + " " +
           std::to_string(totals.level);
  }
  std::size_t ended = 0;
  for (const SimJob& job : want.jobs) {
    if (job.outcome != SimOutcome::kCompleted && job.outcome != SimOutcome::kAborted) continue;
    ++ended;
    const auto got = jobs.find(job.k);
    if (got == jobs.end()) return "job " + std::to_string(job.k) + " is missing";
    if (std::string text = differs(job, got->second, told); !text.empty()) return text;
  }
  return ended == jobs.size() ? std::string() : "the executor has more jobs";
}

struct Sums {
  std::uint64_t releases = 0, late = 0, skipped = 0, aborted = 0, degraded = 0, restored = 0;

  void add(const SimTaskResult& t) {
    releases += t.releases;
    late += t.late;
    skipped += t.skipped;
    aborted += t.aborted;
    degraded += t.degraded;
    restored += t.restored;
  }
  [[nodiscard]] std::uint64_t misses() const { return late + skipped + aborted; }
  static void print_head() {
    std::printf("%-20s %9s %6s %8s %8s %9s %9s\n", "plan", "releases", "late", "skipped", "aborted",
                "degraded", "restored");
  }
  void print(const std::string& name) const {
    const auto u = [](std::uint64_t v) { return static_cast<unsigned long long>(v); };
    std::printf("%-20s %9llu %6llu %8llu %8llu %9llu %9llu\n", name.c_str(), u(releases), u(late),
                u(skipped), u(aborted), u(degraded), u(restored));
  }
};

inline rt::FaultEntry random_fault(rt::Random& rng, const std::vector<SimTask>& tasks) {
  const auto& t =
      tasks[static_cast<std::size_t>(rng.integer(0, static_cast<std::int64_t>(tasks.size()) - 1))];
  rt::FaultEntry e;
  e.target = t.name;
  e.first = static_cast<std::uint64_t>(rng.integer(0, 30));
  e.seed = rng();
  if (rng.integer(0, 14) == 0) {
    e.kind = rt::FaultKind::kDeadThread;
    return e;
  }
  e.kind = static_cast<rt::FaultKind>(rng.integer(0, 5));
  e.every = static_cast<std::uint64_t>(rng.integer(1, 20));
  e.count = static_cast<std::uint64_t>(rng.integer(0, 5));
  e.probability = rng.integer(0, 1) == 0 ? 1.0 : rng.uniform();
  // Whole milliseconds make events of several tasks fall on one instant.
  e.magnitude = rt::Nanos{rng.integer(0, 2) == 0 ? 1'000'000 * rng.integer(1, 20)
                                                 : rng.integer(1, 3'000'000'000 / t.rate_num)};
  return e;
}

}  // namespace support
