// Camera tracking: where was the camera when this depth image was taken?
//
// Projective point-to-plane ICP of a depth pyramid against the ray cast of the map from the last
// pose, coarse to fine (Newcombe et al., KinectFusion, ISMAR 2011, section 3.5). The increment is a
// left twist xi = (v, w) about the model's centroid in frame F:
//     q = X_FC p,  r = n_m . (q - v_m),  dr/dxi = [n_m, (q - c) x n_m].
// fp32 sums inside a row, fp64 sums over rows in fixed order, fp64 solve: same bytes on every
// machine.
//
// Along a direction that the scene does not constrain, the pose keeps the value of the motion prior
// (solution remapping, Zhang, Kaess, Singh, ICRA 2016). The eigenvalues of the scaled 6x6 cross
// moment of live and model normals decide which directions those are. The noise of both is
// independent, so a noisy flat wall does not look like structure (degeneracy.hpp).
//
// Claimed (docs/fusion.md): every direction constrained by the scene, or by an odometry prior whose
// stated error since the last full constraint is below claim_translation_m and claim_rotation_deg,
// and the frame is not lost. Only claimed frames may be integrated.
#pragma once

#include <array>
#include <cstdint>

#include "config/schema.hpp"
#include "perception/icp/degeneracy.hpp"
#include "perception/icp/model_view.hpp"
#include "perception/icp/preprocess.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct TrackerConfig {
  PreprocessConfig preprocess;
  std::array<int, 3> iterations{4, 5, 15};  // fine to coarse; the upper bound of a dynamic knob
  std::array<double, 3> gate_distance_m{0.05, 0.08, 0.20};  // fine to coarse
  double gate_normal_deg = 30;
  // chosen on: recording, room; judged on: turn, moving 31 first 12 (docs/fusion.md, weighting)
  // icp::NoiseRule: the noise of a structured-light camera (Nguyen, Izadi, Lovell, 3DIMPVT 2012) up
  // to 2 m; beyond, 1.5 times as much, for the fixed pattern in images of an uncalibrated camera.
  double noise_m = 0.0015;
  double noise_per_m2 = 0.004;
  double noise_from_m = 0.8;
  double stop_translation_m = 1e-4;  // a level ends when the next step is below both
  double stop_rotation_deg = 5e-3;
  DegeneracyConfig degeneracy;
  // chosen on: not recorded; judged on: not recorded
  // Share of the points that meet a model surface and are on it within their noise
  // (NormalEquations::on_surface). Normals are not compared: how well they agree depends on voxel
  // size and level, not on the pose (docs/fusion.md, Levels).
  double weak_inlier_share = 0.85;
  // chosen on: recording, room, stairs; judged on: turn (docs/fusion.md, Levels)
  double lost_inlier_share = 0.75;
  double map_error_m = 0.01;  // of the model's surface: half a voxel; derived, no key
  // chosen on: not recorded; judged on: not recorded
  double lost_overlap = 0.10;      // share of live points that meet a model surface
  double weak_residual_m = 0.020;  // RMS, point to plane, of the inliers
  double lost_residual_m = 0.040;
  int lost_inliers = 400;  // at level 1 of 512 x 424 pixels; of fewer their share (least_points())
  double jump_translation_m = 0.30;  // farther from the prior in one frame: lost
  double jump_rotation_deg = 20;
  double claim_translation_m = 0.010;
  double claim_rotation_deg = 0.5;
  // chosen on: not recorded; judged on: kidnaps 46 to 50 (docs/fusion.md, Look-alikes)
  // A lost camera counts as found only if the image fits better than a tracked camera needs.
  double reacquire_distance_m = 0.04;  // pairs counted, at half resolution
  double reacquire_inlier_share = 0.60;
  double reacquire_overlap = 0.40;
  double reacquire_residual_m = 0.015;
  double reacquire_contradiction_m = 0.06;  // times depth beyond 1 m
  double reacquire_contradiction = 0.022;
  double reacquire_condition = 600;
  double reacquire_translation_m = 0.6;  // farther from the guess: not this place
  double reacquire_rotation_deg = 30;
  void describe(config::Section& s);
};

