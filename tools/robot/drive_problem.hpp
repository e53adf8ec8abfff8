// The least-squares problem of identify_robot.hpp: factors, solution, covariance. That header
// defines its parts.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "perception/geometry/planar.hpp"
#include "tools/robot/identify_robot.hpp"

namespace teletact {

// A pose of the base on the floor z = 0, z up.
[[nodiscard]] perception::Pose pose_on_floor(const perception::Pose2& p);

struct DriveInstant {
  double t_s = 0;
  perception::Pose X_WC = perception::Pose::Identity();
};
struct DriveInterval {
  int from = 0, to = 0;                     // instants
  std::vector<drivers::WheelVector> steps;  // what the wheels turned, in order, rad
};
struct DriveFloor {
  bool seen = false;
  perception::Vec3 up_C = perception::Vec3::Zero();
  double height_m = 0, sigma_m = 1, sigma_rad = 1;
};

// Standard deviations, as found so far.
struct DriveNoise {
  double camera_m = 0, camera_rad = 0, slip = 0;
};

class DriveProblem {
 public:
  using Parameters = Eigen::Matrix<double, 12, 1>;
  using Matrix12 = Eigen::Matrix<double, 12, 12>;

  DriveProblem(const RobotModel& stated, std::vector<DriveInstant> instants,
               std::vector<DriveInterval> intervals, const DriveFloor& floor, DriveNoise noise);

  // All rounds: solution, noise, what is left out. False: it did not converge.
  [[nodiscard]] bool solve();

  [[nodiscard]] const Parameters& change() const { return state_.change; }
  // Covariance of the changes, from the data and a prior of ten limits. Directions without data
  // keep the prior.
  [[nodiscard]] const Matrix12& covariance() const { return covariance_; }
  [[nodiscard]] const DriveNoise& noise() const { return noise_; }
  [[nodiscard]] int left_out() const;
  [[nodiscard]] const std::vector<perception::Pose2>& bases() const { return state_.X_PB; }
  [[nodiscard]] const std::vector<DriveInterval>& intervals() const { return intervals_; }
  // What the wheels turned under these changes, as a way of the base.
  [[nodiscard]] perception::Pose2 driven(const DriveInterval& i, const Parameters& change) const;

 private:
  struct State {
    Parameters change = Parameters::Zero();
    perception::Pose X_WP = perception::Pose::Identity();
    std::vector<perception::Pose2> X_PB;  // the first one stays where it is
  };
  enum class Kind { kCamera, kWheels, kFloor };
  struct Factor {
    Kind kind = Kind::kCamera;
    int of = 0;  // instant or interval
    bool out = false;
    Eigen::VectorXd r;       // whitened
    Eigen::MatrixXd J;       // columns: `index`
    std::vector<int> index;  // of the unknowns
    double weight = 1;
  };

  [[nodiscard]] Eigen::Matrix<double, 6, 1> camera_off(int k, const Parameters& change,
                                                       const perception::Pose& X_WP,
                                                       const perception::Pose2& X_PB) const;
  [[nodiscard]] Eigen::Vector3d wheels_off(const DriveInterval& i, const perception::Pose2& d,
                                           const State& s) const;
  [[nodiscard]] Eigen::Vector3d floor_off(const Parameters& change) const;
  void whiten_wheels();
  void linearise(Factor& f) const;
  void linearise_camera(Factor& f) const;
  void linearise_wheels(Factor& f) const;
  [[nodiscard]] double cost(const State& s) const;
  [[nodiscard]] Eigen::VectorXd residual(const Factor& f, const State& s) const;
  void assemble(Eigen::MatrixXd& H, Eigen::VectorXd& g);
  [[nodiscard]] State moved(const State& s, const Eigen::VectorXd& dx) const;
  [[nodiscard]] bool minimise();
  bool leave_out();
  void find_noise();
  [[nodiscard]] int unknowns() const { return 18 + 3 * (static_cast<int>(instants_.size()) - 1); }

  RobotModel stated_;
  std::vector<DriveInstant> instants_;
  std::vector<DriveInterval> intervals_;
  DriveFloor floor_;
  DriveNoise noise_;
  State state_;
  std::vector<Factor> factors_;
  std::vector<Eigen::Matrix3d> whitening_;  // of the intervals
  Matrix12 covariance_ = Matrix12::Zero();
};

// The base with these changes: shares of the four radii, lever and slide.
[[nodiscard]] drivers::MecanumConfig changed_base(const drivers::MecanumConfig& stated,
                                                  const DriveProblem::Parameters& change);
[[nodiscard]] perception::Pose changed_mount(const perception::Pose& X_BC,
                                             const DriveProblem::Parameters& change);
// How the wheels' radii follow from mean, left-right, front-back, diagonal.
[[nodiscard]] Eigen::Matrix4d wheel_patterns();

}  // namespace teletact
