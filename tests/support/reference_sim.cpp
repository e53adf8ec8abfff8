#include "tests/support/reference_sim.hpp"

#include <algorithm>
#include <deque>
#include <limits>

#include "rt/random.hpp"

namespace support {
namespace {

constexpr Ticks kNever = std::numeric_limits<Ticks>::max();
constexpr std::uint64_t kAlive = std::numeric_limits<std::uint64_t>::max();

// The plan, read a second time: rt/fault/plan.cpp is not used here.
bool entry_fires(const rt::FaultEntry& e, std::uint64_t plan_seed, std::uint64_t n) {
  if (n < e.first) return false;
  const std::uint64_t since = n - e.first;
  if (since % e.every != 0) return false;
  if (e.count > 0 && since / e.every >= e.count) return false;
  if (e.probability >= 1.0) return true;
  const std::uint64_t seeds = rt::mix64(plan_seed, e.seed);
  const std::uint64_t what =
      rt::mix64(rt::target_hash(e.target), static_cast<std::uint64_t>(e.kind));
  const std::uint64_t draw = rt::mix64(rt::mix64(seeds, what), n);
  return static_cast<double>(draw >> 11U) / 9007199254740992.0 < e.probability;
}

Ticks magnitude(const rt::FaultPlan& plan, rt::FaultKind kind, const std::string& task,
                std::uint64_t k) {
  Ticks sum = 0;
  for (const rt::FaultEntry& e : plan.entries) {
    if (e.kind == kind && e.target == task && entry_fires(e, plan.seed, k)) {
      sum += e.magnitude.count();
    }
  }
  return sum;
}

struct Job {
  SimJob log;
  bool started = false;
  Ticks received = 0;       // CPU so far
  Ticks cost = 0;           // known at the start
  Ticks blocked_until = 0;  // suspended while t < blocked_until
};

class Sim {
 public:
  explicit Sim(const SimConfig& config) : cfg_(config) {
    result_.tasks.resize(cfg_.tasks.size());
    tasks_.resize(cfg_.tasks.size());
    cores_.resize(static_cast<std::size_t>(cfg_.cores));
    for (std::size_t i = 0; i < tasks_.size(); ++i) start_task(i);
  }

  SimResult run() {
    for (Ticks t = 0;;) {
      completions(t);
      aborts(t);
      if (t >= cfg_.horizon) break;
      boundary(t);
      arrivals(t);
      dispatch(t);
      const Ticks next = cfg_.every_tick ? t + 1 : std::min(next_event(t), cfg_.horizon);
      spend(next - t);
      t = next;
    }
    return finish();
  }

 private:
  struct Task {
    std::deque<Job> queue;     // arrived and not ended; only the front may have started
    std::uint64_t next_k = 0;  // next to arrive
    Ticks next_arrival = 0;
    std::uint64_t span_k = 0;  // next nominal release to look up for thefts and hogs
    bool has_spans = false;
    std::uint64_t dead_from = kAlive;
    int level = 0;
    bool missed = false;  // since the last evaluation at a boundary
    int clean = 0;
  };
  struct Core {
    Ticks theft_until = 0;
    std::deque<Ticks> hogs;  // CPU still wanted by each
    int running = -1;        // task, or
    bool hog_runs = false;
  };

  // ---- releases ----
  // An instant of the task's own clock, in ticks.
  Ticks tick_of(std::size_t i, Ticks shown) const {
    const SimTask& s = cfg_.tasks[i];
    return s.on_clock ? s.on_clock(shown) : shown;
  }
  Ticks nominal(std::size_t i, std::uint64_t k) const { return tick_of(i, shown_at(i, k)); }
  // Release k by the task's own clock.
  Ticks shown_at(std::size_t i, std::uint64_t k) const {
    const SimTask& s = cfg_.tasks[i];
    if (s.period > 0) return s.offset + static_cast<Ticks>(k) * s.period;
    __extension__ using Wide = __int128;
    const Wide ticks = static_cast<Wide>(k) * cfg_.ticks_per_second * s.rate_den / s.rate_num;
    return s.offset + static_cast<Ticks>(ticks);
  }
  Ticks arrival_of(std::size_t i, std::uint64_t k, Ticks previous) const {
    const SimTask& s = cfg_.tasks[i];
    Ticks a = shown_at(i, k) + magnitude(cfg_.plan, rt::FaultKind::kLateRelease, s.name, k);
    if (s.jitter_of) a += s.jitter_of(k);
    return std::max(tick_of(i, a), previous);
  }
  Ticks due(std::size_t i, std::uint64_t k) const {
    return tick_of(i, shown_at(i, k) + cfg_.tasks[i].deadline);
  }

