// The fork-join pool: the caller wakes the workers, does its own parts, and waits for theirs. All
// waiting is in the kernel (futex), without spinning. The threads belong to the executor (serve()),
// which places and ranks them as admission decided.
//
//   fork   body, context, parts are written; pending = workers that have a part; then each one's
//          `call` is raised (release) and woken
//   work   a worker sees its call raised (acquire), does its parts, notes its CPU, lowers pending
//          (release); the last one wakes the caller
//   join   the caller sleeps until pending is 0 (acquire): all results and notes are then its own
//
// No allocation, lock or exception anywhere. A fork costs the caller one system call per worker
// and, if the caller is done first, one to sleep.
#pragma once

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <climits>
#include <cstdint>
#include <memory>

#include "rt/clock/box_time.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/memory/section.hpp"
#include "rt/sched/fork_join.hpp"
#include "rt/time.hpp"

namespace rt {

struct WorkerPoolProtocol {
  template <class U>
  using Atomic = std::atomic<U>;
};

template <class Protocol = WorkerPoolProtocol>
class BasicWorkerPool final : public ForkJoin {
 public:
  // What one worker did since begin_job(); host clock. No forks: all 0.
  struct Share {
    std::int64_t fork_ns = 0;          // when it was first called
    std::int64_t start_ns = 0;         // when it first began
    std::int64_t end_ns = 0;           // when it last ended
    std::int64_t cpu_ns = 0;           // thread CPU, waking up included
    std::int64_t longest_wait_ns = 0;  // from a call to its beginning
    std::uint64_t parts = 0;
  };

  BasicWorkerPool(NonRealtime&, int workers)
      : workers_(static_cast<std::size_t>(std::max(0, workers))),
        worker_(std::make_unique<Worker[]>(workers_)) {}

  [[nodiscard]] int width() const noexcept override { return 1 + static_cast<int>(workers_); }
  [[nodiscard]] std::int64_t beyond_ns() const noexcept override { return beyond_ns_; }
  [[nodiscard]] std::uint64_t forks() const noexcept { return forks_; }
  // Fills beyond_ns(), for two clock readings a fork.
  void profile(bool on) noexcept { profiling_ = on; }

  // By the caller, between forks.
  void begin_job() noexcept {
    for (std::size_t w = 0; w < workers_; ++w) worker_[w].share = Share{};
  }
  [[nodiscard]] const Share& share(int worker) const noexcept {
    return worker_[static_cast<std::size_t>(worker)].share;
  }

  // The life of worker `worker` (0 ..), on a thread of its own, until stop().
  void serve(int worker) noexcept {
    Worker& me = worker_[static_cast<std::size_t>(worker)];
    std::int64_t cpu_before = thread_cpu_ns();
    for (std::uint32_t seen = 0;;) {
      std::uint32_t call = me.call.load(std::memory_order_acquire);
      while (call == seen) {
        futex_wait(me.call, seen);
        call = me.call.load(std::memory_order_acquire);
      }
      seen = call;
      if (stop_.load(std::memory_order_acquire)) return;
      const std::int64_t begin = monotonic_ns();
      {
        const Section section;
        for (int p = worker + 1; p < parts_; p += width()) {
          body_(context_, p);
          ++me.share.parts;
        }
      }
      if (me.share.start_ns == 0) {
        me.share.fork_ns = forked_ns_;
        me.share.start_ns = begin;
      }
      me.share.longest_wait_ns = std::max(me.share.longest_wait_ns, begin - forked_ns_);
      me.share.end_ns = monotonic_ns();
      const std::int64_t cpu = thread_cpu_ns();
      me.fork_cpu_ns = cpu - cpu_before;
      me.share.cpu_ns += cpu - cpu_before;
      cpu_before = cpu;
      if (pending_.fetch_sub(1, std::memory_order_acq_rel) == 1) futex_wake(pending_);
    }
  }
  // While no thread is in serve().
  void restart() noexcept {
    stop_.store(false, std::memory_order_release);
    for (std::size_t w = 0; w < workers_; ++w) worker_[w].call.store(0, std::memory_order_release);
  }
  // From any thread but in no fork: serve() returns on all of them.
  void stop() noexcept {
    stop_.store(true, std::memory_order_release);
    for (std::size_t w = 0; w < workers_; ++w) raise(worker_[w]);
  }

