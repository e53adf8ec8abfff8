#include "tasks/graph/operator_nodes.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "rt/effect_count.hpp"
#include "tasks/graph/output_hash.hpp"

namespace tasks {

namespace {

std::array<float, 3> to_floats(const Vec3& v) noexcept {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

HealthCell& health_of(OperatorCells& cells, TaskId id) noexcept {
  return *cells.health[index_of(id)];
}

}  // namespace

// ---------------------------------------------------------------- haptic

HapticNode::HapticNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
                       OperatorCells& cells, double period_s)
    : task_(nrt, config.haptic, setup.device->properties(), period_s,
            0.5 * config.fusion.tsdf.voxel_size_m * config.fusion.patch_nodes),
      device_(*setup.device),
      cells_(cells),
      twin_cpu_(setup.device_twin_cpu),
      hash_(setup.hash_outputs),
      touch_gate_(setup.faults, "touch"),
      hand_gate_(setup.faults, "hand"),
      patch_in_(limit_row(EdgeId::kPatch, TaskId::kHaptic), config, cells.logs.get()),
      surface_in_(limit_row(EdgeId::kSurface, TaskId::kHaptic), config, cells.logs.get()),
      mode_in_(limit_row(EdgeId::kMode, TaskId::kHaptic), config, cells.logs.get()),
      camera_in_(limit_row(EdgeId::kCameraPose, TaskId::kHaptic), config, cells.logs.get()) {}

void HapticNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  in_.stylus_ok = device_.sense(tick.start, in_.stylus);
  in_.patch_newest = nullptr;
  if (task_.wants_patch()) {
    const auto patch = cells_.patch.acquire_if_new(OperatorCells::kPatchHaptic);
    in_.patch_newest = patch.value;
    record.input_seq[0] = patch.seq;
    // Told here; the task ramps the force down, since only it knows of a blend that it finishes first.
    static_cast<void>(patch_in_.within(patch, tick.start));
  }
  if (cells_.surface != nullptr) {
    // Read in place: the one that is latched stays as it is until the next latch.
    const auto surface = cells_.surface->acquire_if_new(OperatorCells::kSurfaceHaptic);
    in_.surface = surface.value;
    static_cast<void>(surface_in_.within(surface, tick.start));
    in_.surface_stale = surface_in_.state() == LimitWatch::State::kSilent;
    record.input_seq[4] = surface.seq;
  }
  const auto mode = cells_.mode.acquire_if_new(OperatorCells::kModeHaptic);
  if (mode) in_.mode = *mode;
  const bool may_push = in_.mode.mode == Mode::kHold || in_.mode.mode == Mode::kEngaged;
  if (!mode_in_.within(mode, tick.start) && may_push) in_.mode.mode = Mode::kRampDown;
  // While the clutch is held the workspace turns to where the camera looks, of which the operator sees the image.
  const auto camera = cells_.camera_pose.acquire_if_new(OperatorCells::kCameraHaptic);
  in_.clutch = in_.stylus_ok && in_.stylus.clutch;
  if (!camera_in_.within(camera, tick.start))
    in_.view_yaw_rad.reset();
  else if (camera->claimed)
    in_.view_yaw_rad = yaw_of_view(camera->X_WC.linear());
  // A box that holds because of a fault stays limp until the next engage: force does not come back
  // by a timeout.
  if (in_.mode.mode == Mode::kHold && in_.mode.cause != rt::kNoFault)
    in_.mode.mode = Mode::kRampDown;
  record.input_seq[1] = in_.mode.seq;
  record.input_seq[2] = in_.stylus.seq;
  record.input_seq[3] = camera.seq;
}

rt::Health HapticNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  record.work = out_.telemetry.work;
  return health_;
}

void HapticNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  device_.act(tick.start, out_.force);
  HapticState& hand = cells_.hand.begin_write();
  hand = out_.state;
  const bool hand_out = publish(hand_gate_, cells_.hand, hand, tick.start);
  for (int i = 0; i < out_.event_count; ++i) send(tick, out_.events[static_cast<std::size_t>(i)]);
  publish_health(health_of(cells_, TaskId::kHaptic), tick.start, health_);
  const auto& t = out_.telemetry;
  HapticSample s;
  s.stamp = tick.start;
  s.p_WH = to_floats(out_.state.p_WH);
  s.p_WP = to_floats(out_.state.p_WP);
  s.f_W = to_floats(out_.state.f_H_W);
  s.penetration_m = static_cast<float>(t.penetration_m);
  s.force_N = static_cast<float>(out_.force.f_H_D.norm());
  s.step_raw_N = static_cast<float>(t.step_raw_N);
  s.step_N = static_cast<float>(t.step_N);
  s.gain = static_cast<float>(t.gain);
  s.energy_J = static_cast<float>(t.energy_J);
  s.booked_J = static_cast<float>(t.booked_J);
  s.patch_age_s = static_cast<float>(t.patch_age_s);
  s.reach = static_cast<float>(t.reach);
  s.work = t.work;
  s.contacts = out_.state.contacts;
  s.in_contact = t.in_contact;
  s.guard_active = t.guard_active;
  s.guard_use = t.guard_use;
  s.stale = t.stale;
  s.held = t.held;
  s.button = out_.state.button;
  s.clutched = t.clutched;
  s.device_state = static_cast<std::uint8_t>(in_.stylus.state);
  s.finite = out_.force.f_H_D.allFinite();
  cells_.haptic_samples.try_push(s);
  if (!hash_) return;
  rt::Hash64 h;
  hash_output(h, out_.force.f_H_D);
  if (hand_out) hash_output(h, hand);
  for (int i = 0; i < out_.event_count; ++i)
    hash_output(h, out_.events[static_cast<std::size_t>(i)]);
  record.output_hash = h.digest();
}

void HapticNode::send(const rt::Tick& tick, const TouchEvent& event) noexcept {
  push(touch_gate_, cells_.touch, event, touch_gap_);
  auto& logs = *cells_.logs;
  auto& log = logs.of(TaskId::kHaptic);
  if (touch_gap_) log.write(logs.events_lost, tick.start, event.seq);
  if (event.kind == TouchEvent::Kind::kContactBegin) {
    log.write(logs.contact, tick.start, event.p_W.x(), event.p_W.y(), event.p_W.z(), event.force_N);
  }
  if (event.kind == TouchEvent::Kind::kSurfaceLeft)
    log.write(logs.surface_left, tick.start, event.p_W.x(), event.p_W.y(), event.p_W.z());
}

// ---------------------------------------------------------------- fusion

namespace {

// The ray cast of the published method is made where somebody reads it.
FusionSetup as_touched(FusionSetup setup, const HapticConfig& haptic) {
  setup.ray_cast = haptic.asks_for_ray_cast();
  return setup;
}

}  // namespace

FusionNode::FusionNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
                       OperatorCells& cells, const OperatorRequests& requests)
    : task_(std::make_unique<FusionTask>(nrt, config.fusion,
                                         as_touched(setup.fusion, config.haptic))),
      cells_(cells),
      requests_(requests),
      drawn_(config.fusion.ground),
      hash_(setup.hash_outputs),
      odometry_prior_(setup.odometry_prior),
      patch_gate_(setup.faults, "patch"),
      surface_gate_(setup.faults, "surface"),
      view_gate_(setup.faults, "view"),
      mesh_gate_(setup.faults, "mesh"),
      map_gate_(setup.faults, "cost_map"),
      camera_gate_(setup.faults, "camera_pose"),
      objects_gate_(setup.faults, "objects"),
      frame_in_(limit_row(EdgeId::kFrame, TaskId::kFusion), config, cells.logs.get()),
      hand_in_(limit_row(EdgeId::kHand, TaskId::kFusion), config, cells.logs.get()),
      robot_in_(limit_row(EdgeId::kRobotState, TaskId::kFusion), config, cells.logs.get()),
      edit_in_(limit_row(EdgeId::kEdit, TaskId::kFusion), config, cells.logs.get()) {
  if (cells.surface != nullptr) {
    const int liveness_ms = config.limits.liveness_ms[limit_row(EdgeId::kSurface, TaskId::kHaptic)];
    const double cast_s = config.fusion.surface_periods * rt::seconds(setup.fusion.period);
    if (2e3 * cast_s > liveness_ms + 1) {
      throw std::runtime_error(
          "limits.haptic.surface_liveness_ms = " + std::to_string(liveness_ms) +
          " is less than two ray casts of fusion.surface_periods = " +
          std::to_string(config.fusion.surface_periods) + " jobs");
    }
    const auto& camera = setup.fusion.camera;
    const auto pixels =
        static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    cells.surface->for_each_slot(nrt, [&](SurfacePoints& s) { s.resize(pixels); });
  }
  if (config.fusion.map.empty()) return;
  const auto file = perception::read_map_file(nrt, config.fusion.map);
  if (!file) throw std::runtime_error("fusion.map: " + file.error());
  if (const auto ok = task_->load_map(nrt, file.value()); !ok)
    throw std::runtime_error("fusion.map: " + ok.error());
}

