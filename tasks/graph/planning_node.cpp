#include "tasks/graph/planning_node.hpp"

#include <stdexcept>

#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/node_parts.hpp"

namespace tasks {

namespace {

// One radius of the base for the map and for what is planned on it.
PlanningConfig of_one_robot(const GraphConfig& config) {
  PlanningConfig c = config.planning;
  c.robot_radius_m = config.fusion.ground.robot_radius_m;
  return c;
}

// What the wheels say, in W.
drivers::RobotState in_world(drivers::RobotState s, const OdometryFrame& frame) noexcept {
  const auto X_WB =
      perception::compose({frame.X_WO[0], frame.X_WO[1], frame.X_WO[2]}, {s.x_m, s.y_m, s.yaw_rad});
  s.x_m = X_WB.x;
  s.y_m = X_WB.y;
  s.yaw_rad = X_WB.yaw;
  return s;
}

}  // namespace

PlanningNode::PlanningNode(rt::NonRealtime& nrt, const GraphConfig& config,
                           const OperatorSetup& setup, OperatorCells& cells,
                           const OperatorRequests& requests)
    : task_(nrt, of_one_robot(config), config.seed),
      cells_(cells),
      requests_(requests),
      hash_(setup.hash_outputs),
      limits_(config, cells.logs.get()) {
  // Within an open mark an event comes this often at least.
  const double event_s = 1 / config.haptic.mark_rate_hz;
  if (2 * event_s > rt::seconds(limits_.of<EdgeId::kTouch>().limit().liveness)) {
    throw std::runtime_error(
        "limits.planning.touch_liveness_ms = " +
        std::to_string(config.limits.liveness_ms[limit_row(EdgeId::kTouch, TaskId::kPlanning)]) +
        " is less than two periods of haptic.mark_rate_hz = " +
        std::to_string(config.haptic.mark_rate_hz));
  }
}

void PlanningNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const int room = PlanningTask::kMaxEvents - in_.event_count;
  const auto events = static_cast<int>(cells_.ring<EdgeId::kTouch, TaskId::kPlanning>().pop_n(
      in_.events.data() + in_.event_count, static_cast<std::size_t>(room)));
  in_.event_count += events;
  if (events > 0) touch_heard_ = tick.start;
  in_.touch_live = !task_.mark_open() ||
                   limits_.of<EdgeId::kTouch>().within(tick.start, touch_heard_, tick.start);
  take_act(tick.start);
  const auto map = cells_.take<EdgeId::kCostMap, TaskId::kPlanning>(record);
  const auto robot = cells_.take<EdgeId::kRobotState, TaskId::kPlanning>(record);
  const auto objects = cells_.take<EdgeId::kObjects, TaskId::kPlanning>(record);
  const auto mode = cells_.take<EdgeId::kMode, TaskId::kPlanning>(record);
  const auto frame = cells_.take<EdgeId::kOdometryFrame, TaskId::kPlanning>(record);
  in_.map = map.value;
  in_.robot = nullptr;
  const bool robot_known = limits_.of<EdgeId::kRobotState>().within(robot, tick.start),
             frame_known =
                 limits_.of<EdgeId::kOdometryFrame>().within(frame, tick.start) && frame->known;
  if (robot_known && frame_known) {
    robot_ = in_world(*robot, *frame);
    in_.robot = &robot_;
  }
  in_.objects =
      limits_.of<EdgeId::kObjects>().within(objects, tick.start) ? objects.value : nullptr;
  if (mode) in_.mode = *mode;
  in_.may_plan = limits_.of<EdgeId::kCostMap>().within(map, tick.start);
  if (!limits_.of<EdgeId::kMode>().within(mode, tick.start) && mode) in_.may_plan = false;
  record.input_seq[sensed_input(TaskId::kPlanning)] =
      in_.event_count > 0 ? in_.events[static_cast<std::size_t>(in_.event_count - 1)].seq : 0;
}

// One a job; what an aborted job saw is seen again.
void PlanningNode::take_act(rt::Time now) noexcept {
  const rt::Time looked = rt::time_from_ns(requests_.console_ns.load(std::memory_order_relaxed));
  if (looked != rt::Time{}) static_cast<void>(limits_.of<EdgeId::kAct>().within(now, looked, now));
  act_taken_.reset();
  OperatorAct act;
  if (in_.act || !cells_.ring<EdgeId::kAct, TaskId::kPlanning>().try_pop(act)) return;
  in_.act = act_taken_ = act;
}

rt::Health PlanningNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  record.work = out_.work;
  return health_;
}

void PlanningNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  in_.event_count = 0;
  in_.act.reset();
  Path& path = cells_.begin_write<EdgeId::kPath>();
  path = out_.path;
  const bool path_out = cells_.publish<EdgeId::kPath>(tick.start);
  TaskState& state = cells_.begin_write<EdgeId::kTask>();
  state = out_.state;
  const bool state_out = cells_.publish<EdgeId::kTask>(tick.start);
  publish_health(health_of(cells_, TaskId::kPlanning), tick.start, health_);
  auto& logs = *cells_.logs;
  auto& log = logs.of(TaskId::kPlanning);
  log_level(logs, TaskId::kPlanning, tick, logged_level_);
  if ((out_.flags & PlanningTask::kMarkTaken) != 0)
    log.write(logs.mark, tick.start, out_.state.marks);
  if ((out_.flags & PlanningTask::kGapDropped) != 0)
    log.write(logs.mark_dropped, tick.start, tick.k);
  if ((out_.flags & PlanningTask::kNewPath) != 0)
    log.write(logs.path, tick.start, out_.path.seq, out_.path.size, out_.path.mark_seq);
  if ((out_.flags & PlanningTask::kGrasp) != 0) {
    const Grasp& g = out_.grasp;
    if (g.refused == Grasp::Refused::kNo)
      log.write(logs.grasp, tick.start, static_cast<unsigned>(g.kind), g.opening_m, g.base_m);
    else
      log.write(logs.no_grasp, tick.start, static_cast<unsigned>(g.refused));
  }
  if ((out_.flags & PlanningTask::kGivenUp) != 0)
    log.write(logs.given_up, tick.start, tick.k, health_.fault);
  if (!hash_) return;
  rt::Hash64 h;
  if (path_out) hash_output(h, path);
  if (state_out) hash_output(h, state);
  record.output_hash = h.digest();
}

void PlanningNode::abandon(const rt::Tick& tick) noexcept {
  task_.abandon();
  publish_health(health_of(cells_, TaskId::kPlanning), tick.start,
                 rt::Health::of(rt::Severity::kCounted, kFaultPlanningCancelled));
}

}  // namespace tasks
