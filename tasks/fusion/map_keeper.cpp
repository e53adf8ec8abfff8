#include "tasks/fusion/map_keeper.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

namespace {

constexpr int kPagedBlocks = 128;         // put away, and brought back, a frame
constexpr double kClearedNodes = 200000;  // of a region, a job

}  // namespace

MapKeeper::MapKeeper(rt::NonRealtime& nrt, const FusionConfig& config, const FusionSetup& setup,
                     FusionStages& stages)
    : config_(config),
      camera_(setup.camera),
      stages_(stages),
      map_(nrt, config.tsdf),
      anchor_(nrt),
      ground_(nrt, config.ground, ground_prior(setup)),
      model_(nrt, setup.camera.width, setup.camera.height) {}

void MapKeeper::learn(const perception::FrameView& seen, int allocate_step, CameraState& camera,
                      FusionOut& out) noexcept {
  map_.decay(std::clamp(rt::seconds(camera.exposure - camera.fused), 0.0, 1.0));
  out.integration = map_.integrate(seen, camera.X_WC, allocate_step);
  out.integrated = !out.integration.refused;
  if (stages_.profiling) stages_.times.integrate_parts = map_.last_times();
  const auto& s = out.integration;
  out.work +=
      static_cast<std::uint64_t>(s.pixels) + static_cast<std::uint64_t>(s.rays) +
      static_cast<std::uint64_t>(s.voxels_fused + s.voxels_carved + s.free_tests + s.follow_tests) +
      kWorkOfBlock * static_cast<std::uint64_t>(s.blocks_fetched);
  if (out.integrated) camera.fused = camera.exposure;
}

void MapKeeper::cast_model(const CameraTracking& tracking, const Pose& X_WC, int pixel_step,
                           FusionOut& out) noexcept {
  Stage stage(stages_, &FusionProfile::raycast);
  perception::RaycastOptions o;
  o.pixel_step = pixel_step;
  o.min_weight = 0.2;  // one far observation under range weighting is 1/4
  o.max_depth_m = config_.tracker.preprocess.depth_max_m + config_.tsdf.truncation_m;
  o.crew = stages_.crew;
  o.smooth_normals = false;  // the sums average; smoothing over voxels would round the corners
  // Rays only where this frame has depth: the next frame's points meet the model there, and nothing
  // reads it elsewhere.
  const auto& depth = tracking.pyramid().level(0).depth;
  o.hint_depth_m = {depth.row(0), depth.width(), depth.height(), depth.stride()};
  o.hinted_only = true;
  const auto stats = perception::raycast(map_, camera_, X_WC, o, model_);
  out.work += static_cast<std::uint64_t>(stats.steps);
}

void MapKeeper::keep_in_place(const CameraTracking& tracking, const Pose& X_WC, bool lost,
                              FusionOut& out) noexcept {
  if (lost || clearing()) return anchor_.forget();  // its nodes may be gone
  if (!out.integrated) return;
  Stage stage(stages_, &FusionProfile::track);
  const auto& t = config_.tracker;
  const perception::icp::NoiseRule noise{static_cast<float>(t.noise_m),
                                         static_cast<float>(t.noise_per_m2),
                                         static_cast<float>(t.noise_from_m)};
  anchor_.update(map_, model_, noise, X_WC, tracking.pyramid().mean_depth(noise));
  out.work += static_cast<std::uint64_t>(anchor_.nodes());
}

// What stands, from the pyramid, which what moves was taken out of; what moves, from all readings.
// A camera that is followed, though one direction is only guessed, is followed well enough to say
// where somebody walks.
void MapKeeper::see_ground(const CameraTracking& tracking, const CameraState& camera,
                           const perception::TrackingResult& r, bool learns) noexcept {
  Stage stage(stages_, &FusionProfile::ground);
  const auto& pyramid = tracking.pyramid();
  if (learns) {
    const auto& depth = pyramid.level(pyramid.pixel_step() >= 2 ? 0 : 1);
    ground_.update(
        {depth.intrinsics,
         {depth.depth.row(0), depth.depth.width(), depth.depth.height(), depth.depth.stride()},
         camera.X_WC,
         camera_,
         pyramid.full_depth()});
  }
  if (r.state == perception::TrackingState::kLost || !(tracking.masked() || ground_.moving() > 0))
    return;
  ground_.see_moving({camera_, pyramid.full_depth(), tracking.mask(), camera.X_WC, camera.exposure,
                      tracking.masked(), r.claimed});
}

void MapKeeper::page(std::span<const Vec3> anchors_W, FusionOut& out) noexcept {
  Stage stage(stages_, &FusionProfile::integrate);
  out.paging = map_.page(anchors_W, kPagedBlocks);
  out.work += kWorkOfBlock * static_cast<std::uint64_t>(out.paging.blocks_moved);
}

// ---------------------------------------------------------------- the operator's edits

bool MapKeeper::clearable(const Eigen::AlignedBox3d& box_W) noexcept {
  return box_W.min().allFinite() && box_W.max().allFinite() && !box_W.isEmpty() &&
         box_W.sizes().maxCoeff() <= kLongestClear_m;
}

bool MapKeeper::clearing() const noexcept { return !to_clear_W_.isEmpty(); }

void MapKeeper::clear(const Eigen::AlignedBox3d& box_W) noexcept {
  if (clearable(box_W)) to_clear_W_ = box_W;
}

void MapKeeper::clear_some(FusionOut& out) noexcept {
  if (to_clear_W_.isEmpty()) return;
  Stage stage(stages_, &FusionProfile::clear);
  const double voxel = map_.voxel_size();
  const Vec3 nodes = to_clear_W_.sizes() / voxel + Vec3::Ones();
  const double layers = std::max(1.0, std::floor(kClearedNodes / (nodes.y() * nodes.z())));
  Eigen::AlignedBox3d slab = to_clear_W_;
  slab.max().x() = std::min(slab.max().x(), slab.min().x() + layers * voxel);
  map_.clear_region(slab);
  ground_.forget(slab);
  out.work += static_cast<std::uint64_t>(std::min(layers, nodes.x()) * nodes.y() * nodes.z());
  to_clear_W_.min().x() = slab.max().x();
  if (!(slab.max().x() < to_clear_W_.max().x())) to_clear_W_.setEmpty();
}

}  // namespace tasks
