#include "tools/measure/accuracy/moving_run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>

#include "rt/quantile.hpp"
#include "tools/measure/accuracy/fusion_study.hpp"
#include "tools/measure/accuracy/moving_ghosts.hpp"
#include "tools/record/fusion_feed.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kCheckEvery = 20;  // frames

// The odometry of a run: steps of the true motion, bent by shares drawn once for the run, or lies.
class Odometry {
 public:
  Odometry(const MovingSample& sample, MovingVariant variant, const tasks::FusionConfig& config)
      : variant_(variant) {
    rt::Random rng(sample.seed, rt::mix64(0x6f646f, static_cast<std::uint64_t>(sample.index)));
    way_ = 1 + rng.uniform(-1, 1) * config.odometry_translation_share;
    turn_ = 1 + rng.uniform(-1, 1) * config.odometry_rotation_share;
    Vec3 axis(rng.normal(), rng.normal(), rng.normal());
    bend_rad_per_m_ = rng.uniform(-1, 1) * config.odometry_deg_per_m * kDegree * axis.normalized();
    still_ = rng.uniform() < 0.5;
  }
  // Its step for the true one.
  [[nodiscard]] Pose step(const Pose& truth) const {
    if (variant_ == MovingVariant::kLying) return still_ ? Pose::Identity() : truth.inverse();
    const Eigen::AngleAxisd r(truth.linear());
    Vec3 turn = turn_ * r.angle() * r.axis();
    turn += truth.translation().norm() * bend_rad_per_m_;
    Pose out = Pose::Identity();
    if (turn.norm() > 0) {
      out.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    }
    out.translation() = way_ * truth.translation();
    return out;
  }

 private:
  MovingVariant variant_;
  double way_, turn_;
  Vec3 bend_rad_per_m_;
  bool still_;
};

class Run {
 public:
  Run(rt::NonRealtime& nrt, const MovingSample& sample, const MovingFilm& film,
      MovingVariant variant, const MovingSetting& setting)
      : nrt_(nrt),
        sample_(sample),
        film_(film),
        images_(variant == MovingVariant::kPlain ? film.plain : film.with),
        variant_(variant),
        setting_(setting),
        ghosts_(nrt, sample, film),
        poses_(film.share_most) {
    tasks::FusionConfig config = fusion_with_voxel(1e-3 * setting.voxel_mm);
    config.levels[0] = config.levels[static_cast<std::size_t>(setting.level)];
    config.tracker.iterations = config.levels[0].iterations;
    config.level_count = 1;
    config.motion.on = setting.watch;
    tasks::FusionSetup setup;
    setup.camera = images_.intrinsics;
    // No wall lies along the voxels' grid; up is up, as on a robot.
    X_TW_.linear() = Eigen::AngleAxisd(0.3, Vec3::UnitZ()).toRotationMatrix();
    X_TW_.translation() = Vec3(0.013, -0.021, 0.007);
    const Pose& X_WC0 = *images_.truth(0);
    setup.X_WC0 = X_TW_ * X_WC0;
    setup.ground.up_known = true;
    setup.ground.camera_height_m = X_WC0.translation().z();
    setup.ground.start_W = X_TW_ * Vec3(X_WC0.translation().x(), X_WC0.translation().y(), 0);
    odometry_ = std::make_unique<Odometry>(sample, variant, config);
    task_ = std::make_unique<tasks::FusionTask>(nrt, config, setup);
    feed_ = std::make_unique<FusionFeed>(*task_);
  }

  MovingRun judge(std::ostream* debug);

 private:
  void feed_odometry(int frame);
  void judge_pose(int frame, const tasks::FusionTask::Out& out);
  MaskFigures judge_frame_mask(int frame, bool claimed);
  void judge_map(int frame);
  void say(int frame, const tasks::FusionTask::Out& out, const MaskFigures& mask,
           std::ostream& debug) const;

  rt::NonRealtime& nrt_;
  const MovingSample& sample_;
  const MovingFilm& film_;
  const FusionSequence& images_;
  MovingVariant variant_;
  MovingSetting setting_;
  MovingGhosts ghosts_;
  Pose X_TW_ = Pose::Identity();  // T: the world of the task
  std::unique_ptr<Odometry> odometry_;
  Pose X_OB_ = Pose::Identity();
  std::unique_ptr<tasks::FusionTask> task_;
  std::unique_ptr<FusionFeed> feed_;

  MovingRun r_;
  PoseJudge poses_;
  std::vector<double> ious_, still_masked_;
  std::int64_t still_ = 0, still_hit_ = 0;
};

void Run::feed_odometry(int frame) {
  if (variant_ != MovingVariant::kOdometry && variant_ != MovingVariant::kLying) return;
  if (frame > 0) {
    X_OB_ = perception::orthonormalised(
        X_OB_ * odometry_->step(images_.truth(frame - 1)->inverse() * *images_.truth(frame)));
  }
  feed_->in.odometry = tasks::OdometryPrior{MovingSample::time_of(frame), X_OB_};
}

void Run::judge_pose(int frame, const tasks::FusionTask::Out& out) {
  const bool claimed = out.camera_written && out.camera.claimed;
  ghosts_.claimed(frame, claimed);
  const double share =
      variant_ == MovingVariant::kPlain ? 0 : film_.share[static_cast<std::size_t>(frame)];
  poses_.add(frame, claimed, out.camera.X_WC, *images_.truth(frame), share);
}

