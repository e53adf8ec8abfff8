#include "perception/relocalisation/relocaliser.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

namespace perception {

namespace {

constexpr int kMostColumns = 85;     // rays of a row of a cast
constexpr int kFetchedBlocks = 768;  // a frame; nothing is fused meanwhile, which costs more
constexpr int kCastBeside = 128;  // blocks: a frame that fetches more leaves the cast to the next
constexpr std::uint64_t kWorkOfBlock = 512;
constexpr double kSamePlace_m = 0.3, kSamePlace_rad = 0.3;  // what ICP finds from either
constexpr std::int64_t kFitHolds = 12;                      // frames
constexpr std::int64_t kSameView = 2;                       // frames that see about the same
// Limits of an alignment to a cast: when it may still be the place, though not close enough to be
// claimed, and by how many inliers an alignment must be behind to be the worse one.
constexpr double kRivalOverlap = 0.2, kRivalInliers = 0.4, kRivalClash = 0.03;
constexpr double kWorseInliers = 0.2;
constexpr double kNoTwinClash = 0.1, kNoTwinInliers = 0.5;  // there is something else there
constexpr double kTried_m = 0.15, kTried_rad = 0.15;        // what a guess is off by, and more
// Of the small images: what can be the place. Below the overlap too few cells meet to say anything.
constexpr double kLeastOverlap = 0.15, kLeastClose = 0.9, kMostAgainst = 0.02;

bool within(const Pose& a, const Pose& b, double way_m, double turn_rad) noexcept {
  const Pose away = a.inverse() * b;
  return away.translation().norm() < way_m && rotation_angle(away.linear()) < turn_rad;
}
bool same_place(const Pose& a, const Pose& b) noexcept {
  return within(a, b, kSamePlace_m, kSamePlace_rad);
}

int step_of(const Intrinsics& camera) noexcept {
  return std::max(4, (camera.width + kMostColumns - 1) / kMostColumns);
}

}  // namespace

void RelocaliserConfig::describe(config::Section& s) {
  keyframes.describe(s.section("keyframes", "views a lost camera is recognised by"));
  s.integer("tries", tries, 0, Relocaliser::kMaxTries,
            "keyframes aligned to in a lost frame; 0 switches relocalisation off")
      .integer("rest_frames", rest_frames, 0, 1000, "before one that failed is tried again")
      .integer("rivals", rivals, 0, 64, "other places tried, at most, before a fit is proposed")
      .number("clear_clash", clear_clash, 0, 1,
              "share of points by which more must speak against any other place that fits")
      .number("most_clash", most_clash, 0, 1, "share of points; a fit with more is not proposed")
      .number("max_depth_m", max_depth_m, 0.5, 20, "farther surfaces are not looked at");
}

Relocaliser::Relocaliser(rt::NonRealtime& nrt, const RelocaliserConfig& config,
                         const Intrinsics& camera)
    : config_(config),
      camera_(camera),
      keyframes_(nrt, config.keyframes),
      aligner_(camera),
      step_(step_of(camera)),
      caster_(nrt, camera.width / step_ + 1, camera.height / step_ + 1),
      maps_{RaycastMaps(nrt, camera.width / step_ + 1, camera.height / step_ + 1),
            RaycastMaps(nrt, camera.width / step_ + 1, camera.height / step_ + 1)} {
  config_.tries = std::clamp(config_.tries, 0, kMaxTries);
}

void Relocaliser::remember(const TrackingPyramid& pyramid, ImageView<const Rgb> colour,
                           const Pose& X_WC) noexcept {
  if (!keyframes_.is_new(X_WC)) return;
  keyframes_.add(X_WC, make_thumbnail(pyramid.level(TrackingPyramid::kLevels - 1), colour));
  work_ += Thumbnail::kCells;
}

void Relocaliser::restart() noexcept {
  rests_until_.fill(0);
  searches_ = 0;
  has_view_ = false;
  place_count_ = 0;
  rivals_tried_ = 0;
  mirrored_of_ = -1;
}

RaycastStats Relocaliser::cast(const MapView& map, const Pose& X_WC, RaycastMaps& maps) noexcept {
  RaycastOptions o;
  o.pixel_step = step_;
  o.min_weight = 0.2;
  o.max_depth_m = config_.max_depth_m;
  o.smooth_normals = false;
  const RaycastStats stats = caster_.cast(map, camera_, X_WC, o, maps);
  work_ += static_cast<std::uint64_t>(stats.steps);
  return stats;
}

bool Relocaliser::fetched(TsdfMap& map, const Pose& X_WC) noexcept {
  const PageStats paged = map.fetch_view(camera_, X_WC, kFetchedBlocks - fetched_);
  fetched_ += paged.blocks_moved;
  work_ += kWorkOfBlock * static_cast<std::uint64_t>(paged.blocks_moved);
  return paged.waiting == 0 && fetched_ <= kCastBeside;
}

bool Relocaliser::look(TsdfMap& map, const Pose& X_WC) noexcept {
  fetched_ = 0;
  if (!fetched(map, X_WC)) return false;
  has_view_ = cast(map, X_WC, maps_[viewed_]).hits > 0;
  return true;
}

std::uint64_t Relocaliser::take_work() noexcept {
  const std::uint64_t w = work_;
  work_ = 0;
  return w;
}

// The camera in the keyframe's, turned so that its image is shifted as the two thumbnails are.
Pose Relocaliser::shift(const Keyframes::Candidate& c) const noexcept {
  const double right = std::atan(c.du * camera_.width / (Thumbnail::kWidth * camera_.fx));
  const double down = std::atan(c.dv * camera_.height / (Thumbnail::kHeight * camera_.fy));
  Pose X = Pose::Identity();
  X.rotate(Eigen::AngleAxisd(right, Vec3::UnitY())).rotate(Eigen::AngleAxisd(-down, Vec3::UnitX()));
  return X;
}

void Relocaliser::list_guesses(const Tracker& tracker, ImageView<const Rgb> colour,
                               const Pose* leader) noexcept {
  const DepthLevel& coarse = tracker.pyramid().level(TrackingPyramid::kLevels - 1);
  const Thumbnail seen = make_thumbnail(coarse, colour);
  fill_cell_view(coarse, seen_);
  std::array<Keyframes::Candidate, kAligned> list;
  const int listed = keyframes_.rank(seen, {}, list);
  guess_count_ = 0;
  for (int k = 0; k < listed; ++k) {
    const Keyframes::Candidate& c = list[static_cast<std::size_t>(k)];
    add_guess(c.index, shift(c), false);
  }
  if (leader != nullptr) list_mirrored(*leader);
  const auto end = guesses_.begin() + static_cast<std::ptrdiff_t>(guess_count_);
  std::sort(guesses_.begin(), end, [](const Guess& a, const Guess& b) {
    if (a.score != b.score) return a.score > b.score;
    return a.keyframe != b.keyframe ? a.keyframe < b.keyframe : a.mirrored < b.mirrored;
  });
  work_ += static_cast<std::uint64_t>(keyframes_.size()) * Thumbnail::kCells / 16 +
           guess_count_ * (ThumbnailAligner::kIterations / 2 + 2) * Thumbnail::kCells;
}

void Relocaliser::add_guess(int keyframe, const Pose& X_KS0, bool mirrored) noexcept {
  const Keyframes::Entry& kept = keyframes_.at(keyframe);
  const ThumbnailFit fit = aligner_.align(seen_, kept.view, X_KS0);
  guesses_[guess_count_++] = {
      keyframe, orthonormalised(kept.X_WC * fit.X_KS), fit.score(),
      fit.overlap >= kLeastOverlap && fit.close >= kLeastClose && fit.against <= kMostAgainst,
      mirrored};
}

// If the map repeats itself, keyframes of the other place look like those of this one, at the same
// pose relative to the camera. Off the mapped path that pose is too far for an alignment that
// starts from the images' shift.
void Relocaliser::list_mirrored(const Pose& leader) noexcept {
  int nearest = -1;
  double best = -std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < guess_count_; ++k) {
    if (guesses_[k].score <= best || !same_place(guesses_[k].X_WC, leader)) continue;
    best = guesses_[k].score;
    nearest = guesses_[k].keyframe;
  }
  if (nearest < 0) nearest = keyframes_.looking_at(leader);
  if (nearest < 0) return;
  const Pose X_KS = keyframes_.at(nearest).X_WC.inverse() * leader;
  if (nearest != mirrored_of_) {
    std::array<bool, Keyframes::kMax> same{};
    for (int i = 0; i < keyframes_.size(); ++i) {
      same[static_cast<std::size_t>(i)] = same_place(keyframes_.at(i).X_WC * X_KS, leader);
    }
    mirrored_count_ =
        static_cast<std::size_t>(keyframes_.rank(keyframes_.at(nearest).view, same, mirrored_));
    mirrored_of_ = nearest;
    work_ += static_cast<std::uint64_t>(keyframes_.size()) * Thumbnail::kCells / 16;
  }
  for (std::size_t k = 0; k < mirrored_count_; ++k) {
    add_guess(mirrored_[k].index, shift(mirrored_[k]) * X_KS, true);
  }
}

