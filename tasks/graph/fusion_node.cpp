#include "tasks/graph/fusion_node.hpp"

#include <stdexcept>

#include "perception/geometry/pose.hpp"
#include "rt/effect_count.hpp"
#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/node_parts.hpp"

namespace tasks {

namespace {

template <EdgeId E>
inline constexpr std::integral_constant<EdgeId, E> kOut{};

// The ray cast that haptic.method = "force_shading" (the paper's) needs is made only for it.
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
      limits_(config, cells.logs.get()) {
  if (cells.has<EdgeId::kSurface>()) {
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
    cells.of<EdgeId::kSurface>().cell.for_each_slot(nrt,
                                                    [&](SurfacePoints& s) { s.resize(pixels); });
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
  if (looked != rt::Time{}) static_cast<void>(limits_.of<EdgeId::kEdit>().within(now, looked, now));
  in_.clear_W.reset();
  in_.virtual_obstacles_changed = edit_refused_ = false;
  in_.given = nullptr;
  in_.drop_object = 0;
  edit_.reset();
  SceneEdit edit;
  if (task_->clearing() || !cells_.ring<EdgeId::kEdit, TaskId::kFusion>().try_pop(edit)) return;
  edit_ = edit;
  edit_refused_ = !apply(edit);
}

// False: refused, nothing changes.
bool FusionNode::apply(const SceneEdit& edit) noexcept {
  switch (edit.kind) {
    case SceneEdit::Kind::kClear: {
      const Eigen::AlignedBox3d box_W = box_of(edit);
      if (FusionTask::clearable(box_W)) in_.clear_W = box_W;
      return in_.clear_W.has_value();
    }
    case SceneEdit::Kind::kObjectBox:
    case SceneEdit::Kind::kObjectPoint: {
      if (task_->objects() == nullptr || !given_.apply(edit)) return false;
      in_.given = given_.whole();
      return true;
    }
    case SceneEdit::Kind::kDropObject:
      in_.drop_object = edit.id;
      return task_->objects() != nullptr && edit.id != 0;
    default:
      in_.virtual_obstacles_changed = drawn_.apply(edit);
      in_.virtual_obstacles = drawn_.all();
      return in_.virtual_obstacles_changed;
  }
}

void FusionNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const auto frame = cells_.take<EdgeId::kFrame, TaskId::kFusion>(record);
  in_.frame = frame.value;
  in_.frame_fresh =
      limits_.of<EdgeId::kFrame>().within(frame, tick.start) && frame.seq != frame_seq_;
  frame_seq_ = frame.seq;
  const auto hand = cells_.take<EdgeId::kHand, TaskId::kFusion>(record);
  // A hand of which nothing is heard any more is not followed on to where it was going.
  if (limits_.of<EdgeId::kHand>().within(hand, tick.start))
    in_.hand = *hand;
  else
    in_.hand.v_WH = Vec3::Zero();
  const auto robot = cells_.take<EdgeId::kRobotState, TaskId::kFusion>(record);
  in_.odometry.reset();
  if (limits_.of<EdgeId::kRobotState>().within(robot, tick.start) && odometry_prior_) {
    OdometryPrior prior;
    prior.taken = robot->taken;
    prior.X_OB.linear() = perception::rotation_about_z(robot->yaw_rad);
    prior.X_OB.translation() = Vec3(robot->x_m, robot->y_m, 0);
    prior.v_OB_B = Vec3(robot->vx, robot->vy, 0);
    prior.w_OB_B = Vec3(0, 0, robot->wz);
    in_.odometry = prior;
  }
  take_edit(tick.start);
  in_.mesh_taken = requests_.mesh_taken.load(std::memory_order_relaxed);
  out_.mesh = cells_.has<EdgeId::kMesh>() ? &cells_.begin_write<EdgeId::kMesh>() : nullptr;
  out_.patch = &cells_.begin_write<EdgeId::kPatch>();
  out_.surface = cells_.has<EdgeId::kSurface>() ? &cells_.begin_write<EdgeId::kSurface>() : nullptr;
  out_.view = &cells_.begin_write<EdgeId::kView>();
  out_.cost_map = &cells_.begin_write<EdgeId::kCostMap>();
  out_.objects = &cells_.begin_write<EdgeId::kObjects>();
}

rt::Health FusionNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_->begin_step(tick, in_, out_);
  record.work = out_.work;
  return health_;
}

void FusionNode::end_step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const std::uint64_t before = out_.work;
  const rt::AllocationCount allocations;
  task_->end_step(tick, in_, out_);
  record.work += out_.work - before;
  if (record.allocations != rt::kNotCounted) record.allocations += allocations.value();
}

void FusionNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  rt::Hash64 h;
  // Hashed as it was published: a planned fault may have changed it (tasks/edges/edge_faults.hpp).
  const auto send = [&]<EdgeId E>(std::integral_constant<EdgeId, E>, auto& slot) {
    if (cells_.publish<E>(tick.start) && hash_) hash_output(h, slot);
  };
  if (out_.patch_written) send(kOut<EdgeId::kPatch>, *out_.patch);
  if (out_.surface_written) rt::effect_ran(rt::Effect::kForceShading);
  if (out_.surface_written) send(kOut<EdgeId::kSurface>, *out_.surface);
  if (out_.cost_map_written) send(kOut<EdgeId::kCostMap>, *out_.cost_map);
  if (out_.camera_written) {
    CameraPose& camera = cells_.begin_write<EdgeId::kCameraPose>();
    camera = out_.camera;
    send(kOut<EdgeId::kCameraPose>, camera);
  }
  if (out_.objects_written) rt::effect_ran(rt::Effect::kObjects);
  if (out_.objects_written) send(kOut<EdgeId::kObjects>, *out_.objects);
  publish_health(health_of(cells_, TaskId::kFusion), tick.start, health_);
  // The patch went out first, for haptic looks for it each millisecond. Nothing that a task reads
  // waits for the ray cast of end_step().
  end_step(tick, record);
  if (out_.view_written) send(kOut<EdgeId::kView>, *out_.view);
  if (out_.mesh_written) rt::effect_ran(rt::Effect::kMesh);
  if (out_.mesh_written) send(kOut<EdgeId::kMesh>, *out_.mesh);
  if (hash_) record.output_hash = h.digest();
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

}  // namespace tasks
