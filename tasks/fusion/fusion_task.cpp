#include "tasks/fusion/fusion_task.hpp"

#include <algorithm>
#include <cmath>

#include "tasks/fusion/fusion_parts.hpp"

namespace tasks {

namespace {

using perception::MotionPrior;
using perception::RgbdFrame;
using perception::TrackingResult;
using perception::TrackingState;

constexpr int kPagedBlocks = 128;  // put away, and brought back, a frame
// Round the hand, what moves slowly is followed: all that it can reach within a second. Elsewhere it shall stand out from the map,
// or it would not be masked.
constexpr double kUnderHand_m = 0.25;
constexpr double kClearedNodes = 200000;  // of a region, a job

// A surface between two nodes is known to half of their distance before it was seen often.
perception::TrackerConfig of_map(perception::TrackerConfig tracker,
                                 const perception::TsdfConfig& map) noexcept {
  tracker.map_error_m = 0.5 * map.voxel_size_m;
  return tracker;
}

}  // namespace

FusionTask::FusionTask(rt::NonRealtime& nrt, const FusionConfig& config, const FusionSetup& setup)
    : config_(config),
      setup_(setup),
      map_(nrt, config.tsdf),
      tracker_(nrt, of_map(config.tracker, config.tsdf), setup.camera.width, setup.camera.height),
      watch_(nrt, config.motion, config.tracker),
      relocaliser_(nrt, config.relocaliser, setup.camera),
      anchor_(nrt),
      ground_(nrt, config.ground, ground_prior(setup)),
      model_(nrt, setup.camera.width, setup.camera.height),
      view_maps_(nrt, setup.camera.width / std::max(1, config.view_step) + 1,
                 setup.camera.height / std::max(1, config.view_step) + 1),
      mask_(static_cast<std::size_t>(setup.camera.width) *
                static_cast<std::size_t>(setup.camera.height),
            static_cast<std::uint8_t>(perception::PixelOf::kPlace)),
      X_WC_(perception::orthonormalised(setup.X_WC0)),
      window_centre_W_(setup.X_WC0 * Vec3(0, 0, 1)) {
  require_valid(config, setup);
  set_up_objects(nrt);
  if (setup.robot != nullptr)
    body_ = std::make_unique<FusionBody>(nrt, config.body, *setup.robot, config.tracker, setup.X_BC,
                                         setup.camera);
  if (setup.ray_cast)
    surface_ = std::make_unique<SurfaceCast>(nrt, setup.camera, config.surface_periods);
  if (config.patch_smooth > 0) {
    perception::SmoothOptions smooth;
    smooth.radius = config.patch_smooth;
    smoother_ = std::make_unique<perception::PatchSmoother>(nrt, smooth);
  }
  if (config.mesh_blocks > 0) mesh_ = std::make_unique<perception::MeshSender>(nrt, map_);
}

FusionTask::~FusionTask() = default;

rt::Result<bool> FusionTask::load_map(rt::NonRealtime& nrt, const perception::MapFile& file) {
  auto ok = perception::restore_map(nrt, file, map_, relocaliser_.keyframes());
  if (!ok) return ok;
  for (std::uint8_t label = 1; label <= perception::kMostLabel; ++label) map_.forget_label(label);
  started_ = recovering_ = true;
  watch_.grown();
  exposure_ = rt::time_from_ns(-(std::int64_t{1} << 60));  // any image is newer
  X_looked_WC_.reset();
  relocaliser_.restart();
  return true;
}

rt::Health FusionTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out.patch_written = out.view_written = out.cost_map_written = out.camera_written = false;
  out.integrated = out.objects_written = out.mesh_written = objects_drawn_ = false;
  out.surface_written = false;
  out.tracking = TrackingResult{};
  out.motion = perception::MotionResult{};
  out.integration = perception::IntegrateStats{};
  out.paging = perception::PageStats{};
  out.segmentation = perception::ObjectStats{};
  out.work = out.work_view = 0;
  out.body_pixels = 0;
  profile_ = Profile{};
  ++periods_;

  remember_odometry(in.odometry);
  remember_mark(in.hand);
  held_ = in.held;
  if (in.virtual_obstacles_changed) static_cast<void>(ground_.set_virtual(in.virtual_obstacles));
  if (in.clear_W && clearable(*in.clear_W)) to_clear_W_ = *in.clear_W;
  clear_some(out);
  rt::Health health = rt::Health::ok();
  if (in.frame != nullptr && in.frame_fresh) health = consume(tick, *in.frame, out);
  write_objects(out);
  write_cost_map(tick, out);
  write_patch(tick, in.hand, out);
  if (surface_ != nullptr) write_surface(tick, out);
  write_view(tick, in.X_WV, out);
  write_mesh(tick, in.mesh_taken, out);
  out.work += ground_.take_work();
  return health;
}