// A place that was tried in vain says little of one a hand's breadth away.
bool Relocaliser::was_tried(const Pose& X_WC) const noexcept {
  const auto end = places_.begin() + static_cast<std::ptrdiff_t>(place_count_);
  return std::any_of(places_.begin(), end, [&](const Place& p) {
    return p.fit == Fit::kFits ? same_place(p.X_WC, X_WC)
                               : within(p.X_WC, X_WC, kTried_m, kTried_rad);
  });
}

// The best that was not tried; once there is a fit, of those that are possible, and then its twins.
bool Relocaliser::next_guess(Guess& out) const noexcept {
  const Place* leader = best();
  for (std::size_t k = 0; k < guess_count_; ++k) {
    const Guess& g = guesses_[k];
    if (leader != nullptr ? !g.possible : resting_[static_cast<std::size_t>(g.keyframe)]) continue;
    if (was_tried(g.X_WC)) continue;
    out = g;
    return true;
  }
  for (std::size_t n = 0; leader != nullptr && n < 2 * twin_count_; ++n) {
    const Pose& twin = twins_[n / 2].X_TH;
    const Pose X_WC = (n % 2 == 0 ? twin : twin.inverse()) * leader->X_WC;
    if (was_tried(X_WC)) continue;
    out = Guess{};
    out.keyframe = -1 - static_cast<int>(n / 2);
    out.X_WC = orthonormalised(X_WC);
    return true;
  }
  return false;
}

