#include "tasks/fusion/fusion_task.hpp"

#include <algorithm>
#include <array>
#include <span>

#include "perception/motion/motion_watch.hpp"

namespace tasks {

namespace {

using perception::RgbdFrame;
using perception::TrackingResult;
using perception::TrackingState;

// As far as the hand reaches within a second, the map follows surfaces that move slowly. Elsewhere
// it does not: what moves must differ from the map, or it would not be masked.
constexpr double kUnderHand_m = 0.25;

rt::Health counted(rt::FaultId fault) noexcept {
  return rt::Health::of(rt::Severity::kCounted, fault);
}

// What a consumed frame says of the task.
rt::Health health_of(const FusionOut& out) noexcept {
  if (out.tracking.state == TrackingState::kLost)
    return rt::Health::of(rt::Severity::kDegraded, kFaultFusionLost);
  if (out.integration.blocks_refused > 0 || out.paging.refused > 0)
    return rt::Health::of(rt::Severity::kDegraded, kFaultFusionMapFull);
  return out.tracking.claimed ? rt::Health::ok() : counted(kFaultFusionUnclaimed);
}

}  // namespace

void FusionOut::begin() noexcept {
  patch_written = view_written = cost_map_written = camera_written = false;
  integrated = objects_written = mesh_written = surface_written = false;
  tracking = TrackingResult{};
  motion = perception::MotionResult{};
  integration = perception::IntegrateStats{};
  paging = perception::PageStats{};
  segmentation = perception::ObjectStats{};
  work = work_view = 0;
  body_pixels = 0;
}

FusionTask::FusionTask(rt::NonRealtime& nrt, const FusionConfig& config, const FusionSetup& setup)
    : config_(config),
      setup_(setup),
      prior_(config_, setup.X_BC),
      tracking_(nrt, config_, setup.camera),
      search_(nrt, config_, setup.camera, tracking_),
      keeper_(nrt, config_, setup, stages_),
      patch_(nrt, config_, setup_),
      view_(nrt, config_, setup.camera),
      cost_map_(config.cost_map_period) {
  require_valid(config, setup);
  camera_.X_WC = perception::orthonormalised(setup.X_WC0);
  if (config.objects.enabled) objects_.emplace(nrt, config_, setup.camera, setup_.palette);
  if (setup.robot != nullptr)
    body_.emplace(nrt, config.body, *setup.robot, config.tracker, setup.X_BC, setup.camera);
  if (setup.ray_cast) surface_.emplace(nrt, setup.camera, config.surface_periods);
  if (config.mesh_blocks > 0) mesh_.emplace(nrt, config_, keeper_.map());
}

rt::Result<bool> FusionTask::load_map(rt::NonRealtime& nrt, const perception::MapFile& file) {
  perception::TsdfMap& map = keeper_.map();
  auto ok = perception::restore_map(nrt, file, map, search_.keyframes());
  if (!ok) return ok;
  for (std::uint8_t label = 1; label <= perception::kMostLabel; ++label) map.forget_label(label);
  camera_.started = true;
  camera_.exposure = rt::time_from_ns(-(std::int64_t{1} << 60));  // any image is newer
  tracking_.watch().grown();
  search_.begin();
  return true;
}

rt::Health FusionTask::begin_step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out.begin();
  consumed_ = nullptr;
  stages_.times = Profile{};
  ++periods_;

  prior_.remember(in.odometry);
  if (objects_) {
    objects_->begin(in.hand);
    objects_->edit(keeper_.map(), in.given, in.drop_object);
  }
  if (in.virtual_obstacles_changed)
    static_cast<void>(keeper_.ground().set_virtual(in.virtual_obstacles));
  if (in.clear_W) keeper_.clear(*in.clear_W);
  keeper_.clear_some(out);
  rt::Health health = rt::Health::ok();
  if (in.frame != nullptr && in.frame_fresh) health = consume(tick, in, out);
  write_outputs(tick, in, out);
  out.work += keeper_.ground().take_work();
  return health;
}

// ---------------------------------------------------------------- one image

