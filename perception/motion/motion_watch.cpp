#include "perception/motion/motion_watch.hpp"

#include <algorithm>
#include <cmath>

#include "perception/motion/evidence.hpp"

namespace perception {

namespace {

constexpr int kRounds = 3;         // of sums taken anew
constexpr double kNear_m = 0.004;  // mean way over the points: the sums hold
// chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
constexpr double kDoubt =
    0.05;  // of the pixels that may be static, unexplained: hypotheses compete
// chosen on: not recorded; judged on: moving 606, moving 707
constexpr double kSudden = 0.02;  // of the image
// How well the camera's motion has been foreseen of late says how far off the next prior may be; at most so much.
constexpr double kPriorSigma_m = 0.02, kOfInnovation = 3, kInnovationGain = 1.0 / 8;
// chosen on: moving 1 (13), WrongOdometry.OneThatBeginsAnewIsFoundOut; judged on: moving 606, moving 707
constexpr double kLeastMet = 0.8;  // of the readings: a pose to look for thin things by
// chosen on: moving 54 (6, 17, 1); judged on: moving 606, moving 707
// Fitting so much worse than of late is a mean of two motions.
constexpr float kLoose = 4, kLateScaleGain = 1.0F / 8;
// chosen on: moving 101, moving 404 (movers from the first frame on); judged on: moving 606
constexpr float kYoungLoose = 2;  // while the map is young
// chosen on: moving 1 first 8; judged on: moving 606, moving 707
// So much of the image says what trusted odometry says, and not what the majority says: the majority moves.
constexpr double kCorroborated = 0.03;
// chosen on: moving 101, moving 404 (movers from the first frame on, share >= .12), moving 1 (9), moving 505 (ten at level 2), recording; judged on: moving 606
// Of the image: where the map should show something and shows nothing, beyond what it did when there was least of that;
// what does not fit, and lies behind what does.
constexpr double kHoles = 0.04, kOfLeastHoles = 1.5, kUnfit = 0.10;
constexpr int kDoubtFrames = 10;  // without, and it may be claimed again
constexpr int kSoon = 2;          // frames, at most, to the second one that proves it
constexpr int kLeastShown = 3;    // of 3 x 3 pixels of the view
// chosen on: moving 51 (3, 22), moving 7 (6), moving 53 (5), recording backwards; judged on: moving 606, moving 707
// A map that has drifted misses what stands still by more than noise: RMS of the tracker's residuals over some frames,
// at most so much; five of what is beyond the first, which noise and voxels make (.6 to .8 mm in rendered rooms,
// 2 to 5 in the recording), are no motion yet.
constexpr float kFreeMapError_m = 0.001F, kMostMapError_m = 0.005F, kOfMapError = 5,
                kMapErrorGain = 1.0F / 16;

}  // namespace

void MotionConfig::describe(config::Section& s) {
  s.flag("on", on, "look for what moves; off: everything is the place")
      .number("front_m", front_m, 0.001, 0.2, "in front of the map's surface by this much ...")
      .number("front_voxel", front_voxel, 0, 4, "... and this share of a voxel ...")
      .number("front_sigma", front_sigma, 0, 20, "... and so many sigma: it moves")
      .number("least_share", least_share, 0.01, 1, "of a thing that has to be seen to move")
      .integer("least_pixels", least_pixels, 4, 1000, "of the coarse image, of a thing")
      .integer("rest_frames", rest_frames, 2, 300, "in its place, and it is part of the map")
      .number("least_explained", least_explained, 0, 1,
              "of what stands still, by a tracked pose; below, it is carried")
      .number("rest_cell_m", rest_cell_m, 0.005, 0.2, "edge of such a place");
}

MotionWatch::MotionWatch(rt::NonRealtime&, const MotionConfig& config, const TrackerConfig& tracker)
    : config_(config),
      tracker_(tracker),
      mask_(kMost),
      evidence_(kMost + 16),  // read eight at a time
      seed_(kMost),
      recalled_(kMost),
      visited_(kMost),
      core_(kMost),
      queue_(kMost),
      points_W_(kMost),
      now_W_(kMost),
      places_(motion::kPlaceSlots),
      taken_(motion::kPlaceSlots / 32) {}

void MotionWatch::forget() noexcept {
  remembered_ = 0;
  had_ = false;
  masked_share_ = 0;
  recent_ = 0;
  map_error_m_ = 0;
  late_scale_ = 1;
  innovation_m_ = kPriorSigma_m;
  std::fill(mask_.begin(), mask_.end(), std::uint8_t{0});
  std::fill(places_.begin(), places_.end(), Place{});
  std::fill(taken_.begin(), taken_.end(), 0U);
  trails_ = {};
}

float MotionWatch::front_limit(float z) const noexcept {
  const float beyond = std::max(z - static_cast<float>(tracker_.noise_from_m), 0.0F);
  const float sigma =
      0.5F * static_cast<float>(tracker_.noise_m +
                                tracker_.noise_per_m2 * static_cast<double>(beyond * beyond));
  return static_cast<float>(config_.front_m) +
         kOfMapError * std::max(0.0F, map_error_m_ - kFreeMapError_m) +
         static_cast<float>(config_.front_voxel) * voxel_m_ +
         static_cast<float>(config_.front_sigma) * sigma;
}

Vec3f MotionWatch::point_C(const DepthLevel& live, int i) const noexcept {
  const int u = i % width_, v = i / width_;
  const float z = live.depth.row(v)[u];
  constexpr int kMargin = PaddedImage::kMargin;
  return {live.x_factor[static_cast<std::size_t>(u + kMargin)] * z,
          live.y_factor[static_cast<std::size_t>(v + kMargin)] * z, z};
}

// The sums of the cells about a pose.
void MotionWatch::linearise(const TrackingPyramid& pyramid, const ModelView& model,
                            const Pose& X_WC, bool again) noexcept {
  X_WF_ = model.X_WF;
  X_FC_ = model.X_WF.inverse(Eigen::Isometry) * X_WC;
  centre_F_ = X_FC_ * Vec3(0, 0, length_m_);
  // Where nothing moved of late, half of the image says whether something does.
  const int rows = recent_ > 0 || doubtful_ ? CellSums::kEdge : CellSums::kEdge / 2;
  consensus_.look(pyramid.level(level_), model, X_FC_, centre_F_, length_m_, rule_, rows, again);
}

double MotionWatch::prior_sigma_m() const noexcept {
  return std::clamp(kOfInnovation * innovation_m_, kNear_m, kPriorSigma_m);
}

Pose MotionWatch::moved_by(const Vec6& xi) const noexcept {
  const Eigen::Translation3d to_centre(-centre_F_), back(centre_F_);
  return orthonormalised(X_WF_ * Pose(back * exp_se3(xi) * to_centre * X_FC_));
}

// moved_by(twist_to(X)) = X.
Vec6 MotionWatch::twist_to(const Pose& X_WC) const noexcept {
  const Eigen::Translation3d to_centre(-centre_F_), back(centre_F_);
  const Pose moved(to_centre * (X_WF_.inverse(Eigen::Isometry) * X_WC) *
                   X_FC_.inverse(Eigen::Isometry) * back);
  const Eigen::AngleAxisd r(moved.linear());
  Vec6 xi;
  xi << moved.translation(), r.angle() * r.axis();
  return xi;
}

bool MotionWatch::against_odometry(const MotionPrior& prior, const MotionResult& r) const noexcept {
  return is_trusted(tracker_, prior) &&
         consensus_.mean_way(r.consensus.xi, twist_to(prior.X_WC_odometry)) >= kNear_m;
}

// Least squares from a pose, the sums taken anew where it has gone far: they hold for centimetres.
// False: it goes on.
bool MotionWatch::settle_at(const TrackingPyramid& pyramid, const ModelView& model,
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
void MotionWatch::stay_at(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
                          MotionResult& out) noexcept {
  linearise(pyramid, model, X_WC);
  consensus_.stay(memory_, out.consensus);
  out.work += pixels();
  out.X_WC = moved_by(out.consensus.xi);
}

// Cells of which a quarter moved in the last image may not be static.
void MotionWatch::remember_cells(const DepthLevel& live, const Pose& X_WC) noexcept {
  memory_.fill(1);
  if (!had_) return;
  recall(live, X_WC);
  const int columns = (width_ + CellSums::kEdge - 1) / CellSums::kEdge,
            rows = (height_ + CellSums::kEdge - 1) / CellSums::kEdge;
  for (int c = 0; c < columns * rows; ++c) {
    const int u0 = c % columns * CellSums::kEdge, v0 = c / columns * CellSums::kEdge;
    int n = 0, m = 0;
    for (int v = v0; v < std::min(v0 + CellSums::kEdge, height_); ++v)
      for (int u = u0; u < std::min(u0 + CellSums::kEdge, width_); ++u, ++n)
        m += recalled_[static_cast<std::size_t>(v * width_ + u)];
    if (m > n / 4) memory_[static_cast<std::size_t>(c)] = 0;
  }
}

void MotionWatch::look(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
                       const MotionPrior& prior, MotionResult& out) noexcept {
  out = MotionResult{};
  out.X_WC = X_prior_WC_ = prior.X_WC;
  looked_ = certain_ = held_ = false;
  if (!config_.on) return;
  ++frame_;
  level_ = TrackingPyramid::kLevels - 1;
  while (level_ > 0 && pyramid.level(level_).depth.width() < 96) --level_;
  const DepthLevel& live = pyramid.level(level_);
  width_ = live.depth.width(), height_ = live.depth.height();
  voxel_m_ = static_cast<float>(map.voxel_size());
  length_m_ = pyramid.mean_depth(
      {static_cast<float>(tracker_.noise_m), 0.0F, static_cast<float>(tracker_.noise_from_m)});
  if (!fits_cells(width_, height_) || !(length_m_ > 0) || !model.valid()) {
    std::fill_n(mask_.begin(), std::min(width_ * height_, kMost), std::uint8_t{0});
    return;
  }
  rule_.noise = {static_cast<float>(tracker_.noise_m), static_cast<float>(tracker_.noise_per_m2),
                 static_cast<float>(tracker_.noise_from_m)};
  rule_.voxel_m = map.voxel_size();
  remember_cells(live, prior.X_WC);
  const bool settled = settle_at(pyramid, model, prior.X_WC, out);
  looked_ = true;
  certain_ = true;
  out.cells_misfit = out.consensus.misfits;
  X_majority_WC_ = out.X_WC;
  scale_ = out.consensus.scale;
  doubtful_ = out.doubtful = !settled || out.consensus.unexplained > kDoubt ||
                             loose(out.consensus.scale) || against_odometry(prior, out);
}

bool MotionWatch::loose(float scale) const noexcept {
  return scale > (known_ < kYoungMap ? kYoungLoose : kLoose) * late_scale_;
}

// By the prior or by the whole image: whichever more of the image speaks for alone, a leap with a share of it. Where
// both fit only loosely they are a mean of two motions: then what fits the expected pose itself has a say, too. Returns
// what speaks for the next best, over the best.
double MotionWatch::choose_start(const TrackingPyramid& pyramid, const ModelView& model,
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

void MotionWatch::compete(const TrackingPyramid& pyramid, const ModelView& model,
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
    consensus_.compete(memory_, still, expected, prior_sigma_m(), frame_, out.consensus);
    out.work += 4 * pixels();  // of hypotheses
    out.certain = out.consensus.certain && leap < Consensus::kRivalLimit;
    out.X_WC = moved_by(out.consensus.xi);
  }
  // Odometry that is good enough to claim on settles which of two motions is the camera's, where some of the image says the same.
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
  X_majority_WC_ = out.X_WC;
  scale_ = out.consensus.scale;
  certain_ = out.certain;
  out.cells_misfit = out.consensus.misfits;
}

void MotionWatch::find(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
                       MotionResult& out) noexcept {
  model_ = model, X_FW_ = model.X_WF.inverse(Eigen::Isometry);
  out.moving = out.sudden = false;
  out.masked_share = 0;
  if (!looked_) return;
  const DepthLevel& live = pyramid.level(level_);
  std::fill_n(mask_.begin(), width_ * height_, std::uint8_t{0});
  // Nothing moved of late: a quarter of what does not meet its surface says whether something does, then all of that.
  start_evidence(map, out.X_WC);
  MapReader reader(map, 1.0);
  if (recent_ == 0) {
    if (!glimpse(map, reader, live, (config_.least_pixels + 1) / 2)) return;
    gather_evidence(map, reader, live, false);
    if (patches(map, reader, live) < config_.least_pixels) return;
  }
  // A thing is more than the cells that do not fit.
  gather_evidence(map, reader, live, true);
  out.evidence = patches(map, reader, live);
  recent_ = out.evidence >= config_.least_pixels ? config_.rest_frames : std::max(0, recent_ - 1);
  if (recent_ == 0) return;
  out.work += 8 * pixels();
  if (had_)
    recall(live, out.X_WC);
  else
    std::fill_n(recalled_.begin(), width_ * height_, std::uint8_t{0});
  grow(live);
  int masked = 0, valid = 0;
  fringe(live);
  // By a pose that is wrong, edges look like thin things.
  if (!doubtful_ && met_share() >= kLeastMet) grow_thin(live);
  for (int i = 0; i < width_ * height_; ++i) {
    if (mask_[static_cast<std::size_t>(i)] != 0)
      ++masked, now_W_[static_cast<std::size_t>(i)] = point_W(live, i);
    valid += live.depth.row(i / width_)[i % width_] > 0 ? 1 : 0;
  }
  out.moving = masked > 0;
  out.masked_share = valid > 0 ? static_cast<double>(masked) / valid : 0;
  out.sudden = out.masked_share > 2 * masked_share_ + kSudden;
}

// Of the readings that were looked at: how many meet a surface of the map at all.
double MotionWatch::met_share() const noexcept {
  const CellSums& sums = consensus_.sums();
  double live = 0, pairs = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums.size()); ++c)
    live += static_cast<double>(sums.live[c]), pairs += static_cast<double>(sums.pairs[c]);
  return live > 0 ? pairs / live : 0;
}

