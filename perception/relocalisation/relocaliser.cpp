#include "perception/relocalisation/relocaliser.hpp"

#include <algorithm>
#include <cmath>
#include <span>

namespace perception {

namespace {

constexpr int kMostColumns = 85;      // rays of a row of a cast
constexpr int kFetchedBlocks = 1024;  // a frame; nothing is fused meanwhile, which costs more
constexpr int kCastBeside = 128;  // blocks: a frame that fetches more leaves the cast to the next
constexpr std::uint64_t kWorkOfBlock = 512;
constexpr double kSamePlace_m = 0.3, kSamePlace_rad = 0.3;  // what ICP finds from either
constexpr std::int64_t kFitHolds = 12;                       // frames
// Of the small images: what can be the place.
constexpr double kLeastOverlap = 0.4, kLeastClose = 0.7, kMostAgainst = 0.08;

bool same_place(const Pose& a, const Pose& b) noexcept {
  const Pose away = a.inverse() * b;
  return away.translation().norm() < kSamePlace_m &&
         rotation_angle(away.linear()) < kSamePlace_rad;
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
}

RaycastStats Relocaliser::cast(const TsdfMap& map, const Pose& X_WC, RaycastMaps& maps) noexcept {
  RaycastOptions o;
  o.pixel_step = step_;
  o.min_weight = 0.2;
  o.max_depth_m = config_.max_depth_m;
  o.smooth_normals = false;
  const RaycastStats stats = raycast(map, camera_, X_WC, o, maps);
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
                               std::span<const bool> skip) noexcept {
  const DepthLevel& coarse = tracker.pyramid().level(TrackingPyramid::kLevels - 1);
  const Thumbnail seen = make_thumbnail(coarse, colour);
  fill_cell_view(coarse, seen_);
  std::array<Keyframes::Candidate, kAligned> list;
  const int count = keyframes_.rank(seen, skip, list);
  guess_count_ = static_cast<std::size_t>(count);
  for (std::size_t k = 0; k < guess_count_; ++k) {
    const Keyframes::Entry& kept = keyframes_.at(list[k].index);
    const ThumbnailFit fit = aligner_.align(seen_, kept.view, shift(list[k]));
    guesses_[k] = {list[k].index, orthonormalised(kept.X_WC * fit.X_KS), fit.score(),
                   fit.overlap >= kLeastOverlap && fit.close >= kLeastClose &&
                       fit.against <= kMostAgainst};
  }
  std::stable_sort(guesses_.begin(), guesses_.begin() + count,
                   [](const Guess& a, const Guess& b) { return a.score > b.score; });
  work_ += static_cast<std::uint64_t>(keyframes_.size()) * Thumbnail::kCells / 16 +
           guess_count_ * (ThumbnailAligner::kIterations / 2 + 2) * Thumbnail::kCells;
}

// The best that was not looked at; once there is a fit, of those that are possible.
const Relocaliser::Guess* Relocaliser::next_guess() const noexcept {
  const bool held = best() != nullptr;
  for (std::size_t k = 0; k < guess_count_; ++k) {
    const Guess& g = guesses_[k];
    if (resting_[static_cast<std::size_t>(g.keyframe)] || (held && !g.possible)) continue;
    const auto end = places_.begin() + static_cast<std::ptrdiff_t>(place_count_);
    if (std::none_of(places_.begin(), end,
                     [&](const Place& p) { return same_place(p.X_WC, g.X_WC); }))
      return &g;
  }
  return nullptr;
}

bool Relocaliser::alone(const Tracker& tracker, ImageView<const Rgb> colour,
                        const Pose& X_WC) noexcept {
  list_guesses(tracker, colour, {});
  for (std::size_t k = 0; k < guess_count_; ++k) {
    if (guesses_[k].possible && !same_place(guesses_[k].X_WC, X_WC)) return false;
  }
  return true;
}

// ---------------------------------------------------------------- places looked at

void Relocaliser::note(const Pose& X_WC, bool fits, double clash) noexcept {
  std::size_t at = place_count_;
  for (std::size_t k = 0; k < place_count_; ++k) {
    if (same_place(places_[k].X_WC, X_WC)) at = k;
  }
  if (at == kPlaces) {  // the oldest
    const auto oldest = std::min_element(places_.begin(), places_.end(),
                                         [](const Place& a, const Place& b) { return a.at < b.at; });
    at = static_cast<std::size_t>(oldest - places_.begin());
  }
  places_[at] = {X_WC, fits, clash, searches_};
  place_count_ = std::max(place_count_, at + 1);
}

void Relocaliser::forget_old() noexcept {
  const auto end = places_.begin() + static_cast<std::ptrdiff_t>(place_count_);
  const auto kept = std::remove_if(places_.begin(), end, [&](const Place& p) {
    return searches_ - p.at > (p.fits ? kFitHolds : config_.rest_frames);
  });
  place_count_ = static_cast<std::size_t>(kept - places_.begin());
  if (best() == nullptr) rivals_tried_ = 0;
}

const Relocaliser::Place* Relocaliser::best() const noexcept {
  const Place* best = nullptr;
  for (std::size_t k = 0; k < place_count_; ++k) {
    if (places_[k].fits && (best == nullptr || places_[k].clash < best->clash)) best = &places_[k];
  }
  return best;
}

const Relocaliser::Place& Relocaliser::oldest_fit() const noexcept {
  const Place* oldest = best();
  for (std::size_t k = 0; k < place_count_; ++k) {
    if (places_[k].fits && places_[k].at < oldest->at) oldest = &places_[k];
  }
  return *oldest;
}

bool Relocaliser::clear(const Place& best) const noexcept {
  if (best.clash > config_.most_clash) return false;
  for (std::size_t k = 0; k < place_count_; ++k) {
    const Place& p = places_[k];
    if (&p == &best || !p.fits || same_place(p.X_WC, best.X_WC)) continue;
    if (p.clash < 2 * best.clash + config_.clear_clash) return false;
  }
  return true;
}

// ---------------------------------------------------------------- search

bool Relocaliser::search(TsdfMap& map, const Tracker& tracker, ImageView<const Rgb> colour,
                         const TrackingResult* here, TrackingResult& found) noexcept {
  ++searches_;
  fetched_ = 0;
  forget_old();
  if (here != nullptr) note(here->X_WC, true, here->clash);
  for (std::size_t i = 0; i < resting_.size(); ++i) resting_[i] = rests_until_[i] > searches_;
  list_guesses(tracker, colour, {});
  bool tried_any = false, last_fits = false;
  for (int k = 0; k < config_.tries && rivals_left(); ++k) {
    const Guess* guess = next_guess();
    if (guess == nullptr) break;
    const bool rival = best() != nullptr;
    const Tried tried = try_at(map, tracker, guess->X_WC, found);
    if (tried == Tried::kWaiting) return false;  // the next frame goes on with it
    const auto index = static_cast<std::size_t>(guess->keyframe);
    rests_until_[index] = searches_ + 1 + config_.rest_frames;
    resting_[index] = true;
    tried_any = true;
    last_fits = tried == Tried::kFits;
    rivals_tried_ += rival ? 1 : 0;
    note(last_fits ? found.X_WC : guess->X_WC, last_fits, found.clash);
  }
  const Place* leader = best();
  if (leader == nullptr) return false;
  const bool stands = clear(*leader) && !(rivals_left() && next_guess() != nullptr);
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
  const Tried tried = try_at(map, tracker, X_WC, found);
  if (tried == Tried::kWaiting) return false;
  const bool fits = tried == Tried::kFits;
  note(fits ? found.X_WC : X_WC, fits, found.clash);
  if (!fits) return false;
  const Place* leader = best();
  if (!same_place(found.X_WC, leader->X_WC) || !clear(*leader)) return false;
  propose();
  return true;
}

Relocaliser::Tried Relocaliser::try_at(TsdfMap& map, const Tracker& tracker, const Pose& X_WC,
                                       TrackingResult& found) noexcept {
  if (!fetched(map, X_WC)) return Tried::kWaiting;
  RaycastMaps& maps = maps_[1 - viewed_];
  if (cast(map, X_WC, maps).hits == 0) return Tried::kNothing;
  tracker.reacquire({maps.data(), maps.intrinsics, maps.X_WC}, X_WC, found);
  work_ += found.work;
  return tracker.reliable(found) ? Tried::kFits : Tried::kNothing;
}

// What was tried last is the view.
void Relocaliser::propose() noexcept {
  viewed_ = 1 - viewed_;
  has_view_ = true;
  place_count_ = 0;
  rivals_tried_ = 0;
}

}  // namespace perception
