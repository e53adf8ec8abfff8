#include "tasks/fusion/fusion_task.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <numbers>

#include "perception/tsdf/patch_copy.hpp"

namespace tasks {

namespace {

using perception::FrameView;
using perception::MotionPrior;
using perception::RgbdFrame;
using perception::SurfacePatch;
using perception::TrackingResult;
using perception::TrackingState;
using Twist = Eigen::Matrix<double, 6, 1>;

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kPagedBlocks = 128;  // put away, and brought back, a frame
constexpr std::uint64_t kWorkOfBlock = 512;
constexpr double kClearedNodes = 200000;  // of a region, a job
constexpr int kMeshPatience = 10;         // messages' time that an answer may take

// Adds the CPU of its scope, of the way through, to a counter while profiling is on.
class Stage {
 public:
  Stage(bool on, const rt::ForkJoin& crew, std::int64_t& sum) noexcept
      : crew_(crew), sum_(on ? &sum : nullptr), begin_(on ? now() : 0) {}
  ~Stage() {
    if (sum_ != nullptr) *sum_ += now() - begin_;
  }
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

 private:
  [[nodiscard]] std::int64_t now() const noexcept {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec + crew_.beyond_ns();
  }
  const rt::ForkJoin& crew_;
  std::int64_t* sum_;
  std::int64_t begin_;
};

// (v, w) with exp_se3(v, w) = X.
Twist twist_of(const Pose& X) noexcept {
  const Eigen::AngleAxisd r(X.linear());
  Twist xi;
  xi << X.translation(), r.angle() * r.axis();
  return xi;
}

Pose between(const Pose& a, const Pose& b, double f) noexcept {
  const Pose step = a.inverse() * b;
  return perception::orthonormalised(a * perception::exp_se3(f * twist_of(step)));
}

perception::ImageView<const perception::Rgb> colour_of(const RgbdFrame& frame) noexcept {
  return frame.has_colour ? frame.rgb() : perception::ImageView<const perception::Rgb>{};
}

double seconds_between(rt::Time a, rt::Time b) noexcept { return rt::seconds(b - a); }

}  // namespace

FusionTask::FusionTask(rt::NonRealtime& nrt, const FusionConfig& config, const FusionSetup& setup)
    : config_(config),
      setup_(setup),
      map_(nrt, config.tsdf),
      tracker_(nrt, config.tracker, setup.camera.width, setup.camera.height),
      relocaliser_(nrt, config.relocaliser, setup.camera),
      anchor_(nrt),
      ground_(nrt, config.ground, setup.ground),
      model_(nrt, setup.camera.width, setup.camera.height),
      view_maps_(nrt, setup.camera.width / std::max(1, config.view_step) + 1,
                 setup.camera.height / std::max(1, config.view_step) + 1),
      X_WC_(perception::orthonormalised(setup.X_WC0)),
      window_centre_W_(setup.X_WC0 * Vec3(0, 0, 1)) {
  require_valid(config, setup);
  set_up_objects(nrt);
  if (config.mesh_blocks > 0) mesh_ = std::make_unique<perception::MeshSender>(nrt, map_);
}

FusionTask::~FusionTask() = default;

rt::Result<bool> FusionTask::load_map(rt::NonRealtime& nrt, const perception::MapFile& file) {
  auto ok = perception::restore_map(nrt, file, map_, relocaliser_.keyframes());
  if (!ok) return ok;
  for (std::uint8_t label = 1; label <= perception::kMostLabel; ++label) map_.forget_label(label);
  started_ = recovering_ = true;
  exposure_ = rt::time_from_ns(-(std::int64_t{1} << 60));  // any image is newer
  relocaliser_.restart();
  return true;
}

rt::Health FusionTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out.patch_written = out.view_written = out.cost_map_written = out.camera_written = false;
  out.integrated = out.objects_written = out.mesh_written = objects_drawn_ = false;
  out.tracking = TrackingResult{};
  out.integration = perception::IntegrateStats{};
  out.paging = perception::PageStats{};
  out.segmentation = perception::ObjectStats{};
  out.work = out.work_view = 0;
  profile_ = Profile{};
  ++periods_;

