#include "tasks/graph/robot_nodes.hpp"

#include <cmath>

#include "tasks/graph/output_hash.hpp"

namespace tasks {

// ---------------------------------------------------------------- robot_io

RobotIoNode::RobotIoNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
                         RobotCells& cells, LinkStatus& link)
    : task_(nrt, config.robot_io),
      bus_(*setup.bus),
      cells_(cells),
      link_(link),
      twin_cpu_(setup.bus_twin_cpu),
      hash_(setup.hash_outputs),
      goal_in_(limit_row(EdgeId::kGoal, TaskId::kRobotIo), config, cells.logs.get()),
      mode_in_(limit_row(EdgeId::kRobotMode, TaskId::kRobotIo), config, cells.logs.get()) {
  in_.mode = &mode_;
}

// One bus frame a tick carries the setpoints of the last committed job out and the states in.
void RobotIoNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  in_.bus = bus_.exchange(tick.start, setpoints_, in_.motors);
  const auto goal = cells_.goal.acquire_if_new(RobotCells::kGoalIo);
  in_.goal = goal.value;
  in_.goal_unsure = goal.unsure;
  const auto mode = cells_.mode.acquire_if_new(RobotCells::kModeIo);
  if (mode) mode_ = *mode;
  heard_ = mode_.mode;
  if (!mode_in_.within(mode, tick.start) && mode_.mode == Mode::kEngaged)
    mode_.mode = Mode::kRampDown;
  const std::int64_t heard = link_.last_heard_ns.load(std::memory_order_relaxed);
  in_.link_heard = heard != 0;
  in_.link_heard_at = rt::time_from_ns(heard);
  in_.link_closed = link_.closed.load(std::memory_order_relaxed);
  // Told here; the task goes by how long each goal says that it is valid.
  if (goal && heard != 0)
    static_cast<void>(goal_in_.within(tick.start, in_.link_heard_at, goal->made, goal.unsure));
  record.input_seq[0] = goal.seq;
  record.input_seq[1] = mode_.seq;
  record.input_seq[2] = in_.motors.seq;
}

rt::Health RobotIoNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  // The base ramps down; the operator's box is not told of a mode that nobody has entered.
  out_.state.mode = static_cast<std::uint8_t>(heard_);
  record.work = 1;
  return health_;
}

void RobotIoNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  if (out_.rearm_motors) bus_.rearm();
  setpoints_ = out_.setpoints;
  cells_.state.begin_write() = out_.state;
  cells_.state.publish(tick.start);
  publish_health(*cells_.health[index_of(TaskId::kRobotIo)], tick.start, health_);
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
  record.output_hash = h.digest();
}

// ---------------------------------------------------------------- capture

CaptureNode::CaptureNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
                         RobotCells& cells)
    : task_(nrt, config.capture, rt::Box::kRobot),
      camera_(*setup.camera),
      cells_(cells),
      twin_cpu_(setup.camera_twin_cpu),
      hash_(setup.hash_outputs),
      frame_(std::make_unique<perception::RgbdFrame>()) {
  in_.frame = frame_.get();
}

void CaptureNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const auto status = camera_.poll(tick.start, *frame_);
  in_.fresh = status == drivers::CameraStatus::kFrame;
  out_.slot = &cells_.encoded.begin_write();
  out_.written = false;
  record.input_seq[0] = frame_->seq;
}

rt::Health CaptureNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  record.work = out_.written ? out_.slot->depth_size + out_.slot->colour_size : 0;
  return health_;
}

void CaptureNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  if (out_.written) {
    if (hash_) {
      rt::Hash64 h;
      hash_output(h, *out_.slot);
      record.output_hash = h.digest();
    }
    cells_.encoded.publish(tick.start);
  }
  publish_health(*cells_.health[index_of(TaskId::kCapture)], tick.start, health_);
  log_level(*cells_.logs, TaskId::kCapture, tick, logged_level_);
}

// ---------------------------------------------------------------- supervision

namespace {

using std::chrono::milliseconds;
constexpr std::array<Watch, 2> kRobotWatches{{{590, milliseconds{50}}, {690, milliseconds{1000}}}};
constexpr std::array<TaskId, 2> kRobotWatched{TaskId::kRobotIo, TaskId::kCapture};

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
      mode_gate_(setup.faults, "robot_mode"),
      goal_in_(limit_row(EdgeId::kGoal, TaskId::kRobotSupervision), config, cells.logs.get()) {}

void RobotSupervisionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  for (std::size_t i = 0; i < kRobotWatched.size(); ++i) {
    const auto health = cells_.health[index_of(kRobotWatched[i])]->acquire_if_new(0);
    auto& report = in_.tasks[i];
    report.heard = static_cast<bool>(health);
    if (health) {
      report.heartbeat = health->heartbeat;
      report.health = health->health;
    }
    record.input_seq[i] = health.seq;
  }
  const auto goal = cells_.goal.acquire_if_new(RobotCells::kGoalSupervision);
  record.input_seq[2] = goal.seq;
  const std::int64_t heard = link_.last_heard_ns.load(std::memory_order_relaxed);
  in_.link_expected = link_.expected.load(std::memory_order_relaxed);
  in_.link_heard = heard != 0;
  in_.link_last = rt::time_from_ns(heard);
  in_.link_refused = link_.refused.load(std::memory_order_relaxed);
  in_.link_closed = link_.closed.load(std::memory_order_relaxed);
  in_.watchdog_bit = requests_.watchdog_bit.load(std::memory_order_relaxed);
  // The operator's engage and clear travel in the goal; without a goal there is none.
  using Engage = SupervisionTask::Engage;
  using Clear = SupervisionTask::Clear;
  // Of long ago, while the line is live: as if there were none. A silent line is the task's matter.
  const bool old = goal && heard != 0 &&
                   !goal_in_.within(tick.start, in_.link_last, goal->made, goal.unsure) &&
                   goal_in_.state() == LimitWatch::State::kOld;
  const drivers::RobotGoal* const asked = old ? nullptr : goal.value;
  in_.requests.engage = asked == nullptr               ? Engage::kAbsent
                        : asked->operator_engaged != 0 ? Engage::kYes
                                                       : Engage::kNo;
  in_.peer_mode = asked != nullptr && asked->operator_engaged != 0 ? Mode::kEngaged : Mode::kHold;
  in_.requests.clear = asked == nullptr             ? Clear::kAbsent
                       : asked->operator_clear != 0 ? Clear::kYes
                                                    : Clear::kNo;
  in_.requests.ramp_down = requests_.ramp_down.load(std::memory_order_relaxed);
  in_.requests.stop = requests_.stop.load(std::memory_order_relaxed);
}

rt::Health RobotSupervisionNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  record.work = 1;
  return task_.step(tick, in_, out_);
}

void RobotSupervisionNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  log_mode(*cells_.logs, TaskId::kRobotSupervision, tick.start, out_.mode, logged_mode_);
  ModeMsg& mode = cells_.mode.begin_write();
  mode = out_.mode;
  const bool mode_out = publish(mode_gate_, cells_.mode, mode, tick.start);
  if (!hash_ || !mode_out) return;
  rt::Hash64 h;
  hash_output(h, mode);
  record.output_hash = h.digest();
}

}  // namespace tasks