MaskFigures Run::judge_frame_mask(int frame, bool claimed) {
  const auto mask = task_->pixel_mask();
  const auto& truth = film_.truth[static_cast<std::size_t>(frame)];
  MaskFigures figures;
  if (variant_ == MovingVariant::kPlain) {
    // Nothing moves: all readings are still.
    std::vector<std::uint8_t> still(truth.size(), 0);
    for (std::size_t i = 0; i < still.size(); ++i) {
      const auto u = static_cast<int>(i) % mask.width, v = static_cast<int>(i) / mask.width;
      if (images_.depth_mm(frame, u, v) == 0) {
        still[i] = static_cast<std::uint8_t>(PixelTruth::kEither);
      }
    }
    figures = judge_mask({mask.data, still.size()}, still);
  } else {
    figures = judge_mask({mask.data, truth.size()}, truth);
  }
  if (claimed && !std::isnan(figures.iou)) ious_.push_back(figures.iou);
  still_masked_.push_back(figures.still_masked);
  still_ += figures.still, still_hit_ += figures.still_hit;
  return figures;
}

void Run::judge_map(int frame) {
  if (!setting_.surfaces) return;
  const bool plain = variant_ == MovingVariant::kPlain;
  const bool ghost_check =
      frame + 1 == sample_.frames || (frame > sample_.first_moving && frame % kCheckEvery == 0);
  const int rested = frame - sample_.last_moving - 20;
  const bool rest_check = !plain && sample_.end == MoverEnd::kComesToRest && rested >= 0 &&
                          rested <= 25 && rested % 5 == 0 &&
                          (rested == 20 || !(r_.rest_frames < MovingRun::kNever));
  if (!ghost_check && !rest_check) return;
  const perception::Mesh mesh = perception::extract_mesh(nrt_, task_->map());
  const auto& cost = feed_->cost_map();
  if (ghost_check) {
    const auto most = [](double a, double b) { return std::isnan(a) ? b : std::max(a, b); };
    r_.ghost_cm3 = most(r_.ghost_cm3, ghosts_.volume_cm3(mesh, poses_.X_WT(), frame));
    r_.ghost_cells = most(r_.ghost_cells, ghosts_.cost_cells(cost, poses_.X_WT(), frame));
    r_.ghost_nodes = most(r_.ghost_nodes, ghosts_.window_nodes(task_->map(), poses_.X_WT(), frame));
    r_.vertices = mesh.vertices_W.size();
  }
  if (rest_check) {
    const double reach = 0.01 + std::max(0.01, 1e-3 * setting_.voxel_mm);
    if (!(r_.rest_frames < MovingRun::kNever)) {
      const double in = ghosts_.mover_in_mesh(mesh, poses_.X_WT(), frame, reach);
      if (!std::isnan(in)) r_.rest_frames = in >= 0.5 ? rested : MovingRun::kNever;
    }
    if (rested == 20) r_.rest_cost = ghosts_.mover_in_cost(cost, poses_.X_WT(), frame);
  }
}

void Run::say(int frame, const tasks::FusionTask::Out& out, const MaskFigures& mask,
              std::ostream& debug) const {
  char line[320];
  std::snprintf(
      line, sizeof line,
      "%4d  off %8.1f mm  %-9s state %d  share %.3f  iou %5.3f  still masked %.4f  "
      "overlap %.2f  majority off %.1f mm, %d misfits, unexplained %.3f, rival %.2f, evidence %d\n",
      frame, poses_.off_mm(), out.camera.claimed ? "claimed" : "unclaimed",
      static_cast<int>(out.camera.tracking), film_.share[static_cast<std::size_t>(frame)], mask.iou,
      mask.still_masked, out.tracking.overlap,
      poses_.off_mm(out.motion.X_WC, *images_.truth(frame)), out.motion.cells_misfit,
      out.motion.consensus.unexplained, out.motion.consensus.rival, out.motion.evidence);
  debug << line;
}

MovingRun Run::judge(std::ostream* debug) {
  double cpu = 0;
  for (int f = 0; f < images_.size(); ++f) {
    images_.frame(f, feed_->frame());
    feed_odometry(f);
    const auto& out = feed_->step();
    cpu += feed_->cpu_ms();
    r_.cpu_most_ms = std::max(r_.cpu_most_ms, feed_->cpu_ms());
    judge_pose(f, out);
    const MaskFigures mask = judge_frame_mask(f, out.camera_written && out.camera.claimed);
    judge_map(f);
    if (debug != nullptr) say(f, out, mask, *debug);
  }
  poses_.write(r_);
  r_.mask_iou = rt::quantile(ious_, 0.5, MovingRun::kNone);
  r_.masked_still = still_ > 0 ? static_cast<double>(still_hit_) / static_cast<double>(still_) : 0;
  r_.masked_still_p95 = rt::quantile(still_masked_, 0.95, MovingRun::kNone);
  r_.cpu_ms = cpu / std::max(1, images_.size());
  return r_;
}

}  // namespace

const char* name_of(MovingVariant v) {
  static constexpr std::array<const char*, 4> names{"plain", "alone", "odometry", "lying"};
  return names[static_cast<std::size_t>(v)];
}

bool has_variant(const MovingSample& sample, MovingVariant v) {
  return v != MovingVariant::kLying || sample.carry != Carry::kAtRest;
}

MovingRun run_moving(rt::NonRealtime& nrt, const MovingSample& sample, const MovingFilm& film,
                     MovingVariant variant, const MovingSetting& setting, std::ostream* debug) {
  return Run(nrt, sample, film, variant, setting).judge(debug);
}

}  // namespace teletact
