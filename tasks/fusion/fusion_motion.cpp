// Where the camera should be, and where it is when nobody knows.
#include <algorithm>
#include <numbers>

#include "tasks/fusion/fusion_parts.hpp"
#include "tasks/fusion/fusion_task.hpp"

namespace tasks {

namespace {

using perception::MotionPrior;
using perception::RgbdFrame;
using perception::TrackingResult;
using perception::TrackingState;
using Twist = Eigen::Matrix<double, 6, 1>;

constexpr double kDegree = std::numbers::pi / 180;
// chosen on: moving 54 (6, 17, 1); judged on: moving 606, moving 707
// Unclaimed with so little of the image on the map for so many frames: by itself it does not get better. A wall that
// says nothing of the way along it is met by nearly all of its image.
constexpr double kAdriftOverlap = 0.65;
constexpr int kAdriftFrames = 5;
// chosen on: moving 101 (116, 125, 245, 246); judged on: moving 303, kidnaps of Relocalisation.*
// Of the readings of a frame that is lost: where so many fit the map by themselves, it is not.
constexpr double kLeastKept = 0.5;

// (v, w) with exp_se3(v, w) = X.
Twist twist_of(const Pose& X) noexcept {
  const Eigen::AngleAxisd r(X.linear());
  Twist xi;
  xi << X.translation(), r.angle() * r.axis();
  return xi;
}

Pose between(const Pose& a, const Pose& b, double f) noexcept {
  const Pose step = a.inverse() * b;
  return perception::orthonormalised(a * perception::exp_se3(f * twist_of(step)));
}

double seconds_between(rt::Time a, rt::Time b) noexcept { return rt::seconds(b - a); }

}  // namespace

// ---------------------------------------------------------------- what stands still

// By what stands still alone, when something moves.
void FusionTask::track(const MotionPrior& prior, const FusionLevel& knobs, Out& out) noexcept {
  TrackingResult& r = out.tracking;
  perception::MotionResult& m = out.motion;
  const auto& pyramid = tracker_.pyramid();
  std::uint64_t work = 0;
  watch_.look(map_, pyramid, model(), prior, m);
  const auto look_again = [&] {
    // Where the whole image would have the camera, roughly: right when only the prior was off.
    tracker_.track(model(), prior, prior.X_WC, {0, 0, knobs.iterations[2]}, r);
    work += r.work;
    watch_.compete(pyramid, model(), prior, r.X_WC, m);
  };
  if (m.doubtful) look_again();
  watch_.find(map_, pyramid, model(), m);
  // A camera that has moved far along large walls sees all else move.
  if (m.sudden && !m.doubtful) {
    look_again();
    watch_.find(map_, pyramid, model(), m);
  }
  watch_.doubt_place(map_, pyramid, is_trusted(config_.tracker, prior), m);
  if (m.moving) {
    watch_.spread(pyramid, mask_.data());
    masked_ = true;
  }
  const bool by_majority = m.moving || m.doubtful;
  if (by_majority) tracker_.drop(watch_.misfits(), watch_.level());
  tracker_.track(model(), prior, by_majority ? m.X_WC : prior.X_WC, knobs.iterations, r);
  // Along what the scene does not constrain odometry holds, and no majority of noise: as long as it does hold.
  const bool trusted = is_trusted(config_.tracker, prior);
  const auto open = [&] {
    return trusted && r.degenerate_count > 0 &&
           (r.X_WC.translation() - prior.X_WC.translation()).norm() <=
               config_.tracker.claim_translation_m;
  };
  if (by_majority && r.state != TrackingState::kLost && trusted && r.degenerate_count > 0) {
    work += r.work;
    tracker_.track(model(), prior, prior.X_WC, knobs.iterations, r);
  }
  // Weighed by their noise, readings of a thing that the mask has missed have the leverage to carry the camera.
  const auto carried = [&] {
    return r.state != TrackingState::kLost && !open() &&
           watch_.explains(pyramid, model(), r.X_WC) < config_.motion.least_explained;
  };
  // Nor is a camera lost whose place most of the image knows well enough to claim it.
  const bool lost = r.state == TrackingState::kLost && m.consensus.pairs > 0;
  if ((carried() || lost) && !by_majority) {
    work += r.work;
    tracker_.drop(watch_.misfits(), watch_.level());
    tracker_.track(model(), prior, m.X_WC, knobs.iterations, r);
  }
  if (carried()) {
    work += r.work;
    tracker_.track(model(), prior, m.X_WC, {0, 0, 0}, r);
  }
  // Nor one of which the larger part of the image knows the place, whatever has come into it.
  if (r.state == TrackingState::kLost && m.certain && m.consensus.pairs > 0) {
    double kept = 0;
    const auto strangers = watch_.strangers(pyramid.level(watch_.level()), kept);
    if (kept >= kLeastKept) {
      work += r.work;
      tracker_.drop(strangers, watch_.level());
      tracker_.track(model(), prior, m.X_WC, knobs.iterations, r);
    }
  }
  if (lost && !r.claimed) {
    r.state = TrackingState::kLost;
    r.X_WC = prior.X_WC;
  }
  if (!m.certain) r.claimed = r.fully_constrained = false;
  r.work += work + m.work;
  watch_.settle(r);
}

// ---------------------------------------------------------------- lost and found

void FusionTask::watch_for_loss(const TrackingResult& r) noexcept {
  const bool blank = tracker_.pyramid().level(1).valid < tracker_.least_points();
  blank_run_ = blank ? blank_run_ + 1 : 0;
  const bool adrift = r.state != TrackingState::kLost && !r.claimed && r.overlap < kAdriftOverlap;
  adrift_run_ = adrift ? adrift_run_ + 1 : 0;
  if (recovering_ || (r.state != TrackingState::kLost && adrift_run_ < kAdriftFrames)) return;
  // A dark image says nothing of where the camera is: the prior may still hold when it is over.
  if (blank && blank_run_ <= config_.blank_frames) return;
  recovering_ = true;
  watch_.forget();
  confirming_ = look_again_ = false;
  X_looked_WC_.reset();
  relocaliser_.restart();
}

// A leap from where the camera should be is no motion when another place looks like what is seen: then nobody
// knows where it is. Odometry that is trusted leaves no room for one.
void FusionTask::doubt_leap(const RgbdFrame& frame, const MotionPrior& prior,
                            TrackingResult& r) noexcept {
  if (r.state == TrackingState::kLost || is_trusted(config_.tracker, prior)) return;
  const Pose leap = prior.X_WC.inverse() * r.X_WC;
  if (leap.translation().norm() <= config_.leap_translation_m &&
      perception::rotation_angle(leap.linear()) <= config_.leap_rotation_deg * kDegree)
    return;
  if (relocaliser_.alone(tracker_, colour_of(frame), r.X_WC)) return;
  r.state = TrackingState::kLost;
  r.claimed = r.fully_constrained = false;
  r.X_WC = prior.X_WC;
}

// A lost camera is believed to be back when two frames in a row pass the strict gates: the first against
// what was seen last or against a keyframe, the second from the pose that the first one gave; that one is then
// tracked like any other. A frame does one thing about it: one cast, or one keyframe.
void FusionTask::recover(const RgbdFrame& frame, const MotionPrior& prior, const FusionLevel& knobs,
                         TrackingResult& r) noexcept {
  const bool was_confirming = confirming_;
  // Where to look when what was found is not confirmed; odometry carries it on.
  if (was_confirming) {
    X_lost_WC_ = perception::orthonormalised(X_lost_WC_ * (X_WC_.inverse() * prior.X_WC));
  } else {
    X_lost_WC_ = prior.X_WC;
  }
  const auto view = relocaliser_.view();
  tracker_.reacquire(view.valid() ? view : model(), prior.X_WC, r);
  std::uint64_t work = r.work;
  const bool trusted = is_trusted(config_.tracker, prior);
  const bool fits = tracker_.reliable(r, trusted);
  if (fits && was_confirming) {
    MotionPrior near = prior;
    near.X_WC = r.X_WC;
    const double contradiction = r.contradiction, clash = r.clash;
    tracker_.track(model(), near, knobs.iterations, r);
    r.contradiction = contradiction;
    r.clash = clash;
    r.work += work;
    if (r.state != TrackingState::kLost && r.claimed) {
      recovering_ = confirming_ = false;
      return;
    }
    work = r.work;
  }
  const bool blank = tracker_.pyramid().level(1).valid < tracker_.least_points();
  bool found = false;
  if (fits && !was_confirming && (trusted || !view.valid())) {
    // Odometry says that it is no other place; else the next frame is compared in a view without hint. Not before
    // all of it is in the pool: until then it is found again in the view that there is.
    found = look(r.X_WC) && trusted;
    look_again_ = false;
  } else if (was_confirming || look_again_ || (!fits && moved_on())) {
    look_again_ = !look(X_lost_WC_);
  } else if (!blank) {
    const TrackingResult here = r;
    found = relocaliser_.search(map_, tracker_, colour_of(frame), fits ? &here : nullptr, r);
  }
  r.work = work;
  confirming_ = found;
  if (!found) r.X_WC = X_lost_WC_;
  r.state = TrackingState::kLost;
  r.claimed = r.fully_constrained = false;
}

bool FusionTask::look(const Pose& X_WC) noexcept {
  if (!relocaliser_.look(map_, X_WC)) return false;
  X_looked_WC_ = X_WC;
  return true;
}

// Has odometry carried the lost camera away from where it was looked for? Where nothing of the map was to be seen
// counts as well: odometry that is wrong by metres must not keep the search from the kept views.
bool FusionTask::moved_on() const noexcept {
  if (!X_OB_last_) return false;
  const Pose step = (X_looked_WC_ ? *X_looked_WC_ : model_.X_WC).inverse() * X_lost_WC_;
  return step.translation().norm() > 0.1 || perception::rotation_angle(step.linear()) > 6 * kDegree;
}

// Where the camera should be at `exposure`. Also advances what odometry knows to that instant.
perception::MotionPrior FusionTask::predict(rt::Time exposure) noexcept {
  MotionPrior prior;
  const std::optional<Pose> X_OB = odometry_at(exposure);
  if (X_OB && X_OB_last_) {
    const Pose step_B = X_OB_last_->inverse() * *X_OB;
    const double way = step_B.translation().norm();
    const double turn_deg = perception::rotation_angle(step_B.linear()) / kDegree;
    sigma_translation_m_ += config_.odometry_translation_share * way;
    sigma_rotation_deg_ +=
        config_.odometry_rotation_share * turn_deg + config_.odometry_deg_per_m * way;
    const Pose step_C = setup_.X_BC.inverse() * step_B * setup_.X_BC;
    prior.X_WC = X_WC_ * step_C;
    chain_.carry(step_C, config_.odometry_translation_share * way,
                 config_.odometry_rotation_share * turn_deg + config_.odometry_deg_per_m * way);
    prior.X_WC_odometry = chain_.X_WC();
    prior.source = MotionPrior::Source::kOdometry;
    prior.sigma_translation_m = sigma_translation_m_;
    prior.sigma_rotation_deg = sigma_rotation_deg_;
  } else {
    // Without odometry over the whole interval, a later odometry step starts from nothing known.
    sigma_translation_m_ = sigma_rotation_deg_ = 1e3;
    chain_.restart(X_WC_);
    const double dt = seconds_between(exposure_, exposure);
    prior.X_WC = X_WC_ * perception::exp_se3(dt * velocity_);
  }
  X_OB_last_ = X_OB;
  prior.X_WC = perception::orthonormalised(prior.X_WC);
  return prior;
}

void FusionTask::settle_motion(const TrackingResult& r, rt::Time exposure, bool first) noexcept {
  if (first) {
    X_OB_last_ = odometry_at(exposure);
  } else {
    const double dt = seconds_between(exposure_, exposure);
    // A pose among rivals says nothing of the camera's motion.
    if (watch_.certain() || recovering_)
      velocity_ = twist_of(X_WC_.inverse() * r.X_WC) / std::max(dt, 1e-3);
    if (!r.claimed) velocity_ *= config_.velocity_decay;
    // Between two frames of which one was only found, a way is a leap and no motion.
    if (recovering_) velocity_.setZero();
  }
  if (r.fully_constrained) sigma_translation_m_ = sigma_rotation_deg_ = 0;
  X_WC_ = r.X_WC;
  if (first || recovering_) chain_.restart(X_WC_);
  if (r.claimed) chain_.follow(X_WC_);
  exposure_ = exposure;
}

// ---------------------------------------------------------------- odometry

void FusionTask::remember_odometry(const std::optional<OdometryPrior>& odometry) noexcept {
  if (!odometry || !odometry->X_OB.matrix().allFinite()) return;
  if (odometry_count_ > 0) {
    const OdometryPrior& newest = odometry_[(odometry_count_ - 1) % kOdometry];
    if (odometry->taken <= newest.taken) return;
  }
  odometry_[odometry_count_++ % kOdometry] = *odometry;
}

// Interpolated; beyond the newest sample by its velocity, at most 100 ms. Empty: not known then.
std::optional<Pose> FusionTask::odometry_at(rt::Time t) const noexcept {
  if (odometry_count_ == 0) return std::nullopt;
  const OdometryPrior& newest = odometry_[(odometry_count_ - 1) % kOdometry];
  if (t >= newest.taken) {
    const double dt = seconds_between(newest.taken, t);
    if (dt > 0.1) return std::nullopt;
    Twist xi;
    xi << newest.v_OB_B * dt, newest.w_OB_B * dt;
    return perception::orthonormalised(newest.X_OB * perception::exp_se3(xi));
  }
  const std::uint64_t held = std::min<std::uint64_t>(odometry_count_, kOdometry);
  for (std::uint64_t i = 1; i < held; ++i) {
    const OdometryPrior& after = odometry_[(odometry_count_ - i) % kOdometry];
    const OdometryPrior& before = odometry_[(odometry_count_ - i - 1) % kOdometry];
    if (before.taken > t) continue;
    const double f = seconds_between(before.taken, t) / seconds_between(before.taken, after.taken);
    return between(before.X_OB, after.X_OB, f);
  }
  return std::nullopt;
}

}  // namespace tasks