bool Relocaliser::alone(const Tracker& tracker, ImageView<const Rgb> colour,
                        const Pose& X_WC) noexcept {
  for (std::size_t n = 0; n < 2 * twin_count_; ++n) {
    const Pose& twin = twins_[n / 2].X_TH;
    const Pose X_there = (n % 2 == 0 ? twin : twin.inverse()) * X_WC;
    if (!same_place(X_there, X_WC) && keyframes_.near(X_there)) return false;
  }
  mirrored_of_ = -1;  // keyframes may have come since
  list_guesses(tracker, colour, &X_WC);
  for (std::size_t k = 0; k < guess_count_; ++k) {
    if (guesses_[k].possible && !same_place(guesses_[k].X_WC, X_WC)) return false;
  }
  return true;
}

// ---------------------------------------------------------------- places looked at

void Relocaliser::note(const Pose& X_WC, Fit fit, const TrackingResult& r) noexcept {
  std::size_t at = place_count_;
  for (std::size_t k = 0; k < place_count_; ++k) {
    const Place& p = places_[k];
    // An alignment that diverged does not cancel a fit. An alignment without a fit does not rule
    // out the place beside it.
    if (p.fit == Fit::kFits && fit != Fit::kFits && same_place(p.X_WC, X_WC)) return;
    if (p.fit == Fit::kFits ? same_place(p.X_WC, X_WC) : within(p.X_WC, X_WC, kTried_m, kTried_rad))
      at = k;
  }
  if (at == kPlaces) {  // the oldest
    const auto oldest = std::min_element(
        places_.begin(), places_.end(), [](const Place& a, const Place& b) { return a.at < b.at; });
    at = static_cast<std::size_t>(oldest - places_.begin());
  }
  places_[at] = {X_WC, fit, r.clash, r.inlier_share, searches_};
  place_count_ = std::max(place_count_, at + 1);
}

