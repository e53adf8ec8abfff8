// Where the device's small workspace lies in the scene, and how the operator moves it there.
//
//   p_WH = p_WD + R_WD (scale p_DH)        scale: scene metres per hand metre
//
//   clutch   while it is held the device moves and the hand in the scene stays; afterwards the hand
//            goes on from there, wherever the device is now
//   view     only while the clutch is held: D turns about z of W so that "away from the operator"
//            is where the view looks; the hand in the scene stays where it is
//   border   beyond a radius of the device's reach the workspace itself moves in the scene,
//            outwards, at a rate that grows with how far the hand is beyond it: position control
//            inside, rate control outside (bubble technique: Dominjon, Lecuyer, Burkhardt,
//            Andrade-Barroso, Richir 2005)
//
// Frames: W world, D haptic base (x away from the operator, y to the left, z up), H stylus tip, V
// view (optical: x right, y down, z ahead).  SI.  Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "perception/geometry/pose.hpp"

namespace tasks {

struct WorkspaceConfig {
  double scale = 1.0;
  perception::Vec3 p_WD = perception::Vec3::Zero();
  double yaw_rad = 0;            // of D about z of W
  double border_m = 0;           // radius at the device; 0: no border
  double border_rate_per_s = 2;  // hand metres a second per metre beyond it
};

// Yaw of D with which the operator looks along the view; none for a view straight up or down.
[[nodiscard]] inline std::optional<double> yaw_of_view(const perception::Mat3& R_WV) noexcept {
  const perception::Vec3 ahead = R_WV.col(2);
  if (!(std::hypot(ahead.x(), ahead.y()) > 0.1)) return std::nullopt;
  return std::atan2(ahead.y(), ahead.x());
}

class Workspace {
 public:
  Workspace() = default;
  explicit Workspace(const WorkspaceConfig& c) : config_(c), p_WD_(c.p_WD) { turn(c.yaw_rad); }

  [[nodiscard]] perception::Vec3 to_world(const perception::Vec3& p_DH) const noexcept {
    return p_WD_ + R_WD_ * (config_.scale * p_DH);
  }
  [[nodiscard]] perception::Vec3 to_device(const perception::Vec3& p_W) const noexcept {
    return R_WD_.transpose() * (p_W - p_WD_) / config_.scale;
  }
  [[nodiscard]] const perception::Mat3& R_WD() const noexcept { return R_WD_; }
  [[nodiscard]] const perception::Vec3& p_WD() const noexcept { return p_WD_; }
  [[nodiscard]] double scale() const noexcept { return config_.scale; }
  // The mapping changed in the last advance(): the scene's hand moved without the device's, or not
  // with it.
  [[nodiscard]] bool moved() const noexcept { return moved_; }
  // The hand is beyond the border.
  [[nodiscard]] bool beyond() const noexcept { return beyond_; }

  // One tick with the device at p_DH (finite): the hand in the scene.
  perception::Vec3 advance(const perception::Vec3& p_DH, bool clutch,
                           const std::optional<double>& view_yaw_rad, double dt) noexcept {
    moved_ = beyond_ = false;
    if (clutch) {
      if (!clutched_) held_W_ = to_world(last_D_known_ ? last_D_ : p_DH);
      if (view_yaw_rad && std::isfinite(*view_yaw_rad)) turn(*view_yaw_rad);
      p_WD_ = held_W_ - R_WD_ * (config_.scale * p_DH);
      moved_ = true;
    } else if (config_.border_m > 0) {
      const double reach = p_DH.norm(), over = reach - config_.border_m;
      if (over > 0) {
        p_WD_ += R_WD_ * ((config_.scale * config_.border_rate_per_s * over * dt / reach) * p_DH);
        moved_ = beyond_ = true;
      }
    }
    clutched_ = clutch;
    last_D_ = p_DH;
    last_D_known_ = true;
    return to_world(p_DH);
  }
  // The device's position is not to be connected with the last one (unplugged, not a number).
  void forget_hand() noexcept { last_D_known_ = clutched_ = false; }

 private:
  void turn(double yaw_rad) noexcept {
    R_WD_ = Eigen::AngleAxisd(yaw_rad, perception::Vec3::UnitZ()).toRotationMatrix();
  }

  WorkspaceConfig config_;
  perception::Vec3 p_WD_ = perception::Vec3::Zero();
  perception::Mat3 R_WD_ = perception::Mat3::Identity();
  perception::Vec3 held_W_ = perception::Vec3::Zero(), last_D_ = perception::Vec3::Zero();
  bool clutched_ = false, last_D_known_ = false, moved_ = false, beyond_ = false;
};

}  // namespace tasks
