// The bodies of RealExecutor, for real_executor.cpp and real_executor_planned.cpp: an instance
// each, so that the plain one is the same code whether or not planned ones are built.
#pragma once

#include "rt/sched/real_executor_beside-inl.hpp"
#include "rt/sched/real_executor_pool-inl.hpp"
#include "rt/sched/real_executor_state-inl.hpp"

namespace rt {

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
      notes_.push_back(std::string("deep idle states are not held off: /dev/cpu_dma_latency: ") +
                       std::strerror(errno));
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
  const Time t = clock.from_host(plan_.epoch_host_ns) + spec.offset + spec.rate.release(k);
  return spec.postponed ? t + Nanos{spec.postponed->applied_ns.load(std::memory_order_relaxed)} : t;
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
  // No work before every thread has its core and its priority: a task whose release is due would
  // run as an ordinary thread, and tasks that have their priority would keep it from the others.
  thread = std::thread([this, body = std::move(body)] {
    placed_.wait(false);
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
  placed_.store(false);
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
  placed_.store(true);
  placed_.notify_all();
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
    if (Postponed* p = spec.postponed.get(); p != nullptr)
      p->applied_ns.store(std::max(p->asked_ns.load(), p->applied_ns.load()));
    const NextRelease next = next_release(spec, k, arrival, clock.from_host(ended), raw);
    k = next.k;
    arrival = next.arrival;
    skipped = next.skipped;
    w.totals.skipped += next.skipped;
    if (w.degrades() && skipped > 0) w.levels.on_miss();
    w.totals.level = w.levels.level();
  }
}

template <class Faults>
std::vector<TaskTotals> RealExecutor<Faults>::totals() const {
  std::vector<TaskTotals> out;
  for (const auto& w : workers_) out.push_back(w->totals);
  return out;
}

// What a job's record says before the job runs.
template <class Worker>
void name_job(const Worker& w, std::uint64_t k, Time release, std::uint32_t skipped,
              JobRecord& r) noexcept {
  r.k = k;
  r.task = w.task.id;
  r.core = static_cast<std::uint8_t>(w.task.core);
  r.level = static_cast<std::uint8_t>(w.levels.level());
  r.skipped = skipped;
  r.release_ns = ns_of(release);
  r.deadline_ns = ns_of(release + w.task.spec.relative_deadline());
}

// What the kernel counted of the thread since the last job.
inline void note_counters(const ThreadCounters& after, ThreadCounters& before,
                          JobRecord& r) noexcept {
  r.run_delay_ns = after.run_delay_ns - before.run_delay_ns;
  r.minor_faults = static_cast<std::uint32_t>(after.minor_faults - before.minor_faults);
  r.major_faults = static_cast<std::uint16_t>(
      std::min(after.major_faults - before.major_faults,
               static_cast<long>(std::numeric_limits<std::uint16_t>::max())));
  r.involuntary = static_cast<std::uint32_t>(after.involuntary - before.involuntary);
  r.voluntary = static_cast<std::uint32_t>(after.voluntary - before.voluntary);
  before = after;
}

// Counts the job and picks the next level. True: the task has missed too often and is to be made
// safe.
template <class Worker>
[[nodiscard]] bool close_job(Worker& w, const JobRecord& r, bool aborted) noexcept {
  if (w.degrades() && r.missed()) w.levels.on_miss();
  (aborted ? w.totals.aborted : w.totals.completed) += 1;
  if (!aborted && r.missed()) ++w.totals.late;
  return w.bucket.on_job(r.missed(), r.skipped);
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
  name_job(w, k, release, skipped, r);
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
    const AllocationCount allocations;
    health = w.task.body->step(tick, r);
    r.allocations = allocations.value();
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
  note_counters(counters(w.stat), w.before, r);
  r.end_ns = ns_of(clock.from_host(monotonic_ns()));
  if (close_job(w, r, aborted)) w.task.body->make_safe();
  w.records.try_push(r);
  if (w.pool != nullptr) record_shares(w, r);
}

template <class Faults>
std::uint64_t RealExecutor<Faults>::dropped_records() const noexcept {
  std::uint64_t n = 0;
  for (const auto& w : workers_) n += w->records.dropped();
  for (const auto& s : sentinels_) n += s->records.dropped();
  return n;
}

}  // namespace rt
