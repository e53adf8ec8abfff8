// What a RealExecutor keeps of each task and each core; included by its bodies only.
#pragma once

#include "rt/sched/real_executor.hpp"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

#include "rt/fault/planned.hpp"
#include "rt/memory/prefault.hpp"
#include "rt/memory/section.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/policy.hpp"
#include "rt/sched/thread_probe.hpp"

namespace rt {

namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

constexpr int kHogPriority = 93;
constexpr int kTheftPriority = 98;
constexpr std::int64_t kSentinelLead = 20000;  // before the wake-up of a task that spins

[[maybe_unused]] void burn_cpu(Nanos length) noexcept {
  const std::int64_t until = thread_cpu_ns() + length.count();
  while (thread_cpu_ns() < until) {
  }
}

// The first job must not fault: touch the stack it will use.
[[maybe_unused, gnu::noinline]] void touch_stack() noexcept {
  volatile unsigned char stack[128 * 1024];
  for (std::size_t i = 0; i < sizeof stack; i += 512) stack[i] = 0;
}

// A page that the kernel took back: touching it faults inside the job.
[[maybe_unused]] void touch_released_page() noexcept {
  void* page = ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (page == MAP_FAILED) return;
  ::munlock(page, 4096);  // under mlockall the page is there at once and can not be given back
  ::madvise(page, 4096, MADV_DONTNEED);
  *static_cast<volatile char*>(page) = 1;
  ::munmap(page, 4096);
}

}  // namespace

template <class Faults>
struct RealExecutor<Faults>::Worker {
  PlacedTask task;
  LevelControl levels;
  MissBucket bucket;
  CancelToken cancel;
  SchedStat stat;
  ThreadCounters before;
  std::thread thread;
  Ring<JobRecord, 4096> records;
  // Heartbeat for the watchdog: start of the job in progress, 0 between jobs.
  std::atomic<std::int64_t> busy_since{0};
  bool forced = false;  // watchdog only
  // Host: the next hyperperiod boundary to look at; the last job, arrival to end.
  std::int64_t boundary = 0, pending_from = 0, pending_to = 0;
  // Set last by the task's thread when it ends before the run does: from then on the release to
  // lose next, its arrival, bucket, levels and totals are the watchdog's.
  std::atomic<bool> ended{false};
  std::uint64_t next_k = 0;
  Time next_arrival{};
  TaskTotals totals;
  WorkerPool* pool = nullptr;    // of a task with workers, and of these
  int place = -1;                // in the pool; a task: -1
  std::vector<Worker*> helpers;  // of a task; by place

  explicit Worker(const PlacedTask& t)
      : task(t), levels(t.level, t.lowest_level()), bucket(t.spec.consecutive_miss_limit) {}
  [[nodiscard]] bool degrades() const noexcept { return task.spec.policy == MissPolicy::kDegrade; }
  // Variants switch at the first boundary with no pending job. Those that passed since the last
  // job's arrival are looked at afterwards, with what was pending then.
  void pass_boundaries(std::int64_t host_ns, std::int64_t hyperperiod_ns) noexcept {
    for (; degrades() && boundary <= host_ns; boundary += hyperperiod_ns) {
      levels.at_boundary(pending_from < boundary && boundary < pending_to);
    }
  }
};

template <class Faults>
struct RealExecutor<Faults>::Sentinel {
  int cpu = 0;
  std::vector<TaskSpec> specs;  // of the tasks on this core
  std::thread thread;
  Ring<SentinelRecord, 8192> records;
};

}  // namespace rt
