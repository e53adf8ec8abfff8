#include "tasks/fusion/camera_tracking.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "perception/motion/motion_watch.hpp"

namespace tasks {

namespace {

using perception::MotionPrior;
using perception::PixelOf;
using perception::TrackingResult;
using perception::TrackingState;

// chosen on: moving 101 (116, 125, 245, 246); judged on: moving 303, kidnaps of Relocalisation.*
// Share of the readings: where so many fit the map by themselves, a frame that seemed lost is not.
constexpr double kLeastKept = 0.5;

// Until it was seen often, where a surface lies between two nodes is known to half a voxel.
perception::TrackerConfig of_map(perception::TrackerConfig tracker,
                                 const perception::TsdfConfig& map) noexcept {
  tracker.map_error_m = 0.5 * map.voxel_size_m;
  return tracker;
}

}  // namespace

CameraTracking::CameraTracking(rt::NonRealtime& nrt, const FusionConfig& config,
                               const perception::Intrinsics& camera)
    : config_(config),
      camera_(camera),
      tracker_(nrt, of_map(config.tracker, config.tsdf), camera.width, camera.height),
      watch_(std::make_unique<perception::MotionWatch>(nrt, config.motion, config.tracker)),
      mask_(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height),
            static_cast<std::uint8_t>(PixelOf::kPlace)) {}

CameraTracking::~CameraTracking() = default;

void CameraTracking::clear_mask() noexcept {
  if (masked_) std::fill(mask_.begin(), mask_.end(), std::uint8_t{0});
  masked_ = false;
}

struct CameraTracking::Job {
  const perception::MapView& map;
  const perception::ModelView& model;
  const MotionPrior& prior;
  const FusionLevel& knobs;
  TrackingResult& r;
  perception::MotionResult& m;
  bool trusted;            // the prior is good enough to claim on
  std::uint64_t work = 0;  // of alignments that another one has replaced
};

void CameraTracking::track(const perception::MapView& map, const perception::ModelView& model,
                           const MotionPrior& prior, const FusionLevel& knobs, TrackingResult& r,
                           perception::MotionResult& m) noexcept {
  Job job{map, model, prior, knobs, r, m, is_trusted(config_.tracker, prior)};
  watch_->look(map, pyramid(), model, prior, m);
  find_movers(job);
  const bool by_majority = m.moving || m.doubtful;
  align_by_what_stands(job, by_majority);
  const bool lost = r.state == TrackingState::kLost && m.consensus.pairs > 0;
  align_without_misfits(job, lost, by_majority);
  align_without_strangers(job);
  if (lost && !r.claimed) {
    r.state = TrackingState::kLost;
    r.X_WC = prior.X_WC;
  }
  if (!m.certain) r.claimed = r.fully_constrained = false;
  r.work += job.work + m.work;
  watch_->settle(r);
}

void CameraTracking::align(Job& job, const Pose& X_WC_start) noexcept {
  tracker_.track(job.model, job.prior, X_WC_start, job.knobs.iterations, job.r);
}

// Where the whole image would have the camera, roughly: right when only the prior was off.
void CameraTracking::look_again(Job& job) noexcept {
  const MotionPrior& prior = job.prior;
  tracker_.track(job.model, prior, prior.X_WC, {0, 0, job.knobs.iterations[2]}, job.r);
  job.work += job.r.work;
  watch_->compete(pyramid(), job.model, prior, job.r.X_WC, job.m);
}

void CameraTracking::find_movers(Job& job) noexcept {
  const auto& m = job.m;
  if (m.doubtful) look_again(job);
  watch_->find(job.map, pyramid(), job.model, job.m);
  // A camera that has moved far along large walls sees all else move.
  if (m.sudden && !m.doubtful) {
    look_again(job);
    watch_->find(job.map, pyramid(), job.model, job.m);
  }
  watch_->doubt_place(job.map, pyramid(), job.trusted, job.m);
  if (!m.moving) return;
  watch_->spread(pyramid(), mask_.data());
  masked_ = true;
}