// ---------------------------------------------------------------- one image

rt::Health FusionTask::consume(const rt::Tick& tick, const RgbdFrame& frame, Out& out) noexcept {
  const auto& k = frame.intrinsics;
  if (!(k == setup_.camera)) return rt::Health::of(rt::Severity::kCounted, kFaultFusionBadFrame);
  // A frame that is not newer than the last one was duplicated or overtaken on its way.
  if (started_ && frame.exposure <= exposure_) {
    return rt::Health::of(rt::Severity::kCounted, kFaultFusionBadFrame);
  }
  if (!see_body(frame, out)) return rt::Health::of(rt::Severity::kCounted, kFaultFusionNoJoints);
  // The answer to a mark takes as long as fine tracking: the frame that gives it does the one coarser.
  const int coarser = mark_W_ ? 1 : 0;
  const auto level =
      static_cast<std::size_t>(std::clamp(tick.level + coarser, 0, config_.level_count - 1));
  const FusionLevel& knobs = config_.levels[level];
  {
    Stage stage(profiling_, *crew_, profile_.prepare);
    tracker_.prepare(view_of(frame).depth_mm, k, knobs.pixel_step);
    out.work += tracker_.pyramid().work();
  }
  if (!started_ && tracker_.pyramid().level(1).valid < tracker_.least_points()) {
    return rt::Health::of(rt::Severity::kCounted, kFaultFusionBadFrame);
  }

  TrackingResult& r = out.tracking;
  const bool first = !started_;
  bool found_again = false;
  if (first) {
    started_ = true;
    r.X_WC = X_WC_;
    r.state = TrackingState::kTracking;
    r.claimed = r.fully_constrained = true;
    r.degenerate_count = 0;
  } else {
    Stage stage(profiling_, *crew_, profile_.track);
    if (masked_) std::fill(mask_.begin(), mask_.end(), std::uint8_t{0});
    masked_ = false;
    const MotionPrior prior = predict(frame.exposure);
    if (recovering_) {
      recover(frame, prior, knobs, r);
      found_again = !recovering_;
    } else {
      track(prior, knobs, out);
      doubt_leap(frame, prior, r);
      if (r.fully_constrained && r.claimed && !masked_) r.X_WC = anchor_.held(r.X_WC);
    }
    watch_for_loss(r);
    out.work += r.work + relocaliser_.take_work();
  }
  show_body();
  settle_motion(r, frame.exposure, first);
  ++frames_;

  // Nobody has looked yet at what moves in the image by which the camera was found: the map learns from the next one on.
  const bool learns = r.claimed && !found_again;
  if (r.claimed) ++frames_claimed_;
  if (learns) {
    Stage stage(profiling_, *crew_, profile_.integrate);
    perception::FrameView seen = view_of(frame);
    if (masked_) seen.moving = pixel_mask();
    seen.follow = hand_known_;
    seen.follow_W = {window_centre_W_ - Vec3::Constant(kUnderHand_m),
                     window_centre_W_ + Vec3::Constant(kUnderHand_m)};
    map_.decay(std::clamp(rt::seconds(frame.exposure - fused_exposure_), 0.0, 1.0));
    out.integration = map_.integrate(seen, X_WC_, knobs.allocate_step);
    out.integrated = !out.integration.refused;
    if (profiling_) profile_.integrate_parts = map_.last_times();
    const auto& s = out.integration;
    out.work += static_cast<std::uint64_t>(s.pixels) + static_cast<std::uint64_t>(s.rays) +
                static_cast<std::uint64_t>(s.voxels_fused + s.voxels_carved + s.free_tests +
                                           s.follow_tests) +
                kWorkOfBlock * static_cast<std::uint64_t>(s.blocks_fetched);
    if (out.integrated) fused_exposure_ = frame.exposure;
  }
  if (objects_ != nullptr) {
    Stage stage(profiling_, *crew_, profile_.objects);
    follow_objects(frame, out.integrated, out);
  }
  if (learns && r.fully_constrained) {
    relocaliser_.remember(tracker_.pyramid(), colour_of(frame), X_WC_);
  }
  // While it is lost, what was seen last stays where it is looked for; what was found is tracked next.
  if (r.state != TrackingState::kLost || confirming_) cast_model(knobs.pixel_step, out);
  keep_map_in_place(out);
  see_ground(r, learns);
  page(out);

  out.camera.seq = frames_;
  out.camera.exposure = frame.exposure;
  out.camera.X_WC = X_WC_;
  out.camera.tracking = static_cast<CameraPose::Tracking>(r.state);
  out.camera.claimed = r.claimed;
  if (r.claimed) seen_ = frame.exposure;
  out.camera.seen = seen_;
  out.camera_written = true;

  if (r.state == TrackingState::kLost) {
    return rt::Health::of(rt::Severity::kDegraded, kFaultFusionLost);
  }
  if (out.integration.blocks_refused > 0 || out.paging.refused > 0) {
    return rt::Health::of(rt::Severity::kDegraded, kFaultFusionMapFull);
  }
  if (!r.claimed) return rt::Health::of(rt::Severity::kCounted, kFaultFusionUnclaimed);
  return rt::Health::ok();
}