  remember_odometry(in.odometry);
  remember_mark(in.hand);
  if (in.virtual_obstacles_changed) static_cast<void>(ground_.set_virtual(in.virtual_obstacles));
  if (in.clear_W && clearable(*in.clear_W)) to_clear_W_ = *in.clear_W;
  clear_some(out);
  rt::Health health = rt::Health::ok();
  if (in.frame != nullptr && in.frame_fresh) health = consume(tick, *in.frame, out);
  write_objects(out);
  write_cost_map(tick, out);
  write_patch(tick, in.hand, out);
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
  // The answer to a mark takes as long as fine tracking: the frame that gives it does the one coarser.
  const int coarser = mark_W_ ? 1 : 0;
  const auto level =
      static_cast<std::size_t>(std::clamp(tick.level + coarser, 0, config_.level_count - 1));
  const FusionLevel& knobs = config_.levels[level];
  {
    Stage stage(profiling_, *crew_, profile_.prepare);
    tracker_.prepare(frame.depth(), k, knobs.pixel_step);
    out.work += tracker_.pyramid().work();
  }
  if (!started_ && tracker_.pyramid().level(1).valid < config_.tracker.lost_inliers) {
    return rt::Health::of(rt::Severity::kCounted, kFaultFusionBadFrame);
  }

  TrackingResult& r = out.tracking;
  const bool first = !started_;
  if (first) {
    started_ = true;
    r.X_WC = X_WC_;
    r.state = TrackingState::kTracking;
    r.claimed = r.fully_constrained = true;
    r.degenerate_count = 0;
  } else {
    Stage stage(profiling_, *crew_, profile_.track);
    const MotionPrior prior = predict(frame.exposure);
    if (recovering_) {
      recover(frame, prior, knobs, r);
    } else {
      tracker_.track(model(), prior, knobs.iterations, r);
      doubt_leap(frame, prior, r);
      if (r.fully_constrained && r.claimed) r.X_WC = anchor_.held(r.X_WC);
    }
    watch_for_loss(r);
    out.work += r.work + relocaliser_.take_work();
  }
  settle_motion(r, frame.exposure, first);
  ++frames_;

  if (r.claimed) {
    ++frames_claimed_;
    Stage stage(profiling_, *crew_, profile_.integrate);
    map_.decay(std::clamp(seconds_between(fused_exposure_, frame.exposure), 0.0, 1.0));
    out.integration = map_.integrate(FrameView::of(frame), X_WC_, knobs.allocate_step);
    out.integrated = !out.integration.refused;
    if (profiling_) profile_.integrate_parts = map_.last_times();
    const auto& s = out.integration;
    out.work += static_cast<std::uint64_t>(s.pixels) + static_cast<std::uint64_t>(s.rays) +
                static_cast<std::uint64_t>(s.voxels_fused + s.voxels_carved + s.free_tests) +
                kWorkOfBlock * static_cast<std::uint64_t>(s.blocks_fetched);
    if (out.integrated) fused_exposure_ = frame.exposure;
  }
  if (objects_ != nullptr) {
    Stage stage(profiling_, *crew_, profile_.objects);
    follow_objects(frame, out.integrated, out);
  }
  if (r.claimed && r.fully_constrained) {
    relocaliser_.remember(tracker_.pyramid(), colour_of(frame), X_WC_);
  }
  // While it is lost, what was seen last stays where it is looked for; what was found is tracked next.
  if (r.state != TrackingState::kLost || confirming_) cast_model(knobs.pixel_step, out);
  keep_map_in_place(out);
  if (r.claimed) {
    Stage stage(profiling_, *crew_, profile_.ground);
    const auto& pyramid = tracker_.pyramid();
    const auto& depth = pyramid.level(pyramid.pixel_step() >= 2 ? 0 : 1);
    ground_.update(
        {depth.intrinsics,
         {depth.depth.row(0), depth.depth.width(), depth.depth.height(), depth.depth.stride()},
         X_WC_});
  }

  page(out);

