#include "perception/icp/tracker.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "perception/icp/contradiction.hpp"
#include "perception/icp/normal_equations.hpp"

namespace perception {

namespace {

constexpr double kDegree = std::numbers::pi / 180;

icp::NoiseRule noise_of(const TrackerConfig& c) noexcept {
  return {static_cast<float>(c.noise_m), static_cast<float>(c.noise_per_m2),
          static_cast<float>(c.noise_from_m)};
}

}  // namespace

void TrackerConfig::describe(config::Section& s) {
  preprocess.describe(s.section("preprocess", "depth filter and pyramid"));
  s.integer("iterations_fine", iterations[0], 1, 50, "at full resolution")
      .integer("iterations_middle", iterations[1], 1, 50, "at half")
      .integer("iterations_coarse", iterations[2], 1, 50, "at a quarter")
      .numbers("gate_distance_m", gate_distance_m, 0.005, 1,
               "largest pair distance, fine to coarse")
      .number("gate_normal_deg", gate_normal_deg, 1, 89, "largest angle between normals")
      .number("noise_m", noise_m, 1e-4, 0.1, "of a reading: this much ...")
      .number("noise_per_m2", noise_per_m2, 0, 1, "... plus this times the square of the depth ...")
      .number("noise_from_m", noise_from_m, 0, 10, "... beyond this one")
      .number("stop_translation_m", stop_translation_m, 0, 0.01,
              "a level ends when the next step is below this")
      .number("stop_rotation_deg", stop_rotation_deg, 0, 1, "and this one")
      .number("weak_inlier_share", weak_inlier_share, 0, 1,
              "of points on the model's surface, within noise; below: weak")
      .number("lost_inlier_share", lost_inlier_share, 0, 1,
              "of points on the model's surface, within noise; below: lost")
      .number("lost_overlap", lost_overlap, 0, 1, "share of points that meet the map; below: lost")
      .number("weak_residual_m", weak_residual_m, 0, 1, "RMS above: weak")
      .number("lost_residual_m", lost_residual_m, 0, 1, "RMS above: lost")
      .integer("lost_inliers", lost_inliers, 6, 100000,
               "fewer points at half resolution of 512 x 424: lost; of smaller images as many less")
      .number("jump_translation_m", jump_translation_m, 0.001, 10, "from the prior; beyond: lost")
      .number("jump_rotation_deg", jump_rotation_deg, 0.1, 180, "from the prior; beyond: lost")
      .number("claim_translation_m", claim_translation_m, 0, 1, "prior good enough to claim on")
      .number("claim_rotation_deg", claim_rotation_deg, 0, 90, "prior good enough to claim on")
      .number("reacquire_distance_m", reacquire_distance_m, 0.005, 1, "pair distance when lost")
      .number("reacquire_inlier_share", reacquire_inlier_share, 0, 1, "to be found again")
      .number("reacquire_overlap", reacquire_overlap, 0, 1, "to be found again")
      .number("reacquire_residual_m", reacquire_residual_m, 0, 1, "to be found again, at most")
      .number("reacquire_contradiction_m", reacquire_contradiction_m, 0.005, 1,
              "off every surface about it by this much at 1 m: against")
      .number("reacquire_contradiction", reacquire_contradiction, 0, 1,
              "share of points against, to be found again, at most")
      .number("reacquire_condition", reacquire_condition, 1, 1e9, "to be found again, at most")
      .number("reacquire_translation_m", reacquire_translation_m, 0, 10, "from the guess, at most")
      .number("reacquire_rotation_deg", reacquire_rotation_deg, 0, 180, "from the guess, at most");
  degeneracy.describe(s.section("degeneracy", "which directions the scene constrains"));
}

Tracker::Tracker(rt::NonRealtime& nrt, const TrackerConfig& config, int max_width, int max_height)
    : config_(config), pyramid_(nrt, config.preprocess, max_width, max_height) {}

void Tracker::prepare(ImageView<const std::uint16_t> depth_mm, const Intrinsics& intrinsics,
                      int pixel_step) noexcept {
  pyramid_.build(depth_mm, intrinsics, pixel_step, *crew_);
}

int Tracker::least_points() const noexcept {
  constexpr int kLeast = 60;
  constexpr std::int64_t kWhole = 256 * 212;
  const Intrinsics& k = pyramid_.level(1).intrinsics;
  const std::int64_t share = config_.lost_inliers * std::int64_t{k.width} * k.height / kWhole;
  return static_cast<int>(std::clamp<std::int64_t>(share, std::min(kLeast, config_.lost_inliers),
                                                   config_.lost_inliers));
}

double Tracker::mean_depth() const noexcept { return pyramid_.mean_depth(noise_of(config_)); }

namespace {

// How fast the steps of an alignment shrink, from those of one level, else from the level before.
class StepSizes {
 public:
  void next_level() noexcept { last_.setZero(); }
  // Bound of the step after `xi`, as a share of `xi`. Steps shrink by nearly the same factor each
  // time, six- to twentyfold on most frames. The bound is twice the last ratio of two steps, never
  // below a fifth.
  [[nodiscard]] double next_share(const Vec6& xi) noexcept {
    if (!last_.isZero(0)) {
      const auto share = [](double now, double before) { return before > 0 ? now / before : 1.0; };
      seen_ = std::max({share(xi.head<3>().norm(), last_.head<3>().norm()),
                        share(xi.tail<3>().norm(), last_.tail<3>().norm()), kLeast});
    }
    last_ = xi;
    return std::min(1.0, 2 * seen_);
  }

