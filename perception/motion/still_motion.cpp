#include "perception/motion/still_motion.hpp"

#include <algorithm>
#include <cmath>

namespace perception::motion {

namespace {

constexpr int kRounds = 3;         // of sums taken anew
constexpr double kNear_m = 0.004;  // mean way over the points: the sums hold
// chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
// Of the pixels that may be static, unexplained: hypotheses compete.
constexpr double kDoubt = 0.05;
// chosen on: not recorded; judged on: moving 606, moving 707
// How well the camera's motion has been foreseen of late says how far off the next prior may be; at
// most so much.
constexpr double kPriorSigma_m = 0.02, kOfInnovation = 3, kInnovationGain = 1.0 / 8;
// chosen on: moving 54 (6, 17, 1); judged on: moving 606, moving 707
// Fitting so much worse than of late is a mean of two motions.
constexpr float kLoose = 4, kLateScaleGain = 1.0F / 8;
// chosen on: moving 101, moving 404 (movers from the first frame on); judged on: moving 606
constexpr float kYoungLoose = 2;  // while the map is young
// chosen on: moving 1 first 8; judged on: moving 606, moving 707
// So much of the image says what trusted odometry says, and not what the majority says: the
// majority moves.
constexpr double kCorroborated = 0.03;

}  // namespace

StillMotion::StillMotion(const MotionConfig& config, const TrackerConfig& tracker,
                         const WatchedImage& image)
    : config_(config), tracker_(tracker), image_(image) {}

void StillMotion::forget() noexcept {
  late_scale_ = 1;
  innovation_m_ = kPriorSigma_m;
}

// The sums of the cells about a pose.
void StillMotion::linearise(const TrackingPyramid& pyramid, const ModelView& model,
                            const Pose& X_WC, bool again) noexcept {
  X_WF_ = model.X_WF;
  X_FC_ = model.X_WF.inverse(Eigen::Isometry) * X_WC;
  centre_F_ = X_FC_ * Vec3(0, 0, image_.length_m);
  // Where nothing moved of late, half of the image says whether something does.
  const int rows = image_.recent > 0 || doubtful_ ? CellSums::kEdge : CellSums::kEdge / 2;
  consensus_.look(pyramid.level(image_.level), model, X_FC_, centre_F_, image_.length_m, rule_,
                  rows, again);
}

double StillMotion::prior_sigma_m() const noexcept {
  return std::clamp(kOfInnovation * innovation_m_, kNear_m, kPriorSigma_m);
}

Pose StillMotion::moved_by(const Vec6& xi) const noexcept {
  const Eigen::Translation3d to_centre(-centre_F_), back(centre_F_);
  return orthonormalised(X_WF_ * Pose(back * exp_se3(xi) * to_centre * X_FC_));
}

// moved_by(twist_to(X)) = X.
Vec6 StillMotion::twist_to(const Pose& X_WC) const noexcept {
  const Eigen::Translation3d to_centre(-centre_F_), back(centre_F_);
  const Pose moved(to_centre * (X_WF_.inverse(Eigen::Isometry) * X_WC) *
                   X_FC_.inverse(Eigen::Isometry) * back);
  const Eigen::AngleAxisd r(moved.linear());
  Vec6 xi;
  xi << moved.translation(), r.angle() * r.axis();
  return xi;
}

bool StillMotion::against_odometry(const MotionPrior& prior, const MotionResult& r) const noexcept {
  return is_trusted(tracker_, prior) &&
         consensus_.mean_way(r.consensus.xi, twist_to(prior.X_WC_odometry)) >= kNear_m;
}

// Least squares from a pose, the sums taken anew where it has gone far: they hold for centimetres.
// False: it goes on.
bool StillMotion::settle_at(const TrackingPyramid& pyramid, const ModelView& model,
                            const Pose& X_WC, MotionResult& out) noexcept {
  Pose at = X_WC;
  bool settled = false;
  for (int round = 0; round < kRounds && !settled; ++round) {
    linearise(pyramid, model, at, round > 0);
    consensus_.settle(memory_, out.consensus);
    out.work += pixels();
    at = moved_by(out.consensus.xi);
    settled = consensus_.mean_way(out.consensus.xi, Vec6::Zero()) < kNear_m;
  }
  out.X_WC = at;
  return settled;
}

// A pose that is believed though most of the image may say otherwise: only what fits it has a say.
void StillMotion::stay_at(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
                          MotionResult& out) noexcept {
  linearise(pyramid, model, X_WC);
  consensus_.stay(memory_, out.consensus);
  out.work += pixels();
  out.X_WC = moved_by(out.consensus.xi);
}

void StillMotion::begin(const Pose& X_prior_WC) noexcept {
  X_prior_WC_ = X_prior_WC;
  looked_ = certain_ = held_ = false;
}

void StillMotion::look(const TrackingPyramid& pyramid, const ModelView& model,
                       const MotionPrior& prior, MotionResult& out) noexcept {
  rule_.noise = {static_cast<float>(tracker_.noise_m), static_cast<float>(tracker_.noise_per_m2),
                 static_cast<float>(tracker_.noise_from_m)};
  rule_.voxel_m = image_.map_voxel_m;
  const bool settled = settle_at(pyramid, model, prior.X_WC, out);
  looked_ = true;
  certain_ = true;
  out.cells_misfit = out.consensus.misfits;
  X_majority_WC_ = out.X_WC;
  scale_ = out.consensus.scale;
  doubtful_ = out.doubtful = !settled || out.consensus.unexplained > kDoubt ||
                             loose(out.consensus.scale) || against_odometry(prior, out);
}

bool StillMotion::loose(float scale) const noexcept {
  return scale > (image_.young() ? kYoungLoose : kLoose) * late_scale_;
}

// By the prior or by the whole image: whichever more of the image speaks for alone, a leap with a
// share of it. Where both fit only loosely they are a mean of two motions: then what fits the
// expected pose itself has a say, too. Returns what speaks for the next best, over the best.
double StillMotion::choose_start(const TrackingPyramid& pyramid, const ModelView& model,
                                 const Pose& X_expected_WC, const Pose& X_tracked_WC,
                                 MotionResult& out) noexcept {
  const MotionResult by_prior = out;
  consensus_.stand(stand_[0]);
  static_cast<void>(settle_at(pyramid, model, X_tracked_WC, out));
  consensus_.stand(stand_[1]);
  double rival = 0;
  Pose X_WC = out.X_WC;
  std::size_t chosen = 1;
  // Twists are taken about one pose at a time: of `i` against the one chosen so far.
  const auto challenge = [&](std::size_t i, const Pose& X_i_WC) {
    const Vec6 expected = twist_to(X_expected_WC), a = twist_to(X_i_WC), b = twist_to(X_WC);
    if (consensus_.mean_way(a, b) < Consensus::kOtherMotion_m) return false;
    const float scale = std::max(2 * late_scale_, 0.03F);
    const auto says = [&](std::size_t ours, std::size_t theirs, const Vec6& xi) {
      return consensus_.only(stand_[ours], stand_[theirs], scale) *
             Consensus::likely(consensus_.mean_way(xi, expected), prior_sigma_m());
    };
    const double new_one = says(i, chosen, a), old_one = says(chosen, i, b);
    rival = std::min(new_one, old_one) / std::max({new_one, old_one, 1.0});
    if (new_one < Consensus::kRivalLimit * old_one) return false;
    chosen = i, X_WC = X_i_WC;
    return true;
  };
  if (challenge(0, by_prior.X_WC) || by_prior.consensus.better_than(out.consensus))
    static_cast<void>(settle_at(pyramid, model, by_prior.X_WC, out));
  if (!loose(out.consensus.scale)) return rival;
  const MotionResult loosely = out;
  stay_at(pyramid, model, X_expected_WC, out);
  consensus_.stand(stand_[2]);
  if (!challenge(2, out.X_WC)) static_cast<void>(settle_at(pyramid, model, loosely.X_WC, out));
  return rival;
}

void StillMotion::compete(const TrackingPyramid& pyramid, const ModelView& model,
                          const MotionPrior& prior, const Pose& X_tracked_WC,
                          MotionResult& out) noexcept {
  if (!looked_) return;
  const bool trusted = is_trusted(tracker_, prior);
  const double leap =
      choose_start(pyramid, model, trusted ? prior.X_WC_odometry : prior.X_WC, X_tracked_WC, out);
  const bool competed = out.consensus.unexplained > kDoubt || loose(out.consensus.scale);
  if (competed) {
    const Vec6 still = twist_to(model.X_WF),
               expected = twist_to(trusted ? prior.X_WC_odometry : prior.X_WC);
    consensus_.compete(memory_, still, expected, prior_sigma_m(), image_.frame, out.consensus);
    out.work += 4 * pixels();  // of hypotheses
    out.certain = out.consensus.certain && leap < Consensus::kRivalLimit;
    out.X_WC = moved_by(out.consensus.xi);
  }
  let_odometry_choose(pyramid, model, prior, competed, out);
  X_majority_WC_ = out.X_WC;
  scale_ = out.consensus.scale;
  certain_ = out.certain;
  out.cells_misfit = out.consensus.misfits;
}

// Odometry that is good enough to claim on settles which of two motions is the camera's, where some
// of the image says the same.
void StillMotion::let_odometry_choose(const TrackingPyramid& pyramid, const ModelView& model,
                                      const MotionPrior& prior, bool competed,
                                      MotionResult& out) noexcept {
  const bool trusted = is_trusted(tracker_, prior);
  const Vec6 by_odometry = twist_to(prior.X_WC_odometry);
  const bool against = against_odometry(prior, out), outvoted = competed && out.consensus.outvoted;
  if (trusted &&
      (against ? consensus_.own_share(by_odometry) > kCorroborated : outvoted || !out.certain)) {
    stay_at(pyramid, model, against ? prior.X_WC_odometry : out.X_WC, out);
    out.certain = held_ = true;
  } else if (competed && (outvoted || !out.certain)) {
    stay_at(pyramid, model, out.X_WC, out);
    held_ = true;
  } else if (competed && consensus_.mean_way(out.consensus.xi, Vec6::Zero()) >= kNear_m) {
    static_cast<void>(settle_at(pyramid, model, out.X_WC, out));
  }
}

// Of the readings that were looked at: how many meet a surface of the map at all.
double StillMotion::met_share() const noexcept {
  const CellSums& sums = consensus_.sums();
  double live = 0, pairs = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums.size()); ++c)
    live += static_cast<double>(sums.live[c]), pairs += static_cast<double>(sums.pairs[c]);
  return live > 0 ? pairs / live : 0;
}

