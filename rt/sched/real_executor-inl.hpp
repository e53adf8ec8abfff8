// The bodies of RealExecutor, for real_executor.cpp and real_executor_planned.cpp: an instance each, so that
// the plain one is the same code whether or not planned ones are built.
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
  // Set last by the task's thread when it ends before the run does: from then on the release to lose
  // next, its arrival, bucket, levels and totals are the watchdog's.
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
  // Variants switch at the first boundary with no pending job. Those that passed since the last job's
  // arrival are looked at afterwards, with what was pending then.
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

template <class Faults>
RealExecutor<Faults>::RealExecutor(NonRealtime& nrt, const std::vector<PlacedTask>& tasks,
                                   const Faults& faults, JobSink jobs, SentinelSink sentinels,
                                   RealOptions options)
    : options_(options),
      faults_(faults),
      job_sink_(std::move(jobs)),
      sentinel_sink_(std::move(sentinels)) {
  for (const auto& t : tasks) {
    workers_.push_back(std::make_unique<Worker>(t));
    auto same_cpu = [&](const auto& s) { return s->cpu == t.core; };
    if (options_.sentinel && std::none_of(sentinels_.begin(), sentinels_.end(), same_cpu)) {
      sentinels_.push_back(std::make_unique<Sentinel>());
      sentinels_.back()->cpu = t.core;
    }
    for (auto& s : sentinels_) {
      if (s->cpu == t.core) s->specs.push_back(t.spec);
    }
  }
  make_pools(nrt);
  if (options_.lock_memory) {
    const std::string what = prepare_process_memory(nrt, 16U << 20U, 256U << 10U);
    if (!what.empty()) missing_.push_back(what);
  }
  if (options_.hold_dma_latency) {
    // Held open for the life of the executor: the kernel then avoids deep idle states.
    dma_fd_ = ::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    const std::int32_t zero = 0;
    if (dma_fd_ < 0 || ::write(dma_fd_, &zero, sizeof zero) != sizeof zero) {
      missing_.push_back(std::string("/dev/cpu_dma_latency: ") + std::strerror(errno));
    }
  }
}

template <class Faults>
RealExecutor<Faults>::~RealExecutor() {
  if (dma_fd_ >= 0) ::close(dma_fd_);
}

template <class Faults>
Time RealExecutor<Faults>::release_box(const TaskSpec& spec, std::uint64_t k) const noexcept {
  const auto& clock = plan_.clock[static_cast<std::size_t>(spec.box)];
  return clock.from_host(plan_.epoch_host_ns) + spec.offset + spec.rate.release(k);
}

// ---- pool workers

template <class Faults>
void RealExecutor<Faults>::make_pools(NonRealtime& nrt) {
  for (auto& w : workers_) {
    for (auto& h : workers_) {
      if (!h->task.spec.is_worker() || h->task.spec.parent != w->task.spec.name ||
          h->task.spec.box != w->task.spec.box)
        continue;
      h->place = static_cast<int>(w->helpers.size());
      w->helpers.push_back(h.get());
    }
    if (w->helpers.empty()) continue;
    pools_.push_back(std::make_unique<WorkerPool>(nrt, static_cast<int>(w->helpers.size())));
    w->pool = pools_.back().get();
    for (Worker* h : w->helpers) h->pool = w->pool;
    w->task.body->use(*w->pool);
  }
}

template <class Faults>
void RealExecutor<Faults>::start_workers() {
  for (auto& pool : pools_) pool->restart();
  for (auto& w : workers_) {
    if (w->place < 0) continue;
    launch(w->thread, w->task.core, w->task.priority, w->task.spec.name, [p = w.get()] {
      prctl(PR_SET_TIMERSLACK, 1UL);
      touch_stack();
      p->pool->serve(p->place);
    });
  }
}

// The tasks have ended: nobody forks any more.
template <class Faults>
void RealExecutor<Faults>::stop_workers() {
  for (auto& pool : pools_) pool->stop();
  for (auto& w : workers_) {
    if (w->place >= 0) w->thread.join();
  }
  for (auto& w : workers_) {
    for (Worker* h : w->helpers) {
      h->totals.skipped = w->totals.skipped;
      h->totals.lost = w->totals.lost;
      h->totals.level = w->totals.level;
    }
  }
}

