// One job, as the audit sees it. Fixed size, no padding that matters, travels by Ring.
#pragma once

#include <array>
#include <cstdint>

#include "rt/health.hpp"
#include "rt/memory/allocations.hpp"

namespace rt {

enum class Outcome : std::uint8_t { kCompleted = 0, kAborted = 1 };

struct JobRecord {
  static constexpr int kMaxInputs = 8;

  std::uint64_t k = 0;            // release index
  std::int64_t release_ns = 0;    // box clock
  std::int64_t start_ns = 0;      // first dispatch: inputs latched
  std::int64_t end_ns = 0;        // outputs committed (or aborted)
  std::int64_t deadline_ns = 0;   // absolute
  std::int64_t cpu_ns = 0;        // thread CPU of sense + step + act, twins taken out
  std::int64_t twin_cpu_ns = 0;   // thread CPU of simulated devices inside this job
  std::int64_t run_delay_ns = 0;  // runnable but not running, since the previous job's end
  std::uint64_t work = 0;         // deterministic work count of step()
  std::uint64_t output_hash = 0;  // of everything committed; 0 when hashing is off
  std::array<std::uint64_t, kMaxInputs> input_seq{};  // sequence number of every input used
  std::uint32_t skipped = 0;                          // releases dropped directly before this job
  std::uint32_t minor_faults = 0;
  std::uint32_t involuntary = 0;  // involuntary context switches since the previous job's end
  std::uint32_t voluntary = 0;  // voluntary ones: 1 is the sleep before the release, more is a wait
  std::uint16_t task = 0;       // row of the task table
  std::uint16_t fault = kNoFault;
  std::uint8_t core = 0;
  std::uint8_t level = 0;
  Outcome outcome = Outcome::kCompleted;
  Severity severity = Severity::kOk;
  std::uint8_t injected = 0;  // a fault plan touched this job
  std::uint16_t major_faults =
      0;  // pages that came from disk since the previous job's end; at most 65535
  std::int32_t allocations = kNotCounted;  // of step(), by its thread

  [[nodiscard]] bool missed() const noexcept {
    return outcome == Outcome::kAborted || end_ns > deadline_ns;
  }
  [[nodiscard]] std::int64_t lateness_ns() const noexcept { return start_ns - release_ns; }
};
static_assert(sizeof(JobRecord) <= 256, "records travel by Ring");

// Every release of a task that arrived before the end is one of these, or still open at the end.
struct TaskTotals {
  std::uint64_t completed = 0, late = 0, aborted = 0, skipped = 0;
  int level = 0;
  std::uint64_t lost = 0;  // of the skipped: arrived after the task's thread had ended
};

// The sentinel of a core: one wake-up at the same instant as a task's release.
struct SentinelRecord {
  std::int64_t release_ns = 0;  // box clock
  std::int64_t late_ns = 0;
  std::uint16_t core = 0;
};

}  // namespace rt
