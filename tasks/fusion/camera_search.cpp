#include "tasks/fusion/camera_search.hpp"

#include <numbers>

#include "perception/motion/motion_watch.hpp"
#include "tasks/fusion/fusion_parts.hpp"

namespace tasks {

namespace {

using perception::MotionPrior;
using perception::RgbdFrame;
using perception::TrackingResult;
using perception::TrackingState;

constexpr double kDegree = std::numbers::pi / 180;
// chosen on: moving 54 (6, 17, 1); judged on: moving 606, moving 707
// Unclaimed with so little of the image on the map for so many frames: by itself it does not get
// better. A wall that says nothing of the way along it is met by nearly all of its image.
constexpr double kAdriftOverlap = 0.65;
constexpr int kAdriftFrames = 5;

}  // namespace

CameraSearch::CameraSearch(rt::NonRealtime& nrt, const FusionConfig& config,
                           const perception::Intrinsics& camera, CameraTracking& tracking)
    : config_(config), tracking_(tracking), relocaliser_(nrt, config.relocaliser, camera) {}

void CameraSearch::begin() noexcept {
  lost_ = true;
  confirming_ = look_again_ = false;
  X_looked_WC_.reset();
  relocaliser_.restart();
}

void CameraSearch::remember(const RgbdFrame& frame, const Pose& X_WC) noexcept {
  relocaliser_.remember(tracking_.pyramid(), colour_of(frame), X_WC);
}

void CameraSearch::watch_for_loss(const TrackingResult& r) noexcept {
  const bool blank = tracking_.blank();
  blank_run_ = blank ? blank_run_ + 1 : 0;
  const bool adrift = r.state != TrackingState::kLost && !r.claimed && r.overlap < kAdriftOverlap;
  adrift_run_ = adrift ? adrift_run_ + 1 : 0;
  if (lost_ || (r.state != TrackingState::kLost && adrift_run_ < kAdriftFrames)) return;
  // A dark image says nothing of where the camera is: the prior may still hold when it is over.
  if (blank && blank_run_ <= config_.blank_frames) return;
  tracking_.watch().forget();
  begin();
}

// A leap from where the camera should be is no motion when another place looks like what is seen:
// then nobody knows where it is. Odometry that is trusted leaves no room for one.
void CameraSearch::doubt_leap(const RgbdFrame& frame, const MotionPrior& prior,
                              TrackingResult& r) noexcept {
  if (r.state == TrackingState::kLost || is_trusted(config_.tracker, prior)) return;
  const Pose leap = prior.X_WC.inverse() * r.X_WC;
  if (leap.translation().norm() <= config_.leap_translation_m &&
      perception::rotation_angle(leap.linear()) <= config_.leap_rotation_deg * kDegree)
    return;
  if (relocaliser_.alone(tracking_.tracker(), colour_of(frame), r.X_WC)) return;
  r.state = TrackingState::kLost;
  r.claimed = r.fully_constrained = false;
  r.X_WC = prior.X_WC;
}

// Does a frame that fits agree with the one before it? Then it was tracked like any other: r.
bool CameraSearch::confirmed(const LostFrame& f, bool was_confirming, TrackingResult& r) noexcept {
  if (!was_confirming) return false;
  MotionPrior near = f.prior;
  near.X_WC = r.X_WC;
  const double contradiction = r.contradiction, clash = r.clash;
  const std::uint64_t work = r.work;
  tracking_.tracker().track(f.model, near, f.knobs.iterations, r);
  r.contradiction = contradiction;
  r.clash = clash;
  r.work += work;
  return r.state != TrackingState::kLost && r.claimed;
}

void CameraSearch::recover(perception::TsdfMap& map, const LostFrame& f,
                           TrackingResult& r) noexcept {
  const bool was_confirming = confirming_;
  perception::Tracker& tracker = tracking_.tracker();
  const MotionPrior& prior = f.prior;
  // Where to look when what was found is not confirmed; odometry carries it on.
  if (was_confirming) {
    X_lost_WC_ = perception::orthonormalised(X_lost_WC_ * (f.X_last_WC.inverse() * prior.X_WC));
  } else {
    X_lost_WC_ = prior.X_WC;
  }
  const auto view = relocaliser_.view();
  tracker.reacquire(view.valid() ? view : f.model, prior.X_WC, r);
  const bool trusted = is_trusted(config_.tracker, prior);
  const bool fits = tracker.reliable(r, trusted);
  if (fits && confirmed(f, was_confirming, r)) {
    lost_ = confirming_ = false;
    return;
  }
  const std::uint64_t work = r.work;
  bool found = false;
  if (fits && !was_confirming && (trusted || !view.valid())) {
    // Trusted odometry rules out a place that looks alike. Without it the next frame is compared
    // with a new view, cast without a hint. Until that view's blocks are in the pool, the present
    // view is used.
    found = look(map, r.X_WC) && trusted;
    look_again_ = false;
  } else if (was_confirming || look_again_ || (!fits && moved_on(f))) {
    look_again_ = !look(map, X_lost_WC_);
  } else if (!tracking_.blank()) {
    const TrackingResult here = r;
    found = relocaliser_.search(map, tracker, colour_of(f.frame), fits ? &here : nullptr, r);
  }
  r.work = work;
  confirming_ = found;
  if (!found) r.X_WC = X_lost_WC_;
  r.state = TrackingState::kLost;
  r.claimed = r.fully_constrained = false;
}

bool CameraSearch::look(perception::TsdfMap& map, const Pose& X_WC) noexcept {
  if (!relocaliser_.look(map, X_WC)) return false;
  X_looked_WC_ = X_WC;
  return true;
}

// Has odometry carried the lost camera away from where it was looked for? Where nothing of the map
// was to be seen counts as well: odometry that is wrong by metres must not keep the search from the
// kept views.
bool CameraSearch::moved_on(const LostFrame& f) const noexcept {
  if (!f.has_odometry) return false;
  const Pose step = (X_looked_WC_ ? *X_looked_WC_ : f.model.X_WF).inverse() * X_lost_WC_;
  return step.translation().norm() > 0.1 || perception::rotation_angle(step.linear()) > 6 * kDegree;
}

}  // namespace tasks
