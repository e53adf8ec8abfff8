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
constexpr double kSamePlace_m = 0.5, kSamePlace_rad = 0.7;

int step_of(const Intrinsics& camera) noexcept {
  return std::max(4, (camera.width + kMostColumns - 1) / kMostColumns);
}

}  // namespace

void RelocaliserConfig::describe(config::Section& s) {
  keyframes.describe(s.section("keyframes", "views a lost camera is recognised by"));
  s.integer("tries", tries, 0, Relocaliser::kMaxTries,
            "keyframes aligned to in a lost frame; 0 switches relocalisation off")
      .integer("rest_frames", rest_frames, 0, 1000, "before one that failed is tried again")
      .integer("rivals", rivals, 0, 64, "tried before a fit in doubt is proposed")
      .number("sure_contradiction", sure_contradiction, 0, 1,
              "share of points against; a fit with more is in doubt")
      .number("max_depth_m", max_depth_m, 0.5, 20, "farther surfaces are not looked at");
}

Relocaliser::Relocaliser(rt::NonRealtime& nrt, const RelocaliserConfig& config,
                         const Intrinsics& camera)
    : config_(config),
      camera_(camera),
      keyframes_(nrt, config.keyframes),
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
  doubt_ = {};
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

// The keyframe's pose, turned so that its image is shifted as the two thumbnails are.
Pose Relocaliser::guess(const Keyframes::Candidate& c) const noexcept {
  const double right = std::atan(c.du * camera_.width / (Thumbnail::kWidth * camera_.fx));
  const double down = std::atan(c.dv * camera_.height / (Thumbnail::kHeight * camera_.fy));
  Pose X = keyframes_.at(c.index).X_WC;
  X.rotate(Eigen::AngleAxisd(right, Vec3::UnitY())).rotate(Eigen::AngleAxisd(-down, Vec3::UnitX()));
  return X;
}

bool Relocaliser::search(TsdfMap& map, const Tracker& tracker, ImageView<const Rgb> colour,
                         TrackingResult& found) noexcept {
  if (config_.tries == 0 || keyframes_.size() == 0) return false;
  ++searches_;
  fetched_ = 0;
  if (doubt_.held && doubt_.rivals_left <= 0) {
    // No rival was better: again from where it was, for this frame.
    const Tried tried = try_at(map, tracker, doubt_.X_WC, found);
    if (tried == Tried::kWaiting) return false;
    if (tried == Tried::kFits)
      propose();
    else
      doubt_ = {};
    return tried == Tried::kFits;
  }
  for (std::size_t i = 0; i < resting_.size(); ++i) resting_[i] = rests_until_[i] > searches_;
  const Thumbnail seen =
      make_thumbnail(tracker.pyramid().level(TrackingPyramid::kLevels - 1), colour);
  std::array<Keyframes::Candidate, kMaxTries> list;
  const int count = keyframes_.rank(seen, resting_,
                                    std::span(list).first(static_cast<std::size_t>(config_.tries)));
  work_ += static_cast<std::uint64_t>(keyframes_.size()) * Thumbnail::kCells / 16;
  for (int k = 0; k < count; ++k) {
    const Keyframes::Candidate& c = list[static_cast<std::size_t>(k)];
    const Tried tried = try_at(map, tracker, guess(c), found);
    if (tried == Tried::kWaiting) break;  // the next frame goes on with it
    if (tried == Tried::kFits && sure(found)) {
      propose();
      return true;
    }
    rests_until_[static_cast<std::size_t>(c.index)] = searches_ + 1 + config_.rest_frames;
    --doubt_.rivals_left;
    if (tried == Tried::kFits) hold(found);
  }
  if (count == 0) doubt_.rivals_left = 0;
  return false;
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
  doubt_ = {};
}

void Relocaliser::hold(const TrackingResult& found) noexcept {
  if (!doubt_.held || found.contradiction < doubt_.contradiction) {
    const int left = doubt_.held ? doubt_.rivals_left : config_.rivals;
    doubt_ = {true, found.X_WC, found.contradiction, left};
  }
  // Its neighbours would say the same.
  for (int i = 0; i < keyframes_.size(); ++i) {
    const Pose away = found.X_WC.inverse() * keyframes_.at(i).X_WC;
    if (away.translation().norm() > kSamePlace_m || rotation_angle(away.linear()) > kSamePlace_rad)
      continue;
    std::int64_t& until = rests_until_[static_cast<std::size_t>(i)];
    until = std::max(until, searches_ + 1 + config_.rest_frames);
  }
}

}  // namespace perception