rt::Health FusionTask::consume(const rt::Tick& tick, const In& in, Out& out) noexcept {
  const RgbdFrame& frame = *in.frame;
  if (!(frame.intrinsics == setup_.camera)) return counted(kFaultFusionBadFrame);
  // A frame that is not newer than the last one was duplicated or overtaken on its way.
  if (camera_.started && frame.exposure <= camera_.exposure) return counted(kFaultFusionBadFrame);
  if (!see_body(in, out)) return counted(kFaultFusionNoJoints);
  const FusionLevel& knobs = knobs_at(tick.level);
  {
    Stage stage(stages_, &Profile::prepare);
    tracking_.prepare(view_of(frame).depth_mm, knobs.pixel_step);
    out.work += tracking_.pyramid().work();
  }
  const bool first = !camera_.started;
  if (first && tracking_.blank()) return counted(kFaultFusionBadFrame);

  const TrackingResult& r = out.tracking;
  bool found_again = false;
  if (first)
    begin_map(out.tracking);
  else
    found_again = locate(frame, knobs, out);
  settle(frame, first, out);

  // The frame by which a lost camera was found has no mask of what moves: it is not fused, the
  // next is.
  const bool learns = r.claimed && !found_again;
  if (learns) learn(frame, knobs, out);
  if (objects_) follow_objects(frame, out);
  if (learns && r.fully_constrained) search_.remember(frame, camera_.X_WC);
  consumed_ = &knobs;
  keeper_.see_ground(tracking_, camera_, r, learns);
  page(out);
  write_camera(out);
  return health_of(out);
}

// What the next image is tracked against, from the map as it is now. While lost, the last model
// stays as the search target; what was found is tracked next.
void FusionTask::prepare_next(const FusionLevel& knobs, Out& out) noexcept {
  if (out.tracking.state != TrackingState::kLost || search_.confirming())
    keeper_.cast_model(tracking_, camera_.X_WC, knobs.pixel_step, out);
  keeper_.keep_in_place(tracking_, camera_.X_WC, search_.lost(), out);
}

// Segmenting a marked object costs about as much as fine tracking: that frame tracks one level
// coarser.
const FusionLevel& FusionTask::knobs_at(int level) const noexcept {
  const int coarser = objects_ && objects_->marked() ? 1 : 0;
  return config_
      .levels[static_cast<std::size_t>(std::clamp(level + coarser, 0, config_.level_count - 1))];
}

// The robot's own body, before anything looks at the image. False: it is not known where the body
// is in it. Its joint angles travel in the frame. in.held is for an arm that grasps: no node of
// this stack sets it.
bool FusionTask::see_body(const In& in, Out& out) noexcept {
  if (!body_) return true;
  Stage stage(stages_, &Profile::prepare);
  if (!body_->see(*in.frame, in.held)) return false;
  out.body_pixels = body_->pixels();
  out.work += body_->work();
  // What was taken up is in the map where it lay; one region at a time.
  if (!camera_.started) return true;
  if (const auto box_W = body_->take_grasp_W(camera_.X_WC)) grasp_W_ = box_W;
  if (grasp_W_ && !clearing()) {
    keeper_.clear(*grasp_W_);
    grasp_W_.reset();
  }
  return true;
}

// Without the robot's own body.
perception::FrameView FusionTask::view_of(const RgbdFrame& frame) const noexcept {
  auto view = perception::FrameView::of(frame);
  if (body_) view.depth_mm = body_->depth();
  return view;
}

// The first usable frame defines the map.
void FusionTask::begin_map(TrackingResult& r) noexcept {
  camera_.started = true;
  r.X_WC = camera_.X_WC;
  r.state = TrackingState::kTracking;
  r.claimed = r.fully_constrained = true;
  r.degenerate_count = 0;
}

// Where the camera is: out.tracking, out.motion. True: it was lost and is found again.
bool FusionTask::locate(const RgbdFrame& frame, const FusionLevel& knobs, Out& out) noexcept {
  Stage stage(stages_, &Profile::track);
  TrackingResult& r = out.tracking;
  tracking_.clear_mask();
  const perception::MotionPrior prior = prior_.predict(camera_, frame.exposure);
  const bool was_lost = search_.lost();
  bool found_again = false;
  if (was_lost) {
    search_.recover(keeper_.map(),
                    {frame, prior, knobs, keeper_.model(), camera_.X_WC, prior_.has_odometry()}, r);
    found_again = !search_.lost();
  } else {
    tracking_.track(keeper_.map(), keeper_.model(), prior, knobs, r, out.motion);
    search_.doubt_leap(frame, prior, r);
    if (r.fully_constrained && r.claimed && !tracking_.masked()) r.X_WC = keeper_.held(r.X_WC);
  }
  search_.watch_for_loss(r);
  out.work += r.work + search_.take_work();
  return found_again;
}

