#include "tasks/robot_io/robot_io_task.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tasks {
namespace {

using drivers::RobotGoal;
using perception::Pose2;
using perception::Twist2;
using rt::Health;
using rt::Severity;

bool usable(const RobotGoal& g) noexcept {
  const double all[] = {g.x_m, g.y_m, g.yaw_rad, g.vx, g.vy, g.wz, g.speed_limit_m_per_s};
  for (const double v : all) {
    if (!std::isfinite(v)) return false;
  }
  return g.speed_limit_m_per_s >= 0;
}

}  // namespace

RobotIoTask::RobotIoTask(rt::NonRealtime&, const RobotIoConfig& config)
    : config_(config),
      kinematics_(config.base),
      odometry_(kinematics_, {config.start_x_m, config.start_y_m, config.start_yaw_rad}),
      trajectory_(config.trajectory),
      last_pose_(odometry_.pose()),
      bus_(config.frames_lost_limit) {
  // Straight drive at the speed limit must be within what the wheels may do; combined motion is
  // scaled down when it has to be.
  const double peak = kinematics_.peak_wheel_speed({config.trajectory.speed_m_per_s, 0, 0});
  if (peak > config.wheel_speed_limit_rad_per_s) {
    throw std::invalid_argument("robot_io: speed_m_per_s needs " + std::to_string(peak) +
                                " rad/s at the wheels, wheel_speed_limit_rad_per_s is " +
                                std::to_string(config.wheel_speed_limit_rad_per_s));
  }
  trajectory_.zero_at_once(odometry_.pose());
}

Health RobotIoTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out.rearm_motors = false;
  Health health = rt::worst(safety_.step(in.safety, in.mode), sense_bus(tick, in));
  health = rt::worst(health, accept_goal(in));

  last_mode_ = in.mode != nullptr ? in.mode->mode : Mode::kInit;
  if (last_mode_ == Mode::kSafeStop && in.mode->clear) let_go(out);
  health = until_seen(health);

  const Drive drive = decide(tick, in, health);
  out.safety = safety_.show(tick, in.safety, in.mode, bus_.is_down());
  if (drive == Drive::kOff) {
    powered_ = false;
    off_until_ = tick.start;
  } else if (!powered_) {
    start_motors(in, out);
    write_state(tick, in, health, out);
    return health;
  }
  const double period = rt::seconds(tick.period);
  const double dt = period * std::min(10.0, 1.0 + static_cast<double>(tick.skipped));
  const Pose2& X_OB = odometry_.pose();
  telemetry_.driving = drive == Drive::kGoal;
  telemetry_.tracking_error_m = telemetry_.tracking_error_rad = 0;
  PlanarVelocity v_O;
  switch (drive) {
    case Drive::kOff:
      trajectory_.zero_at_once(X_OB);
      break;
    case Drive::kRampDown:
      v_O = trajectory_.ramp_down(X_OB, dt);
      break;
    case Drive::kHalt:
      v_O = trajectory_.brake(X_OB, dt);
      break;
    case Drive::kGoal: {
      // Measured before the reference moves on: both are of this tick's sample.
      const Pose2& ref = trajectory_.reference();
      telemetry_.tracking_error_m = std::hypot(ref.x - X_OB.x, ref.y - X_OB.y);
      telemetry_.tracking_error_rad = std::abs(perception::wrap_angle(ref.yaw - X_OB.yaw));
      telemetry_.tracking_error_max_m =
          std::max(telemetry_.tracking_error_max_m, telemetry_.tracking_error_m);
      if (telemetry_.tracking_error_m > 0.5 * config_.trajectory.leash_m) {
        health = rt::worst(health, Health::of(Severity::kCounted, robot_io_fault::kTracking));
      }
      TrajectoryTarget target;
      target.X_OG = {goal_.x_m, goal_.y_m, goal_.yaw_rad};
      const double c = std::cos(goal_.yaw_rad), s = std::sin(goal_.yaw_rad);
      target.v_O = {c * goal_.vx - s * goal_.vy, s * goal_.vx + c * goal_.vy, goal_.wz};
      target.speed_limit_m_per_s = goal_.speed_limit_m_per_s;
      v_O = trajectory_.track(target, X_OB, dt);
      break;
    }
  }
  const double c = std::cos(X_OB.yaw), s = std::sin(X_OB.yaw);
  v_commanded_ = {c * v_O.x + s * v_O.y, -s * v_O.x + c * v_O.y, v_O.yaw};
  write_setpoints(drive, dt, out);
  write_state(tick, in, health, out);
  return health;
}