// Does the map know where the point lies, and show nothing in the view where it should be? What has never been seen before
// is not asked for: what comes into range, or from behind a thing.
bool MotionWatch::shows_nothing(MapReader& reader, const Pose& X_FC,
                                const Vec3f& p_C) const noexcept {
  const Vec3 p_F = X_FC * p_C.cast<double>();
  const Intrinsics& k = model_.intrinsics;
  if (!(p_F.z() > 0)) return false;
  const Eigen::Vector2d px = k.project(p_F) + Eigen::Vector2d(0.5, 0.5);
  if (!(px.x() >= 1 && px.y() >= 1 && px.x() < k.width - 1 && px.y() < k.height - 1)) return false;
  int shown = 0;
  for (int n = 0; n < 9; ++n)
    shown += model_.at(static_cast<int>(px.x()) + n % 3 - 1,
                       static_cast<int>(px.y()) + n / 3 - 1)[3] > 0;
  if (shown >= kLeastShown) return false;
  const Vec3 node = (model_.X_WF * p_F) / static_cast<double>(voxel_m_);
  return reader.known(reader.word(static_cast<int>(std::lround(node.x())),
                                  static_cast<int>(std::lround(node.y())),
                                  static_cast<int>(std::lround(node.z()))));
}

// A coarse pixel fits or it does not: it is masked, or of a cell that meets no surface or misses the one that it meets. A
// map that is made by a wrong motion has no surface in more and more places, as what it saw there is carved and what it sees
// lies elsewhere in every image. A real camera's young map has holes, too, but they close.
void MotionWatch::doubt_place(const MapView& map, const TrackingPyramid& pyramid, bool trusted,
                              MotionResult& out) noexcept {
  if (!looked_ || trusted || known_ >= kYoungMap) return;
  const DepthLevel& live = pyramid.level(level_);
  const CellSums& sums = consensus_.sums();
  const Pose X_FC = X_FW_ * out.X_WC;
  MapReader reader(map, 1.0);
  std::array<double, 2> pixels{}, depth{};  // that fit, that do not
  double nowhere = 0;
  // An eighth of the pixels is enough for shares of some hundredths.
  for (int v = 0; v < height_; v += 2)
    for (int u = v & 2; u < width_; u += 4) {
      const float z = live.depth.row(v)[u];
      if (!(z > 0)) continue;
      const int i = v * width_ + u;
      const auto c = static_cast<std::size_t>(cell_of(u, v));
      const bool met = sums.pairs[c] >= 0.5F * sums.live[c],
                 misses = sums.pairs[c] >= Consensus::kLeastPairs &&
                          !consensus_.fits_noise(static_cast<int>(c)),
                 masked = mask_[static_cast<std::size_t>(i)] != 0;
      const std::size_t k = masked || !met || misses ? 1 : 0;
      pixels[k] += 1, depth[k] += static_cast<double>(z);
      if (!met && !masked && shows_nothing(reader, X_FC, point_C(live, i))) nowhere += 1;
    }
  out.work += this->pixels() / 8;
  const double all = std::max(pixels[0] + pixels[1], 1.0), share = nowhere / all;
  // Where a thing has been seen to move, it is known what moves.
  const bool grows = known_ > 1 && masked_share_ < kUnfit &&
                     share >= kHoles + kOfLeastHoles * std::max(least_holes_, own_holes_),
             behind = depth[1] * pixels[0] >= depth[0] * pixels[1];
  least_holes_ = known_ > 1 ? std::min(least_holes_, share) : share;
  const bool unfit = behind && pixels[1] >= kUnfit * all, again = grown_ago_ <= kSoon;
  // Holes that are gone in the next image are the map's own: far surfaces at a coarse level (what misses them is dropped, and
  // so not cast the next time), a room that a door opens.
  if (grown_ago_ == 1 && !sure_ && share < kHoles / 2) own_holes_ = std::max(own_holes_, holes_);
  holes_ = share;
  sure_ = (sure_ && in_doubt_ > 0) || (unfit && grows && again);
  grown_ago_ = unfit && grows ? 1 : std::min(grown_ago_ + 1, kSoon + 1);
  in_doubt_ = unfit && sure_ ? kDoubtFrames : std::max(0, in_doubt_ - 1);
  if (in_doubt_ > 0) out.certain = certain_ = false;
}