template <class Which>
void Relocaliser::forget_if(Which&& which) noexcept {
  const auto end = places_.begin() + static_cast<std::ptrdiff_t>(place_count_);
  place_count_ =
      static_cast<std::size_t>(std::remove_if(places_.begin(), end, which) - places_.begin());
  if (best() == nullptr) rivals_tried_ = 0;
}

void Relocaliser::forget(const Pose& X_WC) noexcept {
  forget_if([&](const Place& p) { return same_place(p.X_WC, X_WC); });
}

void Relocaliser::forget_old() noexcept {
  forget_if([&](const Place& p) {
    return searches_ - p.at > (p.fit == Fit::kNothing ? config_.rest_frames : kFitHolds);
  });
}

// Of those that fit, the one that least speaks against.
const Relocaliser::Place* Relocaliser::best() const noexcept {
  const Place* best = nullptr;
  for (std::size_t k = 0; k < place_count_; ++k) {
    const Place& p = places_[k];
    if (p.fit == Fit::kFits && (best == nullptr || p.clash < best->clash)) best = &p;
  }
  return best;
}

const Relocaliser::Place& Relocaliser::oldest_fit() const noexcept {
  const Place* oldest = best();
  for (std::size_t k = 0; k < place_count_; ++k) {
    if (places_[k].fit != Fit::kNothing && places_[k].at < oldest->at) oldest = &places_[k];
  }
  return *oldest;
}

bool Relocaliser::clear(const Place& best) const noexcept {
  if (best.clash > config_.most_clash) return false;
  for (std::size_t k = 0; k < place_count_; ++k) {
    const Place& p = places_[k];
    if (p.fit == Fit::kNothing || same_place(p.X_WC, best.X_WC)) continue;
    if (p.inlier_share < best.inlier_share - kWorseInliers) continue;
    if (p.clash < 2 * best.clash + config_.clear_clash) return false;
  }
  return true;
}

// If a frame fits at two places, the map repeats itself: a camera that seems to be at one may
// always be at the other. The motion between the two is as good as the poorer of the two fits.
// Better fits replace it, and the poorest entry makes room.
void Relocaliser::learn_twin(const Pose& X_WC, double inlier_share) noexcept {
  for (std::size_t k = 0; k < place_count_; ++k) {
    const Place& p = places_[k];
    if (p.fit == Fit::kNothing || searches_ - p.at > kSameView || same_place(p.X_WC, X_WC))
      continue;
    const Pose X_TH = orthonormalised(X_WC * p.X_WC.inverse());
    const double quality = std::min(p.inlier_share, inlier_share);
    std::size_t at = twin_count_;
    for (std::size_t n = 0; n < twin_count_; ++n) {
      const Pose& twin = twins_[n].X_TH;
      if (same_place(twin * p.X_WC, X_WC) || same_place(twin.inverse() * p.X_WC, X_WC)) at = n;
    }
    if (at == kTwins) {
      const auto worse = [](const Twin& a, const Twin& b) { return a.quality < b.quality; };
      const auto poorest = std::min_element(twins_.begin(), twins_.end(), worse);
      at = static_cast<std::size_t>(poorest - twins_.begin());
    }
    if (at < twin_count_ && quality <= twins_[at].quality) continue;
    twins_[at] = {X_TH, quality};
    twin_count_ = std::max(twin_count_, at + 1);
  }
}

void Relocaliser::forget_twin(std::size_t n) noexcept {
  for (std::size_t k = n + 1; k < twin_count_; ++k) twins_[k - 1] = twins_[k];
  --twin_count_;
}

// ---------------------------------------------------------------- search

