#include "tasks/prediction/prediction_task.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {
namespace {

using perception::Pose2;
using rt::Health;
using rt::Severity;

constexpr double kSingleShare = 0.25;  // of settle_s, after a single lateness

Pose2 measured(const drivers::RobotState& s) noexcept { return {s.x_m, s.y_m, s.yaw_rad}; }

// The planar part of a pose whose z axes agree: x, y and the heading of the x axis.
Pose2 planar(const Pose& X) noexcept {
  return {X.translation().x(), X.translation().y(), std::atan2(X.linear()(1, 0), X.linear()(0, 0))};
}

}  // namespace

PredictionTask::PredictionTask(rt::NonRealtime&, const PredictionConfig& config, const Pose& X_BC,
                               bool start_known)
    : config_(config),
      X_CB_(X_BC.inverse()),
      motion_(config.motion),
      follower_(config.path),
      world_(config.world, start_known || !config.map_correction) {}

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
  out.telemetry.X_WO = world_.X_WO();
  out.telemetry.X_WB = out.telemetry.predicted_X_WB = perception::compose(world_.X_WO(), here);
  out.telemetry.path_seq = follower_.seq();
  g.operator_engaged = in.mode == nullptr                ? 0
                       : in.mode->mode == Mode::kEngaged ? 1
                       : in.mode->resumes                ? 2
                                                         : 0;
  g.operator_clear = in.mode != nullptr && in.mode->clear ? 1 : 0;
  out.frame = {};
  if (make_goal(tick, in, out, health)) g.engaged = 1;
  write_frame(out);
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
    world_.restart_odometry();
  }
  (void)motion_.add(sample);
  if (config_.map_correction) (void)world_.add_odometry(sample.t, sample.X_OB);
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
  if (c == nullptr || c->seq == camera_seq_ || !epoch_set_) return Health::ok();
  if (!c->claimed || c->tracking != CameraPose::Tracking::kTracking) return Health::ok();
  const WorldFilter::Taken taken =
      world_.add_camera(to_seconds(c->exposure), planar(c->X_WC * X_CB_));
  if (taken == WorldFilter::Taken::kTooNew)
    return Health::ok();  // the next robot state may cover it
  camera_seq_ = c->seq;
  if (taken == WorldFilter::Taken::kUsed || taken == WorldFilter::Taken::kTooOld)
    return Health::ok();
  return Health::of(Severity::kCounted, prediction_fault::kCorrectionRefused);
}

// Would the stated error be within the limit where the base comes to rest if it was told to now?
// The news takes until the next job and the way there; below half of the limit it goes on.
bool PredictionTask::sure_enough(double lead_s) noexcept {
  if (!config_.map_correction) return true;
  const double speed = std::hypot(state_.vx, state_.vy);
  const double way = speed * (lead_s + 0.1) + speed * speed / (2 * config_.brake_m_per_s2);
  double dx = 0, dy = 0;
  if (speed > 1e-6) {
    const double a = std::atan2(state_.vy, state_.vx) + state_.yaw_rad + world_.X_WO().yaw;
    dx = way * std::cos(a), dy = way * std::sin(a);
  }
  const double error_m = world_.error_after_m(dx, dy);
  unsure_ = !(error_m <= (unsure_ ? 0.5 : 1.0) * config_.error_limit_m);
  return !unsure_;
}

void PredictionTask::write_frame(Out& out) noexcept {
  OdometryFrame& f = out.frame;
  f.seq = ++frame_seq_;
  if (!have_state_) return;
  f.taken = state_.taken;
  f.X_WO = {world_.X_WO().x, world_.X_WO().y, world_.X_WO().yaw};
  f.follows_camera = config_.map_correction;
  f.unsure = unsure_;
  f.known = true;
  if (!config_.map_correction) return;
  const WorldFilter::Matrix3 P = world_.covariance();
  f.covariance = {P(0, 0), P(0, 1), P(0, 2), P(1, 1), P(1, 2), P(2, 2)};
  f.error_m = world_.error_m();
  f.error_rad = world_.error_rad();
  f.known = world_.known();
  if (world_.claimed_t() >= 0) f.claimed = epoch_ + rt::nanos_from_seconds(world_.claimed_t());
}