double MotionWatch::explains(const TrackingPyramid& pyramid, const ModelView& model,
                             const Pose& X_WC) noexcept {
  if (!looked_) return 1;
  const Vec6 xi = twist_to(X_WC);
  // Support does not speak for a pose that is held against more of it.
  if (held_ && consensus_.mean_way(xi, twist_to(X_majority_WC_)) >= kNear_m) return 0;
  const double share = consensus_.share_of_winner(xi);
  if (share >= config_.least_explained || consensus_.mean_way(xi, Vec6::Zero()) < kNear_m)
    return share;
  // Too far for these sums: each by its own; then those of the majority again, for misfits() and the next question.
  linearise(pyramid, model, X_WC);
  const double theirs = consensus_.support_of(Vec6::Zero());
  linearise(pyramid, model, X_majority_WC_);
  const double ours = consensus_.reconsider();
  return ours > 0 ? theirs / ours : 1;
}

ImageView<const std::uint8_t> MotionWatch::misfits() noexcept {
  std::copy_n(mask_.begin(), width_ * height_, seed_.begin());
  const CellSums& sums = consensus_.sums();
  for (int c = 0; c < sums.size(); ++c) {
    if (sums.pairs[static_cast<std::size_t>(c)] < Consensus::kLeastPairs || consensus_.fits(c))
      continue;
    const int u0 = c % sums.columns * CellSums::kEdge, v0 = c / sums.columns * CellSums::kEdge;
    for (int v = v0; v < std::min(v0 + CellSums::kEdge, height_); ++v)
      std::fill(seed_.begin() + v * width_ + u0,
                seed_.begin() + v * width_ + std::min(u0 + CellSums::kEdge, width_),
                std::uint8_t{1});
  }
  return {seed_.data(), width_, height_, width_};
}