// By the parent's thread: what each worker did in this job.
template <class Faults>
void RealExecutor<Faults>::record_shares(Worker& w, const JobRecord& job) {
  const auto& clock = plan_.clock[static_cast<std::size_t>(w.task.spec.box)];
  for (Worker* h : w.helpers) {
    const WorkerPool::Share& share = w.pool->share(h->place);
    JobRecord r = job;
    r.task = h->task.id;
    r.core = static_cast<std::uint8_t>(h->task.core);
    r.cpu_ns = share.cpu_ns;
    r.work = share.parts;
    r.twin_cpu_ns = r.run_delay_ns = 0;
    r.output_hash = 0;
    r.input_seq = {};
    r.minor_faults = r.involuntary = r.voluntary = 0;
    r.major_faults = 0;
    r.severity = Severity::kOk;
    r.fault = kNoFault;
    r.injected = 0;
    if (share.parts > 0) {
      r.release_ns = ns_of(clock.from_host(share.fork_ns));
      r.start_ns = ns_of(clock.from_host(share.start_ns));
      r.end_ns = ns_of(clock.from_host(share.end_ns));
    } else {  // a job without an image forks nothing
      r.release_ns = r.end_ns = r.start_ns;
    }
    (r.outcome == Outcome::kAborted ? h->totals.aborted : h->totals.completed) += 1;
    if (r.outcome == Outcome::kCompleted && r.missed()) ++h->totals.late;
    h->records.try_push(r);
  }
}

// With the delay that a fault plan adds.
template <class Faults>
Time RealExecutor<Faults>::raw_arrival(const PlacedTask& task, std::uint64_t k) const noexcept {
  Time t = release_box(task.spec, k);
  if constexpr (Faults::kEnabled) t += faults_.job(task.id, k).late;
  return t;
}

// False when a stop was requested meanwhile.
template <class Faults>
bool RealExecutor<Faults>::sleep_until(std::int64_t host_ns) const noexcept {
  timespec ts{};
  ts.tv_sec = host_ns / 1000000000;
  ts.tv_nsec = host_ns % 1000000000;
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &ts, nullptr) == EINTR) {
  }
  return !stop_.load(std::memory_order_relaxed);
}

template <class Faults>
void RealExecutor<Faults>::launch(std::thread& thread, int cpu, int priority,
                                  const std::string& name, std::function<void()> body) {
  thread = std::thread([this, body = std::move(body)] {
    body();
    alive_.fetch_sub(1);
  });
  alive_.fetch_add(1);
  const auto handle = thread.native_handle();
  pthread_setname_np(handle, name.substr(0, 15).c_str());
  if (cpu >= 0) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    if (const int e = pthread_setaffinity_np(handle, sizeof set, &set); e != 0) {
      missing_.push_back(name + ": core " + std::to_string(cpu) + ": " + std::strerror(e));
    }
  }
  if (!options_.fifo) return;
  sched_param param{};
  param.sched_priority = priority;
  // Reset-on-fork: a thread that a library starts from here must not inherit the priority.
  if (const int e = pthread_setschedparam(handle, SCHED_FIFO | SCHED_RESET_ON_FORK, &param);
      e != 0) {
    missing_.push_back(name + ": SCHED_FIFO " + std::to_string(priority) + ": " + std::strerror(e));
  }
}

template <class Faults>
void RealExecutor<Faults>::run(const RunPlan& plan) {
  plan_ = plan;
  stop_.store(false);
  stopped_at_.store(kNever);
  drain_done_.store(false);
  start_workers();
  for (auto& w : workers_) {
    if (w->place >= 0) continue;
    launch(w->thread, w->task.core, w->task.priority, w->task.spec.name,
           [this, p = w.get()] { task_loop(*p); });
  }
  for (auto& s : sentinels_) {
    launch(s->thread, s->cpu, kSentinelPriority, "sentinel",
           [this, p = s.get()] { sentinel_loop(*p); });
  }
  std::vector<std::thread> injectors;
  if (faults_.has_spans()) {
    for (const auto& sentinel : sentinels_) {
      for (const bool theft : {true, false}) {
        launch(injectors.emplace_back(), sentinel->cpu, theft ? kTheftPriority : kHogPriority,
               "injector", [this, cpu = sentinel->cpu, theft] { injector_loop(cpu, theft); });
      }
    }
  }
  std::thread watchdog;
  launch(watchdog, watchdog_cpu(), kWatchdogPriority, "watchdog", [this] { watchdog_loop(); });
  std::thread drain([this] { drain_loop(); });
  for (auto& w : workers_) {
    if (w->place < 0) w->thread.join();
  }
  stop_.store(true);
  for (auto& s : sentinels_) s->thread.join();
  for (auto& t : injectors) t.join();
  watchdog.join();
  for (auto& w : workers_) {
    if (w->ended.load(std::memory_order_acquire)) lose_until(*w, kNever);
  }
  stop_workers();
  drain_done_.store(true);
  drain.join();
}

