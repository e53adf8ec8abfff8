// The bodies of VirtualExecutor, for virtual_executor.cpp and virtual_executor_planned.cpp: an
// instance each, so that the plain one is the same code whether or not planned ones are built.
#pragma once

#include "rt/sched/virtual_executor.hpp"

#include <algorithm>
#include <limits>

#include "rt/fault/planned.hpp"
#include "rt/memory/section.hpp"

namespace rt {

inline constexpr std::int64_t kNoEvent = std::numeric_limits<std::int64_t>::max();

template <class Faults>
VirtualExecutor<Faults>::VirtualExecutor(const std::vector<PlacedTask>& tasks, CostModel& costs,
                                         const Faults& faults, Sink sink, VirtualOptions options)
    : costs_(costs), faults_(faults), sink_(std::move(sink)), options_(options) {
  for (const auto& t : tasks) {
    owned_.push_back(std::make_unique<State>(t));
    cores_ = std::max(cores_, t.core + 1);
  }
  make_pools();
}

// ---- pool workers

template <class Faults>
void VirtualExecutor<Faults>::make_pools() {
  for (auto& s : owned_) {
    for (auto& h : owned_) {
      if (!h->task.spec.is_worker() || h->task.spec.parent != s->task.spec.name ||
          h->task.spec.box != s->task.spec.box)
        continue;
      h->parent = s.get();
      s->helpers.push_back(h.get());
    }
    if (s->helpers.empty()) continue;
    s->crew = std::make_unique<InlineForkJoin>(static_cast<int>(s->helpers.size()), false);
    if (s->task.body != nullptr) s->task.body->use(*s->crew);
  }
}

// Its own part is done, that of a worker is not.
template <class Faults>
bool VirtualExecutor<Faults>::joining(const State& s) noexcept {
  return s.started && s.remaining <= 0 &&
         std::any_of(s.helpers.begin(), s.helpers.end(), [](const State* h) { return h->pending; });
}

// The job of `parent` has just been dispatched: those of its workers arrive. A job that forked
// nothing leaves them a record without CPU.
template <class Faults>
void VirtualExecutor<Faults>::fork(State& parent) {
  const bool live = !options_.stub_bodies && parent.task.body != nullptr;
  for (std::size_t w = 0; w < parent.helpers.size(); ++w) {
    State& h = *parent.helpers[w];
    h.tick = parent.tick;
    h.pending = true;
    h.started = false;
    h.served = 0;
    h.record = JobRecord{};
    h.record.k = parent.record.k;
    h.record.task = h.task.id;
    h.record.core = static_cast<std::uint8_t>(h.task.core);
    h.record.level = parent.record.level;
    h.record.skipped = parent.record.skipped;
    h.record.release_ns = parent.record.start_ns;
    h.record.deadline_ns = parent.record.deadline_ns;
    if (live && parent.crew->forks() == 0) {
      h.started = true;
      h.record.start_ns = h.record.release_ns;
      finish_share(h, Outcome::kCompleted);
      continue;
    }
    h.remaining = costs_.cost(h.task.id, h.tick.k, h.tick.level).count();
    forked_ = true;
  }
}

template <class Faults>
void VirtualExecutor<Faults>::finish_share(State& s, Outcome outcome) {
  const auto& clock = plan_.clock[static_cast<std::size_t>(s.task.spec.box)];
  s.pending = false;
  s.record.outcome = outcome;
  s.record.end_ns = ns_of(clock.from_host(now_));
  if (!s.started) s.record.start_ns = s.record.end_ns;
  s.record.cpu_ns = s.served;
  (outcome == Outcome::kAborted ? s.totals.aborted : s.totals.completed) += 1;
  if (outcome == Outcome::kCompleted && s.record.missed()) ++s.totals.late;
  sink_(s.record);
}

template <class Faults>
Time VirtualExecutor<Faults>::release_box(const State& s, std::uint64_t k) const noexcept {
  const auto& clock = plan_.clock[static_cast<std::size_t>(s.task.spec.box)];
  return clock.from_host(plan_.epoch_host_ns) + s.task.spec.offset + s.task.spec.rate.release(k);
}

template <class Faults>
Time VirtualExecutor<Faults>::raw_arrival(const State& s, std::uint64_t k) const noexcept {
  Time t = release_box(s, k);
  if constexpr (Faults::kEnabled) t += faults_.job(s.task.id, k).late;
  return t;
}

template <class Faults>
void VirtualExecutor<Faults>::arm_next(State& s, Time arrival) {
  const auto& clock = plan_.clock[static_cast<std::size_t>(s.task.spec.box)];
  s.arrival = arrival;
  s.next_release =
      clock.to_host(arrival) >= end_ ? kNoEvent : std::max(now_, clock.to_host(arrival));
  if constexpr (Faults::kEnabled) s.dead = s.dead || faults_.job(s.task.id, s.next_k).dead;
}

template <class Faults>
void VirtualExecutor<Faults>::run(const RunPlan& plan) {
  plan_ = plan;
  now_ = plan.epoch_host_ns;
  end_ = plan.epoch_host_ns + plan.duration.count();
  next_boundary_ = plan.epoch_host_ns + plan.hyperperiod.count();
  stop_ = false;
  core_.assign(static_cast<std::size_t>(cores_), CoreState{});
  for (auto& s : owned_) {
    s->next_release = s->next_span = kNoEvent;
    if (s->parent != nullptr) continue;  // its parent forks it
    arm_next(*s, raw_arrival(*s, 0));
    arm_span(*s);
  }
  while (!stop_) {
    const std::int64_t t = next_event();
    if (t == kNoEvent || t > end_) break;
    advance(t);
    complete_due();
    abort_due();
    if (now_ == end_) break;
    for (auto* actor : actors_) {
      while (actor->next_host_ns() <= now_) actor->act(now_);
    }
    switch_levels();
    start_spans();
    do {
      release_due();
    } while (abort_due());  // one that arrives at or after its deadline never starts
    dispatch();
  }
}

template <class Faults>
std::vector<TaskTotals> VirtualExecutor<Faults>::totals() const {
  std::vector<TaskTotals> out;
  for (const auto& s : owned_) {
    const State& judge = s->parent != nullptr ? *s->parent : *s;
    out.push_back(s->totals);
    out.back().level = judge.levels.level();
    out.back().skipped = judge.totals.skipped;
    out.back().lost = judge.totals.lost;
  }
  return out;
}

// Theft and hogs belong to nominal releases, whether or not the job of that release is served.
template <class Faults>
void VirtualExecutor<Faults>::arm_span(State& s) {
  s.next_span = kNoEvent;
  if (!faults_.has_spans()) return;
  const auto& clock = plan_.clock[static_cast<std::size_t>(s.task.spec.box)];
  const std::int64_t host = clock.to_host(release_box(s, s.span_k));
  if (host < end_) s.next_span = host;
}

template <class Faults>
void VirtualExecutor<Faults>::start_spans() {
  if (!faults_.has_spans()) return;
  for (auto& s : owned_) {
    while (s->next_span <= now_) {
      const JobFaults f = faults_.job(s->task.id, s->span_k);
      CoreState& core = core_[static_cast<std::size_t>(s->task.core)];
      if (f.theft.count() > 0)
        core.stolen_until = std::max(core.stolen_until, now_ + f.theft.count());
      core.hog_left += f.hog.count();
      ++s->span_k;
      arm_span(*s);
    }
  }
}

// The job that holds a core: the highest priority that is pending, started or not, and not blocked.
template <class Faults>
typename VirtualExecutor<Faults>::State* VirtualExecutor<Faults>::running_on(int core) noexcept {
  const CoreState& c = core_[static_cast<std::size_t>(core)];
  if (c.stolen_until > now_ || c.hog_left > 0) return nullptr;
  State* best = nullptr;
  for (auto& s : owned_) {
    if (s->task.core != core || !s->pending || s->blocked_until > now_ || joining(*s)) continue;
    if (best == nullptr || s->task.priority > best->task.priority) best = s.get();
  }
  return best;
}

template <class Faults>
std::int64_t VirtualExecutor<Faults>::next_event() noexcept {
  std::int64_t t = kNoEvent;
  for (auto& s : owned_) {
    if (s->parent != nullptr) continue;
    if (!s->pending) t = std::min(t, s->next_release);
    t = std::min(t, s->next_span);
    if (s->pending && s->started && s->blocked_until > now_) t = std::min(t, s->blocked_until);
    if (s->pending && s->task.spec.policy == MissPolicy::kAbort) {
      t = std::min(t, std::max(now_, s->deadline_host));
    }
  }
  for (int core = 0; core < cores_; ++core) {
    const CoreState& c = core_[static_cast<std::size_t>(core)];
    if (c.stolen_until > now_) {
      t = std::min(t, c.stolen_until);
    } else if (c.hog_left > 0) {
      t = std::min(t, now_ + c.hog_left);
    } else if (const State* s = running_on(core); s != nullptr && s->started) {
      t = std::min(t, now_ + s->remaining);
    }
  }
  for (const auto* actor : actors_) t = std::min(t, std::max(now_, actor->next_host_ns()));
  if (t != kNoEvent) t = std::min(t, std::max(now_, next_boundary_));
  return t;
}

template <class Faults>
void VirtualExecutor<Faults>::advance(std::int64_t to) noexcept {
  const std::int64_t dt = to - now_;
  for (int core = 0; core < cores_ && dt > 0; ++core) {
    CoreState& c = core_[static_cast<std::size_t>(core)];
    if (c.stolen_until > now_) continue;
    if (c.hog_left > 0) {
      c.hog_left -= dt;
    } else if (State* s = running_on(core); s != nullptr && s->started) {
      s->remaining -= dt;
      s->served += dt;
    }
  }
  now_ = to;
}

template <class Faults>
void VirtualExecutor<Faults>::complete_due() {
  for (auto& s : owned_) {
    if (s->parent != nullptr && s->pending && s->started && s->remaining <= 0)
      finish_share(*s, Outcome::kCompleted);
  }
  for (auto& s : owned_) {
    if (s->parent == nullptr && s->pending && s->started && s->remaining <= 0 &&
        s->blocked_until <= now_ && !joining(*s)) {
      finish(*s, Outcome::kCompleted);
    }
  }
}

template <class Faults>
bool VirtualExecutor<Faults>::abort_due() {
  bool any = false;
  for (auto& s : owned_) {
    if (s->parent == nullptr && s->pending && s->task.spec.policy == MissPolicy::kAbort &&
        s->deadline_host <= now_) {
      finish(*s, Outcome::kAborted);
      any = true;
    }
  }
  return any;
}

template <class Faults>
void VirtualExecutor<Faults>::switch_levels() {
  if (now_ < next_boundary_) return;
  next_boundary_ += plan_.hyperperiod.count();
  for (auto& s : owned_) {
    if (s->task.spec.policy == MissPolicy::kDegrade) s->levels.at_boundary(s->pending);
  }
}

template <class Faults>
void VirtualExecutor<Faults>::release_due() {
  for (auto& s : owned_) {
    while (!s->pending && s->next_release <= now_) {
      if (!s->dead) {
        begin_job(*s);
        break;
      }
      // Nobody serves it: it is lost as it arrives.
      const bool live = !options_.stub_bodies && s->task.body != nullptr;
      const bool first = s->totals.lost == 0;
      ++s->totals.skipped;
      ++s->totals.lost;
      ++s->skipped;
      if ((s->bucket.on_job(true, 0) || first) && live) s->task.body->make_safe();
      if (s->task.spec.policy == MissPolicy::kDegrade) s->levels.on_miss();
      ++s->next_k;
      arm_next(*s, std::max(s->arrival, raw_arrival(*s, s->next_k)));
    }
  }
}

template <class Faults>
void VirtualExecutor<Faults>::begin_job(State& s) {
  const auto& clock = plan_.clock[static_cast<std::size_t>(s.task.spec.box)];
  const Time release = release_box(s, s.next_k);
  s.pending = true;
  s.started = false;
  s.blocked_until = 0;
  s.served = 0;
  s.tick =
      Tick{s.next_k, release, {}, s.task.spec.period(), s.skipped, s.levels.level(), &s.cancel};
  s.record = JobRecord{};
  s.record.k = s.next_k;
  s.record.task = s.task.id;
  s.record.core = static_cast<std::uint8_t>(s.task.core);
  s.record.level = static_cast<std::uint8_t>(s.tick.level);
  s.record.skipped = s.skipped;
  s.record.release_ns = ns_of(release);
  s.record.deadline_ns = ns_of(release + s.task.spec.relative_deadline());
  s.deadline_host = clock.to_host(release + s.task.spec.relative_deadline());
  s.skipped = 0;
}

template <class Faults>
void VirtualExecutor<Faults>::dispatch() {
  do {
    forked_ = false;  // what a core forks may begin on one that was looked at before
    for (int core = 0; core < cores_; ++core) {
      State* s = running_on(core);
      while (s != nullptr && !s->started) {
        first_dispatch(*s);
        s = running_on(core);  // it may have blocked: the next one gets the core
      }
    }
  } while (forked_);
}

template <class Faults>
void VirtualExecutor<Faults>::first_dispatch(State& s) {
  const auto& clock = plan_.clock[static_cast<std::size_t>(s.task.spec.box)];
  s.started = true;
  s.tick.start = clock.from_host(now_);
  s.record.start_ns = ns_of(s.tick.start);
  if (s.parent != nullptr) return;  // its cost was drawn at the fork
  s.remaining = costs_.cost(s.task.id, s.tick.k, s.tick.level).count();
  if constexpr (Faults::kEnabled) {
    const JobFaults f = faults_.job(s.task.id, s.tick.k);
    s.remaining += f.extra_cpu.count() + f.page_fault.count();
    if (f.block.count() > 0) s.blocked_until = now_ + f.block.count();
    s.record.injected = f.any() ? 1 : 0;
  }
  // A job that can not end before its deadline even undisturbed sees its token from the start, as
  // its polls would; one that is later preempted past the deadline is aborted there and commits
  // nothing.
  s.cancel.clear();
  if (s.task.spec.policy == MissPolicy::kAbort && now_ + s.remaining > s.deadline_host) {
    s.cancel.request();
  }
  if (options_.stub_bodies || s.task.body == nullptr) {
    fork(s);
    return;
  }
  if (s.crew != nullptr) s.crew->begin_job();
  s.task.body->latch(s.tick, s.record);
  Health health;
  {
    const Section section(s.task.spec.task_class == TaskClass::kHard);
    const AllocationCount allocations;
    health = s.task.body->step(s.tick, s.record);
    s.record.allocations = allocations.value();
  }
  s.record.severity = health.severity;
  s.record.fault = health.fault;
  fork(s);
}

template <class Faults>
void VirtualExecutor<Faults>::finish(State& s, Outcome outcome) {
  const auto& clock = plan_.clock[static_cast<std::size_t>(s.task.spec.box)];
  for (State* h : s.helpers) {
    if (h->pending) finish_share(*h, Outcome::kAborted);
  }
  s.pending = false;
  s.record.outcome = outcome;
  s.record.end_ns = ns_of(clock.from_host(now_));
  if (!s.started) s.record.start_ns = s.record.end_ns;
  const bool live = !options_.stub_bodies && s.task.body != nullptr;
  if (live && outcome == Outcome::kCompleted) s.task.body->commit(s.tick, s.record);
  if (live && outcome == Outcome::kAborted && s.started) s.task.body->abandon(s.tick);
  s.record.twin_cpu_ns = 0;  // measured, so not the same on every machine
  s.record.cpu_ns = s.served;
  const bool missed = s.record.missed();
  (outcome == Outcome::kAborted ? s.totals.aborted : s.totals.completed) += 1;
  if (outcome == Outcome::kCompleted && missed) ++s.totals.late;
  const NextRelease next = next_release(s.task.spec, s.tick.k, s.arrival, clock.from_host(now_),
                                        [&](std::uint64_t k) { return raw_arrival(s, k); });
  s.next_k = next.k;
  s.skipped = next.skipped;
  s.totals.skipped += next.skipped;
  if (s.task.spec.policy == MissPolicy::kDegrade && (missed || next.skipped > 0))
    s.levels.on_miss();
  if (s.bucket.on_job(missed, next.skipped) && live) s.task.body->make_safe();
  sink_(s.record);
  arm_next(s, next.arrival);
}

}  // namespace rt