// Motors that were off. The next job's setpoints go on from these with the acceleration limit.
void RobotIoTask::start_motors(const In& in, Out& out) noexcept {
  const Pose2& X_OB = odometry_.pose();
  const double c = std::cos(X_OB.yaw), s = std::sin(X_OB.yaw);
  v_commanded_ = v_measured_;
  trajectory_.start_from(X_OB, {c * v_measured_.vx - s * v_measured_.vy,
                                s * v_measured_.vx + c * v_measured_.vy, v_measured_.wz});
  telemetry_.driving = false;
  telemetry_.tracking_error_m = telemetry_.tracking_error_rad = 0;
  out.setpoints.mode = drivers::MotorMode::kVelocity;
  out.setpoints.wheel_rad_per_s = in.motors.wheel_rad_per_s;
  const drivers::WheelVector of_base = kinematics_.inverse(v_measured_);
  for (std::size_t w = 0; w < of_base.size(); ++w)
    residual_rad_per_s_[w] = in.motors.wheel_rad_per_s[w] - of_base[w];
  powered_ = true;
}

Health RobotIoTask::sense_bus(const rt::Tick& tick, const In& in) noexcept {
  const Health cycle = bus_.cycle(in.bus, in.sent, in.bus_detail);
  telemetry_.frames_lost = bus_.bad_cycles();
  // A bus that does not drive may still tell what the wheels do: a stopped robot rolls out.
  const bool told = in.bus == drivers::BusStatus::kOk || in.motors.seq != motors_seq_;
  if (!told) return cycle;
  motors_seq_ = in.motors.seq;
  const Twist2 v = kinematics_.forward(in.motors.wheel_rad_per_s);
  encoder_readable_ = perception::is_finite(v);
  for (const double angle : in.motors.wheel_rad) {
    encoder_readable_ = encoder_readable_ && std::isfinite(angle);
  }
  if (!encoder_readable_ || !odometry_.update(in.motors.wheel_rad)) encoder_fault_ = true;
  if (encoder_fault_) {
    v_measured_ = {};
    const Health encoder = Health::of(Severity::kSafeStop, robot_io_fault::kEncoder);
    return in.bus == drivers::BusStatus::kOk ? encoder : rt::worst(cycle, encoder);
  }
  v_measured_ = v;
  motors_taken_ = in.motors.taken;
  const Pose2& p = odometry_.pose();
  telemetry_.odometry_path_m += std::hypot(p.x - last_pose_.x, p.y - last_pose_.y);
  last_pose_ = p;
  if (in.bus != drivers::BusStatus::kOk) return cycle;
  return rt::worst(cycle, bus_.motors(tick, in.motors));
}

// The operator's clear, of what is no longer there. After a leap the pose is kept and the angles
// count from where they are now.
void RobotIoTask::let_go(Out& out) noexcept {
  if (encoder_fault_ && encoder_readable_) {
    odometry_.reset(odometry_.pose());
    encoder_fault_ = false;
  }
  out.rearm_motors = true;
}

// Supervision looks every tenth tick and at the newest report only: what lasted for one tick must
// not be missed.
Health RobotIoTask::until_seen(Health health) noexcept {
  if (last_mode_ == Mode::kSafeStop) {
    unseen_stop_ = Health::ok();
  } else if (health.severity == Severity::kSafeStop) {
    unseen_stop_ = health;
  }
  return rt::worst(health, unseen_stop_);
}

Health RobotIoTask::accept_goal(const In& in) noexcept {
  if (in.goal == nullptr || (have_goal_ && in.goal->seq == goal_.seq)) return Health::ok();
  if (!usable(*in.goal)) {
    if (refused_seq_ != in.goal->seq || telemetry_.goals_refused == 0) ++telemetry_.goals_refused;
    refused_seq_ = in.goal->seq;
    return Health::of(Severity::kCounted, robot_io_fault::kGoalRefused);
  }
  goal_ = *in.goal;
  have_goal_ = true;
  expiry_counted_ = false;
  return Health::ok();
}