ImageView<const std::uint8_t> MotionWatch::strangers(const DepthLevel& live,
                                                     double& kept_share) noexcept {
  const ImageView<const std::uint8_t> out = misfits();
  const CellSums& sums = consensus_.sums();
  int kept = 0, valid = 0;
  for (int i = 0; i < width_ * height_; ++i) {
    const int u = i % width_, v = i / width_;
    const auto c = static_cast<std::size_t>(cell_of(u, v));
    const auto p = static_cast<std::size_t>(i);
    if (sums.pairs[c] < 0.5F * sums.live[c] || evidence_[p] == kRested) seed_[p] = 1;
    const bool left = seed_[p] == 0 && live.depth.row(v)[u] > 0;
    valid += left || seed_[p] != 0 ? 1 : 0;  // what was dropped before has no depth any more
    kept += left ? 1 : 0;
  }
  kept_share = valid > 0 ? static_cast<double>(kept) / valid : 0;
  return out;
}

void MotionWatch::settle(const TrackingResult& r) noexcept {
  if (r.claimed) known_ = std::min(known_ + 1, kYoungMap);
  if (!certain_) return;
  if (r.claimed) {
    const Pose step = X_prior_WC_.inverse(Eigen::Isometry) * r.X_WC;
    const double way =
        std::hypot(step.translation().norm(), length_m_ * rotation_angle(step.linear()));
    innovation_m_ += kInnovationGain * (std::min(way, kPriorSigma_m) - innovation_m_);
    late_scale_ +=
        std::max(kLateScaleGain, 1 / static_cast<float>(known_)) * (scale_ - late_scale_);
    map_error_m_ += kMapErrorGain *
                    (std::min(static_cast<float>(r.residual_m), kMostMapError_m) - map_error_m_);
  }
  int masked = 0;
  for (int i = 0; recent_ > 0 && i < width_ * height_; ++i)
    if (mask_[static_cast<std::size_t>(i)] != 0)
      points_W_[static_cast<std::size_t>(masked++)] = now_W_[static_cast<std::size_t>(i)];
  // What has just come back to where the map shows it is masked no more, and may leave again: for a while it is
  // remembered where it was.
  since_masked_ = masked > 0 ? 0 : since_masked_ + 1;
  if (masked > 0 || since_masked_ >= config_.rest_frames) remembered_ = masked;
  had_ = remembered_ > 0;
  masked_share_ = static_cast<double>(masked) / std::max(1, width_ * height_);
}