  void start_task(std::size_t i) {
    Task& task = tasks_[i];
    task.level = cfg_.tasks[i].first_level;
    task.next_arrival = arrival_of(i, 0, 0);
    for (const rt::FaultEntry& e : cfg_.plan.entries) {
      if (e.target != cfg_.tasks[i].name) continue;
      if (e.kind == rt::FaultKind::kDeadThread) task.dead_from = std::min(task.dead_from, e.first);
      if (e.kind == rt::FaultKind::kTheft || e.kind == rt::FaultKind::kPriorityHog) {
        task.has_spans = true;
      }
    }
  }

  // ---- endings ----
  void end_front(std::size_t i, Ticks t, SimOutcome outcome) {
    Task& task = tasks_[i];
    SimTaskResult& r = result_.tasks[i];
    SimJob log = task.queue.front().log;
    task.queue.pop_front();
    log.end = t;
    log.outcome = outcome;
    if (log.start < 0) log.level = task.level;
    if (outcome == SimOutcome::kCompleted) {
      log.late = t > due(i, log.k);
      ++r.completed;
      if (log.late) ++r.late;
      r.worst_response = std::max(r.worst_response, t - log.release);
    } else if (outcome == SimOutcome::kAborted) {
      ++r.aborted;
    } else {
      ++r.skipped;
    }
    if (log.late || outcome != SimOutcome::kCompleted) task.missed = true;
    if (cfg_.keep_jobs) r.jobs.push_back(log);
  }

  // The policy, after a job ended at t. What arrives at t itself is not in the queue yet.
  void drop_pending(std::size_t i, Ticks t) {
    std::size_t keep = 0;
    if (cfg_.tasks[i].policy == SimPolicy::kCatchUp) {
      keep = static_cast<std::size_t>(cfg_.tasks[i].catch_up_max);
    }
    while (tasks_[i].queue.size() > keep) end_front(i, t, SimOutcome::kSkipped);
    bury_dead(i, t);
  }

  void completions(Ticks t) {
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      if (tasks_[i].queue.empty()) continue;
      const Job& job = tasks_[i].queue.front();
      if (!job.started || job.received < job.cost) continue;
      end_front(i, t, SimOutcome::kCompleted);
      drop_pending(i, t);
    }
  }

  void aborts(Ticks t) {
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      if (cfg_.tasks[i].policy != SimPolicy::kAbort || tasks_[i].queue.empty()) continue;
      if (due(i, tasks_[i].queue.front().log.k) > t) continue;
      end_front(i, t, SimOutcome::kAborted);
      drop_pending(i, t);
    }
  }