double StillMotion::explains(const TrackingPyramid& pyramid, const ModelView& model,
                             const Pose& X_WC) noexcept {
  if (!looked_) return 1;
  const Vec6 xi = twist_to(X_WC);
  // Support does not speak for a pose that is held against more of it.
  if (held_ && consensus_.mean_way(xi, twist_to(X_majority_WC_)) >= kNear_m) return 0;
  const double share = consensus_.share_of_winner(xi);
  if (share >= config_.least_explained || consensus_.mean_way(xi, Vec6::Zero()) < kNear_m)
    return share;
  // Too far for these sums: each by its own; then those of the majority again, for misfits() and
  // the next question.
  linearise(pyramid, model, X_WC);
  const double theirs = consensus_.support_of(Vec6::Zero());
  linearise(pyramid, model, X_majority_WC_);
  const double ours = consensus_.reconsider();
  return ours > 0 ? theirs / ours : 1;
}

void StillMotion::settle(const TrackingResult& r) noexcept {
  const Pose step = X_prior_WC_.inverse(Eigen::Isometry) * r.X_WC;
  const double way =
      std::hypot(step.translation().norm(), image_.length_m * rotation_angle(step.linear()));
  innovation_m_ += kInnovationGain * (std::min(way, kPriorSigma_m) - innovation_m_);
  late_scale_ +=
      std::max(kLateScaleGain, 1 / static_cast<float>(image_.known)) * (scale_ - late_scale_);
}

}  // namespace perception::motion
