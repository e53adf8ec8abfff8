// The pool workers of a RealExecutor.
#pragma once

#include "rt/sched/real_executor_state-inl.hpp"

namespace rt {

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

}  // namespace rt
