// Ring: a queue of events between exactly one producer thread and one consumer thread.
//
//   Full means the newest is dropped and counted; nobody waits, retries or allocates.
//   A type with a member `bool gap` gets it set on the first element that goes in after a drop, so
//   that a reader of events (a mark's begin and end) knows that something is missing before it.
//
// Wait-free on both sides. Element i of all time lives in slot i mod N; the counters run freely
// over 64 bits and wrap without a special case. A slot carries its own sequence word beside the
// element: the consumer looks at the slot it wants and nowhere else, so one line brings flag and
// data together (a shared tail would be a second line, and the one both sides fight for). The
// producer keeps a private copy of the consumer's counter and looks at the shared one only when the
// copy says full. The four words of the two sides lie on four separate 128-byte places (the
// adjacent-line prefetcher fetches pairs). What the slots cost and gain is measured by `teletact
// bench rings`.
//
// The storage is inside the object and written once by the constructor, so the first lap meets no
// page fault. A Ring is large: make it at set-up, not on a stack.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <type_traits>

namespace rt {

inline constexpr std::size_t kLinePair = 128;  // bytes that may travel together between cores

// What the protocol is made of. Tests replace single parts to show that each one is needed.
struct RingProtocol {
  template <class U>
  using Atomic = std::atomic<U>;
  static constexpr std::memory_order kPublish = std::memory_order_release;
  static constexpr std::memory_order kObserve = std::memory_order_acquire;
};

template <class T, std::size_t N, class Protocol = RingProtocol>
class Ring {
  static_assert(std::is_copy_assignable_v<T>);
  // Fixed-size Eigen vectors have a copy constructor of their own; what is trivially destructible
  // owns nothing, so copying it neither allocates nor throws.
  static_assert(std::is_trivially_copyable_v<T> ||
                    (std::is_trivially_destructible_v<T> && std::is_default_constructible_v<T>),
                "a record owns nothing");
  static_assert(sizeof(T) <= 256, "larger values travel by Latest, which does not copy");
  static_assert(N >= 2 && (N & (N - 1)) == 0, "the capacity is a power of two");

 public:
  using value_type = T;

  Ring() noexcept : Ring(0) {}
  // Starts both counters at `first`; for tests of the wrap at 2^64.
  explicit Ring(std::uint64_t first) noexcept
      : tail_{first}, head_copy_{first}, last_full_{first}, head_{first}, last_empty_{first} {
    for (std::uint64_t i = first; i != first + N; ++i) {
      Slot& slot = slot_of(i);
      slot.seq.store(i + 1 - N, std::memory_order_relaxed);  // as if taken one lap ago
      std::memset(slot.bytes, 0, sizeof slot.bytes);
      if constexpr (!std::is_trivially_copyable_v<T>) ::new (static_cast<void*>(slot.bytes)) T();
    }
  }
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  // Producer. False: full, `value` was dropped and counted.
  bool try_push(const T& value) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_copy_ >= N) [[unlikely]] {
      head_copy_ = head_.load(Protocol::kObserve);
      if (tail - head_copy_ >= N) {
        dropped_.store(dropped_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
        gap_pending_ = true;
        give_way(tail, last_full_);
        return false;
      }
    }
    fetch_ahead(tail);
    Slot& slot = slot_of(tail);
    slot.value() = value;
    if constexpr (requires(T & t) { t.gap = true; }) {
      if (gap_pending_) [[unlikely]] {
        slot.value().gap = true;
        gap_pending_ = false;
      }
    }
    tail_.store(tail + 1, std::memory_order_relaxed);
    slot.seq.store(tail + 1, Protocol::kPublish);
    return true;
  }

