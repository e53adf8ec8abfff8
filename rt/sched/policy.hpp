// Miss policies as pure functions, shared by both executors: which release is served next.
#pragma once

#include <algorithm>
#include <cstdint>

#include "rt/sched/task_spec.hpp"

namespace rt {

struct NextRelease {
  std::uint64_t k = 0;        // release to serve next
  std::uint32_t skipped = 0;  // releases dropped on the way there
  Time arrival{};             // when it arrives (in the past for a caught-up one)
};

// After the job of release k, which arrived at `arrival`, ended at `end`: which release is next?
// `raw_arrival(i)` is release i plus its injected delay; release i arrives at
// A(i) = max(raw_arrival(i), A(i - 1)). A release that arrives exactly at `end` is neither late nor
// pending.
//   skip, abort, degrade: everything that arrived before `end` is dropped
//   catch_up(n): of what arrived before `end` the newest n are kept and run back to back
template <class RawArrival>
[[nodiscard]] NextRelease next_release(const TaskSpec& spec, std::uint64_t k, Time arrival,
                                       Time end, const RawArrival& raw_arrival) noexcept {
  std::uint64_t open = k + 1;  // first release that has not arrived before `end`
  Time a = std::max(arrival, raw_arrival(open));
  while (a < end) a = std::max(a, raw_arrival(++open));
  const std::uint64_t pending = open - (k + 1);
  const std::uint64_t keep = spec.policy == MissPolicy::kCatchUp
                                 ? std::min(pending, static_cast<std::uint64_t>(spec.catch_up_max))
                                 : 0;
  const std::uint64_t dropped = pending - keep;
  // A kept release has arrived already; its exact instant no longer matters, only that it is past.
  return {k + 1 + dropped, static_cast<std::uint32_t>(dropped), keep > 0 ? std::min(a, end) : a};
}

// Which variant a task with policy degrade runs: one level down at the first hyperperiod boundary
// after a miss where no job of it is pending, one level back after `clean_needed` clean
// hyperperiods. Never above the level that admission chose, never beyond the last one that it
// reckoned with.
class LevelControl {
 public:
  LevelControl(int start_level, int last_level, int clean_needed = 10) noexcept
      : level_(start_level), first_(start_level), last_(last_level), clean_needed_(clean_needed) {}

  void on_miss() noexcept { missed_ = true; }
  // At a hyperperiod boundary. Returns true when the level changed.
  bool at_boundary(bool job_pending) noexcept {
    if (job_pending) return false;
    if (missed_) {
      missed_ = false;
      clean_ = 0;
      if (level_ >= last_) return false;
      ++level_;
      return true;
    }
    if (level_ == first_ || ++clean_ < clean_needed_) return false;
    clean_ = 0;
    --level_;
    return true;
  }
  [[nodiscard]] int level() const noexcept { return level_; }

 private:
  int level_, first_, last_, clean_needed_;
  int clean_ = 0;
  bool missed_ = false;
};

// Leaky bucket on consecutive misses: +1 for a miss, -1 for a job in time; above the limit the
// task's safe output is forced, and that never waits for a boundary. It holds twice the limit: a
// process that stood still for seconds has thousands of misses, and is well again after as many
// jobs in time as the limit says, not after seconds of them.
class MissBucket {
 public:
  explicit MissBucket(int limit) noexcept : limit_(limit) {}
  // Returns true when the limit is passed.
  bool on_job(bool missed, std::uint32_t skipped) noexcept {
    if (missed || skipped > 0)
      level_ = std::min<std::int64_t>(2 * limit_, level_ + 1 + std::int64_t{skipped});
    else if (level_ > 0)
      --level_;
    return level_ > limit_;
  }
  [[nodiscard]] std::int64_t level() const noexcept { return level_; }

 private:
  std::int64_t limit_;  // 0: never
  std::int64_t level_ = 0;
};

}  // namespace rt