template <class Faults>
void RealExecutor<Faults>::request_stop() noexcept {
  std::int64_t never = kNever;
  stopped_at_.compare_exchange_strong(never, monotonic_ns(), std::memory_order_relaxed);
  stop_.store(true, std::memory_order_relaxed);
}

// The rule that admission charges it by (PlatformWakes::kOnceABox).
template <class Faults>
int RealExecutor<Faults>::watchdog_cpu() const noexcept {
  int cpu = -1;
  for (const auto& w : workers_) cpu = std::max(cpu, w->task.core);
  return cpu;
}

template <class Faults>
void RealExecutor<Faults>::task_loop(Worker& w) {
  const TaskSpec& spec = w.task.spec;
  const auto& clock = plan_.clock[static_cast<std::size_t>(spec.box)];
  const std::int64_t end = plan_.epoch_host_ns + plan_.duration.count();
  prctl(PR_SET_TIMERSLACK, 1UL);
  w.stat.open_here();
  touch_stack();
  w.before = counters(w.stat);
  const auto raw = [&](std::uint64_t i) { return raw_arrival(w.task, i); };
  std::uint64_t k = 0;
  std::uint32_t skipped = 0;
  Time arrival = raw(0);
  w.boundary = plan_.epoch_host_ns + plan_.hyperperiod.count();
  while (clock.to_host(arrival) < end) {
    JobFaults f{};
    if constexpr (Faults::kEnabled) f = faults_.job(w.task.id, k);
    if (f.dead) {
      w.next_k = k;
      w.next_arrival = arrival;
      w.ended.store(true, std::memory_order_release);
      return;
    }
    const std::int64_t host = clock.to_host(arrival);
    if (!sleep_until(host - spec.spin_lead.count())) return;
    while (monotonic_ns() < host) {
    }
    w.pass_boundaries(host, plan_.hyperperiod.count());
    serve(w, k, release_box(spec, k), skipped, f);
    w.pending_from = host;
    w.pending_to = monotonic_ns();
    // A release at or after the end is not ours to drop.
    const std::int64_t ended = std::min(w.pending_to, end);
    const NextRelease next = next_release(spec, k, arrival, clock.from_host(ended), raw);
    k = next.k;
    arrival = next.arrival;
    skipped = next.skipped;
    w.totals.skipped += next.skipped;
    if (w.degrades() && skipped > 0) w.levels.on_miss();
    w.totals.level = w.levels.level();
  }
}

// The thread of a task has ended, as a fault plan says: its releases still arrive, and each is lost as
// it does. Nobody else would make its output safe.
template <class Faults>
void RealExecutor<Faults>::lose_until(Worker& w, std::int64_t host_ns) {
  const auto& clock = plan_.clock[static_cast<std::size_t>(w.task.spec.box)];
  const std::int64_t end = std::min({host_ns, plan_.epoch_host_ns + plan_.duration.count(),
                                     stopped_at_.load(std::memory_order_relaxed)});
  const std::int64_t hyperperiod = plan_.hyperperiod.count();
  while (clock.to_host(w.next_arrival) < end) {
    w.pass_boundaries(clock.to_host(w.next_arrival), hyperperiod);
    const bool first = w.totals.lost == 0;
    ++w.totals.skipped;
    ++w.totals.lost;
    if (w.bucket.on_job(true, 0) || first) w.task.body->make_safe();
    if (w.degrades()) w.levels.on_miss();
    w.next_arrival = std::max(w.next_arrival, raw_arrival(w.task, ++w.next_k));
  }
  // What is left arrives at `end` or later, after these.
  w.pass_boundaries(end - 1, hyperperiod);
  w.totals.level = w.levels.level();
}

template <class Faults>
std::vector<TaskTotals> RealExecutor<Faults>::totals() const {
  std::vector<TaskTotals> out;
  for (const auto& w : workers_) out.push_back(w->totals);
  return out;
}