  // Consumer. False: empty, `out` untouched.
  bool try_pop(T& out) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    Slot& slot = slot_of(head);
    if (slot.seq.load(Protocol::kObserve) != head + 1) {
      met_empty_ = true;
      give_way(head, last_empty_);
      return false;
    }
    if (met_empty_) note_backlog(head);
    out = slot.value();
    head_.store(head + 1, Protocol::kPublish);
    return true;
  }

  // Consumer. Takes up to `max` elements in order, frees them in one step; returns how many.
  std::size_t pop_n(T* out, std::size_t max) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    std::size_t n = 0;
    for (; n < max && n < N; ++n) {
      Slot& slot = slot_of(head + n);
      if (slot.seq.load(Protocol::kObserve) != head + n + 1) break;
      if (n == 0) note_backlog(head);
      out[n] = slot.value();
    }
    if (n > 0) {
      head_.store(head + n, Protocol::kPublish);
    } else if (max > 0) {
      give_way(head, last_empty_);
    }
    return n;
  }

  // Any thread; exact only while both sides rest.
  [[nodiscard]] std::size_t size() const noexcept {
    const std::uint64_t head = head_.load(std::memory_order_acquire);
    const std::uint64_t tail = tail_.load(std::memory_order_acquire);
    return std::min(static_cast<std::size_t>(tail - head), N);
  }
  [[nodiscard]] bool empty() const noexcept { return size() == 0; }
  [[nodiscard]] static constexpr std::size_t capacity() noexcept { return N; }

  // Any thread: elements accepted and elements taken, since both counters were 0.
  [[nodiscard]] std::uint64_t pushed() const noexcept {
    return tail_.load(std::memory_order_acquire);
  }
  [[nodiscard]] std::uint64_t taken() const noexcept {
    return head_.load(std::memory_order_acquire);
  }
  // Any thread: elements refused since construction.
  [[nodiscard]] std::uint64_t dropped() const noexcept {
    return dropped_.load(std::memory_order_relaxed);
  }
  // Any thread: the largest backlog that the consumer met when it looked, or is there now. Exact
  // for a consumer that drains at each visit, a lower bound otherwise; N after a drop.
  [[nodiscard]] std::size_t high_water() const noexcept {
    if (dropped() > 0) return N;
    return std::max(static_cast<std::size_t>(high_water_.load(std::memory_order_relaxed)), size());
  }

 private:
  struct Slot {
    typename Protocol::template Atomic<std::uint64_t> seq{0};  // i + 1 once element i is in
    alignas(T) std::byte bytes[sizeof(T)];
    // Plain assignment, not memcpy: gcc's ThreadSanitizer does not see a memcpy expanded inline.
    T& value() noexcept { return *std::launder(reinterpret_cast<T*>(bytes)); }
  };
  [[nodiscard]] Slot& slot_of(std::uint64_t i) noexcept {
    return slots_[static_cast<std::size_t>(i & (N - 1))];
  }

  // A look that was refused costs a moment, for a caller that retries at once would only take the
  // line away from the side that is about to change it. A few nanoseconds as a rule (the fences
  // keep the processor from queueing up looks that are out of date on arrival); about 0.2 us once
  // after a stream of elements, so that the other side gets ahead and both then run undisturbed.
  // Measured: round trip 119 -> 91 to 113 ns, 8-byte elements
  // 290 -> 1000 million a second on near cores.
  static constexpr std::uint64_t kStream = 64;
  static void give_way(std::uint64_t now, std::uint64_t& last_refused) noexcept {
    const bool streaming = now - last_refused >= kStream;
    last_refused = now;
#if defined(__x86_64__)
    if (streaming) {
      for (int i = 0; i < 8; ++i) __builtin_ia32_pause();
    } else {
      for (int i = 0; i < 4; ++i) __builtin_ia32_lfence();
    }
#elif defined(__aarch64__)
    for (int i = streaming ? 8 : 1; i > 0; --i) asm volatile("isb" : : : "memory");
#else
    (void)streaming;
#endif
  }

  // The line the producer will write a little later, if it is free already: the consumer has it
  // now.
  static constexpr std::size_t kAhead = (1024 + sizeof(Slot) - 1) / sizeof(Slot);  // 16 lines
  void fetch_ahead(std::uint64_t tail) noexcept {
#if defined(__x86_64__)
    if constexpr (N > 2 * kAhead) {
      if (tail - head_copy_ < N - kAhead) {
        const std::byte* line = reinterpret_cast<const std::byte*>(&slot_of(tail + kAhead));
        for (std::size_t b = 0; b < sizeof(Slot); b += 64) {
          asm volatile("prefetchw %0" : : "m"(line[b]));  // does nothing on processors without it
        }
      }
    }
#else
    (void)tail;
#endif
  }

  // Was the backlog ever this high? One look at the slot that would say so.
  void note_backlog(std::uint64_t head) noexcept {
    met_empty_ = false;
    const std::uint64_t high = high_water_.load(std::memory_order_relaxed);
    if (slot_of(head + high).seq.load(Protocol::kObserve) != head + high + 1) return;
    high_water_.store(tail_.load(std::memory_order_relaxed) - head, std::memory_order_relaxed);
  }

  alignas(kLinePair) std::atomic<std::uint64_t> tail_;  // producer; others only to count
  alignas(kLinePair) std::uint64_t head_copy_;          // producer only, with what it rarely writes
  std::uint64_t last_full_;
  bool gap_pending_ = false;
  std::atomic<std::uint64_t> dropped_{0};
  // Written by the consumer, read by the producer when its copy says full.
  alignas(kLinePair) typename Protocol::template Atomic<std::uint64_t> head_;
  alignas(kLinePair) std::uint64_t last_empty_;  // consumer only
  bool met_empty_ = true;
  std::atomic<std::uint64_t> high_water_{0};
  alignas(kLinePair) Slot slots_[N];
};

}  // namespace rt
