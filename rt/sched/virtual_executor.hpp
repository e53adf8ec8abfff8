// The virtual clock: preemptive fixed-priority scheduling of the same TaskBody objects as a
// discrete-event simulation. Inputs are latched at the instant of first dispatch, step() runs there
// and then, outputs are committed at the instant of completion; between the two lies the cost that
// the CostModel (and the fault plan) gives the job, stretched by preemption. Bit-exact on any
// machine.
//
// A row that names a parent is a worker of its pool. Its parts are computed inline with step(). In
// simulated time all forks of a job count as one at its first dispatch: there the worker's job of
// that release arrives on its own core with a cost of its own, and the parent ends when both have
// been served.
//
// Order at one instant: completions, then aborts, then actors (devices, link), then variant
// switches, then releases, then dispatch by priority, lowest core first.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "rt/fault/injector.hpp"
#include "rt/sched/cost_model.hpp"
#include "rt/sched/executor.hpp"
#include "rt/sched/policy.hpp"
#include "rt/sched/worker_pool.hpp"

namespace rt {

// Something outside the tasks that acts at instants of its own: the simulated link, a script.
class Actor {
 public:
  virtual ~Actor() = default;
  // Host instant of its next action; int64 max = none.
  [[nodiscard]] virtual std::int64_t next_host_ns() const noexcept = 0;
  virtual void act(std::int64_t host_ns) = 0;
};

struct VirtualOptions {
  bool stub_bodies = false;  // schedule only: no body is called
};

template <class Faults>
class VirtualExecutor final : public Executor {
 public:
  using Sink = std::function<void(const JobRecord&)>;
  VirtualExecutor(const std::vector<PlacedTask>& tasks, CostModel& costs, const Faults& faults,
                  Sink sink, VirtualOptions options = {});
  void add_actor(Actor& actor) { actors_.push_back(&actor); }
  void run(const RunPlan& plan) override;
  void request_stop() noexcept override { stop_ = true; }
  [[nodiscard]] std::vector<TaskTotals> totals() const override;
  [[nodiscard]] std::int64_t now_host_ns() const noexcept { return now_; }

 private:
  struct State {
    PlacedTask task;
    LevelControl levels;
    MissBucket bucket;
    CancelToken cancel;
    std::uint64_t next_k = 0;
    std::uint32_t skipped = 0;      // to hand to the next job
    std::int64_t next_release = 0;  // host; int64 max = none left
    bool pending = false;           // released, not finished
    bool started = false;
    bool dead = false;  // the thread has ended: releases arrive and are lost
    Time arrival{};     // of next_k
    TaskTotals totals;
    std::int64_t remaining = 0;  // CPU still to be served
    std::int64_t blocked_until = 0;
    std::int64_t deadline_host = 0;
    std::int64_t served = 0;
    std::uint64_t span_k = 0;    // next nominal release to ask the plan about
    std::int64_t next_span = 0;  // its host instant; int64 max = none
    Tick tick{};
    JobRecord record{};
    std::vector<State*> helpers;           // of a task: its pool's workers
    State* parent = nullptr;               // of a worker
    std::unique_ptr<InlineForkJoin> crew;  // of a task with workers

    State(const PlacedTask& t)
        : task(t), levels(t.level, t.lowest_level()), bucket(t.spec.consecutive_miss_limit) {}
  };
  struct CoreState {
    std::int64_t stolen_until = 0;  // theft: nothing runs, overlapping spans unite
    std::int64_t hog_left = 0;      // CPU that a hog above all tasks still wants; hogs queue
  };

  void make_pools();
  void fork(State& parent);
  void finish_share(State& s, Outcome outcome);
  [[nodiscard]] static bool joining(const State& s) noexcept;
  void arm_next(State& s, Time arrival);
  [[nodiscard]] Time release_box(const State& s, std::uint64_t k) const noexcept;
  [[nodiscard]] Time raw_arrival(const State& s, std::uint64_t k) const noexcept;
  [[nodiscard]] State* running_on(int core) noexcept;
  void arm_span(State& s);
  void start_spans();
  [[nodiscard]] std::int64_t next_event() noexcept;
  void advance(std::int64_t to) noexcept;
  void complete_due();
  bool abort_due();
  void switch_levels();
  void release_due();
  void begin_job(State& s);
  void dispatch();
  void first_dispatch(State& s);
  void finish(State& s, Outcome outcome);

  std::vector<std::unique_ptr<State>> owned_;
  CostModel& costs_;
  const Faults& faults_;
  Sink sink_;
  VirtualOptions options_;
  std::vector<Actor*> actors_;
  std::vector<CoreState> core_;
  RunPlan plan_{};
  std::int64_t now_ = 0, end_ = 0, next_boundary_ = 0;
  int cores_ = 1;
  bool stop_ = false, forked_ = false;
};

}  // namespace rt