void MotionWatch::spread(const TrackingPyramid& pyramid, std::uint8_t* out) const noexcept {
  const auto raw = pyramid.full_depth();
  const DepthLevel& live = pyramid.level(level_);
  const int step = std::max(1, (raw.width + width_ - 1) / width_);
  for (int v = 0; v < raw.height; ++v) {
    const float* z = raw.row(v);
    const int cv = std::min(v / step, height_ - 1), cv1 = std::min(cv + 1, height_ - 1);
    for (int u = 0; u < raw.width; ++u) {
      const int cu = std::min(u / step, width_ - 1), cu1 = std::min(cu + 1, width_ - 1);
      const int at[4] = {cv * width_ + cu, cv * width_ + cu1, cv1 * width_ + cu,
                         cv1 * width_ + cu1};
      float best = 1e9F;
      bool moving = false, any = false;
      for (const int i : at) {
        const bool m = mask_[static_cast<std::size_t>(i)] != 0;
        any = any || m;
        const float d = std::abs(live.depth.row(i / width_)[i % width_] - z[u]);
        if (d < best) best = d, moving = m;
      }
      // A reading like none of them, beside a thing: between two surfaces.
      const bool lone = best > 0.03F + 0.02F * z[u];
      out[static_cast<std::ptrdiff_t>(v) * raw.width + u] = static_cast<std::uint8_t>(
          any && z[u] > 0 && (lone || moving) ? PixelOf::kMoving : PixelOf::kPlace);
    }
  }
}

}  // namespace perception
