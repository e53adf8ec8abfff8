// Where the odometry frame O lies in the world W, and how sure that is: the camera's claimed poses
// and the wheels, each weighted by what it may err.
//
// State     the base's pose X_WB at the instant of the newest claimed image, its covariance P, and
//           the odometry since.
// Odometry  add_odometry(): poses X_OB in order of time. From one to the next the base's error
//           grows by four unknown shares, the same ones from one claimed pose to the next (a slip
//           does not average out on the way):
//             along, across   `translation_share` of the way, each
//             turn            `rotation_share` of the turn, and `deg_per_m` of the way
//           so without a camera the stated error grows with the way, not with its root, and a heading that is wrong by
//           a leads aside by a times the way. J holds the error of the pose by each share.
// Camera    add_camera(): the base's pose at an exposure, in order of exposures, however late each
//           arrives: what was driven since stays on top. Before it is used P takes up J S J^T, and
//           the shares start anew. Kalman's update with the camera's stated error; a pose farther
//           off than the covariance lets expect (chi-square, three degrees of freedom, 0.999) is
//           refused. Poses that are refused and agree with each other by what odometry may err in
//           between are believed after `agree` of them in a row (the base was carried, a wheel
//           spun): the filter starts again from there.
// Stated    error_m(): three standard deviations of the place along the worst direction, with the
//           camera's own error, which is that of the map and does not average out; and while poses
//           are being refused, how far off they are.
//
// Frames: W world, O odometry, B base. Covariances are of (x, y in W; yaw) of the base's pose. SI.
// Allocates nothing.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "config/schema.hpp"
#include "perception/geometry/planar.hpp"

namespace tasks {

// Section [prediction.world]: what odometry and the camera may err, one standard deviation.
struct WorldFilterConfig {
  // No keys: what [fusion] states of odometry (odometry_translation_share and so on).
  double odometry_translation_share = 0.02;  // of the way
  double odometry_rotation_share = 0.02;     // of the turn
  double odometry_deg_per_m = 0.5;
  // chosen on: not recorded; judged on: scene rounds, seeds of docs/prediction.md
  double camera_m = 0.005;
  double camera_deg = 0.3;
  int agree = 5;  // refused poses in a row that agree and are then believed

  void describe(config::Section& s) {
    s.number("camera_m", camera_m, 1e-4, 1, "error of a claimed pose");
    s.number("camera_deg", camera_deg, 0.01, 30, "error of a claimed pose");
    s.integer("agree", agree, 2, 1000, "refused poses in a row that agree and are then believed");
  }
};

class WorldFilter {
 public:
  using Matrix3 = Eigen::Matrix3d;
  enum class Taken : std::uint8_t {
    kUsed,
    kRefused,  // not finite, or farther off than expected
    kRestarted,
    kTooOld,  // not later than the newest one, or before what is remembered of odometry
    kTooNew,  // later than the newest odometry: give it again when there is more
  };

  // `start_known`: O is W at the start. Else nothing is known until the first claimed pose.
  WorldFilter(const WorldFilterConfig&, bool start_known) noexcept;

  // False and ignored: not finite or not later than the last one.
  bool add_odometry(double t, const perception::Pose2& X_OB) noexcept;
  Taken add_camera(double t, const perception::Pose2& X_WB) noexcept;
  // Odometry began anew (the robot's box was started again): O is another frame now, W is not.
  void restart_odometry() noexcept;

  [[nodiscard]] const perception::Pose2& X_WO() const noexcept { return X_WO_; }
  // Of the base's pose at the newest odometry, the camera's own error included.
  [[nodiscard]] Matrix3 covariance() const noexcept { return stated(at_newest_); }
  [[nodiscard]] double error_m() const noexcept { return error_of(at_newest_); }
  // The same after the base has driven a further (dx_W, dy_W) straight on.
  [[nodiscard]] double error_after_m(double dx_W, double dy_W) const noexcept;
  // Three standard deviations of the heading, rad.
  [[nodiscard]] double error_rad() const noexcept;
  // False: the start was not known and no pose was claimed since, or odometry began anew since.
  [[nodiscard]] bool known() const noexcept {
    return at_newest_.P(0, 0) < kUnknown_m * kUnknown_m / 4;
  }
  // The newest claimed pose that was used, s; below any odometry if none was.
  [[nodiscard]] double claimed_t() const noexcept { return claimed_t_; }
  [[nodiscard]] int refused_in_a_row() const noexcept { return refused_; }

 private:
  static constexpr double kUnknown_m = 1e3;  // of a place that is not known
  using Sensitivity = Eigen::Matrix<double, 3, 4>;
  struct Error {
    Matrix3 P = Matrix3::Zero();
    Sensitivity J = Sensitivity::Zero();
  };
  struct Sample {
    double t = 0;
    perception::Pose2 X_OB;
  };
  static constexpr int kSamples = 128;

  [[nodiscard]] const Sample& sample(int i) const noexcept {
    return samples_[static_cast<std::size_t>((head_ + i) % kSamples)];
  }
  static void carry(Error& e, double dx_W, double dy_W, double turn) noexcept;
  void carry(Error& e, const perception::Pose2& from_O,
             const perception::Pose2& to_O) const noexcept;
  [[nodiscard]] Matrix3 total(const Error& e) const noexcept;
  [[nodiscard]] Matrix3 stated(const Error& e) const noexcept;
  [[nodiscard]] double error_of(const Error& e) const noexcept;
  [[nodiscard]] perception::Pose2 odometry_at(double t, int& before) const noexcept;
  [[nodiscard]] Taken refuse(double t, const perception::Pose2& X_WB, const perception::Pose2& X_OB,
                             double off_m) noexcept;
  void set(double t, const perception::Pose2& X_WB, const perception::Pose2& X_OB) noexcept;
  void drop_until(double t, int before, const perception::Pose2& X_OB) noexcept;

  WorldFilterConfig config_;
  Eigen::Vector4d share2_;  // variances of the shares
  Matrix3 camera_;
  perception::Pose2 X_WO_;
  Error at_first_, at_newest_;  // at the oldest sample kept, at the newest
  std::array<Sample, kSamples> samples_{};
  int head_ = 0, size_ = 0;
  double claimed_t_ = -1e300, refused_t_ = -1e300, off_m_ = 0;
  int refused_ = 0;
  perception::Pose2 refused_X_WB_, refused_X_OB_;
};

}  // namespace tasks