// One a job, and none while the last region is still being cleared: the ring keeps the order.
void FusionNode::take_edit(rt::Time now) noexcept {
  const rt::Time looked = rt::time_from_ns(requests_.console_ns.load(std::memory_order_relaxed));
  if (looked != rt::Time{}) static_cast<void>(edit_in_.within(now, looked, now));
  in_.clear_W.reset();
  in_.virtual_obstacles_changed = edit_refused_ = false;
  edit_.reset();
  SceneEdit edit;
  if (task_->clearing() || !cells_.edit.try_pop(edit)) return;
  edit_ = edit;
  if (edit.kind == SceneEdit::Kind::kClear) {
    const Eigen::AlignedBox3d box_W = box_of(edit);
    if (FusionTask::clearable(box_W)) in_.clear_W = box_W;
    edit_refused_ = !in_.clear_W;
    return;
  }
  edit_refused_ = !drawn_.apply(edit);
  in_.virtual_obstacles = drawn_.all();
  in_.virtual_obstacles_changed = !edit_refused_;
}

void FusionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const auto frame = cells_.frame.acquire_if_new(OperatorCells::kFrameFusion);
  in_.frame = frame.value;
  in_.frame_fresh = frame_in_.within(frame, tick.start) && frame.seq != frame_seq_;
  frame_seq_ = frame.seq;
  const auto hand = cells_.hand.acquire_if_new(OperatorCells::kHandFusion);
  // A hand of which nothing is heard any more is not followed on to where it was going.
  if (hand_in_.within(hand, tick.start))
    in_.hand = *hand;
  else
    in_.hand.v_WH = Vec3::Zero();
  const auto robot = cells_.robot_state.acquire_if_new(OperatorCells::kStateFusion);
  in_.odometry.reset();
  if (robot_in_.within(robot, tick.start) && odometry_prior_) {
    OdometryPrior prior;
    prior.taken = robot->taken;
    prior.X_OB.linear() = Eigen::AngleAxisd(robot->yaw_rad, Vec3::UnitZ()).toRotationMatrix();
    prior.X_OB.translation() = Vec3(robot->x_m, robot->y_m, 0);
    prior.v_OB_B = Vec3(robot->vx, robot->vy, 0);
    prior.w_OB_B = Vec3(0, 0, robot->wz);
    in_.odometry = prior;
  }
  record.input_seq[0] = frame.seq;
  record.input_seq[1] = hand.seq;
  record.input_seq[2] = robot.seq;
  take_edit(tick.start);
  in_.mesh_taken = requests_.mesh_taken.load(std::memory_order_relaxed);
  out_.mesh = cells_.mesh == nullptr ? nullptr : &cells_.mesh->begin_write();
  out_.patch = &cells_.patch.begin_write();
  out_.surface = cells_.surface == nullptr ? nullptr : &cells_.surface->begin_write();
  out_.view = &cells_.view.begin_write();
  out_.cost_map = &cells_.cost_map.begin_write();
  out_.objects = &cells_.objects.begin_write();
}

rt::Health FusionNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_->step(tick, in_, out_);
  record.work = out_.work;
  return health_;
}

void FusionNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  rt::Hash64 h;
  // What a gate lets out is hashed as it went out.
  const auto send = [&](EdgeGate& gate, auto& cell, auto& slot) {
    if (publish(gate, cell, slot, tick.start) && hash_) hash_output(h, slot);
  };
  if (out_.patch_written) send(patch_gate_, cells_.patch, *out_.patch);
  if (out_.surface_written) rt::effect_ran(rt::Effect::kForceShading);
  if (out_.surface_written) send(surface_gate_, *cells_.surface, *out_.surface);
  if (out_.view_written) send(view_gate_, cells_.view, *out_.view);
  if (out_.mesh_written) rt::effect_ran(rt::Effect::kMesh);
  if (out_.mesh_written) send(mesh_gate_, *cells_.mesh, *out_.mesh);
  if (out_.cost_map_written) send(map_gate_, cells_.cost_map, *out_.cost_map);
  if (out_.camera_written) {
    CameraPose& camera = cells_.camera_pose.begin_write();
    camera = out_.camera;
    send(camera_gate_, cells_.camera_pose, camera);
  }
  if (out_.objects_written) rt::effect_ran(rt::Effect::kObjects);
  if (out_.objects_written) send(objects_gate_, cells_.objects, *out_.objects);
  if (hash_) record.output_hash = h.digest();
  publish_health(health_of(cells_, TaskId::kFusion), tick.start, health_);
  log_level(*cells_.logs, TaskId::kFusion, tick, logged_level_);
  if (edit_) {
    auto& logs = *cells_.logs;
    const auto kind = static_cast<unsigned>(edit_->kind);
    if (edit_refused_)
      logs.of(TaskId::kFusion).write(logs.edit_refused, tick.start, edit_->seq, kind);
    else
      logs.of(TaskId::kFusion).write(logs.edit, tick.start, edit_->seq, kind, unsigned{edit_->id});
  }
  const bool lost =
      out_.camera_written ? out_.camera.tracking == CameraPose::Tracking::kLost : lost_;
  if (lost != lost_) {
    const auto& logs = *cells_.logs;
    cells_.logs->of(TaskId::kFusion)
        .write(lost ? logs.tracking_lost : logs.tracking_back, tick.start, tick.k);
    lost_ = lost;
  }
  FusionSample s;
  s.stamp = tick.start;
  s.exposure = out_.camera.exposure;
  s.p_WC = to_floats(out_.camera.X_WC.translation());
  const Eigen::Quaternionf q(out_.camera.X_WC.linear().cast<float>());
  s.q_WC = {q.x(), q.y(), q.z(), q.w()};
  s.work = out_.work;
  s.blocks = static_cast<std::uint32_t>(task_->map().block_count());
  s.moving_cells = static_cast<std::uint32_t>(task_->ground().moving());
  s.moving_share = out_.camera_written ? static_cast<float>(out_.motion.masked_share) : 0;
  s.consumed = out_.camera_written;
  s.tracked = out_.camera_written && out_.camera.tracking != CameraPose::Tracking::kLost;
  s.claimed = out_.camera_written && out_.camera.claimed;
  s.integrated = out_.integrated;
  cells_.fusion_samples.try_push(s);
}

// ---------------------------------------------------------------- planning

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
                           const OperatorSetup& setup, OperatorCells& cells)
    : task_(nrt, of_one_robot(config), config.seed),
      cells_(cells),
      hash_(setup.hash_outputs),
      path_gate_(setup.faults, "path"),
      task_gate_(setup.faults, "task"),
      map_in_(limit_row(EdgeId::kCostMap, TaskId::kPlanning), config, cells.logs.get()),
      robot_in_(limit_row(EdgeId::kRobotState, TaskId::kPlanning), config, cells.logs.get()),
      objects_in_(limit_row(EdgeId::kObjects, TaskId::kPlanning), config, cells.logs.get()),
      touch_in_(limit_row(EdgeId::kTouch, TaskId::kPlanning), config, cells.logs.get()),
      mode_in_(limit_row(EdgeId::kMode, TaskId::kPlanning), config, cells.logs.get()),
      frame_in_(limit_row(EdgeId::kOdometryFrame, TaskId::kPlanning), config, cells.logs.get()) {
  // Within an open mark an event comes this often at least.
  const double event_s = 1 / config.haptic.mark_rate_hz;
  if (2 * event_s > rt::seconds(touch_in_.limit().liveness)) {
    throw std::runtime_error(
        "limits.planning.touch_liveness_ms = " +
        std::to_string(config.limits.liveness_ms[limit_row(EdgeId::kTouch, TaskId::kPlanning)]) +
        " is less than two periods of haptic.mark_rate_hz = " +
        std::to_string(config.haptic.mark_rate_hz));
  }
}

void PlanningNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const int room = PlanningTask::kMaxEvents - in_.event_count;
  const auto events = static_cast<int>(
      cells_.touch.pop_n(in_.events.data() + in_.event_count, static_cast<std::size_t>(room)));
  in_.event_count += events;
  if (events > 0) touch_heard_ = tick.start;
  in_.touch_live = !task_.mark_open() || touch_in_.within(tick.start, touch_heard_, tick.start);
  const auto map = cells_.cost_map.acquire_if_new(OperatorCells::kMapPlanning);
  const auto robot = cells_.robot_state.acquire_if_new(OperatorCells::kStatePlanning);
  const auto objects = cells_.objects.acquire_if_new(OperatorCells::kObjectsPlanning);
  const auto mode = cells_.mode.acquire_if_new(OperatorCells::kModePlanning);
  const auto frame = cells_.odometry_frame.acquire_if_new(OperatorCells::kWorldPlanning);
  in_.map = map.value;
  in_.robot = nullptr;
  const bool robot_known = robot_in_.within(robot, tick.start),
             frame_known = frame_in_.within(frame, tick.start) && frame->known;
  if (robot_known && frame_known) {
    robot_ = in_world(*robot, *frame);
    in_.robot = &robot_;
  }
  in_.objects = objects_in_.within(objects, tick.start) ? objects.value : nullptr;
  if (mode) in_.mode = *mode;
  in_.may_plan = map_in_.within(map, tick.start);
  if (!mode_in_.within(mode, tick.start) && mode) in_.may_plan = false;
  record.input_seq[0] = map.seq;
  record.input_seq[1] = robot.seq;
  record.input_seq[2] = in_.mode.seq;
  record.input_seq[3] =
      in_.event_count > 0 ? in_.events[static_cast<std::size_t>(in_.event_count - 1)].seq : 0;
  record.input_seq[4] = objects.seq;
  record.input_seq[5] = frame.seq;
}

rt::Health PlanningNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  record.work = out_.work;
  return health_;
}

void PlanningNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  in_.event_count = 0;
  Path& path = cells_.path.begin_write();
  path = out_.path;
  const bool path_out = publish(path_gate_, cells_.path, path, tick.start);
  TaskState& state = cells_.task.begin_write();
  state = out_.state;
  const bool state_out = publish(task_gate_, cells_.task, state, tick.start);
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

// ---------------------------------------------------------------- prediction

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

// In a stored map the start is where fusion finds the camera; in a new one the start is what W is made of.
PredictionNode::PredictionNode(rt::NonRealtime& nrt, const GraphConfig& config,
                               const OperatorSetup& setup, OperatorCells& cells, LinkStatus& link)
    : task_(nrt, of_one_odometry(config, setup), setup.fusion.X_BC, config.fusion.map.empty()),
      cells_(cells),
      link_(link),
      hash_(setup.hash_outputs),
      frame_gate_(setup.faults, "odometry_frame"),
      robot_in_(limit_row(EdgeId::kRobotState, TaskId::kPrediction), config, cells.logs.get()),
      path_in_(limit_row(EdgeId::kPath, TaskId::kPrediction), config, cells.logs.get()),
      camera_in_(limit_row(EdgeId::kCameraPose, TaskId::kPrediction), config, cells.logs.get()),
      mode_in_(limit_row(EdgeId::kMode, TaskId::kPrediction), config, cells.logs.get()) {
  in_.mode = &mode_;
}

void PredictionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const auto robot = cells_.robot_state.acquire_if_new(OperatorCells::kStatePrediction);
  const auto path = cells_.path.acquire_if_new(OperatorCells::kPathPrediction);
  const auto camera = cells_.camera_pose.acquire_if_new(OperatorCells::kCameraPrediction);
  const auto mode = cells_.mode.acquire_if_new(OperatorCells::kModePrediction);
  in_.robot = robot.value;
  in_.robot_live = robot_in_.within(robot, tick.start);
  in_.robot_unsure = robot.unsure;
  path_live_ = !path || path->seq == 0 || path_in_.within(path, tick.start);
  in_.path = path && path->seq != 0 && path_live_ ? path.value : nullptr;
  in_.camera = camera_in_.within(camera, tick.start) ? camera.value : nullptr;
  if (mode) mode_ = *mode;
  mode_live_ = mode_in_.within(mode, tick.start);
  in_.round_trip = rt::Nanos{link_.round_trip_ns.load(std::memory_order_relaxed)};
  in_.round_trip_uncertainty = rt::Nanos{link_.uncertainty_ns.load(std::memory_order_relaxed)};
  in_.delay_known = in_.round_trip.count() > 0;
  record.input_seq[0] = robot.seq;
  record.input_seq[1] = path.seq;
  record.input_seq[2] = camera.seq;
  record.input_seq[3] = mode_.seq;
}