RobotIoTask::Drive RobotIoTask::decide(const rt::Tick& tick, const In& in,
                                       Health& health) noexcept {
  telemetry_.goal_distance_m = 0;
  if (health.severity == Severity::kSafeStop || !odometry_.primed()) return Drive::kOff;
  // What the wheels do now has to be known before they are given speeds.
  const bool heard = in.bus == drivers::BusStatus::kOk && in.sent == drivers::BusStatus::kOk;
  if (!powered_ && !heard) return Drive::kOff;
  // While the motors are re-armed they take no setpoints. The first one after it is what they do
  // then.
  if (in.bus_detail.trouble == drivers::BusTrouble::kRearming) return Drive::kOff;
  switch (last_mode_) {
    case Mode::kInit:
    case Mode::kSafeStop:
      return Drive::kOff;
    case Mode::kHold:
    case Mode::kRampDown:
      return Drive::kRampDown;
    case Mode::kEngaged:
      break;
  }
  // A fault of this job, as of the enable switch.
  if (health.severity == Severity::kRampDown) return Drive::kRampDown;
  if (!in.link_heard || in.link_closed ||
      tick.start - in.link_heard_at > std::chrono::milliseconds{config_.link_silence_ms}) {
    health = rt::worst(health, Health::of(Severity::kDegraded, robot_io_fault::kLinkSilent));
    return Drive::kRampDown;
  }
  // A goal from before the motors were on again does not move them.
  if (!have_goal_ || goal_.engaged == 0 || goal_.made <= off_until_ + in.goal_unsure)
    return Drive::kHalt;
  if (tick.start + in.goal_unsure > goal_.valid_until) {
    if (!expiry_counted_) ++telemetry_.goals_expired;
    expiry_counted_ = true;
    health = rt::worst(health, Health::of(Severity::kDegraded, robot_io_fault::kGoalExpired));
    return Drive::kRampDown;
  }
  const Pose2& p = odometry_.pose();
  telemetry_.goal_distance_m = std::hypot(goal_.x_m - p.x, goal_.y_m - p.y);
  return Drive::kGoal;
}

void RobotIoTask::write_setpoints(Drive drive, double dt, Out& out) noexcept {
  if (drive == Drive::kOff) {
    out.setpoints = {};
    return;
  }
  const double peak = kinematics_.peak_wheel_speed(v_commanded_);
  if (peak > config_.wheel_speed_limit_rad_per_s) {
    const double scale = config_.wheel_speed_limit_rad_per_s / peak;
    v_commanded_ = {scale * v_commanded_.vx, scale * v_commanded_.vy, scale * v_commanded_.wz};
  }
  out.setpoints.mode = drivers::MotorMode::kVelocity;
  out.setpoints.wheel_rad_per_s = kinematics_.inverse(v_commanded_);
  const double most =
      config_.trajectory.ramp_down_deceleration_m_per_s2 * dt / kinematics_.wheel_radius();
  for (std::size_t w = 0; w < residual_rad_per_s_.size(); ++w) {
    residual_rad_per_s_[w] -= std::clamp(residual_rad_per_s_[w], -most, most);
    out.setpoints.wheel_rad_per_s[w] += residual_rad_per_s_[w];
  }
}

// RobotState::pauses: 0, no silence has interrupted this box; 1, it has, and lasts; 2, the link is
// heard again. Silent: for twice as long as what makes the base ramp down; by default that is
// supervision.link_liveness_s.
std::uint8_t RobotIoTask::pauses(const rt::Tick& tick, const In& in) const noexcept {
  if (in.mode == nullptr || !in.mode->resumes) return 0;
  const auto silence = 2 * std::chrono::milliseconds{config_.link_silence_ms};
  return !in.link_heard || in.link_closed || tick.start - in.link_heard_at > silence ? 1 : 2;
}

void RobotIoTask::write_state(const rt::Tick& tick, const In& in, Health health,
                              Out& out) noexcept {
  const Pose2& p = odometry_.pose();
  drivers::RobotState& s = out.state;
  s.seq = ++seq_;
  s.made = tick.start;
  s.taken = motors_taken_;
  s.x_m = p.x;
  s.y_m = p.y;
  s.yaw_rad = p.yaw;
  s.vx = v_measured_.vx;
  s.vy = v_measured_.vy;
  s.wz = v_measured_.wz;
  s.cmd_vx = v_commanded_.vx;
  s.cmd_vy = v_commanded_.vy;
  s.cmd_wz = v_commanded_.wz;
  s.goal_seq = have_goal_ ? goal_.seq : 0;
  s.mode = static_cast<std::uint8_t>(in.mode != nullptr ? in.mode->mode : Mode::kInit);
  s.mode_cause = in.mode != nullptr ? in.mode->cause : rt::kNoFault;
  const bool turning = std::hypot(s.vx, s.vy) > 0.005 || std::abs(s.wz) > 0.01;
  s.moving = static_cast<std::uint8_t>(turning || trajectory_.moving());
  s.fault = health.fault;
  s.pauses = pauses(tick, in);
  telemetry_.X_OR = trajectory_.reference();
  out.telemetry = telemetry_;
  out.bus = bus_.report();
  bus_.told(out.setpoints);
}

}  // namespace tasks
