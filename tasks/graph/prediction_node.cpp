#include "tasks/graph/prediction_node.hpp"

#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/node_parts.hpp"

namespace tasks {

namespace {

// One statement of odometry's error. A camera that does not ride on the robot says nothing of it.
PredictionConfig of_one_odometry(const GraphConfig& config, const OperatorSetup& setup) {
  PredictionConfig c = config.prediction;
  c.world.odometry_translation_share = config.fusion.odometry_translation_share;
  c.world.odometry_rotation_share = config.fusion.odometry_rotation_share;
  c.world.odometry_deg_per_m = config.fusion.odometry_deg_per_m;
  c.map_correction = c.map_correction && setup.odometry_prior;
  return c;
}

}  // namespace

// In a stored map the start is where fusion finds the camera. In a new map the start defines W.
PredictionNode::PredictionNode(rt::NonRealtime& nrt, const GraphConfig& config,
                               const OperatorSetup& setup, OperatorCells& cells, LinkStatus& link)
    : task_(nrt, of_one_odometry(config, setup), setup.fusion.X_BC, config.fusion.map.empty()),
      cells_(cells),
      link_(link),
      hash_(setup.hash_outputs),
      limits_(config, cells.logs.get()) {
  in_.mode = &mode_;
}

void PredictionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const auto robot = cells_.take<EdgeId::kRobotState, TaskId::kPrediction>(record);
  const auto path = cells_.take<EdgeId::kPath, TaskId::kPrediction>(record);
  const auto camera = cells_.take<EdgeId::kCameraPose, TaskId::kPrediction>(record);
  const auto mode = cells_.take<EdgeId::kMode, TaskId::kPrediction>(record);
  in_.robot = robot.value;
  in_.robot_live = limits_.of<EdgeId::kRobotState>().within(robot, tick.start);
  in_.robot_unsure = robot.unsure;
  path_live_ = !path || path->seq == 0 || limits_.of<EdgeId::kPath>().within(path, tick.start);
  in_.path = path && path->seq != 0 && path_live_ ? path.value : nullptr;
  in_.camera =
      limits_.of<EdgeId::kCameraPose>().within(camera, tick.start) ? camera.value : nullptr;
  const auto drive = cells_.take<EdgeId::kDrive, TaskId::kPrediction>(record);
  if (drive) drive_ = *drive;
  drive_latched_ = {static_cast<bool>(drive), drive.seq, drive.at};
  // One that was let go does not grow old.
  const bool driven =
      drive && drive_.held && limits_.of<EdgeId::kDrive>().within(drive, tick.start);
  in_.drive = driven ? &drive_ : nullptr;
  if (mode) mode_ = *mode;
  mode_live_ = limits_.of<EdgeId::kMode>().within(mode, tick.start);
  in_.round_trip = rt::Nanos{link_.round_trip_ns.load(std::memory_order_relaxed)};
  in_.round_trip_uncertainty = rt::Nanos{link_.uncertainty_ns.load(std::memory_order_relaxed)};
  in_.delay_known = in_.round_trip.count() > 0;
}

rt::Health PredictionNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  // Without a mode the base halts. `operator_engaged` stays, so the robot's box keeps its mode.
  if (!mode_live_) out_.goal.engaged = 0;
  if (out_.frame.held == Held::kNo && !mode_live_)
    out_.frame.held = Held::kModeSilent;
  else if (out_.frame.held == Held::kNo && !path_live_)
    out_.frame.held = Held::kPathOld;
  record.work = 1;
  return health_;
}

void PredictionNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  cells_.begin_write<EdgeId::kGoal>() = out_.goal;
  cells_.publish<EdgeId::kGoal>(tick.start);
  OdometryFrame& frame = cells_.begin_write<EdgeId::kOdometryFrame>();
  frame = out_.frame;
  const bool frame_out = cells_.publish<EdgeId::kOdometryFrame>(tick.start);
  publish_health(health_of(cells_, TaskId::kPrediction), tick.start, health_);
  if (!hash_) return;
  rt::Hash64 h;
  hash_output(h, out_.goal);
  if (frame_out) hash_output(h, frame);
  record.output_hash = h.digest();
}

}  // namespace tasks
