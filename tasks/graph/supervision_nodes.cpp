#include "tasks/graph/supervision_nodes.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>

#include "tasks/contract/table.hpp"
#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/node_parts.hpp"
#include "tasks/supervision/peer_rules.hpp"

namespace tasks {

namespace {

// Whom the supervision of a box watches: the rows of kTaskTable that say so, in their order.
template <rt::Box B>
[[nodiscard]] consteval auto watched_in() {
  constexpr auto watched = [](const TaskRow& t) { return t.box == B && t.watch.fault != 0; };
  constexpr auto count = std::count_if(kTaskTable.begin(), kTaskTable.end(), watched);
  std::array<TaskRow, static_cast<std::size_t>(count)> rows{};
  std::copy_if(kTaskTable.begin(), kTaskTable.end(), rows.begin(), watched);
  return rows;
}

template <std::size_t N>
[[nodiscard]] consteval std::array<Watch, N> watches_of(const std::array<TaskRow, N>& rows) {
  std::array<Watch, N> watches{};
  for (std::size_t i = 0; i < N; ++i)
    watches[i] = {rows[i].watch.fault, std::chrono::milliseconds{rows[i].watch.silence_ms}};
  return watches;
}

// Newest health of each watched task, and its number.
template <class Cells, std::size_t N>
void latch_health(Cells& cells, const std::array<TaskRow, N>& watched, SupervisionTask::In& in,
                  rt::JobRecord& record) noexcept {
  for (std::size_t i = 0; i < N; ++i) {
    const auto health = health_of(cells, watched[i].id).acquire_if_new(0);
    auto& report = in.tasks[i];
    report.heard = static_cast<bool>(health);
    if (health) {
      report.heartbeat = health->heartbeat;
      report.health = health->health;
    }
    record.input_seq[static_cast<std::size_t>(watched[i].watch.input)] = health.seq;
  }
}

constexpr auto kOperatorWatched = watched_in<rt::Box::kOperator>();
constexpr auto kOperatorWatches = watches_of(kOperatorWatched);

}  // namespace

LatchedStatus latched_status(const SupervisionTask::In& in) noexcept {
  LatchedStatus s;
  s.last_heard_ns = rt::ns_of(in.link_last);
  s.refused = in.link_refused;
  s.closed = in.link_closed;
  s.session = in.link_session;
  s.expected = in.link_expected;
  s.engage = static_cast<int>(in.requests.engage);
  s.ramp_down = in.requests.ramp_down;
  s.stop = in.requests.stop;
  s.clear = in.requests.clear == SupervisionTask::Clear::kYes;
  s.watchdog_bit = in.watchdog_bit;
  return s;
}

SupervisionNode::SupervisionNode(rt::NonRealtime& nrt, const GraphConfig& config,
                                 OperatorCells& cells, LinkStatus& link, OperatorRequests& requests,
                                 const OperatorSetup& setup)
    : task_(nrt, config.supervision, rt::Box::kOperator, kOperatorWatches.data(),
            static_cast<int>(kOperatorWatches.size()), setup.mode_gate),
      cells_(cells),
      link_(link),
      requests_(requests),
      hash_(setup.hash_outputs),
      limits_(config, cells.logs.get()) {}

void SupervisionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  latch_health(cells_, kOperatorWatched, in_, record);
  const auto robot = cells_.take<EdgeId::kRobotState, TaskId::kSupervision>(record);
  in_.peer_mode = robot ? static_cast<Mode>(robot->mode) : Mode::kInit;
  using Pause = SupervisionTask::Pause;
  in_.peer_pause = robot ? static_cast<Pause>(robot->pauses) : Pause::kNone;
  in_.peer_mode_at = robot ? robot->made : rt::Time{};
  const std::int64_t heard = link_.last_heard_ns.load(std::memory_order_relaxed);
  in_.link_expected = link_.expected.load(std::memory_order_relaxed);
  in_.link_heard = heard != 0 && robot;
  auto& limit = limits_.of<EdgeId::kRobotState>();
  // By when the robot's box made it: its motors may have failed, and it tells so.
  const bool state_old = robot && robot->made != rt::Time{} &&
                         !limit.within(tick.start, robot.at, robot->made, robot.unsure);
  in_.link_last = link_heard_with_state(rt::time_from_ns(heard), robot.at, state_old, tick.start,
                                        limit.limit().liveness);
  in_.link_refused = link_.refused.load(std::memory_order_relaxed);
  in_.link_closed = link_.closed.load(std::memory_order_relaxed);
  in_.link_session = link_.session.load(std::memory_order_relaxed);
  in_.watchdog_bit = requests_.watchdog_bit.load(std::memory_order_relaxed);
  in_.requests.engage =
      static_cast<SupervisionTask::Engage>(requests_.engage.load(std::memory_order_relaxed));
  in_.requests.ramp_down = requests_.ramp_down.load(std::memory_order_relaxed);
  in_.requests.stop = requests_.stop.load(std::memory_order_relaxed);
  using Clear = SupervisionTask::Clear;
  in_.requests.clear = requests_.clear.load(std::memory_order_relaxed) ? Clear::kYes : Clear::kNo;
}