// What stands, from the pyramid, which what moves was taken out of; then what moves, from all readings. A camera that
// is followed, though one direction is only guessed, is followed well enough to say where somebody walks.
void FusionTask::see_ground(const TrackingResult& r, bool learns) noexcept {
  Stage stage(profiling_, *crew_, profile_.ground);
  const auto& pyramid = tracker_.pyramid();
  if (learns) {
    const auto& depth = pyramid.level(pyramid.pixel_step() >= 2 ? 0 : 1);
    ground_.update(
        {depth.intrinsics,
         {depth.depth.row(0), depth.depth.width(), depth.depth.height(), depth.depth.stride()},
         X_WC_,
         setup_.camera,
         pyramid.full_depth()});
  }
  if (r.state == TrackingState::kLost || !(masked_ || ground_.moving() > 0)) return;
  ground_.see_moving(
      {setup_.camera, pyramid.full_depth(), pixel_mask(), X_WC_, exposure_, masked_, r.claimed});
}

// What the next frame is tracked against.
void FusionTask::cast_model(int pixel_step, Out& out) noexcept {
  Stage stage(profiling_, *crew_, profile_.raycast);
  perception::RaycastOptions o;
  o.pixel_step = pixel_step;
  o.min_weight = 0.2;  // one far observation under range weighting is 1/4
  o.max_depth_m = config_.tracker.preprocess.depth_max_m + config_.tsdf.truncation_m;
  o.crew = crew_;
  o.smooth_normals = false;  // the sums average; smoothing over voxels would round the corners
  // Live points of the next frame meet what this one sees; elsewhere nothing looks at the model.
  const auto& depth = tracker_.pyramid().level(0).depth;
  o.hint_depth_m = {depth.row(0), depth.width(), depth.height(), depth.stride()};
  o.hinted_only = true;
  const auto stats = perception::raycast(map_, setup_.camera, X_WC_, o, model_);
  out.work += static_cast<std::uint64_t>(stats.steps);
}

// Where the map is, what was just fused included.
void FusionTask::keep_map_in_place(Out& out) noexcept {
  if (recovering_ || clearing()) return anchor_.forget();  // its nodes may be gone
  if (!out.integrated) return;
  Stage stage(profiling_, *crew_, profile_.track);
  const auto& t = config_.tracker;
  const perception::icp::NoiseRule noise{static_cast<float>(t.noise_m),
                                         static_cast<float>(t.noise_per_m2),
                                         static_cast<float>(t.noise_from_m)};
  anchor_.update(map_, model_, noise, X_WC_, tracker_.pyramid().mean_depth(noise));
  out.work += static_cast<std::uint64_t>(anchor_.nodes());
}

// What is far from camera and hand leaves the pool, what they come near to returns. A lost camera is where
// nobody knows: then the search brings back what it wants to look at.
void FusionTask::page(Out& out) noexcept {
  if (recovering_) return;
  Stage stage(profiling_, *crew_, profile_.integrate);
  const std::array<Vec3, 2> anchors{X_WC_.translation(), window_centre_W_};
  out.paging = map_.page(std::span(anchors).first(hand_known_ ? 2 : 1), kPagedBlocks);
  out.work += kWorkOfBlock * static_cast<std::uint64_t>(out.paging.blocks_moved);
}

// ---------------------------------------------------------------- the operator's edits

bool FusionTask::clearable(const Eigen::AlignedBox3d& box_W) noexcept {
  return box_W.min().allFinite() && box_W.max().allFinite() && !box_W.isEmpty() &&
         box_W.sizes().maxCoeff() <= kLongestClear_m;
}

void FusionTask::clear_some(Out& out) noexcept {
  if (to_clear_W_.isEmpty()) return;
  Stage stage(profiling_, *crew_, profile_.clear);
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
