#include "rt/audit/blame.hpp"

#include <algorithm>

#include "rt/audit/task_past.hpp"

namespace rt {

namespace {

JobBlame split(const JobRecord& r, std::int64_t previous_end, const TaskLog& task,
               const CoreGaps& gaps) {
  JobBlame b;
  b.response = r.end_ns - r.release_ns;
  const std::int64_t free_from = std::clamp(previous_end, r.release_ns, r.start_ns);
  b.carried = free_from - r.release_ns;
  const std::int64_t waiting = r.start_ns - free_from;
  const std::int64_t platform_before = gaps.overlap(free_from, r.start_ns);
  const std::int64_t delay_before = std::min(r.run_delay_ns, waiting);
  const std::int64_t queued_before =
      std::clamp<std::int64_t>(waiting - platform_before, 0, delay_before);
  const std::int64_t wall = r.end_ns - r.start_ns;
  const std::int64_t off_cpu = std::max<std::int64_t>(0, wall - r.cpu_ns - r.twin_cpu_ns);
  // The run delay also holds what fell between two jobs; inside this one it can not exceed off_cpu.
  const std::int64_t delay_inside =
      std::clamp<std::int64_t>(r.run_delay_ns - delay_before, 0, off_cpu);
  const std::int64_t gone = off_cpu - delay_inside;
  const std::int64_t over =
      std::max<std::int64_t>(0, r.cpu_ns - task.spec.budget_of(r.level).count());
  const bool calibrated = task.work_max > 0;
  const bool more_work = !calibrated || r.work > task.work_max;
  b.platform = platform_before;
  b.queued = queued_before + delay_inside;
  (more_work ? b.own : b.charged) += over;
  // Off the CPU without being runnable: a wait of ours if the kernel counted one, else the host.
  (r.voluntary > 1 ? b.own : b.platform) += gone;
  return b;
}

Cause largest(const JobBlame& b, std::int64_t to_explain, bool whole_job) {
  const std::array<std::pair<std::int64_t, Cause>, 5> parts{
      {{b.carried, Cause::kCarried},
       {b.platform, Cause::kPlatform},
       {b.queued, Cause::kQueued},
       {whole_job ? b.own : 0, Cause::kOwn},
       {whole_job ? b.charged : 0, Cause::kCharged}}};
  std::int64_t best = 0, sum = 0;
  Cause cause = Cause::kUnknown;
  for (const auto& [ns, c] : parts) {
    sum += ns;
    if (ns > best) {
      best = ns;
      cause = c;
    }
  }
  return 2 * sum < to_explain ? Cause::kUnknown : cause;
}

}  // namespace

namespace {

// From the jobs that are gone to those that are here, where one follows the other.
BlameWalk walk_after(const TaskLog& task) {
  if (task.jobs.empty() || task.past->last_k >= task.jobs.front().k) return {};
  return {task.past->last_end_ns, task.past->last_cause};
}

}  // namespace

std::string_view name_of(Cause cause) noexcept {
  constexpr std::array<std::string_view, kCauses> names{"carried", "platform", "queued",
                                                        "own",     "charged",  "unknown"};
  return names[static_cast<std::size_t>(cause)];
}

void BlameCounts::add(const JobRecord& r, const JobBlame& b) noexcept {
  if (b.late_start) {
    ++late[static_cast<std::size_t>(b.late_cause)];
    ++late_total;
  }
  misses[static_cast<std::size_t>(b.skip_cause)] += r.skipped;
  miss_total += r.skipped;
  skipped += r.skipped;
  if (b.missed) {
    ++misses[static_cast<std::size_t>(b.miss_cause)];
    ++miss_total;
  }
  (r.outcome == Outcome::kAborted ? aborted : completed) += 1;
}

void BlameCounts::merge(const BlameCounts& other) noexcept {
  for (std::size_t i = 0; i < late.size(); ++i) late[i] += other.late[i];
  for (std::size_t i = 0; i < misses.size(); ++i) misses[i] += other.misses[i];
  late_total += other.late_total;
  miss_total += other.miss_total;
  completed += other.completed;
  aborted += other.aborted;
  skipped += other.skipped;
}

CoreGaps::CoreGaps(std::span<const SentinelRecord> samples, int core) {
  for (const auto& s : samples) {
    if (s.core == core) samples_.push_back(s);
  }
  std::stable_sort(samples_.begin(), samples_.end(),
                   [](const auto& a, const auto& b) { return a.release_ns < b.release_ns; });
  for (const auto& s : samples_) gaps_.push_back({s.release_ns, s.release_ns + s.late_ns});
  // Samples overlap after a theft: keep the union, with both ends in ascending order.
  for (std::size_t i = 1; i < gaps_.size(); ++i) {
    gaps_[i].from = std::max(gaps_[i].from, gaps_[i - 1].to);
    gaps_[i].to = std::max(gaps_[i].to, gaps_[i].from);
  }
}

std::int64_t CoreGaps::overlap(std::int64_t from, std::int64_t to) const noexcept {
  if (to <= from) return 0;
  auto it = std::lower_bound(gaps_.begin(), gaps_.end(), from,
                             [](const Gap& g, std::int64_t t) { return g.to <= t; });
  std::int64_t sum = 0;
  for (; it != gaps_.end() && it->from < to; ++it) {
    sum += std::max<std::int64_t>(0, std::min(it->to, to) - std::max(it->from, from));
  }
  return sum;
}

std::optional<std::int64_t> CoreGaps::late_at(std::int64_t release_ns) const noexcept {
  const auto it = std::lower_bound(samples_.begin(), samples_.end(), release_ns,
                                   [](const auto& s, std::int64_t t) { return s.release_ns < t; });
  if (it == samples_.end() || it->release_ns != release_ns) return std::nullopt;
  return it->late_ns;
}

JobBlame BlameWalk::next(const JobRecord& r, const TaskLog& task, const CoreGaps& gaps,
                         const BlameOptions& options) {
  JobBlame b = split(r, previous_end, task, gaps);
  const std::int64_t late = r.lateness_ns();
  b.late_start = late > options.late_ns;
  b.missed = r.missed();
  // Only what happened before the start can make a start late.
  JobBlame before = b;
  before.platform = gaps.overlap(std::max(previous_end, r.release_ns), r.start_ns);
  before.queued =
      std::min(r.run_delay_ns, std::max<std::int64_t>(0, late - before.carried - before.platform));
  b.late_cause = largest(before, late, false);
  // A late job needed more than its deadline; explain what exceeds an undisturbed run.
  const std::int64_t undisturbed =
      std::min(r.cpu_ns + r.twin_cpu_ns, task.spec.budget_of(r.level).count());
  b.miss_cause = largest(b, b.response - undisturbed, true);
  // The releases dropped before this job were lost to the one that ran over them.
  b.skip_cause = previous_cause;
  // A job that ran over a release without missing its own deadline still has a cause.
  previous_cause = b.miss_cause;
  previous_end = r.end_ns;
  return b;
}

TaskBlame blame(const RunLog& log, const TaskLog& task, const BlameOptions& options) {
  const CoreGaps gaps(log.sentinels, task.core);
  TaskBlame out;
  BlameWalk walk;
  if (task.past) {
    out.merge(task.past->counts);
    walk = walk_after(task);
  }
  out.jobs.reserve(task.jobs.size());
  for (const auto& r : task.jobs) {
    out.jobs.push_back(walk.next(r, task, gaps, options));
    out.add(r, out.jobs.back());
  }
  if (task.totals && task.totals->skipped > out.skipped) {
    const std::uint64_t tail = task.totals->skipped - out.skipped;
    const std::uint64_t lost = std::min(tail, task.totals->lost);
    out.misses[static_cast<std::size_t>(Cause::kOwn)] += lost;
    out.misses[static_cast<std::size_t>(Cause::kUnknown)] += tail - lost;
    out.miss_total += tail;
    out.skipped += tail;
  }
  out.releases = out.completed + out.aborted + out.skipped;
  return out;
}

std::vector<std::int64_t> late_minus_sentinel(const RunLog& log, const TaskLog& task) {
  const CoreGaps gaps(log.sentinels, task.core);
  std::vector<std::int64_t> out;
  BlameWalk walk;
  if (task.past) walk = walk_after(task);
  std::int64_t previous_end = walk.previous_end;
  for (const auto& r : task.jobs) {
    const bool carried = previous_end > r.release_ns;
    previous_end = r.end_ns;
    if (carried) continue;
    if (const auto late = gaps.late_at(r.release_ns)) out.push_back(r.lateness_ns() - *late);
  }
  return out;
}

}  // namespace rt
