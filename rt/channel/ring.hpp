// Ring: a queue of events between exactly one producer thread and one consumer thread.
//
//   Full means the newest is dropped and counted; nobody waits, retries or allocates.
//   A type with a member `bool gap` gets it set on the first element that goes in after a drop, so
//   that a reader of events (a mark's begin and end) knows that something is missing before it.
//
// Wait-free on both sides. The two counters run freely over 64 bits (element i lives in slot
// i mod N) and wrap without a special case. Each side keeps a private copy of the other side's
// counter and looks at the shared one only when its copy says full or empty; the four words lie on
// four separate 128-byte places (two lines: the adjacent-line prefetcher fetches pairs), so a
// private copy never sits on a line that the other side polls.
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
      : tail_{first}, head_copy_{first}, head_{first}, tail_copy_{first} {
    std::memset(storage_, 0, sizeof storage_);
    if constexpr (!std::is_trivially_copyable_v<T>) {
      for (std::uint64_t i = 0; i < N; ++i) ::new (static_cast<void*>(place(i))) T();
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
        return false;
      }
    }
    copy_in(tail, value);
    if constexpr (requires(T & t) { t.gap = true; }) {
      if (gap_pending_) [[unlikely]] {
        T marked = value;
        marked.gap = true;
        copy_in(tail, marked);
        gap_pending_ = false;
      }
    }
    tail_.store(tail + 1, Protocol::kPublish);
    return true;
  }

  // Consumer. False: empty, `out` untouched.
  bool try_pop(T& out) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_copy_) {
      refresh(head);
      if (head == tail_copy_) return false;
    }
    copy_out(head, out);
    head_.store(head + 1, Protocol::kPublish);
    return true;
  }

  // Consumer. Takes up to `max` elements in order, frees them in one step; returns how many.
  std::size_t pop_n(T* out, std::size_t max) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (tail_copy_ - head < max) refresh(head);
    const std::size_t n = std::min(max, static_cast<std::size_t>(tail_copy_ - head));
    for (std::size_t i = 0; i < n; ++i) copy_out(head + i, out[i]);
    if (n > 0) head_.store(head + n, Protocol::kPublish);
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
  void refresh(std::uint64_t head) noexcept {
    tail_copy_ = tail_.load(Protocol::kObserve);
    const std::uint64_t backlog = tail_copy_ - head;
    if (backlog > high_water_.load(std::memory_order_relaxed)) {
      high_water_.store(backlog, std::memory_order_relaxed);
    }
  }
  // Plain assignment, not memcpy: gcc's ThreadSanitizer does not see a memcpy that it expands
  // inline.
  void copy_in(std::uint64_t i, const T& value) noexcept {
    *std::launder(reinterpret_cast<T*>(place(i))) = value;
  }
  void copy_out(std::uint64_t i, T& out) noexcept {
    out = *std::launder(reinterpret_cast<const T*>(place(i)));
  }
  [[nodiscard]] std::byte* place(std::uint64_t i) noexcept {
    return storage_ + static_cast<std::size_t>(i & (N - 1)) * sizeof(T);
  }

  alignas(kLinePair)
      typename Protocol::template Atomic<std::uint64_t> tail_;  // written by the producer, polled
                                                                // by the consumer
  alignas(kLinePair) std::uint64_t head_copy_;  // producer only, with what it rarely writes
  bool gap_pending_ = false;
  std::atomic<std::uint64_t> dropped_{0};
  alignas(kLinePair)
      typename Protocol::template Atomic<std::uint64_t> head_;  // written by the consumer, polled
                                                                // by the producer
  alignas(kLinePair) std::uint64_t tail_copy_;                  // consumer only
  std::atomic<std::uint64_t> high_water_{0};
  alignas(kLinePair) std::byte storage_[N * sizeof(T)];
};

}  // namespace rt