// The pose is believed from now on.
void FusionTask::settle(const RgbdFrame& frame, bool first, const Out& out) noexcept {
  if (body_) body_->show(tracking_.mask());
  const TrackingResult& r = out.tracking;
  prior_.settle(camera_, r, frame.exposure, {first, tracking_.watch().certain(), search_.lost()});
  camera_.X_WC = r.X_WC;
  camera_.exposure = frame.exposure;
  ++camera_.frames;
  if (!r.claimed) return;
  ++camera_.frames_claimed;
  camera_.seen = frame.exposure;
}

void FusionTask::learn(const RgbdFrame& frame, const FusionLevel& knobs, Out& out) noexcept {
  Stage stage(stages_, &Profile::integrate);
  perception::FrameView seen = view_of(frame);
  if (tracking_.masked()) seen.moving = pixel_mask();
  seen.follow = patch_.hand_known();
  seen.follow_W = {patch_.centre_W() - Vec3::Constant(kUnderHand_m),
                   patch_.centre_W() + Vec3::Constant(kUnderHand_m)};
  keeper_.learn(seen, knobs.allocate_step, camera_, out);
}

void FusionTask::follow_objects(const RgbdFrame& frame, Out& out) noexcept {
  Stage stage(stages_, &Profile::objects);
  objects_->follow(view_of(frame), keeper_.map(), camera_.X_WC,
                   view_.due(camera_.started, periods_, out), out);
}

// Blocks far from camera and hand leave the pool, near ones return. While the camera is lost
// nothing is paged here; the search brings back what it needs.
void FusionTask::page(Out& out) noexcept {
  if (search_.lost()) return;
  const std::array<Vec3, 2> anchors_W{camera_.X_WC.translation(), patch_.centre_W()};
  keeper_.page(std::span(anchors_W).first(patch_.hand_known() ? 2 : 1), out);
}

void FusionTask::write_camera(Out& out) noexcept {
  const TrackingResult& r = out.tracking;
  out.camera.seq = camera_.frames;
  out.camera.exposure = camera_.exposure;
  out.camera.X_WC = camera_.X_WC;
  out.camera.tracking = static_cast<CameraPose::Tracking>(r.state);
  out.camera.claimed = r.claimed;
  out.camera.seen = camera_.seen;
  out.camera_written = true;
}

// ---------------------------------------------------------------- what others read

void FusionTask::write_outputs(const rt::Tick& tick, const In& in, Out& out) noexcept {
  const FusionScene scene = scene_of(tick);
  if (objects_) objects_->write(camera_.seen, out);
  cost_map_.write(scene, keeper_.ground(), out);
  patch_.write(scene, in.hand, out);
  if (surface_) write_surface(tick, out);
}

void FusionTask::end_step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  if (consumed_ != nullptr) prepare_next(*consumed_, out);
  const FusionScene scene = scene_of(tick);
  // in.X_WV: of who wants a view from elsewhere; no node of this stack sets it.
  view_.write(scene, in.X_WV, body_.has_value(), out);
  if (mesh_) mesh_->write(scene, in.mesh_taken, out);
}

FusionScene FusionTask::scene_of(const rt::Tick& tick) noexcept {
  return {tick,   periods_, keeper_.map(), camera_, tracking_, objects_ ? &*objects_ : nullptr,
          stages_};
}

// Some rows more every period, so that a job's cost has a bound; the slot is the same until it is
// whole. A camera that is lost casts from where it was claimed last.
void FusionTask::write_surface(const rt::Tick& tick, Out& out) noexcept {
  if (out.camera_written && out.camera.claimed) surface_->stand_at(out.camera.X_WC);
  if (out.surface == nullptr || !surface_->stands()) return;
  Stage stage(stages_, &Profile::surface);
  const double reach_m = config_.tracker.preprocess.depth_max_m + config_.tsdf.truncation_m;
  if (surface_->begins()) out.surface->exposure = camera_.fused;  // of the oldest rows
  const auto stats = surface_->cast(keeper_.map(), reach_m, *stages_.crew, *out.surface);
  out.work += static_cast<std::uint64_t>(stats.steps) + static_cast<std::uint64_t>(stats.rays);
  if (stats.rays == 0 || !surface_->begins()) return;
  out.surface->fused = tick.start;
  out.surface_written = true;
}

}  // namespace tasks