  out.camera.seq = frames_;
  out.camera.exposure = frame.exposure;
  out.camera.X_WC = X_WC_;
  out.camera.tracking = static_cast<CameraPose::Tracking>(r.state);
  out.camera.claimed = r.claimed;
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

// ---------------------------------------------------------------- lost and found

void FusionTask::watch_for_loss(const TrackingResult& r) noexcept {
  const bool blank = tracker_.pyramid().level(1).valid < config_.tracker.lost_inliers;
  blank_run_ = blank ? blank_run_ + 1 : 0;
  if (recovering_ || r.state != TrackingState::kLost) return;
  // A dark image says nothing of where the camera is: the prior may still hold when it is over.
  if (blank && blank_run_ <= config_.blank_frames) return;
  recovering_ = true;
  confirming_ = look_again_ = false;
  relocaliser_.restart();
}

// A leap from where the camera should be is no motion when another place looks like what is seen: then nobody
// knows where it is. Odometry that is trusted leaves no room for one.
void FusionTask::doubt_leap(const RgbdFrame& frame, const MotionPrior& prior,
                            TrackingResult& r) noexcept {
  if (r.state == TrackingState::kLost || tracker_.trusted(prior)) return;
  const Pose leap = prior.X_WC.inverse() * r.X_WC;
  if (leap.translation().norm() <= config_.leap_translation_m &&
      perception::rotation_angle(leap.linear()) <= config_.leap_rotation_deg * kDegree)
    return;
  if (relocaliser_.alone(tracker_, colour_of(frame), r.X_WC)) return;
  r.state = TrackingState::kLost;
  r.claimed = r.fully_constrained = false;
  r.X_WC = prior.X_WC;
}

// A lost camera is believed to be back when two frames in a row pass the strict gates: the first against
// what was seen last or against a keyframe, the second from the pose that the first one gave; that one is then
// tracked like any other. A frame does one thing about it: one cast, or one keyframe.
void FusionTask::recover(const RgbdFrame& frame, const MotionPrior& prior, const FusionLevel& knobs,
                         TrackingResult& r) noexcept {
  const bool was_confirming = confirming_;
  // Where to look when what was found is not confirmed; odometry carries it on.
  if (was_confirming) {
    X_lost_WC_ = perception::orthonormalised(X_lost_WC_ * (X_WC_.inverse() * prior.X_WC));
  } else {
    X_lost_WC_ = prior.X_WC;
  }
  const auto view = relocaliser_.view();
  tracker_.reacquire(view.valid() ? view : model(), prior.X_WC, r);
  std::uint64_t work = r.work;
  const bool trusted = tracker_.trusted(prior);
  const bool fits = tracker_.reliable(r, trusted);
  if (fits && was_confirming) {
    MotionPrior near = prior;
    near.X_WC = r.X_WC;
    const double contradiction = r.contradiction, clash = r.clash;
    tracker_.track(model(), near, knobs.iterations, r);
    r.contradiction = contradiction;
    r.clash = clash;
    r.work += work;
    if (r.state != TrackingState::kLost && r.claimed) {
      recovering_ = confirming_ = false;
      return;
    }
    work = r.work;
  }
  const bool blank = tracker_.pyramid().level(1).valid < config_.tracker.lost_inliers;
  bool found = false;
  if (fits && !was_confirming && (trusted || !view.valid())) {
    // Odometry says that it is no other place; else the next frame is compared in a view without hint. Not before
    // all of it is in the pool: until then it is found again in the view that there is.
    found = relocaliser_.look(map_, r.X_WC) && trusted;
    look_again_ = false;
  } else if (was_confirming || look_again_ || (!fits && moved_on(view))) {
    look_again_ = !relocaliser_.look(map_, X_lost_WC_);
  } else if (!blank) {
    const TrackingResult here = r;
    found = relocaliser_.search(map_, tracker_, colour_of(frame), fits ? &here : nullptr, r);
  }
  r.work = work;
  confirming_ = found;
  if (!found) r.X_WC = X_lost_WC_;
  r.state = TrackingState::kLost;
  r.claimed = r.fully_constrained = false;
}

// Has odometry carried the lost camera away from where it is being looked for?
bool FusionTask::moved_on(const perception::ModelView& view) const noexcept {
  if (!X_OB_last_) return false;
  const Pose step = (view.valid() ? view.X_WF : model_.X_WC).inverse() * X_lost_WC_;
  return step.translation().norm() > 0.1 || perception::rotation_angle(step.linear()) > 6 * kDegree;
}

// Where the camera should be at `exposure`. Also advances what odometry knows to that instant.
perception::MotionPrior FusionTask::predict(rt::Time exposure) noexcept {
  MotionPrior prior;
  const std::optional<Pose> X_OB = odometry_at(exposure);
  if (X_OB && X_OB_last_) {
    const Pose step_B = X_OB_last_->inverse() * *X_OB;
    const double way = step_B.translation().norm();
    const double turn_deg = perception::rotation_angle(step_B.linear()) / kDegree;
    sigma_translation_m_ += config_.odometry_translation_share * way;
    sigma_rotation_deg_ +=
        config_.odometry_rotation_share * turn_deg + config_.odometry_deg_per_m * way;
    prior.X_WC = X_WC_ * setup_.X_BC.inverse() * step_B * setup_.X_BC;
    prior.source = MotionPrior::Source::kOdometry;
    prior.sigma_translation_m = sigma_translation_m_;
    prior.sigma_rotation_deg = sigma_rotation_deg_;
  } else {
    // Without odometry over the whole interval, a later odometry step starts from nothing known.
    sigma_translation_m_ = sigma_rotation_deg_ = 1e3;
    const double dt = seconds_between(exposure_, exposure);
    prior.X_WC = X_WC_ * perception::exp_se3(dt * velocity_);
  }
  X_OB_last_ = X_OB;
  prior.X_WC = perception::orthonormalised(prior.X_WC);
  return prior;
}

void FusionTask::settle_motion(const TrackingResult& r, rt::Time exposure, bool first) noexcept {
  if (first) {
    X_OB_last_ = odometry_at(exposure);
  } else {
    const double dt = seconds_between(exposure_, exposure);
    velocity_ = twist_of(X_WC_.inverse() * r.X_WC) / std::max(dt, 1e-3);
    if (!r.claimed) velocity_ *= config_.velocity_decay;
    // Between two frames of which one was only found, a way is a leap and no motion.
    if (recovering_) velocity_.setZero();
  }
  if (r.fully_constrained) sigma_translation_m_ = sigma_rotation_deg_ = 0;
  X_WC_ = r.X_WC;
  exposure_ = exposure;
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

// ---------------------------------------------------------------- odometry

void FusionTask::remember_odometry(const std::optional<OdometryPrior>& odometry) noexcept {
  if (!odometry || !odometry->X_OB.matrix().allFinite()) return;
  if (odometry_count_ > 0) {
    const OdometryPrior& newest = odometry_[(odometry_count_ - 1) % kOdometry];
    if (odometry->taken <= newest.taken) return;
  }
  odometry_[odometry_count_++ % kOdometry] = *odometry;
}

// Interpolated; beyond the newest sample by its velocity, at most 100 ms. Empty: not known then.
std::optional<Pose> FusionTask::odometry_at(rt::Time t) const noexcept {
  if (odometry_count_ == 0) return std::nullopt;
  const OdometryPrior& newest = odometry_[(odometry_count_ - 1) % kOdometry];
  if (t >= newest.taken) {
    const double dt = seconds_between(newest.taken, t);
    if (dt > 0.1) return std::nullopt;
    Twist xi;
    xi << newest.v_OB_B * dt, newest.w_OB_B * dt;
    return perception::orthonormalised(newest.X_OB * perception::exp_se3(xi));
  }
  const std::uint64_t held = std::min<std::uint64_t>(odometry_count_, kOdometry);
  for (std::uint64_t i = 1; i < held; ++i) {
    const OdometryPrior& after = odometry_[(odometry_count_ - i) % kOdometry];
    const OdometryPrior& before = odometry_[(odometry_count_ - i - 1) % kOdometry];
    if (before.taken > t) continue;
    const double f = seconds_between(before.taken, t) / seconds_between(before.taken, after.taken);
    return between(before.X_OB, after.X_OB, f);
  }
  return std::nullopt;
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

// ---------------------------------------------------------------- what others read

void FusionTask::write_patch(const rt::Tick& tick, const HapticState& hand, Out& out) noexcept {
  if (out.patch == nullptr) return;
  Stage stage(profiling_, *crew_, profile_.patch);
  const Vec3 centre =
      hand.p_WH + config_.window_lead_periods * rt::seconds(setup_.period) * hand.v_WH;
  // Before the haptic task ran, and for a hand that is not finite, the window stays where it was.
  if (hand.seq > 0 && centre.allFinite()) {
    window_centre_W_ = centre;
    hand_known_ = true;
  }
  SurfacePatch& p = *out.patch;
  const std::span<const std::uint8_t> slots =
      objects_ == nullptr ? std::span<const std::uint8_t>{} : slot_of_label_;
  if (!perception::copy_patch(map_, window_centre_W_, config_.patch_nodes, p, slots)) return;
  p.seq = ++patch_seq_;
  p.fused = tick.start;
  p.exposure = fused_exposure_;
  p.palette = setup_.palette;
  p.checksum = config_.patch_checksums ? perception::patch_checksum(p) : 0;
  out.work += p.cells();
  out.patch_written = true;
}

void FusionTask::write_cost_map(const rt::Tick& tick, Out& out) noexcept {
  if (out.cost_map == nullptr) return;
  ++periods_since_map_;
  const bool due = periods_since_map_ >= static_cast<std::uint64_t>(config_.cost_map_period);
  if (!due && map_seq_ > 0) return;
  Stage stage(profiling_, *crew_, profile_.cost_map);
  ground_.write(*out.cost_map);
  out.cost_map->seq = ++map_seq_;
  out.cost_map->fused = tick.start;
  out.cost_map->exposure = fused_exposure_;
  out.cost_map_written = true;
  periods_since_map_ = 0;
}

bool FusionTask::view_due(const Out& out) const noexcept {
  return out.view != nullptr && config_.view_period_frames > 0 && started_ &&
         (periods_ - 1) % static_cast<std::uint64_t>(config_.view_period_frames) == 0;
}

void FusionTask::write_view(const rt::Tick& tick, const std::optional<Pose>& X_WV,
                            Out& out) noexcept {
  if (!view_due(out)) return;
  Stage stage(profiling_, *crew_, profile_.view);
  perception::RaycastOptions o;
  o.pixel_step = config_.view_step;
  o.colour = true;
  o.crew = crew_;
  const Pose X = X_WV ? *X_WV : X_WC_;
  // The camera's own frame shows objects better than the map alone can.
  const bool own = objects_drawn_ && !X_WV;
  o.labels = !own && objects_ != nullptr && objects_->count() > 0;
  const auto stats = perception::raycast(map_, setup_.camera, X, o, view_maps_);
  if (stats.rays == 0) return;
  SceneView& v = *out.view;
  v.X_WV = X;
  v.intrinsics = view_maps_.intrinsics;
  const auto colour = view_maps_.colour();
  const perception::ImageView<const std::uint8_t> shown =
      own ? objects_shown_.view() : view_maps_.labels();
  for (int y = 0; y < view_maps_.height(); ++y) {
    for (int x = 0; x < view_maps_.width(); ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(v.intrinsics.width) +
                     static_cast<std::size_t>(x);
      const float* r = view_maps_.at(x, y);
      v.object[i] = own || o.labels ? shown.at(x, y) : std::uint8_t{0};
      if (!view_maps_.hit(x, y)) {
        v.colour[i] = {24, 26, 30};
        v.points[i] = {};
        continue;
      }
      // Headlight: brightness by the angle between ray and surface.
      const Eigen::Vector3f p = view_maps_.vertex_C(x, y), n = view_maps_.normal_C(x, y);
      const float shade = 0.35F + 0.65F * std::clamp(-n.dot(p) / p.norm(), 0.0F, 1.0F);
      const perception::Rgb c = colour.at(x, y);
      const auto lit = [shade](std::uint8_t channel) {
        return static_cast<std::uint8_t>(static_cast<float>(channel) * shade);
      };
      v.colour[i] = {lit(c.r), lit(c.g), lit(c.b)};
      const Eigen::Vector3f q = (X * p.cast<double>()).cast<float>();
      v.points[i] = {q.x(), q.y(), q.z(), r[3]};
    }
  }
  v.seq = ++view_seq_;
  v.fused = tick.start;
  v.exposure = fused_exposure_;
  out.work_view = static_cast<std::uint64_t>(stats.steps) + static_cast<std::uint64_t>(stats.rays);
  out.work += out.work_view;
  out.view_written = true;
}

// The next deltas go when the last ones were taken, so none is lost; a receiver that says nothing for long, or
// has begun anew, gets all of the mesh again.
void FusionTask::write_mesh(const rt::Tick& tick, std::uint64_t taken, Out& out) noexcept {
  if (mesh_ == nullptr || out.mesh == nullptr || !started_) return;
  if ((periods_ - 1) % static_cast<std::uint64_t>(config_.mesh_period_frames) != 0) return;
  if (taken != mesh_seq_) {
    if (++mesh_waited_ < kMeshPatience) return;
    mesh_->restart();
  }
  mesh_waited_ = 0;
  Stage stage(profiling_, *crew_, profile_.mesh);
  const bool any = mesh_->next(config_.mesh_blocks, *out.mesh);
  out.work += kWorkOfBlock * static_cast<std::uint64_t>(mesh_->cut_last());
  if (!any) {
    mesh_seq_ = taken;
    return;
  }
  out.mesh->seq = ++mesh_seq_;
  out.mesh->fused = tick.start;
  out.mesh->exposure = fused_exposure_;
  out.mesh_written = true;
}

}  // namespace tasks