// Where the camera is believed to be before the image is looked at.
struct MotionPrior {
  enum class Source : std::uint8_t { kConstantVelocity, kOdometry };
  Pose X_WC = Pose::Identity();
  Source source = Source::kConstantVelocity;
  // One-sigma error accumulated since the last frame that the scene constrained fully.
  double sigma_translation_m = 1.0;
  double sigma_rotation_deg = 180.0;
  // kOdometry only: the camera's pose by odometry alone, over more than the last frame. It differs
  // from X_WC by what tracking added since then, beyond the stated error.
  Pose X_WC_odometry = Pose::Identity();
};

// Is this prior good enough to claim on?
[[nodiscard]] bool is_trusted(const TrackerConfig& config, const MotionPrior& prior) noexcept;

enum class TrackingState : std::uint8_t { kLost = 0, kWeak = 1, kTracking = 2 };

struct TrackingResult {
  Pose X_WC = Pose::Identity();  // lost: the prior
  TrackingState state = TrackingState::kLost;
  bool claimed = false;
  bool fully_constrained = false;  // by the scene alone
  double residual_m = 0;           // RMS of the inliers, point to plane
  double inlier_share = 0;         // inliers / live points that meet a model surface
  double on_surface = 0;  // points on the model's surface within noise / live points that meet one
  double overlap = 0;     // live points that meet a model surface / live points
  int inliers = 0;        // at level 1
  double contradiction = 0;  // reacquire() only: share of points off every surface about them
  double clash = 0;          // reacquire() only: share of points in front (contradiction.hpp)
  double condition = 0;      // largest / smallest eigenvalue of the scaled 6x6; inf = singular
  int degenerate_count = 0;
  // First degenerate_count columns: unit twists (v, w L) in W about the centroid, with w scaled by
  // `length_m` (weighted mean depth).
  Eigen::Matrix<double, 6, 6> degenerate_W = Eigen::Matrix<double, 6, 6>::Zero();
  double length_m = 0;
  std::array<int, 3> iterations{};  // done, fine to coarse
  std::uint64_t work = 0;           // associations tried
};

class Tracker {
 public:
  Tracker(rt::NonRealtime&, const TrackerConfig& config, int max_width, int max_height);

  // Filter, pyramid, normals. `pixel_step` 1, 2, 4.
  void prepare(ImageView<const std::uint16_t> depth_mm, const Intrinsics& intrinsics,
               int pixel_step) noexcept;
  // Threads that take part in prepare(), track() and reacquire(); the bytes are the same.
  void use(rt::ForkJoin& crew) noexcept { crew_ = &crew; }
  // Takes what moves out of the prepared frame: TrackingPyramid::drop().
  void drop(ImageView<const std::uint8_t> mask, int level) noexcept { pyramid_.drop(mask, level); }
  // Aligns the prepared frame, from X_WC_start. `iterations` fine to coarse, each limited to the
  // configured value.
  void track(const ModelView& model, const MotionPrior& prior, const Pose& X_WC_start,
             const std::array<int, 3>& iterations, TrackingResult& out) noexcept;
  void track(const ModelView& model, const MotionPrior& prior, const std::array<int, 3>& iterations,
             TrackingResult& out) noexcept {
    track(model, prior, prior.X_WC, iterations, out);
  }
  // Does the prepared frame show `model`, seen from near X_WC_guess? For a lost camera. `model`
  // must be cast without hint, so that surface which should be visible and is not counts against
  // the fit. Middle and coarse levels. Claims nothing; reliable() judges the result.
  void reacquire(const ModelView& model, const Pose& X_WC_guess,
                 TrackingResult& out) const noexcept;
  // Did reacquire() pass its gates? The fit must be close, and every direction constrained by the
  // scene or, if the guess came from a trusted prior, by that prior.
  [[nodiscard]] bool reliable(const TrackingResult& r, bool trusted_prior = false) const noexcept;
  // With fewer inliers at level 1 of the prepared frame the camera is lost; with fewer readings the
  // image is blank. lost_inliers scaled by the level's share of 256 x 212 pixels, at least 60: ten
  // for each degree of freedom.
  [[nodiscard]] int least_points() const noexcept;

  [[nodiscard]] const TrackingPyramid& pyramid() const noexcept { return pyramid_; }
  [[nodiscard]] const TrackerConfig& config() const noexcept { return config_; }

 private:
  [[nodiscard]] double mean_depth() const noexcept;
  TrackerConfig config_;
  TrackingPyramid pyramid_;
  rt::ForkJoin* crew_ = &rt::serial();
};

}  // namespace perception