rt::Health PredictionNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  // What the operator asked of the robot's box stays asked: only the base halts.
  if (!mode_live_) out_.goal.engaged = 0;
  if (out_.frame.held == Held::kNo && !mode_live_)
    out_.frame.held = Held::kModeSilent;
  else if (out_.frame.held == Held::kNo && !path_live_)
    out_.frame.held = Held::kPathOld;
  record.work = 1;
  return health_;
}

void PredictionNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  cells_.goal.begin_write() = out_.goal;
  cells_.goal.publish(tick.start);
  OdometryFrame& frame = cells_.odometry_frame.begin_write();
  frame = out_.frame;
  const bool frame_out = publish(frame_gate_, cells_.odometry_frame, frame, tick.start);
  publish_health(health_of(cells_, TaskId::kPrediction), tick.start, health_);
  if (!hash_) return;
  rt::Hash64 h;
  hash_output(h, out_.goal);
  if (frame_out) hash_output(h, frame);
  record.output_hash = h.digest();
}

// ---------------------------------------------------------------- supervision

namespace {

using std::chrono::milliseconds;
constexpr std::array<Watch, 4> kOperatorWatches{{{190, milliseconds{50}},      // haptic
                                                 {290, milliseconds{500}},     // fusion
                                                 {390, milliseconds{500}},     // prediction
                                                 {490, milliseconds{1000}}}};  // planning
constexpr std::array<TaskId, 4> kOperatorWatched{TaskId::kHaptic, TaskId::kFusion,
                                                 TaskId::kPrediction, TaskId::kPlanning};

}  // namespace

LatchedStatus latched_status(const SupervisionTask::In& in) noexcept {
  LatchedStatus s;
  s.last_heard_ns = rt::ns_of(in.link_last);
  s.refused = in.link_refused;
  s.closed = in.link_closed;
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
      mode_gate_(setup.faults, "mode"),
      robot_in_(limit_row(EdgeId::kRobotState, TaskId::kSupervision), config, cells.logs.get()) {}

void SupervisionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  for (std::size_t i = 0; i < kOperatorWatched.size(); ++i) {
    const auto health = health_of(cells_, kOperatorWatched[i]).acquire_if_new(0);
    auto& report = in_.tasks[i];
    report.heard = static_cast<bool>(health);
    if (health) {
      report.heartbeat = health->heartbeat;
      report.health = health->health;
    }
    record.input_seq[i] = health.seq;
  }
  const auto robot = cells_.robot_state.acquire_if_new(OperatorCells::kStateSupervision);
  in_.peer_mode = robot ? static_cast<Mode>(robot->mode) : Mode::kInit;
  record.input_seq[4] = robot.seq;
  const std::int64_t heard = link_.last_heard_ns.load(std::memory_order_relaxed);
  in_.link_expected = link_.expected.load(std::memory_order_relaxed);
  in_.link_heard = heard != 0 && robot;
  // A line that carries everything but the robot's state, or that of long ago, is as good as silent.
  in_.link_last = std::min(rt::time_from_ns(heard), robot.at);
  if (robot && !robot_in_.within(robot, tick.start) && robot->taken != rt::Time{})
    in_.link_last = std::min(in_.link_last, tick.start - 2 * robot_in_.limit().liveness);
  in_.link_refused = link_.refused.load(std::memory_order_relaxed);
  in_.link_closed = link_.closed.load(std::memory_order_relaxed);
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
  ModeMsg& mode = cells_.mode.begin_write();
  mode = out_.mode;
  const bool mode_out = publish(mode_gate_, cells_.mode, mode, tick.start);
  if (!hash_ || !mode_out) return;
  rt::Hash64 h;
  hash_output(h, mode);
  record.output_hash = h.digest();
}

}  // namespace tasks
