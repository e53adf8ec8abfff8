// Counts heap allocations of the calling thread. Libraries of a firm task may allocate; the audit
// counts them per job.
//
// Only a program with a malloc of its own counts (count_allocations.cpp in the product, the guard
// in the tests). In any other program, and under a sanitizer, which has its own malloc, the answer
// is kNotCounted.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>

namespace rt {

inline constexpr std::int32_t kNotCounted = -1;

namespace detail {
inline constinit thread_local std::uint64_t allocations = 0;
inline constinit std::atomic<bool> allocations_counted{false};
}  // namespace detail

// From a program's malloc, calloc, realloc and the aligned ones. Allocates nothing, calls nothing.
inline void note_allocation() noexcept { ++detail::allocations; }
// By that program, once, before its threads.
inline void allocations_are_counted() noexcept {
  detail::allocations_counted.store(true, std::memory_order_relaxed);
}

// Counts from its construction on, in its thread.
class AllocationCount {
 public:
  [[nodiscard]] std::int32_t value() const noexcept {
    if (!detail::allocations_counted.load(std::memory_order_relaxed)) return kNotCounted;
    constexpr std::uint64_t kMost = std::numeric_limits<std::int32_t>::max();
    return static_cast<std::int32_t>(std::min(detail::allocations - before_, kMost));
  }

 private:
  std::uint64_t before_ = detail::allocations;
};

}  // namespace rt