template <class Faults>
void RealExecutor<Faults>::serve(Worker& w, std::uint64_t k, Time release, std::uint32_t skipped,
                                 const JobFaults& f) {
  (void)f;
  const TaskSpec& spec = w.task.spec;
  const auto& clock = plan_.clock[static_cast<std::size_t>(spec.box)];
  JobRecord r{};
  const std::int64_t start = monotonic_ns();
  const std::int64_t cpu0 = thread_cpu_ns();
  const std::int64_t twin0 = w.task.body->twin_cpu_ns();
  r.k = k;
  r.task = w.task.id;
  r.core = static_cast<std::uint8_t>(w.task.core);
  r.level = static_cast<std::uint8_t>(w.levels.level());
  r.skipped = skipped;
  r.release_ns = ns_of(release);
  r.deadline_ns = ns_of(release + spec.relative_deadline());
  const Tick tick{
      k, release, clock.from_host(start), spec.period(), skipped, w.levels.level(), &w.cancel};
  r.start_ns = ns_of(tick.start);
  w.cancel.clear();
  if (spec.policy == MissPolicy::kAbort) {
    w.cancel.arm(clock.to_host(release + spec.relative_deadline()));
  }
  w.busy_since.store(start, std::memory_order_release);
  if (w.pool != nullptr) w.pool->begin_job();
  w.task.body->latch(tick, r);
  if constexpr (Faults::kEnabled) {
    r.injected = f.any() ? 1 : 0;
    if (f.block.count() > 0) sleep_until(monotonic_ns() + f.block.count());
    if (f.extra_cpu.count() > 0) burn_cpu(f.extra_cpu);
    if (f.touch_page) touch_released_page();
  }
  Health health;
  {
    const Section section(spec.task_class == TaskClass::kHard);
    health = w.task.body->step(tick, r);
  }
  if constexpr (Faults::kEnabled) {
    // Injected work counts as work: the classifier must be able to see that the job did more.
    r.work += static_cast<std::uint64_t>(f.extra_cpu.count());
  }
  const bool aborted = spec.policy == MissPolicy::kAbort &&
                       clock.from_host(monotonic_ns()) > release + spec.relative_deadline();
  if (aborted)
    w.task.body->abandon(tick);
  else
    w.task.body->commit(tick, r);
  w.busy_since.store(0, std::memory_order_release);
  r.outcome = aborted ? Outcome::kAborted : Outcome::kCompleted;
  r.severity = health.severity;
  r.fault = health.fault;
  r.twin_cpu_ns = w.task.body->twin_cpu_ns() - twin0;
  r.cpu_ns = thread_cpu_ns() - cpu0 - r.twin_cpu_ns;
  const ThreadCounters after = counters(w.stat);
  r.run_delay_ns = after.run_delay_ns - w.before.run_delay_ns;
  r.minor_faults = static_cast<std::uint32_t>(after.minor_faults - w.before.minor_faults);
  r.major_faults = static_cast<std::uint16_t>(
      std::min(after.major_faults - w.before.major_faults,
               static_cast<long>(std::numeric_limits<std::uint16_t>::max())));
  r.involuntary = static_cast<std::uint32_t>(after.involuntary - w.before.involuntary);
  r.voluntary = static_cast<std::uint32_t>(after.voluntary - w.before.voluntary);
  w.before = after;
  r.end_ns = ns_of(clock.from_host(monotonic_ns()));
  if (w.degrades() && r.missed()) w.levels.on_miss();
  (aborted ? w.totals.aborted : w.totals.completed) += 1;
  if (!aborted && r.missed()) ++w.totals.late;
  if (w.bucket.on_job(r.missed(), skipped)) w.task.body->make_safe();
  w.records.try_push(r);
  if (w.pool != nullptr) record_shares(w, r);
}

