// Identifies wheel radii and camera mount of a mecanum base from a drive: wheel angles and camera
// poses.
//
//   unknown   the base's planar poses X_PB at some instants, the floor in the camera's world X_WP,
//             the mount X_BC, and six of the wheels: mean radius, left against right, front against
//             back, the diagonals, lever, slide
//   camera    X_WC(t_k) = X_WP X_PB,k X_BC at every instant: the hand-eye problem AX = XB in
//             absolute poses instead of increments, so that the error of a pose enters once and not
//             twice
//   wheels    inverse(X_PB,k-1) X_PB,k = motion by the wheel angles in between, with their scales,
//             as exact arcs. Slip: each wheel loses its own share, which differs from interval to
//             interval. It acts like a radius of that interval alone, so the interval's covariance
//             is J diag(slip^2) J^T, J its derivative by the four radii
//   floor     the plane that the depth images show; only it determines the camera's height
//   estimate  least squares (Levenberg-Marquardt) with Huber's weights; factors beyond 6 sigma are
//             left out. The camera's two errors and the spread of the slip come from variance
//             components (Helmert), so none of them must be known before. The covariance of all
//             unknowns is stated
//
// A parameter whose standard deviation stays above its limit is not constrained by this drive: it
// is named and keeps its stated value. The fit absorbs what the drive says about combinations of
// such parameters, but does not report it. The mean slip is part of the estimated radius: odometry
// can not and need not separate them.
//
// Frames: W the camera poses' world, P the floor (z up, B's place at the first instant), B base, C
// camera. SI.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "drivers/youbot/mecanum.hpp"
#include "perception/geometry/pose.hpp"
#include "rt/result.hpp"

namespace teletact {

struct WheelAngles {
  double t_s = 0;
  drivers::WheelVector rad{};  // unwrapped, signs and order as in drivers/youbot/mecanum.hpp
};
struct CameraSeen {
  double t_s = 0;
  perception::Pose X_WC = perception::Pose::Identity();  // claimed ones only
};
struct FloorSeen {
  perception::Vec3 up_C = perception::Vec3::Zero();  // unit, normal of the floor
  double height_m = 0;                               // of the lens above it
};

struct RobotDrive {
  std::vector<WheelAngles> wheels;  // t_s rises
  std::vector<CameraSeen> cameras;  // t_s rises, the clock of the wheels
  std::vector<FloorSeen> floor;     // empty: the height keeps its stated value
};

struct RobotModel {
  drivers::MecanumConfig base;
  perception::Pose X_BC = perception::Pose::Identity();
};

enum class RobotParameter : std::uint8_t {
  kRadius,     // mean of the four
  kLeftRight,  // left wheels larger, right ones smaller
  kFrontBack,
  kDiagonal,  // front left and back right larger
  kLever,
  kSlide,
  kX,
  kY,
  kZ,
  kRoll,  // about B's x, y, z
  kPitch,
  kYaw
};
inline constexpr std::size_t kRobotParameters = 12;
[[nodiscard]] const char* name_of(RobotParameter p);

struct ParameterFit {
  double change = 0;  // from what was stated: share, m, rad
  double sigma = 0;   // one standard deviation
  bool constrained = false;
};

struct RobotFitOptions {
  // Distance of two instants, s. Longer than a slip lasts (0.5 s), so that slips of intervals are
  // nearly independent.
  double interval_s = 1.0;
  double gap_s = 5.0;           // a longer hole between two poses is not bridged by the wheels
  double wheel_gap_s = 0.2;     // no wheel angle is interpolated across more
  double shortest_s = 20;       // of a drive
  double least_way_m = 1.0;     // ... that neither drives so far
  double least_turn_rad = 1.0;  // nor turns so much
  // To begin with; what the data say replaces them.
  double camera_m = 0.005, camera_deg = 0.3, slip = 0.02;
};

struct RobotFit {
  RobotModel found;
  std::array<ParameterFit, kRobotParameters> parameters;
  std::array<double, drivers::kWheels> wheel_sigma{};
  std::array<bool, drivers::kWheels> wheel_constrained{};
  double seconds = 0, way_m = 0, turn_rad = 0;  // of the part that was used; turns count both ways
  int instants = 0, intervals = 0, left_out = 0, floor_frames = 0;
  double camera_m = 0, camera_rad = 0, slip = 0;  // one standard deviation, as found
  int rank = 0;                                   // directions that are constrained, of 12
  double condition = 0;  // largest over least standard deviation, in units of the limits
  // Error of odometry alone against the fitted poses, over ways of 2 m: mean distance per metre,
  // mean turn per metre.
  double before_m_per_m = 0, after_m_per_m = 0, before_rad_per_m = 0, after_rad_per_m = 0;

  [[nodiscard]] const ParameterFit& of(RobotParameter p) const {
    return parameters[static_cast<std::size_t>(p)];
  }
};

// Limit of the standard deviation above which a parameter counts as not constrained: 1 %, 20 mm, 1
// degree.
[[nodiscard]] double limit_of(RobotParameter p);
// "a, b and c" of those that are not constrained; the height only if `with_height`. Empty: none.
[[nodiscard]] std::string unconstrained(const RobotFit& fit, bool with_height);

// An error is one line: drive too short, hardly any motion, no camera pose within the wheels' log,
// a fit that does not converge, or one whose slip is not credible (another clock, order or sign of
// the wheels).
[[nodiscard]] rt::Result<RobotFit> fit_robot(const RobotDrive& drive, const RobotModel& stated,
                                             const RobotFitOptions& options = {});

// X_BC's angles as the keys camera.mount_* have them, degrees: yaw, pitch, roll.
[[nodiscard]] std::array<double, 3> mount_angles_deg(const perception::Mat3& R_BC);

}  // namespace teletact