  // ---- hyperperiod boundary ----
  void boundary(Ticks t) {
    if (cfg_.hyperperiod <= 0 || t == 0 || t % cfg_.hyperperiod != 0) return;
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      const SimTask& s = cfg_.tasks[i];
      Task& task = tasks_[i];
      if (s.policy != SimPolicy::kDegrade || !task.queue.empty()) continue;
      if (task.missed) {
        task.missed = false;
        task.clean = 0;
        if (task.level < s.last_level) {
          ++task.level;
          ++result_.tasks[i].degraded;
        }
        continue;
      }
      ++task.clean;
      if (task.level > s.first_level && task.clean >= cfg_.clean_hyperperiods) {
        --task.level;
        task.clean = 0;
        ++result_.tasks[i].restored;
      }
    }
  }

  // ---- arrivals, thefts, hogs ----
  void arrivals(Ticks t) {
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      Task& task = tasks_[i];
      while (task.next_arrival == t) {
        arrive(i, t);
        ++task.next_k;
        task.next_arrival = arrival_of(i, task.next_k, t);
      }
      while (task.has_spans && nominal(i, task.span_k) == t) begin_spans(i, t);
    }
  }

  void arrive(std::size_t i, Ticks t) {
    Task& task = tasks_[i];
    ++result_.tasks[i].releases;
    Job job;
    job.log.k = task.next_k;
    job.log.release = nominal(i, task.next_k);
    job.log.arrival = t;
    task.queue.push_back(job);
    if (cfg_.tasks[i].policy == SimPolicy::kAbort && due(i, task.next_k) <= t &&
        task.next_k < task.dead_from) {
      // Nothing older can be waiting: it would have been aborted at its own, earlier deadline.
      end_front(i, t, SimOutcome::kAborted);
    }
    bury_dead(i, t);
  }

  // Releases of a thread that is gone, once nothing older is before them.
  void bury_dead(std::size_t i, Ticks t) {
    Task& task = tasks_[i];
    while (!task.queue.empty() && task.queue.front().log.k >= task.dead_from) {
      end_front(i, t, SimOutcome::kSkipped);
    }
  }

  void begin_spans(std::size_t i, Ticks t) {
    Task& task = tasks_[i];
    const std::string& name = cfg_.tasks[i].name;
    Core& core = cores_[static_cast<std::size_t>(cfg_.tasks[i].core)];
    const Ticks theft = magnitude(cfg_.plan, rt::FaultKind::kTheft, name, task.span_k);
    const Ticks hog = magnitude(cfg_.plan, rt::FaultKind::kPriorityHog, name, task.span_k);
    if (theft > 0) core.theft_until = std::max(core.theft_until, t + theft);
    if (hog > 0) core.hogs.push_back(hog);
    ++task.span_k;
  }

  // ---- dispatch ----
  void dispatch(Ticks t) {
    for (std::size_t c = 0; c < cores_.size(); ++c) {
      Core& core = cores_[c];
      core.running = -1;
      core.hog_runs = false;
      if (t < core.theft_until) continue;
      core.running = locked_task(static_cast<int>(c));
      if (core.running >= 0) continue;
      if (!core.hogs.empty()) {
        core.hog_runs = true;
        continue;
      }
      for (;;) {
        const int best = highest_ready(static_cast<int>(c), t);
        if (best < 0) break;
        Job& job = tasks_[static_cast<std::size_t>(best)].queue.front();
        if (!job.started) start_job(static_cast<std::size_t>(best), job, t);
        if (t < job.blocked_until) continue;  // suspended at once: the next one
        core.running = best;
        break;
      }
    }
  }

  // The task of this core that is inside its locked section; there is at most one.
  int locked_task(int core) const {
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      if (cfg_.tasks[i].core != core || tasks_[i].queue.empty()) continue;
      const Job& job = tasks_[i].queue.front();
      if (job.started && job.received > 0 && job.received < cfg_.tasks[i].locked) {
        return static_cast<int>(i);
      }
    }
    return -1;
  }

  int highest_ready(int core, Ticks t) const {
    int best = -1;
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      if (cfg_.tasks[i].core != core || tasks_[i].queue.empty()) continue;
      if (t < tasks_[i].queue.front().blocked_until) continue;
      if (best < 0 ||
          cfg_.tasks[i].priority > cfg_.tasks[static_cast<std::size_t>(best)].priority) {
        best = static_cast<int>(i);
      }
    }
    return best;
  }

  void start_job(std::size_t i, Job& job, Ticks t) {
    const SimTask& s = cfg_.tasks[i];
    const std::uint64_t k = job.log.k;
    job.started = true;
    job.log.start = t;
    job.log.level = tasks_[i].level;
    const Ticks own = s.cost_of ? s.cost_of(k, tasks_[i].level) : s.cost;
    job.cost = own + magnitude(cfg_.plan, rt::FaultKind::kExtraCpu, s.name, k) +
               magnitude(cfg_.plan, rt::FaultKind::kPageFault, s.name, k);
    job.cost = std::max<Ticks>(job.cost, 1);
    job.blocked_until = t + magnitude(cfg_.plan, rt::FaultKind::kBlock, s.name, k);
  }

  // ---- time ----
  void spend(Ticks dt) {
    for (Core& core : cores_) {
      if (core.hog_runs) {
        core.hogs.front() -= dt;
        if (core.hogs.front() == 0) core.hogs.pop_front();
      } else if (core.running >= 0) {
        tasks_[static_cast<std::size_t>(core.running)].queue.front().received += dt;
      }
    }
  }

  // The next tick at which anything can change: all ticks between would be worked through without
  // effect. (every_tick visits them anyway; a test compares the two.)
  Ticks next_event(Ticks t) const {
    Ticks next = kNever;
    const auto at = [&](Ticks when) {
      if (when > t) next = std::min(next, when);
    };
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      const Task& task = tasks_[i];
      at(task.next_arrival);
      if (task.has_spans) at(nominal(i, task.span_k));
      if (task.queue.empty()) continue;
      at(task.queue.front().blocked_until);
      if (cfg_.tasks[i].policy == SimPolicy::kAbort) at(due(i, task.queue.front().log.k));
    }
    for (const Core& core : cores_) {
      at(core.theft_until);
      if (core.hog_runs) at(t + core.hogs.front());
      if (core.running < 0) continue;
      const auto i = static_cast<std::size_t>(core.running);
      const Job& job = tasks_[i].queue.front();
      at(t + job.cost - job.received);
      if (job.received < cfg_.tasks[i].locked) at(t + cfg_.tasks[i].locked - job.received);
    }
    if (cfg_.hyperperiod > 0) at((t / cfg_.hyperperiod + 1) * cfg_.hyperperiod);
    return next;
  }

  SimResult finish() {
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
      SimTaskResult& r = result_.tasks[i];
      r.open = tasks_[i].queue.size();
      r.level = tasks_[i].level;
      for (const Job& job : tasks_[i].queue) {
        if (cfg_.keep_jobs) r.jobs.push_back(job.log);
      }
      std::sort(r.jobs.begin(), r.jobs.end(),
                [](const SimJob& a, const SimJob& b) { return a.k < b.k; });
    }
    return std::move(result_);
  }

  const SimConfig& cfg_;
  SimResult result_;
  std::vector<Task> tasks_;
  std::vector<Core> cores_;
};

}  // namespace

SimResult simulate(const SimConfig& config) { return Sim(config).run(); }

}  // namespace support