bool Relocaliser::search(TsdfMap& map, const Tracker& tracker, ImageView<const Rgb> colour,
                         const TrackingResult* here, TrackingResult& found) noexcept {
  ++searches_;
  fetched_ = 0;
  forget_old();
  if (here != nullptr) note(here->X_WC, Fit::kFits, *here);
  for (std::size_t i = 0; i < resting_.size(); ++i) resting_[i] = rests_until_[i] > searches_;
  const Place* ahead = best();
  list_guesses(tracker, colour, ahead != nullptr ? &ahead->X_WC : nullptr);
  bool tried_any = false, last_fits = false;
  for (int k = 0; k < config_.tries && rivals_left(); ++k) {
    Guess guess;
    if (!next_guess(guess)) break;
    const bool rival = best() != nullptr;
    const Fit tried = try_at(map, tracker, guess.X_WC, found);
    if (tried == Fit::kWaiting) {  // the next frame goes on with it; a rival must not take for ever
      rivals_tried_ += rival ? 1 : 0;
      return false;
    }
    if (guess.mirrored) {
      // The keyframe may be one of another place as well.
    } else if (guess.keyframe >= 0) {
      const auto index = static_cast<std::size_t>(guess.keyframe);
      rests_until_[index] = searches_ + 1 + config_.rest_frames;
      resting_[index] = true;
    } else if (tried == Fit::kNothing && found.inlier_share < kNoTwinInliers &&
               found.clash > kNoTwinClash) {
      forget_twin(static_cast<std::size_t>(-1 - guess.keyframe));
    }
    tried_any = true;
    last_fits = tried == Fit::kFits;
    rivals_tried_ += rival ? 1 : 0;
    note(tried == Fit::kNothing ? guess.X_WC : found.X_WC, tried, found);
    if (tried != Fit::kNothing) learn_twin(found.X_WC, found.inlier_share);
  }
  const Place* leader = best();
  if (leader == nullptr) return false;
  Guess next;
  const bool stands = clear(*leader) && !(rivals_left() && next_guess(next));
  if (tried_any) {
    if (!stands || !last_fits || !same_place(found.X_WC, leader->X_WC)) return false;
    propose();
    return true;
  }
  if (here != nullptr && same_place(here->X_WC, leader->X_WC) && stands) {
    found = *here;
    // Not before all of it is in the pool: until then it is found again in the view that there is.
    if (!fetched(map, here->X_WC) || cast(map, here->X_WC, maps_[1 - viewed_]).hits == 0)
      return false;
    propose();
    return true;
  }
  return look_again(map, tracker, stands ? *leader : oldest_fit(), found);
}

// At a place that fitted in an older frame.
bool Relocaliser::look_again(TsdfMap& map, const Tracker& tracker, const Place& place,
                             TrackingResult& found) noexcept {
  const Pose X_WC = place.X_WC;
  const Fit fit = try_at(map, tracker, X_WC, found);
  if (fit == Fit::kWaiting) return false;
  forget(X_WC);  // it may have gone over to another place
  // The camera is no longer there: what fitted with that view means nothing either.
  if (fit == Fit::kNothing)
    forget_if(
        [&](const Place& p) { return p.fit != Fit::kNothing && searches_ - p.at > kSameView; });
  note(fit == Fit::kNothing ? X_WC : found.X_WC, fit, found);
  if (fit != Fit::kFits) return false;
  const Place* leader = best();
  if (!same_place(found.X_WC, leader->X_WC) || !clear(*leader)) return false;
  propose();
  return true;
}

Relocaliser::Fit Relocaliser::try_at(TsdfMap& map, const Tracker& tracker, const Pose& X_WC,
                                     TrackingResult& found) noexcept {
  found = TrackingResult{};
  if (!fetched(map, X_WC)) return Fit::kWaiting;
  RaycastMaps& maps = maps_[1 - viewed_];
  if (cast(map, X_WC, maps).hits == 0) return Fit::kNothing;
  tracker.reacquire({maps.data(), maps.intrinsics, maps.X_WC}, X_WC, found);
  work_ += found.work;
  if (tracker.reliable(found)) return Fit::kFits;
  const bool may_be = found.state != TrackingState::kLost && found.overlap >= kRivalOverlap &&
                      found.inlier_share >= kRivalInliers && found.clash <= kRivalClash;
  return may_be ? Fit::kMayBe : Fit::kNothing;
}

// What was tried last is the view.
void Relocaliser::propose() noexcept {
  viewed_ = 1 - viewed_;
  has_view_ = true;
  place_count_ = 0;
  rivals_tried_ = 0;
}

}  // namespace perception
