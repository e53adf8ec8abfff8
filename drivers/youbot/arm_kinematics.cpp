#include "drivers/youbot/arm_kinematics.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/youbot/arm_geometry.hpp"

namespace drivers {

namespace {

constexpr double kTurn = 2 * std::numbers::pi;
using namespace arm_geometry;
// Below it a direction in the plane is none.
constexpr double kNoDirection = 1e-12;
constexpr double kSame_rad = 1e-9;

// The turn of `angle` that lies within the limits, or the nearest to them.
double within(double angle, double low, double high) noexcept {
  const double middle = (low + high) / 2;
  return middle + std::remainder(angle - middle, kTurn);
}

struct Tool {  // in the plane of joints 2 to 4: where, and the tilt of its axis from upright
  double x = 0, z = 0, tilt = 0;
};

void add_solution(ArmSolutions& out, ArmAngles q, const ArmLimits& limits) noexcept {
  for (std::size_t j = 0; j < q.size(); ++j) {
    q[j] = within(q[j], limits.low[j], limits.high[j]);
    // A solution on a limit is one, whatever the last bit says.
    if (q[j] < limits.low[j] && q[j] > limits.low[j] - kSame_rad) q[j] = limits.low[j];
    if (q[j] > limits.high[j] && q[j] < limits.high[j] + kSame_rad) q[j] = limits.high[j];
  }
  if (!limits.holds(q)) return;
  for (int i = 0; i < out.count; ++i) {
    double most = 0;
    for (std::size_t j = 0; j < q.size(); ++j)
      most = std::max(most, std::abs(q[j] - out.q[static_cast<std::size_t>(i)][j]));
    if (most < kSame_rad) return;
  }
  out.q[static_cast<std::size_t>(out.count++)] = q;
}

// Both elbows.
void solve_plane(const Tool& t, double turn, double roll, const ArmLimits& limits,
                 ArmSolutions& out) noexcept {
  const double c = std::cos(t.tilt), s = std::sin(t.tilt);
  const double x = t.x - kShoulderX_m - (c * kToolX_m + s * kToolZ_m);
  const double z = t.z - kShoulderZ_m - (-s * kToolX_m + c * kToolZ_m);
  const double cosine =
      (x * x + z * z - kUpper_m * kUpper_m - kFore_m * kFore_m) / (2 * kUpper_m * kFore_m);
  if (!(std::abs(cosine) <= 1 + 1e-9)) return;
  const double bend = std::acos(std::clamp(cosine, -1.0, 1.0));
  for (const double elbow : {bend, -bend}) {
    const double shoulder = std::atan2(x, z) - std::atan2(kFore_m * std::sin(elbow),
                                                          kUpper_m + kFore_m * std::cos(elbow));
    add_solution(out,
                 {kAtZero[0] - turn, shoulder - kAtZero[1], elbow - kAtZero[2],
                  t.tilt - shoulder - elbow - kAtZero[3], kAtZero[4] - roll},
                 limits);
  }
}

}  // namespace

bool ArmLimits::holds(const ArmAngles& q) const noexcept {
  bool inside = true;
  for (std::size_t j = 0; j < q.size(); ++j)
    inside = inside && q[j] >= low[j] && q[j] <= high[j];  // NaN is not
  return inside;
}

perception::Pose arm_forward(const ArmAngles& q) noexcept {
  using perception::Vec3;
  const double turn = kAtZero[0] - q[0], roll = kAtZero[4] - q[4];
  const double upper = kAtZero[1] + q[1], fore = upper + kAtZero[2] + q[2];
  const double tilt = fore + kAtZero[3] + q[3];
  const double c = std::cos(tilt), s = std::sin(tilt);
  const double x = kShoulderX_m + kUpper_m * std::sin(upper) + kFore_m * std::sin(fore) +
                   c * kToolX_m + s * kToolZ_m;
  const double z = kShoulderZ_m + kUpper_m * std::cos(upper) + kFore_m * std::cos(fore) -
                   s * kToolX_m + c * kToolZ_m;
  perception::Pose X_AT = perception::Pose::Identity();
  X_AT.linear() = (Eigen::AngleAxisd(turn, Vec3::UnitZ()) * Eigen::AngleAxisd(tilt, Vec3::UnitY()) *
                   Eigen::AngleAxisd(roll, Vec3::UnitZ()))
                      .toRotationMatrix();
  X_AT.translation() = Vec3(kBaseX_m + x * std::cos(turn), x * std::sin(turn), kBaseZ_m + z);
  return X_AT;
}

ArmSolutions arm_inverse(const perception::Pose& X_AT, const ArmLimits& limits, double tolerance,
                         double q1_free) noexcept {
  ArmSolutions out;
  const auto R = X_AT.linear();
  const double px = X_AT.translation().x() - kBaseX_m, py = X_AT.translation().y();
  double turn = kAtZero[0] - q1_free;
  if (std::hypot(px, py) > kNoDirection) {
    turn = std::atan2(py, px);
  } else if (std::hypot(R(0, 2), R(1, 2)) > kNoDirection) {
    turn = std::atan2(R(1, 2), R(0, 2));
  }
  for (const double way : {turn, turn + std::numbers::pi}) {
    const double c = std::cos(way), s = std::sin(way);
    // The tool's axis has to lie in the plane; NaN does not.
    if (!(std::abs(c * R(1, 2) - s * R(0, 2)) <= tolerance)) continue;
    const double tilt = std::atan2(c * R(0, 2) + s * R(1, 2), R(2, 2));
    // What is left of R without turn and tilt is the roll.
    const double roll = std::atan2(c * R(1, 0) - s * R(0, 0), c * R(1, 1) - s * R(0, 1));
    const Tool t{c * px + s * py, X_AT.translation().z() - kBaseZ_m, tilt};
    solve_plane(t, way, roll, limits, out);
  }
  return out;
}

}  // namespace drivers