rt::Health SupervisionNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  record.work = 1;
  return task_.step(tick, in_, out_);
}

void SupervisionNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  log_mode(*cells_.logs, TaskId::kSupervision, tick.start, out_.mode, logged_mode_);
  ModeMsg& mode = cells_.begin_write<EdgeId::kMode>();
  mode = out_.mode;
  const bool mode_out = cells_.publish<EdgeId::kMode>(tick.start);
  if (!hash_ || !mode_out) return;
  rt::Hash64 h;
  hash_output(h, mode);
  record.output_hash = h.digest();
}

// ---------------------------------------------------------------- robot box

namespace {

constexpr auto kRobotWatched = watched_in<rt::Box::kRobot>();
constexpr auto kRobotWatches = watches_of(kRobotWatched);

}  // namespace

RobotSupervisionNode::RobotSupervisionNode(rt::NonRealtime& nrt, const GraphConfig& config,
                                           RobotCells& cells, LinkStatus& link,
                                           OperatorRequests& requests, const RobotSetup& setup)
    : task_(nrt, config.supervision, rt::Box::kRobot, kRobotWatches.data(),
            static_cast<int>(kRobotWatches.size()), setup.mode_gate),
      cells_(cells),
      link_(link),
      requests_(requests),
      hash_(setup.hash_outputs),
      estop_fitted_(setup.safety != nullptr),
      limits_(config, cells.logs.get()) {}

void RobotSupervisionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  latch_health(cells_, kRobotWatched, in_, record);
  // robot_io samples the emergency stop in each job. A press is its own fault, in its health; here
  // only how old the sample is counts.
  for (std::size_t i = 0; estop_fitted_ && i < kRobotWatched.size(); ++i) {
    if (kRobotWatched[i].id != TaskId::kRobotIo) continue;
    in_.estop_fitted = in_.tasks[i].heard;
    in_.estop_sampled = in_.tasks[i].heartbeat;
  }
  const auto goal = cells_.take<EdgeId::kGoal, TaskId::kRobotSupervision>(record);
  const std::int64_t heard = link_.last_heard_ns.load(std::memory_order_relaxed);
  in_.link_expected = link_.expected.load(std::memory_order_relaxed);
  in_.link_heard = heard != 0;
  in_.link_last = rt::time_from_ns(heard);
  in_.link_refused = link_.refused.load(std::memory_order_relaxed);
  in_.link_closed = link_.closed.load(std::memory_order_relaxed);
  in_.link_session = link_.session.load(std::memory_order_relaxed);
  in_.watchdog_bit = requests_.watchdog_bit.load(std::memory_order_relaxed);
  // While the line is live, a goal that is too old counts as no goal. A silent line is judged by
  // the task.
  const bool old =
      goal && heard != 0 &&
      !limits_.of<EdgeId::kGoal>().within(tick.start, in_.link_last, goal->made, goal.unsure) &&
      limits_.of<EdgeId::kGoal>().state() == LimitWatch::State::kOld;
  // What came over an older connection asks nothing any more: another operator may have said it.
  if (in_.link_session != goals_session_) {
    goals_session_ = in_.link_session;
    void_goal_ = goal ? goal->made : rt::Time{};
  }
  const bool is_void = goal && goal->made == void_goal_;
  std::optional<GoalAsks> goal_asks;
  if (goal && !old && !is_void)
    goal_asks = GoalAsks{goal->operator_engaged, goal->operator_clear != 0};
  const PeerAsks asked = asked_by_goal(goal_asks);
  in_.requests.engage = asked.engage;
  in_.requests.clear = asked.clear;
  in_.peer_mode = asked.peer_mode;
  in_.requests.ramp_down = requests_.ramp_down.load(std::memory_order_relaxed);
  in_.requests.stop = requests_.stop.load(std::memory_order_relaxed);
}

rt::Health RobotSupervisionNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  record.work = 1;
  return task_.step(tick, in_, out_);
}

void RobotSupervisionNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  log_mode(*cells_.logs, TaskId::kRobotSupervision, tick.start, out_.mode, logged_mode_);
  ModeMsg& mode = cells_.begin_write<EdgeId::kRobotMode>();
  mode = out_.mode;
  const bool mode_out = cells_.publish<EdgeId::kRobotMode>(tick.start);
  if (!hash_ || !mode_out) return;
  rt::Hash64 h;
  hash_output(h, mode);
  record.output_hash = h.digest();
}

}  // namespace tasks
