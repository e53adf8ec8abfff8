#include "tasks/prediction/prediction_task.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {
namespace {

using perception::Pose2;
using rt::Health;
using rt::Severity;

Pose2 measured(const drivers::RobotState& s) noexcept { return {s.x_m, s.y_m, s.yaw_rad}; }

// The planar part of a pose whose z axes agree: x, y and the heading of the x axis.
Pose2 planar(const Pose& X) noexcept {
  return {X.translation().x(), X.translation().y(), std::atan2(X.linear()(1, 0), X.linear()(0, 0))};
}

}  // namespace

PredictionTask::PredictionTask(rt::NonRealtime&, const PredictionConfig& config, const Pose& X_BC)
    : config_(config), X_CB_(X_BC.inverse()), motion_(config.motion), follower_(config.path) {}

Health PredictionTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  Health health = take_state(in);
  health = rt::worst(health, take_path(in));
  if (config_.map_correction) health = rt::worst(health, correct_map(in));

  drivers::RobotGoal& g = out.goal;
  const Pose2 here = have_state_ ? measured(state_) : Pose2{};
  g = {};
  g.seq = ++seq_;
  g.made = tick.start;
  g.valid_until = tick.start + std::chrono::milliseconds{config_.goal_valid_ms};
  g.x_m = here.x;
  g.y_m = here.y;
  g.yaw_rad = here.yaw;
  g.speed_limit_m_per_s = config_.speed_m_per_s;
  g.path_seq = follower_.seq();
  out.telemetry = {};
  out.telemetry.X_WO = X_WO_;
  out.telemetry.X_WB = out.telemetry.predicted_X_WB = perception::compose(X_WO_, here);
  out.telemetry.path_seq = follower_.seq();
  g.operator_engaged = in.mode != nullptr && in.mode->mode == Mode::kEngaged ? 1 : 0;
  g.operator_clear = in.mode != nullptr && in.mode->clear ? 1 : 0;
  if (make_goal(tick, in, out, health)) g.engaged = 1;
  return health;
}

Health PredictionTask::take_state(const In& in) noexcept {
  if (in.robot == nullptr || (have_state_ && in.robot->seq == state_.seq)) return Health::ok();
  const drivers::RobotState& s = *in.robot;
  if (!epoch_set_) {
    epoch_ = s.taken;
    epoch_set_ = true;
  }
  const MotionSample sample{to_seconds(s.taken), measured(s), {s.vx, s.vy, s.wz}};
  if (!perception::is_finite(sample.X_OB) || !perception::is_finite(sample.v_B)) {
    return Health::of(Severity::kCounted, prediction_fault::kStateRefused);
  }
  // A robot box that was started again begins a new history; a small step back of the clock offset
  // only costs one sample.
  if (have_state_ && (s.seq < state_.seq || sample.t < to_seconds(state_.taken) - 0.05)) {
    motion_.clear();
  }
  (void)motion_.add(sample);
  state_ = s;
  have_state_ = true;
  return Health::ok();
}

Health PredictionTask::take_path(const In& in) noexcept {
  if (in.path == nullptr || in.path->seq == 0 || in.path->size == 0) {
    follower_.drop();
    return Health::ok();
  }
  if (follower_.take(*in.path)) return Health::ok();
  follower_.drop();
  if (refused_path_ == in.path->seq) return Health::ok();
  refused_path_ = in.path->seq;
  return Health::of(Severity::kCounted, prediction_fault::kPathRefused);
}

// X_WO drifts as odometry does: the camera's pose in the map says by how much.
Health PredictionTask::correct_map(const In& in) noexcept {
  const CameraPose* c = in.camera;
  if (c == nullptr || c->seq == camera_seq_) return Health::ok();
  camera_seq_ = c->seq;
  Pose2 X_OB;
  if (!epoch_set_ || !c->claimed || c->tracking != CameraPose::Tracking::kTracking ||
      !motion_.pose_at(to_seconds(c->exposure), X_OB)) {
    return Health::ok();
  }
  // Blended at the base, not at the origin of O: a small turn there would swing the base far away.
  const Pose2 now = perception::compose(X_WO_, X_OB), seen = planar(c->X_WC * X_CB_);
  const double dx = seen.x - now.x, dy = seen.y - now.y;
  const double d = std::hypot(dx, dy), turn = perception::wrap_angle(seen.yaw - now.yaw);
  if (!(d <= config_.map_gate_m) || !std::isfinite(turn)) {
    return Health::of(Severity::kCounted, prediction_fault::kCorrectionRefused);
  }
  const double f = std::min(config_.map_gain, d > 0 ? config_.map_step_m / d : 1.0);
  const double r = std::clamp(config_.map_gain * turn, -config_.map_step_rad, config_.map_step_rad);
  const Pose2 blended{now.x + f * dx, now.y + f * dy, perception::wrap_angle(now.yaw + r)};
  X_WO_ = perception::compose(blended, perception::inverse(X_OB));
  return Health::ok();
}

bool PredictionTask::make_goal(const rt::Tick& tick, const In& in, Out& out,
                               Health& health) noexcept {
  if (!have_state_) return false;
  const rt::Nanos age = std::max(tick.start - state_.taken, rt::Nanos{0});
  if (!in.robot_live || age > std::chrono::milliseconds{config_.state_liveness_ms}) {
    health = rt::worst(health, Health::of(Severity::kDegraded, prediction_fault::kStateStale));
    return false;
  }
  if (!in.delay_known || in.round_trip < rt::Nanos{0}) {
    health = rt::worst(health, Health::of(Severity::kDegraded, prediction_fault::kDelayUnknown));
    return false;
  }
  // The goal acts one way after now, and the state is one way old: together the round trip, or more
  // if the state has waited.
  const double trip = rt::seconds(in.round_trip);
  const double lead =
      std::min(std::max(trip, rt::seconds(age) + 0.5 * trip), config_.horizon_limit_s);
  MotionPredictor::Prediction p;
  if (!motion_.predict(motion_.newest().t + lead, p)) return false;
  PredictionTelemetry& t = out.telemetry;
  t.lead_s = lead;
  t.predicted_X_WB = perception::compose(X_WO_, p.X_OB);
  if (!follower_.has_path()) return false;

  const PathFollower::Goal goal = follower_.next(t.predicted_X_WB);
  const Pose2 end = follower_.end();
  t.arrived = follower_.update_arrival(t.X_WB, std::hypot(state_.vx, state_.vy));
  t.remaining_m = goal.remaining_m;
  t.off_path_m = goal.off_path_m;
  t.goal_is_mark = goal.is_mark;
  t.end_distance_m = std::hypot(end.x - t.X_WB.x, end.y - t.X_WB.y);

  const Pose2 X_OG = perception::compose(perception::inverse(X_WO_), goal.X_WG);
  drivers::RobotGoal& g = out.goal;
  g.x_m = X_OG.x;
  g.y_m = X_OG.y;
  g.yaw_rad = X_OG.yaw;
  const double unsure = rt::seconds(in.round_trip_uncertainty);
  if (unsure > 0) {
    g.speed_limit_m_per_s = std::min(config_.speed_m_per_s, config_.uncertainty_share_m / unsure);
  }
  return in.mode != nullptr && in.mode->mode == Mode::kEngaged;
}

}  // namespace tasks
