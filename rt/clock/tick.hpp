// What a job knows about its own release.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>

#include "rt/clock/box_time.hpp"
#include "rt/time.hpp"

namespace rt {

// Polled by long steps at least every 1 ms. The virtual executor sets it when the job's cost does
// not fit before its deadline; the real one arms it with the deadline, so a poll costs one clock
// read.
class CancelToken {
 public:
  void request() noexcept { requested_.store(true, std::memory_order_relaxed); }
  void clear() noexcept {
    requested_.store(false, std::memory_order_relaxed);
    deadline_host_ns_ = std::numeric_limits<std::int64_t>::max();
  }
  // By the thread that polls, before the step.
  void arm(std::int64_t deadline_host_ns) noexcept { deadline_host_ns_ = deadline_host_ns; }
  [[nodiscard]] bool requested() const noexcept {
    return requested_.load(std::memory_order_relaxed) ||
           (deadline_host_ns_ != std::numeric_limits<std::int64_t>::max() &&
            monotonic_ns() > deadline_host_ns_);
  }

 private:
  std::atomic<bool> requested_{false};
  std::int64_t deadline_host_ns_ = std::numeric_limits<std::int64_t>::max();
};

struct Tick {
  std::uint64_t k = 0;        // release index: the instant is epoch + offset + rate.release(k)
  Time release{};             // the instant the job was due
  Time start{};               // the instant its inputs were latched (first dispatch)
  Nanos period{0};            // nominal distance of releases
  std::uint32_t skipped = 0;  // releases dropped by the miss policy just before this one
  int level = 0;              // variant in force; 0 is the full one
  const CancelToken* cancel = nullptr;  // never null in a job of a task with policy abort

  [[nodiscard]] bool cancelled() const noexcept { return cancel != nullptr && cancel->requested(); }
};

}  // namespace rt