 private:
  static constexpr double kLeast = 0.1;
  Vec6 last_ = Vec6::Zero();
  double seen_ = 1;
};

// The state of one alignment: the pose being refined and what is needed to refine it.
struct Alignment {
  const TrackingPyramid& pyramid;
  const ModelView& model;
  const TrackerConfig& config;
  rt::ForkJoin& crew;
  Pose X_FC;
  Vec3 centre_F;
  double length_m;
  Degeneracy directions;
  std::uint64_t work = 0;
  StepSizes steps{};
  double gate_limit_m = std::numeric_limits<double>::infinity();

  [[nodiscard]] Gates gates(std::size_t level) const noexcept {
    return {static_cast<float>(std::min(config.gate_distance_m[level], gate_limit_m)),
            static_cast<float>(std::cos(config.gate_normal_deg * kDegree)), noise_of(config),
            static_cast<float>(config.map_error_m)};
  }
  // Sums at `level`, and from them which directions are constrained.
  [[nodiscard]] NormalEquations examine(std::size_t level) noexcept {
    NormalEquations eq;
    CrossMoment cross;
    accumulate_cross(pyramid.level(static_cast<int>(level)), model, X_FC, centre_F, gates(level),
                     eq, cross, crew);
    directions = analyse(eq.H, cross.H, eq.weight, length_m, config.degeneracy);
    count_work(level);
    return eq;
  }
  void count_work(std::size_t level) noexcept {
    const Intrinsics& k = pyramid.level(static_cast<int>(level)).intrinsics;
    work += static_cast<std::uint64_t>(k.width) * static_cast<std::uint64_t>(k.height);
  }
  // Coarse to fine, from the coarsest level to `finest`.
  void descend(const std::array<int, 3>& limits, int finest, TrackingResult& out) noexcept {
    for (int level = TrackingPyramid::kLevels - 1; level >= finest; --level) {
      const auto l = static_cast<std::size_t>(level);
      steps.next_level();
      for (int i = 0; i < limits[l]; ++i) {
        ++out.iterations[l];
        if (!refine(l)) break;
      }
    }
  }
  // One step. False: the level is done.
  [[nodiscard]] bool refine(std::size_t level) noexcept {
    NormalEquations eq;
    if (level > 0) {
      // Looked at anew each time: structure that was out of the gates comes into them.
      eq = examine(level);
    } else {
      // Level 0 would say what level 1 said, at four times the price.
      accumulate(pyramid.level(0), model, X_FC, centre_F, gates(level), eq, crew);
      count_work(level);
    }
    Vec6 xi;
    if (!confined_step(eq.H, eq.g, length_m, directions, xi)) return false;
    const Eigen::Translation3d to_centre(-centre_F), back(centre_F);
    X_FC = orthonormalised(Pose(back * exp_se3(xi) * to_centre * X_FC));
    const double share = steps.next_share(xi);
    return share * xi.head<3>().norm() >= config.stop_translation_m ||
           share * xi.tail<3>().norm() >= config.stop_rotation_deg * kDegree;
  }
};

void measure(const NormalEquations& eq, TrackingResult& out) noexcept {
  out.inliers = static_cast<int>(eq.inliers);
  out.inlier_share = eq.met > 0 ? static_cast<double>(eq.inliers) / static_cast<double>(eq.met) : 0;
  out.on_surface =
      eq.met > 0 ? static_cast<double>(eq.on_surface) / static_cast<double>(eq.met) : 0;
  out.overlap = eq.live > 0 ? static_cast<double>(eq.met) / static_cast<double>(eq.live) : 0;
  out.residual_m = eq.weight > 0 ? std::sqrt(eq.r2 / eq.weight) : 0;
}

void judge(const TrackerConfig& c, int least_points, const MotionPrior& prior, const Pose& X_WC,
           TrackingResult& out) noexcept {
  const Pose jump = prior.X_WC.inverse() * X_WC;
  const bool finite = X_WC.matrix().allFinite() && std::isfinite(out.residual_m);
  const bool lost = !finite || out.inliers < least_points || out.on_surface < c.lost_inlier_share ||
                    out.overlap < c.lost_overlap || out.residual_m > c.lost_residual_m ||
                    jump.translation().norm() > c.jump_translation_m ||
                    rotation_angle(jump.linear()) > c.jump_rotation_deg * kDegree;
  if (lost) return;
  out.fully_constrained = out.degenerate_count == 0;
  out.claimed = out.fully_constrained || is_trusted(c, prior);
  const bool weak =
      out.on_surface < c.weak_inlier_share || out.residual_m > c.weak_residual_m || !out.claimed;
  out.state = weak ? TrackingState::kWeak : TrackingState::kTracking;
  out.X_WC = X_WC;
}

}  // namespace

void Tracker::track(const ModelView& model, const MotionPrior& prior, const Pose& X_WC_start,
                    const std::array<int, 3>& iterations, TrackingResult& out) noexcept {
  out = TrackingResult{};
  out.X_WC = prior.X_WC;
  out.condition = std::numeric_limits<double>::infinity();
  out.degenerate_count = 6;
  const double length = mean_depth();
  if (!model.valid() || !(length > 0) || !prior.X_WC.matrix().allFinite() ||
      !X_WC_start.matrix().allFinite())
    return;

  const Pose X_FW = model.X_WF.inverse();
  Alignment a{pyramid_, model, config_, *crew_, X_FW * X_WC_start, Vec3::Zero(), length, {}};
  a.centre_F = a.X_FC * Vec3(0, 0, length);
  std::array<int, 3> limits{};
  for (std::size_t l = 0; l < limits.size(); ++l) {
    limits[l] = std::min(iterations[l], config_.iterations[l]);
  }
  a.descend(limits, 0, out);
  const NormalEquations eq = a.examine(1);

  out.condition = a.directions.condition;
  out.degenerate_count = a.directions.degenerate_count;
  for (int i = 0; i < out.degenerate_count; ++i) {
    Vec6 d = a.directions.degenerate.col(i);
    d.head<3>() = model.X_WF.linear() * d.head<3>();
    d.tail<3>() = model.X_WF.linear() * d.tail<3>();
    out.degenerate_W.col(i) = d;
  }
  out.length_m = length;
  out.work = a.work;
  measure(eq, out);
  judge(config_, least_points(), prior, orthonormalised(model.X_WF * a.X_FC), out);
}

void Tracker::reacquire(const ModelView& model, const Pose& X_WC_guess,
                        TrackingResult& out) const noexcept {
  out = TrackingResult{};
  out.X_WC = X_WC_guess;
  out.condition = std::numeric_limits<double>::infinity();
  out.degenerate_count = 6;
  const double length = mean_depth();
  if (!model.valid() || !(length > 0) || !X_WC_guess.matrix().allFinite()) return;

  Alignment a{pyramid_,     model,  config_, *crew_, model.X_WF.inverse() * X_WC_guess,
              Vec3::Zero(), length, {}};
  a.centre_F = a.X_FC * Vec3(0, 0, length);
  a.descend(config_.iterations, 1, out);
  a.gate_limit_m = config_.reacquire_distance_m;
  measure(a.examine(1), out);
  out.contradiction = contradiction_share(pyramid_.level(TrackingPyramid::kLevels - 1), model,
                                          a.X_FC, config_.reacquire_contradiction_m);
  out.clash = clash(pyramid_.level(TrackingPyramid::kLevels - 1), model, a.X_FC).share();
  for (int i = 0; i < 3; ++i) a.count_work(TrackingPyramid::kLevels - 1);
  out.condition = a.directions.condition;
  out.degenerate_count = a.directions.degenerate_count;
  out.fully_constrained = out.degenerate_count == 0;
  out.length_m = length;
  out.work = a.work;
  const Pose X_WC = orthonormalised(model.X_WF * a.X_FC);
  const Pose moved = X_WC_guess.inverse() * X_WC;
  if (!X_WC.matrix().allFinite() || moved.translation().norm() > config_.reacquire_translation_m ||
      rotation_angle(moved.linear()) > config_.reacquire_rotation_deg * kDegree) {
    return;
  }
  out.X_WC = X_WC;
  out.state = TrackingState::kWeak;
}

bool is_trusted(const TrackerConfig& c, const MotionPrior& prior) noexcept {
  return prior.source == MotionPrior::Source::kOdometry &&
         prior.sigma_translation_m <= c.claim_translation_m &&
         prior.sigma_rotation_deg <= c.claim_rotation_deg;
}

bool Tracker::reliable(const TrackingResult& r, bool trusted_prior) const noexcept {
  return r.state != TrackingState::kLost && (r.fully_constrained || trusted_prior) &&
         r.inliers >= least_points() && r.inlier_share >= config_.reacquire_inlier_share &&
         r.overlap >= config_.reacquire_overlap && r.residual_m <= config_.reacquire_residual_m &&
         r.contradiction <= config_.reacquire_contradiction &&
         (trusted_prior || r.condition <= config_.reacquire_condition);
}

}  // namespace perception