 protected:
  void run(int parts, Body body, const void* context) noexcept override {
    const int called = std::min(width(), parts) - 1;
    if (called < 1) {
      for (int p = 0; p < parts; ++p) body(context, p);
      return;
    }
    body_ = body;
    context_ = context;
    parts_ = parts;
    forked_ns_ = monotonic_ns();
    ++forks_;
    pending_.store(static_cast<std::uint32_t>(called), std::memory_order_release);
    for (int w = 0; w < called; ++w) raise(worker_[static_cast<std::size_t>(w)]);
    const std::int64_t cpu0 = profiling_ ? thread_cpu_ns() : 0;
    for (int p = 0; p < parts; p += width()) body(context, p);
    const std::int64_t own = profiling_ ? thread_cpu_ns() - cpu0 : 0;
    for (;;) {
      const std::uint32_t left = pending_.load(std::memory_order_acquire);
      if (left == 0) break;
      futex_wait(pending_, left);
    }
    if (!profiling_) return;
    std::int64_t longest = own;
    for (int w = 0; w < called; ++w)
      longest = std::max(longest, worker_[static_cast<std::size_t>(w)].fork_cpu_ns);
    beyond_ns_ += longest - own;
  }

 private:
  using Word = typename Protocol::template Atomic<std::uint32_t>;
  struct alignas(128) Worker {
    Word call{0};
    Share share;  // the worker's between a call and its end, else the caller's
    std::int64_t fork_cpu_ns = 0;
  };

  // Returns when the word may have changed.
  static void futex_wait(Word& word, std::uint32_t seen) noexcept {
    ::syscall(SYS_futex, &word, FUTEX_WAIT_PRIVATE, seen, nullptr, nullptr, 0);
  }
  static void futex_wake(Word& word) noexcept {
    ::syscall(SYS_futex, &word, FUTEX_WAKE_PRIVATE, INT_MAX, nullptr, nullptr, 0);
  }
  static void raise(Worker& w) noexcept {
    w.call.fetch_add(1, std::memory_order_release);
    futex_wake(w.call);
  }
  static_assert(sizeof(Word) == 4, "a futex is a word of 32 bits");

  std::size_t workers_;
  std::unique_ptr<Worker[]> worker_;
  // Of the fork in progress: written by the caller before the calls.
  Body body_ = nullptr;
  const void* context_ = nullptr;
  int parts_ = 0;
  std::int64_t forked_ns_ = 0;
  std::atomic<bool> stop_{false};
  bool profiling_ = false;
  std::int64_t beyond_ns_ = 0;
  std::uint64_t forks_ = 0;
  alignas(128) Word pending_{0};
};

using WorkerPool = BasicWorkerPool<>;

// The same parts, all done by the caller in the order 0, 1, ...: for the virtual clock. With
// `measure` it keeps the cost of each worker's parts, so that calibration can separate fusion's own
// CPU from its workers'.
class InlineForkJoin final : public ForkJoin {
 public:
  InlineForkJoin(int workers, bool measure)
      : workers_(workers),
        measure_(measure),
        cpu_(std::make_unique<std::int64_t[]>(static_cast<std::size_t>(std::max(1, workers)))) {}
  [[nodiscard]] int width() const noexcept override { return 1 + workers_; }
  void begin_job() noexcept {
    std::fill_n(cpu_.get(), static_cast<std::size_t>(workers_), 0);
    shares_ns_ = 0;
    forks_ = 0;
  }
  // Since begin_job().
  [[nodiscard]] int forks() const noexcept { return forks_; }
  // Thread CPU of the parts of worker `worker` (0 ..) since begin_job().
  [[nodiscard]] std::int64_t cpu_ns(int worker) const noexcept {
    return cpu_[static_cast<std::size_t>(worker)];
  }
  // Sum over the forks since begin_job() of the largest share that a worker had: a worker's budget.
  [[nodiscard]] std::int64_t largest_shares_ns() const noexcept { return shares_ns_; }

 protected:
  void run(int parts, Body body, const void* context) noexcept override {
    forks_ += std::min(width(), parts) > 1 ? 1 : 0;
    if (!measure_) {
      for (int p = 0; p < parts; ++p) body(context, p);
      return;
    }
    for (int p = 0; p < parts; p += width()) body(context, p);
    std::int64_t largest = 0;
    for (int w = 0; w < std::min(workers_, parts - 1); ++w) {
      const std::int64_t before = thread_cpu_ns();
      for (int p = w + 1; p < parts; p += width()) body(context, p);
      const std::int64_t share = thread_cpu_ns() - before;
      cpu_[static_cast<std::size_t>(w)] += share;
      largest = std::max(largest, share);
    }
    shares_ns_ += largest;
  }

 private:
  int workers_;
  bool measure_;
  std::unique_ptr<std::int64_t[]> cpu_;
  std::int64_t shares_ns_ = 0;
  int forks_ = 0;
};

}  // namespace rt