// Whether the robot state is young enough to drive on, and has been for a while. Without the while
// the base would start and stop with every job where the age is close to the limit. It is short
// after a single late state (a lost packet). If not, `frame` says why.
bool PredictionTask::in_time(const rt::Tick& tick, const In& in, OdometryFrame& frame) noexcept {
  using std::chrono::milliseconds;
  const rt::Nanos age = std::max(tick.start - state_.taken, rt::Nanos{0}) + in.robot_unsure;
  const milliseconds limit{config_.state_liveness_ms};
  frame.held_ms =
      static_cast<std::int32_t>(std::min<std::int64_t>(age.count() / 1'000'000, 1'000'000'000));
  frame.held_limit_ms = config_.state_liveness_ms;
  if (in_time_since_ == rt::Time::max()) in_time_since_ = tick.start;
  if (age > limit || !in.robot_live) {
    frame.held = age > limit ? Held::kStateOld : Held::kStateSilent;
    if (!was_late_)
      single_ = tick.start - in_time_since_ >= 2 * rt::nanos_from_seconds(config_.settle_s);
    else if (settling_)
      single_ = false;  // late again before it had settled
    was_late_ = true;
    settling_ = false;
    late_at_ = tick.start;
    return false;
  }
  if (was_late_) {
    settling_ = true;
    const double settle_s = (single_ ? kSingleShare : 1.0) * config_.settle_s;
    if (tick.start - late_at_ < rt::nanos_from_seconds(settle_s)) {
      frame.held = Held::kSettling;
      return false;
    }
    in_time_since_ = tick.start;
  }
  was_late_ = settling_ = false;
  return true;
}

// So that the way driven on a state, from when it was measured until the goal made from it ends,
// stays within `blind_way_m`, and that within the uncertainty of the delay within
// `uncertainty_share_m`.
double PredictionTask::speed_limit(rt::Nanos age, rt::Nanos life, rt::Nanos unsure) const noexcept {
  const double blind_s = rt::seconds(age + life), unsure_s = rt::seconds(unsure);
  double limit = config_.speed_m_per_s;
  if (blind_s > 0) limit = std::min(limit, config_.blind_way_m / blind_s);
  if (unsure_s > 0) limit = std::min(limit, config_.uncertainty_share_m / unsure_s);
  return limit;
}

bool PredictionTask::usable(const DriveIntent* drive) noexcept {
  return drive != nullptr && drive->held && std::isfinite(drive->vx) && std::isfinite(drive->vy) &&
         std::isfinite(drive->wz);
}

// A place ahead of the base where it will be when the goal arrives: so far that it does not brake
// before the goal after this one has come, and would stop there if none came.
void PredictionTask::drive_goal(const DriveIntent& drive, const Pose2& X_OB,
                                drivers::RobotGoal& g) const noexcept {
  constexpr double kAhead_s = 0.35, kTurnAhead_s = 0.15, kTurnBrake_rad_per_s2 = 1.0;
  const double asked = std::hypot(drive.vx, drive.vy);
  const double speed = std::min(asked, g.speed_limit_m_per_s);
  const double way = speed * kAhead_s + speed * speed / (2 * config_.brake_m_per_s2);
  const double share = asked > 1e-9 ? way / asked : 0;
  const double turn =
      drive.wz * kTurnAhead_s + drive.wz * std::abs(drive.wz) / (2 * kTurnBrake_rad_per_s2);
  const Pose2 X_OG =
      perception::compose(X_OB, {share * drive.vx, share * drive.vy, std::clamp(turn, -1.5, 1.5)});
  g.x_m = X_OG.x;
  g.y_m = X_OG.y;
  g.yaw_rad = X_OG.yaw;
  g.speed_limit_m_per_s = speed;
}

void PredictionTask::limit_goal(const rt::Tick& tick, const In& in,
                                drivers::RobotGoal& g) const noexcept {
  const rt::Nanos age = std::max(tick.start - state_.taken, rt::Nanos{0});
  const rt::Nanos life =
      std::min<rt::Nanos>(in.round_trip + std::chrono::milliseconds{config_.goal_hold_ms},
                          std::chrono::milliseconds{config_.goal_valid_ms});
  g.valid_until = tick.start + life;
  g.speed_limit_m_per_s = speed_limit(age + in.robot_unsure, life, in.round_trip_uncertainty);
}

bool PredictionTask::make_goal(const rt::Tick& tick, const In& in, Out& out,
                               Health& health) noexcept {
  if (!have_state_) return false;
  const rt::Nanos age = std::max(tick.start - state_.taken, rt::Nanos{0});
  if (!in_time(tick, in, out.frame)) {
    if (out.frame.held != Held::kSettling)
      health = rt::worst(health, Health::of(Severity::kDegraded, prediction_fault::kStateStale));
    return false;
  }
  if (!in.delay_known || in.round_trip < rt::Nanos{0}) {
    out.frame.held = Held::kDelayUnknown;
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
  t.predicted_X_WB = perception::compose(world_.X_WO(), p.X_OB);
  const bool sure = sure_enough(lead);
  if (!sure) {
    out.frame.held = Held::kPlaceUnsure;
    health = rt::worst(health, Health::of(Severity::kDegraded, prediction_fault::kPlaceUnsure));
  }
  const bool engaged = in.mode != nullptr && in.mode->mode == Mode::kEngaged;
  limit_goal(tick, in, out.goal);
  if (usable(in.drive)) {
    // The person sees where it goes: it may drive where its place in the map is not sure.
    drive_goal(*in.drive, p.X_OB, out.goal);
    return engaged;
  }
  if (!follower_.has_path()) return false;

  const PathFollower::Goal goal = follower_.next(t.predicted_X_WB);
  const Pose2 end = follower_.end();
  t.arrived = follower_.update_arrival(t.X_WB, std::hypot(state_.vx, state_.vy));
  t.remaining_m = goal.remaining_m;
  t.off_path_m = goal.off_path_m;
  t.goal_is_mark = goal.is_mark;
  t.end_distance_m = std::hypot(end.x - t.X_WB.x, end.y - t.X_WB.y);

  const Pose2 X_OG = perception::compose(perception::inverse(world_.X_WO()), goal.X_WG);
  drivers::RobotGoal& g = out.goal;
  g.x_m = X_OG.x;
  g.y_m = X_OG.y;
  g.yaw_rad = X_OG.yaw;
  return sure && engaged;
}

}  // namespace tasks
