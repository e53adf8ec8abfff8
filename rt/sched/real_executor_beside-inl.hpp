// The threads of a RealExecutor beside the tasks': injectors of a fault plan, sentinels, watchdog,
// drain.
#pragma once

#include "rt/sched/real_executor_state-inl.hpp"

namespace rt {

// Injected theft or hog: a thread above the tasks (or above everything) that holds the core from
// the nominal releases the plan names. Started only when the plan takes cores away.
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

// One wake-up at each release instant of the tasks on this core, just above them. Its lateness
// measures the machine's wake-up latency. With a spin lead L it must come before the task's own
// wake-up.
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
  // On a grid of its own, between the releases of fast tasks: a wake-up at one of them, or one that
  // drifts over them, would hold up the task. What was slept through is left out.
  const std::int64_t period = options_.watchdog_period.count();
  std::int64_t next = plan_.epoch_host_ns + period / 20;
  // While this thread, above all tasks, did not run either, the process or its machine stood still:
  // no job hung. What is still at work then is given its time once more.
  std::int64_t runs_since = 0;
  while (sleep_until(next)) {
    const std::int64_t now = monotonic_ns();
    if (now - next > options_.hang_limit.count() / 2) runs_since = now;
    next += period * (1 + std::max<std::int64_t>(0, now - next) / period);
    for (auto& w : workers_) {
      if (w->ended.load(std::memory_order_acquire)) lose_until(*w, now);
      const std::int64_t since = w->busy_since.load(std::memory_order_acquire);
      const bool hung =
          since != 0 && now - std::max(since, runs_since) > options_.hang_limit.count();
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

// The thread of a task has ended, as a fault plan says: its releases still arrive, and each is lost
// as it does. Nobody else would make its output safe.
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

}  // namespace rt
