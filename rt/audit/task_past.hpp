// What is kept of a task's jobs once their records are gone: exact counts, histograms of times
// (rt/audit/histogram.hpp: a quantile at most 1/64 above the true one), and the records of events.
//
//   exact        jobs, outcomes, misses and late starts with their causes, least and largest times,
//                frames seen, allocations below 128
//   event        a record that missed, followed skipped releases, ran over its level's budget, or
//                changed level, fault or severity. The first kMaxEvents of them are kept whole, the
//                rest counted.
//   merge        of two neighbours in time, the earlier first: as if folded in one go, except that
//                only the first kMaxEvents of both together are kept
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "rt/audit/blame.hpp"
#include "rt/audit/histogram.hpp"

namespace rt {

struct LevelPast {
  std::uint64_t jobs = 0, charged = 0;
  Histogram cpu;  // of those that the machine charged nothing
};

struct TaskPast {
  static constexpr std::size_t kMaxEvents = 512;
  static constexpr std::size_t kMaxLevels = 8;

  std::uint64_t jobs = 0;
  std::int64_t first_release_ns = 0, last_release_ns = 0;  // box clock
  std::uint64_t first_k = 0, last_k = 0;
  std::int64_t last_end_ns = 0;
  Cause last_cause = Cause::kUnknown;
  bool begun = false;  // there was a job, here or before
  std::uint8_t last_level = 0;
  std::uint16_t last_fault = kNoFault;
  Severity last_severity = Severity::kOk;
  BlameCounts counts;
  Histogram lateness, response, cpu;  // ns; response: end - release
  SignedHistogram slack;              // deadline - end
  SignedHistogram late_minus_sentinel;
  std::vector<LevelPast> levels;  // by level
  Histogram allocations;          // of counted jobs; a number, not a time
  // By the sequence number of the job's first input: values that the task saw, and the newest.
  std::uint64_t inputs_seen = 0, newest_input = 0;
  std::vector<JobRecord> events;
  std::uint64_t events_left_out = 0;

  // In order of k. `late_at`: the sentinel's lateness at this release, if it has a sample.
  void add(const JobRecord& record, const TaskLog& task, const JobBlame& blame,
           std::int64_t previous_end_ns, const CoreGaps& gaps);
  void merge(const TaskPast& later);
  // An empty one for the jobs that follow: it knows what came before them, so that a change between
  // the two is seen and no value is counted twice.
  [[nodiscard]] TaskPast following() const;
};

// Adds `jobs`, in order of k, to `past`; `walk` carries over from the jobs before them.
void fold_jobs(TaskPast& past, BlameWalk& walk, const TaskLog& task,
               std::span<const JobRecord> jobs, const CoreGaps& gaps);

}  // namespace rt