void CameraTracking::align_by_what_stands(Job& job, bool by_majority) noexcept {
  if (by_majority) tracker_.drop(watch_->misfits(), watch_->level());
  align(job, by_majority ? job.m.X_WC : job.prior.X_WC);
  // In a direction that the scene does not constrain, a majority of the points is noise: start from
  // the odometry again.
  if (by_majority && job.r.state != TrackingState::kLost && job.trusted &&
      job.r.degenerate_count > 0) {
    job.work += job.r.work;
    align(job, job.prior.X_WC);
  }
}

// Has a moving thing that the mask has missed carried the pose along? Weighed by their noise, its
// readings can do that. It is not asked where the scene leaves a direction open and odometry keeps
// the pose there (`open`).
bool CameraTracking::carried(const Job& job) noexcept {
  const TrackingResult& r = job.r;
  const auto open = [&] {
    return job.trusted && r.degenerate_count > 0 &&
           (r.X_WC.translation() - job.prior.X_WC.translation()).norm() <=
               config_.tracker.claim_translation_m;
  };
  return r.state != TrackingState::kLost && !open() &&
         watch_->explains(pyramid(), job.model, r.X_WC) < config_.motion.least_explained;
}

// Where something that moves pulled the fit away, or the fit was lost: align again without the
// pixels that do not fit.
void CameraTracking::align_without_misfits(Job& job, bool lost, bool by_majority) noexcept {
  if ((carried(job) || lost) && !by_majority) {
    job.work += job.r.work;
    tracker_.drop(watch_->misfits(), watch_->level());
    align(job, job.m.X_WC);
  }
  if (carried(job)) {
    job.work += job.r.work;
    tracker_.track(job.model, job.prior, job.m.X_WC, {0, 0, 0}, job.r);
  }
}

// Still lost, and at least half of the readings fit the map at one pose: align again with these
// alone.
void CameraTracking::align_without_strangers(Job& job) noexcept {
  const auto& m = job.m;
  if (job.r.state != TrackingState::kLost || !m.certain || !(m.consensus.pairs > 0)) return;
  double kept = 0;
  const auto strangers = watch_->strangers(pyramid().level(watch_->level()), kept);
  if (!(kept >= kLeastKept)) return;
  job.work += job.r.work;
  tracker_.drop(strangers, watch_->level());
  align(job, m.X_WC);
}

// What moves is masked: it carves and is not fused, so the field alone would say so late or never.
// Here: do half of the readings about the proxy move? A reading far in front of the proxy hides the
// place and is not counted.
bool CameraTracking::touched_moves(const HapticState& hand, const Pose& X_WC) const noexcept {
  constexpr double kAbout_vox = 2, kHides_m = 0.25;
  if (!masked_ || hand.contacts == 0 || !hand.p_WP.allFinite()) return false;
  const Vec3 p_C = X_WC.inverse() * hand.p_WP;
  if (p_C.z() < config_.tracker.preprocess.depth_min_m) return false;
  const auto& k = camera_;
  const double reach = kAbout_vox * config_.tsdf.voxel_size_m / p_C.z();
  const double u = k.fx * p_C.x() / p_C.z() + k.cx, v = k.fy * p_C.y() / p_C.z() + k.cy;
  const int u0 = std::max(0, static_cast<int>(std::floor(std::max(u - k.fx * reach, 0.0)))),
            v0 = std::max(0, static_cast<int>(std::floor(std::max(v - k.fy * reach, 0.0)))),
            u1 = static_cast<int>(std::min(u + k.fx * reach, k.width - 1.0)),
            v1 = static_cast<int>(std::min(v + k.fy * reach, k.height - 1.0));
  const auto depth_m = pyramid().full_depth();
  const double nearest_m = std::max(p_C.z() - kHides_m, 1e-3);
  int readings = 0, moving = 0;
  for (int y = v0; y <= v1; ++y) {
    for (int x = u0; x <= u1; ++x) {
      const auto of = static_cast<PixelOf>(mask().at(x, y));
      if (of == PixelOf::kBody || !(static_cast<double>(depth_m.at(x, y)) > nearest_m)) continue;
      ++readings;
      moving += of == PixelOf::kMoving ? 1 : 0;
    }
  }
  return readings > 0 && 2 * moving >= readings;
}

}  // namespace tasks