// Injected theft or hog: a thread above the tasks (or above everything) that holds the core from the
// nominal releases the plan names. Started only when the plan takes cores away.
template <class Faults>
void RealExecutor<Faults>::injector_loop(int cpu, bool theft) {
  if constexpr (Faults::kEnabled) {
    struct Cursor {
      const PlacedTask* task;
      std::uint64_t k;
    };
    std::vector<Cursor> cursors;
    for (const auto& w : workers_) {
      if (w->task.core == cpu && w->place < 0) cursors.push_back({&w->task, 0});
    }
    const std::int64_t end = plan_.epoch_host_ns + plan_.duration.count();
    for (;;) {
      std::int64_t host = end;
      Cursor* next = nullptr;
      for (auto& c : cursors) {
        const auto& clock = plan_.clock[static_cast<std::size_t>(c.task->spec.box)];
        const std::int64_t h = clock.to_host(release_box(c.task->spec, c.k));
        if (h < host) {
          host = h;
          next = &c;
        }
      }
      if (next == nullptr) return;
      const JobFaults f = faults_.job(next->task->id, next->k++);
      const Nanos length = theft ? f.theft : f.hog;
      if (length.count() == 0) continue;
      if (!sleep_until(host)) return;
      if (theft) {
        const std::int64_t until = host + length.count();
        while (monotonic_ns() < until) {
        }
      } else {
        burn_cpu(length);
      }
    }
  } else {
    (void)cpu, (void)theft;
  }
}

// One wake-up at each release instant of the tasks on this core, just above them: how late it is, is
// how late the machine was. With a spin lead L it must come before the task's own wake-up.
template <class Faults>
void RealExecutor<Faults>::sentinel_loop(Sentinel& s) {
  prctl(PR_SET_TIMERSLACK, 1UL);
  const std::int64_t end = plan_.epoch_host_ns + plan_.duration.count();
  std::vector<std::uint64_t> k(s.specs.size(), 0);
  for (;;) {
    std::int64_t host = kNever;
    std::int64_t lead = 0;
    Time release{};
    for (std::size_t i = 0; i < s.specs.size(); ++i) {
      const auto& clock = plan_.clock[static_cast<std::size_t>(s.specs[i].box)];
      const Time r = release_box(s.specs[i], k[i]);
      const std::int64_t h = clock.to_host(r);
      if (h < host) {
        host = h;
        release = r;
        lead = s.specs[i].spin_lead.count();
      }
    }
    if (host >= end) return;
    for (std::size_t i = 0; i < s.specs.size(); ++i) {
      const auto& clock = plan_.clock[static_cast<std::size_t>(s.specs[i].box)];
      if (clock.to_host(release_box(s.specs[i], k[i])) <= host) ++k[i];
    }
    const std::int64_t due = lead > 0 ? host - lead - kSentinelLead : host;
    if (due < monotonic_ns() - 1000000)
      continue;  // still behind after a theft: those samples are gone
    if (!sleep_until(due)) return;
    s.records.try_push({ns_of(release), monotonic_ns() - due, static_cast<std::uint16_t>(s.cpu)});
  }
}

template <class Faults>
void RealExecutor<Faults>::watchdog_loop() {
  std::int64_t next = plan_.epoch_host_ns;
  while (sleep_until(next)) {
    next = std::max(next, monotonic_ns()) + options_.watchdog_period.count();
    const std::int64_t now = monotonic_ns();
    for (auto& w : workers_) {
      if (w->ended.load(std::memory_order_acquire)) lose_until(*w, now);
      const std::int64_t since = w->busy_since.load(std::memory_order_acquire);
      const bool hung = since != 0 && now - since > options_.hang_limit.count();
      if (hung && !w->forced) {
        w->task.body->make_safe();
        hangs_.fetch_add(1);
      }
      w->forced = hung;
    }
  }
}

template <class Faults>
std::size_t RealExecutor<Faults>::drain_once() {
  std::size_t n = 0;
  JobRecord job;
  for (auto& w : workers_) {
    while (w->records.try_pop(job)) {
      job_sink_(job);
      ++n;
    }
  }
  SentinelRecord sample;
  for (auto& s : sentinels_) {
    while (s->records.try_pop(sample)) {
      sentinel_sink_(sample);
      ++n;
    }
  }
  return n;
}

template <class Faults>
void RealExecutor<Faults>::drain_loop() {
  while (!drain_done_.load()) {
    drain_once();
    timespec pause{0, 20000000};
    nanosleep(&pause, nullptr);
  }
  while (drain_once() > 0) {
  }
}

template <class Faults>
std::uint64_t RealExecutor<Faults>::dropped_records() const noexcept {
  std::uint64_t n = 0;
  for (const auto& w : workers_) n += w->records.dropped();
  for (const auto& s : sentinels_) n += s->records.dropped();
  return n;
}

}  // namespace rt
