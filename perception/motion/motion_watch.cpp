#include "perception/motion/motion_watch.hpp"

#include <algorithm>
#include <cmath>

#include "perception/motion/evidence.hpp"

namespace perception {

namespace {

// chosen on: not recorded; judged on: moving 606, moving 707
constexpr double kSudden = 0.02;  // of the image
// chosen on: moving 1 (13), WrongOdometry.OneThatBeginsAnewIsFoundOut; judged on: moving 606, moving 707
constexpr double kLeastMet = 0.8;  // of the readings: a pose to look for thin things by

}  // namespace

MotionWatch::MotionWatch(rt::NonRealtime&, const MotionConfig& config, const TrackerConfig& tracker)
    : config_(config),
      tracker_(tracker),
      places_(config.rest_cell_m),
      still_(config_, tracker_, image_),
      evidence_(config_, tracker_, image_, still_.consensus(), places_),
      things_(config_, tracker_, image_, still_.consensus(), evidence_, places_),
      dropped_(motion::WatchedImage::kMost) {}

void MotionWatch::forget() noexcept {
  masked_share_ = 0;
  image_.recent = 0;
  still_.forget();
  evidence_.forget();
  things_.forget();
  places_.forget();
}

void MotionWatch::look(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
                       const MotionPrior& prior, MotionResult& out) noexcept {
  out = MotionResult{};
  out.X_WC = prior.X_WC;
  still_.begin(prior.X_WC);
  if (!config_.on) return;
  places_.begin(++image_.frame);
  image_.level = TrackingPyramid::kLevels - 1;
  while (image_.level > 0 && pyramid.level(image_.level).depth.width() < 96) --image_.level;
  const DepthLevel& live = pyramid.level(image_.level);
  image_.width = live.depth.width(), image_.height = live.depth.height();
  image_.map_voxel_m = map.voxel_size();
  image_.voxel_m = static_cast<float>(map.voxel_size());
  image_.length_m = pyramid.mean_depth(
      {static_cast<float>(tracker_.noise_m), 0.0F, static_cast<float>(tracker_.noise_from_m)});
  if (!fits_cells(image_.width, image_.height) || !(image_.length_m > 0) || !model.valid())
    return things_.clear();
  things_.remember_cells(live, prior.X_WC, still_.cells());
  still_.look(pyramid, model, prior, out);
}

// Evidence of all pixels; false: too little for anything to move. Where nothing moved of late, a
// quarter of what does not meet its surface says whether something does, then all of that.
bool MotionWatch::anything_moves(const MapView& map, MapReader& reader, const DepthLevel& live,
                                 int& evidence) noexcept {
  if (image_.recent == 0) {
    if (!evidence_.glimpse(map, reader, live, (config_.least_pixels + 1) / 2)) return false;
    evidence_.gather(map, reader, live, false);
    if (evidence_.patches(map, reader, live) < config_.least_pixels) return false;
  }
  // A thing is more than the cells that do not fit.
  evidence_.gather(map, reader, live, true);
  evidence = evidence_.patches(map, reader, live);
  image_.recent =
      evidence >= config_.least_pixels ? config_.rest_frames : std::max(0, image_.recent - 1);
  return image_.recent > 0;
}

void MotionWatch::find(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
                       MotionResult& out) noexcept {
  evidence_.compare_with(model);
  out.moving = out.sudden = false;
  out.masked_share = 0;
  if (!still_.looked()) return;
  const DepthLevel& live = pyramid.level(image_.level);
  things_.clear();
  evidence_.start(map, out.X_WC);
  MapReader reader(map, 1.0);
  if (!anything_moves(map, reader, live, out.evidence)) return;
  out.work += 8 * static_cast<std::uint64_t>(image_.size());
  // By a pose that is wrong, edges look like thin things.
  things_.grow(live, out.X_WC, !still_.doubtful() && still_.met_share() >= kLeastMet);
  const int masked = things_.note_points(live);
  int valid = 0;
  for (int i = 0; i < image_.size(); ++i) valid += image_.depth_m(live, i) > 0 ? 1 : 0;
  out.moving = masked > 0;
  out.masked_share = valid > 0 ? static_cast<double>(masked) / valid : 0;
  out.sudden = out.masked_share > 2 * masked_share_ + kSudden;
}

void MotionWatch::doubt_place(const MapView& map, const TrackingPyramid& pyramid, bool trusted,
                              MotionResult& out) noexcept {
  if (!still_.looked() || trusted || !image_.young()) return;
  const motion::FitShares shares =
      motion::fit_shares(map, pyramid.level(image_.level), out.X_WC, image_, still_.consensus(),
                         evidence_, things_.mask());
  out.work += static_cast<std::uint64_t>(image_.size()) / 8;
  if (!doubt_.doubts(shares, image_.known, masked_share_)) return;
  still_.doubt();
  out.certain = false;
}

ImageView<const std::uint8_t> MotionWatch::misfits() noexcept {
  const int width = image_.width;
  std::copy_n(things_.mask().begin(), image_.size(), dropped_.begin());
  const CellSums& sums = still_.consensus().sums();
  for (int c = 0; c < sums.size(); ++c) {
    if (sums.pairs[static_cast<std::size_t>(c)] < Consensus::kLeastPairs ||
        still_.consensus().fits(c))
      continue;
    const int u0 = c % sums.columns * CellSums::kEdge, v0 = c / sums.columns * CellSums::kEdge;
    for (int v = v0; v < std::min(v0 + CellSums::kEdge, image_.height); ++v)
      std::fill(dropped_.begin() + v * width + u0,
                dropped_.begin() + v * width + std::min(u0 + CellSums::kEdge, width),
                std::uint8_t{1});
  }
  return {dropped_.data(), width, image_.height, width};
}

ImageView<const std::uint8_t> MotionWatch::strangers(const DepthLevel& live,
                                                     double& kept_share) noexcept {
  const ImageView<const std::uint8_t> out = misfits();
  const CellSums& sums = still_.consensus().sums();
  int kept = 0, valid = 0;
  for (int i = 0; i < image_.size(); ++i) {
    const auto c = static_cast<std::size_t>(image_.cell_of(i % image_.width, i / image_.width));
    std::uint8_t& dropped = dropped_[static_cast<std::size_t>(i)];
    if (sums.pairs[c] < 0.5F * sums.live[c] || evidence_.at(i) == kRested) dropped = 1;
    const bool left = dropped == 0 && image_.depth_m(live, i) > 0;
    valid += left || dropped != 0 ? 1 : 0;  // what was dropped before has no depth any more
    kept += left ? 1 : 0;
  }
  kept_share = valid > 0 ? static_cast<double>(kept) / valid : 0;
  return out;
}

void MotionWatch::settle(const TrackingResult& r) noexcept {
  if (r.claimed) image_.known = std::min(image_.known + 1, motion::WatchedImage::kYoungMap);
  if (!still_.certain()) return;
  if (r.claimed) {
    still_.settle(r);
    evidence_.settle(r.residual_m);
  }
  masked_share_ = static_cast<double>(things_.settle()) / std::max(1, image_.size());
}

void MotionWatch::spread(const TrackingPyramid& pyramid, std::uint8_t* out) const noexcept {
  const std::vector<std::uint8_t>& mask = things_.mask();
  const auto raw = pyramid.full_depth();
  const DepthLevel& live = pyramid.level(image_.level);
  const int step = std::max(1, (raw.width + image_.width - 1) / image_.width);
  for (int v = 0; v < raw.height; ++v) {
    const float* z = raw.row(v);
    const int cv = std::min(v / step, image_.height - 1), cv1 = std::min(cv + 1, image_.height - 1);
    for (int u = 0; u < raw.width; ++u) {
      const int cu = std::min(u / step, image_.width - 1), cu1 = std::min(cu + 1, image_.width - 1);
      const int at[4] = {cv * image_.width + cu, cv * image_.width + cu1, cv1 * image_.width + cu,
                         cv1 * image_.width + cu1};
      float best = 1e9F;
      bool moving = false, any = false;
      for (const int i : at) {
        const bool m = mask[static_cast<std::size_t>(i)] != 0;
        any = any || m;
        const float d = std::abs(live.depth.row(i / image_.width)[i % image_.width] - z[u]);
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
