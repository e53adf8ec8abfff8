// What a job knows about its own release.
#pragma once

#include <atomic>
#include <cstdint>

#include "rt/time.hpp"

namespace rt {

// Polled by long steps at least every 1 ms; set by the executor when the job has no time left.
class CancelToken {
 public:
  void request() noexcept { requested_.store(true, std::memory_order_relaxed); }
  void clear() noexcept { requested_.store(false, std::memory_order_relaxed); }
  [[nodiscard]] bool requested() const noexcept {
    return requested_.load(std::memory_order_relaxed);
  }

 private:
  std::atomic<bool> requested_{false};
};

struct Tick {
  std::uint64_t k = 0;           // release index: the instant is epoch + offset + rate.release(k)
  Time release{};                // the instant the job was due
  Time start{};                  // the instant its inputs were latched (first dispatch)
  Nanos period{0};               // nominal distance of releases
  std::uint32_t skipped = 0;     // releases dropped by the miss policy just before this one
  int level = 0;                 // variant in force; 0 is the full one
  const CancelToken* cancel = nullptr;  // never null in a job of a task with policy abort

  [[nodiscard]] bool cancelled() const noexcept { return cancel != nullptr && cancel->requested(); }
};

}  // namespace rt
