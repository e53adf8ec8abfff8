#include "tasks/graph/robot_io_node.hpp"

#include <algorithm>
#include <cmath>

#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/node_parts.hpp"

namespace tasks {

RobotIoNode::RobotIoNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
                         RobotCells& cells, LinkStatus& link)
    : task_(nrt, config.robot_io),
      bus_(*setup.bus),
      safety_(setup.safety),
      cells_(cells),
      link_(link),
      twin_cpu_(setup.bus_twin_cpu),
      hash_(setup.hash_outputs),
      limits_(config, cells.logs.get()) {
  in_.mode = &mode_;
}

// A job's cycle on the bus: states in here, setpoints out in commit(). The safety lines come first:
// what an open emergency stop forbids is not sent in this job any more.
void RobotIoNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  if (safety_ != nullptr) safety_->sense(tick.start, in_.safety);
  in_.sent = sent_;
  in_.bus = bus_.sense(tick.start, in_.motors);
  const bool of_write = in_.bus == drivers::BusStatus::kOk && sent_ != drivers::BusStatus::kOk;
  in_.bus_detail = of_write ? sent_detail_ : bus_.detail();
  const auto goal = cells_.take<EdgeId::kGoal, TaskId::kRobotIo>(record);
  in_.goal = goal.value;
  in_.goal_unsure = goal.unsure;
  const auto mode = cells_.take<EdgeId::kRobotMode, TaskId::kRobotIo>(record);
  if (mode) mode_ = *mode;
  heard_ = mode_.mode;
  if (!limits_.of<EdgeId::kRobotMode>().within(mode, tick.start) && mode_.mode == Mode::kEngaged)
    mode_.mode = Mode::kRampDown;
  const std::int64_t heard = link_.last_heard_ns.load(std::memory_order_relaxed);
  in_.link_heard = heard != 0;
  in_.link_heard_at = rt::time_from_ns(heard);
  in_.link_closed = link_.closed.load(std::memory_order_relaxed);
  // Only logged here: the task goes by how long each goal says that it is valid.
  if (goal && heard != 0)
    static_cast<void>(
        limits_.of<EdgeId::kGoal>().within(tick.start, in_.link_heard_at, goal->made, goal.unsure));
  record.input_seq[sensed_input(TaskId::kRobotIo)] = in_.motors.seq;
}

// How long the newest press waited for the job that acted on it.
void RobotIoNode::log_estop(const rt::Tick& tick) noexcept {
  const rt::Time opened = in_.safety.estop_opened;
  if (opened == logged_estop_) return;
  logged_estop_ = opened;
  auto& logs = *cells_.logs;
  logs.of(TaskId::kRobotIo).write(logs.estop, tick.start, 1e6 * rt::seconds(tick.start - opened));
}

// Who has a fault. Of slaves that are not in OP or do not answer the cycles name one in turn: these
// are one fault, and of it the slave that was seen first.
void RobotIoNode::log_bus(const rt::Tick& tick) noexcept {
  auto& logs = *cells_.logs;
  auto& log = logs.of(TaskId::kRobotIo);
  LastingFaults::Ended over;
  while (lasting_.take_ended(tick.start, over)) logs.bus.say_over(log, tick.start, over);
  const BusReport& now = out_.bus;
  if (now.fault == rt::kNoFault || now.fault == robot_io_fault::kFrameLost) return;
  // Which slave it is, is known some cycles later.
  if (now.fault == robot_io_fault::kSlaveState && now.detail.slave == 0) return;
  const bool in_turn =
      now.fault == robot_io_fault::kSlaveState || now.fault == robot_io_fault::kSlavesMissing;
  const int who = in_turn ? 0 : now.wheel >= 0 ? now.wheel + 1 : now.detail.slave;
  if (lasting_.is_there(now.fault, who, tick.start)) logs.bus.say(log, tick.start, now);
}

rt::Health RobotIoNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  // What supervision said last, not the ramp down that latch() may have put in its place.
  out_.state.mode = static_cast<std::uint8_t>(heard_);
  record.work = 1;
  return health_;
}

void RobotIoNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  if (out_.rearm_motors) bus_.rearm();
  // The bus is told from when on the setpoints act. On the virtual clock that is the job's end. On
  // the real clock the end is not known yet (0), and the start is told.
  sent_ = bus_.act(std::max(tick.start, rt::time_from_ns(record.end_ns)), out_.setpoints);
  sent_detail_ = bus_.detail();
  log_bus(tick);
  if (safety_ != nullptr) {
    if (out_.rearm_motors) safety_->allow_again();
    safety_->act(tick.start, out_.safety);
    log_estop(tick);
  }
  cells_.begin_write<EdgeId::kRobotState>() = out_.state;
  cells_.publish<EdgeId::kRobotState>(tick.start);
  publish_health(health_of(cells_, TaskId::kRobotIo), tick.start, health_);
  auto& logs = *cells_.logs;
  auto& log = logs.of(TaskId::kRobotIo);
  if (out_.telemetry.goals_refused != logged_refused_)
    log.write(logs.goal_refused, tick.start, logged_refused_ = out_.telemetry.goals_refused);
  if (out_.telemetry.goals_expired != logged_expired_)
    log.write(logs.goal_expired, tick.start, logged_expired_ = out_.telemetry.goals_expired);
  if (tick.k % 10 == 0) {
    RobotSample s;
    s.stamp = tick.start;
    s.x_m = static_cast<float>(out_.state.x_m);
    s.y_m = static_cast<float>(out_.state.y_m);
    s.yaw_rad = static_cast<float>(out_.state.yaw_rad);
    s.tracking_error_m = static_cast<float>(out_.telemetry.tracking_error_m);
    s.goal_distance_m = static_cast<float>(out_.telemetry.goal_distance_m);
    s.speed_m_per_s = static_cast<float>(std::hypot(out_.state.vx, out_.state.vy));
    s.goal_seq = out_.state.goal_seq;
    s.path_seq = in_.goal != nullptr ? in_.goal->path_seq : 0;
    s.driving = out_.telemetry.driving;
    s.mode = out_.state.mode;
    cells_.robot_samples.try_push(s);
  }
  if (!hash_) return;
  rt::Hash64 h;
  hash_output(h, out_.setpoints);
  h.word(out_.rearm_motors ? 1 : 0);
  hash_output(h, out_.state);
  if (safety_ != nullptr) {
    h.word(out_.safety.alive ? 1 : 0);
    h.word(static_cast<std::uint64_t>(out_.safety.lamp));
  }
  record.output_hash = h.digest();
}

}  // namespace tasks
