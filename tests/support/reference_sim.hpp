// An independent reference for scheduling: what a set of tasks does on preemptive fixed-priority
// cores, tick by tick, in integers. It shares no code with the executors or the analysis (from rt/
// it takes the definition of a fault plan's data and the mixing function) and is written to be
// obviously right rather than fast. The virtual executor has to agree with it job by job.
//
// Semantics
// ---------
// Ticks are integers; the epoch is tick 0. Priorities differ within a core; larger runs first.
//
// Releases. r(k) is the nominal release of job k: offset + k * period, or
//   offset + floor(k * ticks_per_second * den / num). Release k *arrives* at
//   A(k) = max(r(k) + jitter(k) + late_release(k), A(k-1)). Deadlines are counted from the nominal
//   release: d(k) = r(k) + D. Jobs of one task are strictly sequential, in the order of k.
// A task may live by a clock of its own (SimTask::on_clock). Its offset, period, deadline and late
//   releases are then counted by that clock: r, A and d are the instants at which it shows them.
//   Costs, blocks, thefts and hogs are counted in ticks.
// One instant t is worked through in this order, on all cores:
//   1. completions: a job that has received its whole cost ends. It is late if t > d(k).
//   2. aborts: the oldest job of a task with policy abort that has arrived, started or not, and has
//      d(k) == t is aborted. (So a job that ends exactly at its deadline has met it.)
//      At every end (1 or 2) the task's policy drops releases that have arrived before t and have
//      not started. A release that arrives exactly at t is not dropped, and does not count as
//      pending here.
//        skip, degrade, abort: all of them
//        catch_up(n): the oldest, until n are left
//      Each dropped release is counted as skipped, at this instant.
//   3. hyperperiod boundary (t a positive multiple of the host's hyperperiod): see degrade.
//   4. arrivals: releases with A(k) == t, in the order of the task table; blocked jobs whose time
//      is up become ready; thefts and hogs of r(k) == t begin; thefts whose time is up end.
//      A job of a task with policy abort that arrives at or after d(k) is aborted on arrival,
//      without a start.
//   5. dispatch: per core, unless a theft is under way: the hog if one has work left, else the
//      ready job of highest priority. A job dispatched for the first time *starts* (its inputs are
//      latched); if its plan says block, it is suspended at once until t + magnitude and the next
//      one is dispatched at the same instant. A job inside its locked section (see SimTask::locked)
//      keeps the core against everything but a theft.
// Between instants the dispatched job, or the hog, receives CPU. Preempted jobs resume where they
// were.
//
// Cost. cost(k, level) + extra_cpu + page_fault, at least 1 tick; the level is the one at the
// start.
//
// Misses. late (completed after d(k)), aborted, skipped: one each, and a job has one outcome.
//   A release that arrived counts as completed, aborted, skipped, or still open at the end.
//
// degrade. As skip. At a boundary, a task is *idle* if it has no job started and unfinished and no
//   release that arrived before t and waits. Only an idle task changes its level:
//     a miss (late or skipped) since its last evaluation: level + 1, at most last_level; clean = 0
//     else: clean + 1; if clean == clean_hyperperiods and level > first_level: level - 1, clean = 0
//   A task that is not idle is not evaluated; its miss stays noted for the next boundary. The
//   switch comes before the releases of that instant.
//
// dead_thread at k0. No release k >= k0 starts. Such a release is counted as skipped (a miss like
//   any other, also for degrade) at the instant it becomes the oldest of its task: when it arrives,
//   or when the job before it ends. Releases before k0 run as always.
//
// End. Instants 0 .. horizon - 1 are worked through whole; at `horizon` only steps 1 and 2.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "rt/fault/plan.hpp"

namespace support {

using Ticks = std::int64_t;

enum class SimPolicy : std::uint8_t { kSkip, kCatchUp, kAbort, kDegrade };
enum class SimOutcome : std::uint8_t { kCompleted, kAborted, kSkipped, kOpen };

struct SimTask {
  std::string name;
  // Either period > 0, or a rate rate_num / rate_den per second.
  Ticks period = 0;
  std::int64_t rate_num = 0, rate_den = 1;
  Ticks offset = 0;
  Ticks deadline = 0;
  int priority = 0;
  int core = 0;
  SimPolicy policy = SimPolicy::kSkip;
  int catch_up_max = 0;
  int first_level = 0, last_level = 0;  // of policy degrade
  Ticks locked = 0;  // the first ticks of a job's cost cannot be preempted, once begun
  Ticks cost = 1;    // if cost_of is empty
  std::function<Ticks(std::uint64_t k, int level)> cost_of;
  std::function<Ticks(std::uint64_t k)> jitter_of;  // empty: 0
  // First tick at which the task's own clock, 0 at the epoch, shows this much or more. Strictly
  // increasing; empty: the clock is the simulation's.
  std::function<Ticks(Ticks shown)> on_clock;
};

struct SimConfig {
  std::vector<SimTask> tasks;
  int cores = 1;
  Ticks horizon = 0;
  Ticks ticks_per_second = 1'000'000'000;
  Ticks hyperperiod = 0;  // of the whole host; 0: no boundaries
  int clean_hyperperiods = 10;
  rt::FaultPlan plan;       // magnitudes: 1 ns is one tick
  bool keep_jobs = true;    // fill SimTaskResult::jobs
  bool every_tick = false;  // visit every tick instead of jumping to the next event
};

struct SimJob {
  std::uint64_t k = 0;
  Ticks release = 0;  // nominal
  Ticks arrival = 0;
  Ticks start = -1;  // first dispatch; -1: never
  Ticks end = -1;    // completion, abort or drop
  int level = 0;     // in force at the start (at the end, if it never started)
  SimOutcome outcome = SimOutcome::kOpen;
  bool late = false;
  friend bool operator==(const SimJob&, const SimJob&) = default;
};

struct SimTaskResult {
  std::uint64_t releases = 0;  // arrived
  std::uint64_t completed = 0, late = 0, skipped = 0, aborted = 0, open = 0;
  std::uint64_t degraded = 0, restored = 0;  // level changes up and down
  int level = 0;                             // at the end
  Ticks worst_response = 0;                  // max of end - release over completed jobs
  std::vector<SimJob> jobs;                  // ordered by k
  [[nodiscard]] std::uint64_t misses() const { return late + skipped + aborted; }
};

struct SimResult {
  std::vector<SimTaskResult> tasks;
};

[[nodiscard]] SimResult simulate(const SimConfig& config);

}  // namespace support
