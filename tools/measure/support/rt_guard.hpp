// The guard: counts allocations, locks, waits and throws that happen while the calling thread is
// inside an rt::Section. Linked into test programs as strong malloc, free, pthread_mutex_lock,
// __cxa_throw, ... symbols over glibc's and libstdc++'s; absent under sanitizers, which bring their
// own. The functions below work either way: without the guard linked() is false, counts() zero.
//
//   rt_guard::reset();
//   { rt::Section s; task.step(...); }
//   if (rt_guard::linked()) EXPECT_EQ(rt_guard::counts().total(), 0u);
//
// Counters are of the process; the section is of the thread.
#pragma once

#include <cstdint>

namespace rt_guard {

struct Counts {
  std::uint64_t allocations =
      0;                     // malloc, calloc, realloc, aligned_alloc, posix_memalign, operator new
  std::uint64_t frees = 0;   // free of a non-null pointer, operator delete
  std::uint64_t locks = 0;   // pthread_mutex_lock and timed forms, rwlock, spin lock
  std::uint64_t waits = 0;   // pthread_cond_wait and timed forms
  std::uint64_t throws = 0;  // __cxa_throw, __cxa_rethrow
  [[nodiscard]] std::uint64_t total() const { return allocations + frees + locks + waits + throws; }
};

}  // namespace rt_guard

extern "C" {
[[gnu::weak]] void teletact_rt_guard_counts(rt_guard::Counts* out) noexcept;
[[gnu::weak]] void teletact_rt_guard_reset() noexcept;
[[gnu::weak]] void teletact_rt_guard_abort(bool on) noexcept;
}

namespace rt_guard {

[[nodiscard]] inline bool linked() noexcept { return teletact_rt_guard_counts != nullptr; }
[[nodiscard]] inline Counts counts() noexcept {
  Counts c;
  if (linked()) teletact_rt_guard_counts(&c);
  return c;
}
inline void reset() noexcept {
  if (linked()) teletact_rt_guard_reset();
}
// Debugging aid: abort() at the first offence, so that the stack shows who did it. The environment
// variable TELETACT_RT_GUARD=abort does the same.
inline void abort_on_offence(bool on) noexcept {
  if (linked()) teletact_rt_guard_abort(on);
}

}  // namespace rt_guard
