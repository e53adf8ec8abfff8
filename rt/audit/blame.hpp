// Blame: each late start and each miss gets exactly one cause, by splitting the job's response.
//
//   release ... start    carried   the previous job ended after this release
//                        platform  the sentinel of this core was late over the same span
//                        queued    runnable, sentinel on time: a higher task of ours had the core
//   start ... end        own       CPU beyond the budget, with more work done than calibration saw;
//                                  or a voluntary wait inside the job
//                        charged   CPU beyond the budget while the work count lies inside
//                                  calibration's range: the time went to something else
//                                  (interrupts, host) but the kernel charged it to this thread
//                        platform  wall time that was neither CPU nor run delay
// The largest part wins; a late start or miss whose parts do not explain half of it is unknown.
// A skipped release takes the cause of the job that ran over it. Releases without a record: cause
// `own` if they arrived after the thread ended, else `unknown`.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "rt/audit/run_log.hpp"

namespace rt {

enum class Cause : std::uint8_t { kCarried, kPlatform, kQueued, kOwn, kCharged, kUnknown };
inline constexpr int kCauses = 6;
[[nodiscard]] std::string_view name_of(Cause cause) noexcept;

struct BlameOptions {
  std::int64_t late_ns = 150000;  // a start later than this is a late start
};

struct JobBlame {
  bool late_start = false;
  bool missed = false;
  Cause late_cause = Cause::kUnknown;  // of the late start
  Cause miss_cause = Cause::kUnknown;  // of the miss
  Cause skip_cause = Cause::kUnknown;  // of the releases dropped before this job
  // The split, ns.
  std::int64_t carried = 0, platform = 0, queued = 0, own = 0, charged = 0, response = 0;
};

struct BlameCounts {
  std::array<std::uint64_t, kCauses> late{};    // late starts by cause
  std::array<std::uint64_t, kCauses> misses{};  // late or aborted jobs plus skipped releases
  std::uint64_t late_total = 0, miss_total = 0;
  std::uint64_t completed = 0, aborted = 0, skipped = 0;

  void add(const JobRecord& record, const JobBlame& blame) noexcept;
  void merge(const BlameCounts& other) noexcept;
};

struct TaskBlame : BlameCounts {
  std::vector<JobBlame> jobs;  // one per record
  std::uint64_t releases = 0;
};

// One core's sentinel samples: the spans in which the core was not to be had, [release, release +
// late), and the lateness at a release.
class CoreGaps {
 public:
  CoreGaps(std::span<const SentinelRecord> samples, int core);
  [[nodiscard]] std::int64_t overlap(std::int64_t from, std::int64_t to) const noexcept;
  [[nodiscard]] std::optional<std::int64_t> late_at(std::int64_t release_ns) const noexcept;

 private:
  struct Gap {
    std::int64_t from, to;
  };
  std::vector<SentinelRecord> samples_;  // by release
  std::vector<Gap> gaps_;                // disjoint, in order
};

// A task's jobs one after the other, in order of k. What is carried from one to the next is here,
// so that a run may be blamed piece by piece.
struct BlameWalk {
  std::int64_t previous_end = 0;
  Cause previous_cause = Cause::kUnknown;
  [[nodiscard]] JobBlame next(const JobRecord& record, const TaskLog& task, const CoreGaps& gaps,
                              const BlameOptions& options = {});
};

// `log.sentinels` may be empty (virtual clock): then nothing is blamed on the platform. The counts
// include task.past.
[[nodiscard]] TaskBlame blame(const RunLog& log, const TaskLog& task,
                              const BlameOptions& options = {});

// Start lateness minus the sentinel's at the same release, ns, for jobs with a sample and without a
// carried start; unsorted. Only of the records: task.past has its own histogram.
[[nodiscard]] std::vector<std::int64_t> late_minus_sentinel(const RunLog& log, const TaskLog& task);

}  // namespace rt
