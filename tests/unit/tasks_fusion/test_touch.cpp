// A hand presses on a fused surface while tracking corrects itself: the map stays where it is, and
// so does the force.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <iostream>
#include <numbers>

#include "tasks/haptic/haptic_task.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using perception::SurfacePatch;
using tests::kDt;

constexpr double kDegree = std::numbers::pi / 180;

// Fusion and touch, one after the other, as the graph joins them: a patch a period, the hand back
// to fusion.
class Pressed {
 public:
  Pressed() : task_(rig.startup.token(), config(), device(), 1e-3) {
    for (auto& s : slots_) s = std::make_unique<SurfacePatch>();
    in_.mode.seq = 1;
    in_.mode.mode = Mode::kHold;
    in_.stylus_ok = true;
    in_.stylus.state = drivers::DeviceState::kForce;
    const Vec3 from = tests::Rig::eye(0).translation(), to(1.7, 0.5, 0.2);  // the first box
    way_ = (to - from).normalized();
    surface_ = from + room.cast(from, to - from).t * (to - from);
  }
  // One period of fusion and its 33 or 34 ticks; what the ticks gave is added to `forces`.
  void period(bool dark, const Pose& X_OB) {
    OdometryPrior o;
    o.taken = rt::Time{rt::nanos_from_seconds(static_cast<double>(rig.period) * kDt - 0.02)};
    o.X_OB = X_OB;
    rig.in.odometry = o;
    rig.in.hand = out_.state;
    rig.see(dark ? tests::AnalyticScene{} : room, tests::Rig::eye(0), 0);
    newest_ = (newest_ + 1) % slots_.size();
    *slots_[newest_] = *rig.patch;
    const double until = static_cast<double>(rig.period) * kDt;
    for (; 1e-3 * static_cast<double>(k_) < until - 1e-9; ++k_) {
      const double t = 1e-3 * static_cast<double>(k_);
      rt::Tick tick;
      tick.k = k_;
      tick.release = tick.start = rt::Time{rt::nanos_from_seconds(t)};
      tick.period = rt::Nanos{1000000};
      in_.patch_newest = task_.wants_patch() ? slots_[newest_].get() : nullptr;
      in_.stylus.seq = k_ + 1;
      // 50 mm off until there is a map, then 12 mm into it and still.
      in_.stylus.p_DH = surface_ + std::min(0.012, 0.1 * t - 0.05) * way_;
      (void)task_.step(tick, in_, out_);
      forces.push_back(out_.force.f_H_D);
    }
  }
  tests::Rig rig;
  tests::AnalyticScene room = tests::test_room();
  std::vector<Vec3> forces;

 private:
  static HapticConfig config() {
    HapticConfig c;
    c.workspace_W_m = {0, 0, 0};
    return c;
  }
  static drivers::DeviceProperties device() { return {}; }

  HapticTask task_;
  HapticTask::In in_;
  HapticTask::Out out_;
  Vec3 way_, surface_;
  std::array<std::unique_ptr<SurfacePatch>, 8> slots_;  // the task keeps two
  std::size_t newest_ = 0;
  std::uint64_t k_ = 0;
};

// In the dark odometry carries the camera, wrongly, by 50 mm and 5 degrees, and then takes it back:
// the pose leaps between two publications, twice, and no tick knows of it.
TEST(Touch, ACorrectionOfTrackingChangesNoForce) {
  Pressed still, leaping;
  Pose leap = Pose::Identity();
  leap.linear() = Eigen::AngleAxisd(5 * kDegree, Vec3(1, 2, -1).normalized()).toRotationMatrix();
  leap.translation() = Vec3(0.03, -0.04, 0);
  double farthest_m = 0, farthest_deg = 0;
  for (int i = 0; i < 36; ++i) {
    const bool dark = i >= 24;
    still.period(dark, Pose::Identity());
    leaping.period(dark, i >= 28 && i < 32 ? leap : Pose::Identity());
    const Pose off = still.rig.task->camera().inverse() * leaping.rig.task->camera();
    farthest_m = std::max(farthest_m, off.translation().norm());
    farthest_deg = std::max(farthest_deg, perception::rotation_angle(off.linear()) / kDegree);
    if (dark) {
      EXPECT_FALSE(leaping.rig.out.integrated);
    }
  }
  EXPECT_GE(farthest_m, 0.0499);
  EXPECT_GE(farthest_deg, 4.99);
  const Pose back = still.rig.task->camera().inverse() * leaping.rig.task->camera();
  EXPECT_LT(back.translation().norm(), 1e-9) << "the correction was not taken";
  ASSERT_EQ(still.forces.size(), leaping.forces.size());
  for (std::size_t k = 0; k < still.forces.size(); ++k) {
    ASSERT_EQ(still.forces[k], leaping.forces[k]) << "tick " << k;
  }
  const double pressed = still.forces.back().norm();
  std::cout << "pose off by " << 1e3 * farthest_m << " mm, " << farthest_deg << " deg; force "
            << pressed << " N, the same to the last bit\n";
  EXPECT_GT(pressed, 3);
  EXPECT_LT(pressed, 12);
}

}  // namespace
}  // namespace tasks
