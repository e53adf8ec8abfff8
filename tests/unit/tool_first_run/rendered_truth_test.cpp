#include "tools/host/run_truth.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tools/host/run_options.hpp"

namespace {

// Fusion's poses of rendered images against the twin's: those that are claimed, aligned by the
// first.
TEST(RenderedTruth, RenderedImagesAreJudgedByTheTwin) {
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "empty_room"), {});
  teletact::OperatorHalf op;
  teletact::RobotHalf robot;
  const perception::Pose X_BC = scene->camera.X_BC();
  for (int i = 0; i <= 60; ++i) {
    const std::int64_t ns = 33'000'000LL * i;
    const double x = 0.01 * i, yaw = 0.002 * i;
    robot.view.truth.push_back({teletact::kRobotClock.from_host(ns), x, 0, yaw, x, 0});
    perception::Pose X_WB = perception::Pose::Identity();
    X_WB.linear() = Eigen::AngleAxisd(yaw, perception::Vec3::UnitZ()).toRotationMatrix();
    X_WB.translation().x() = x;
    perception::Pose X_WC = X_WB * X_BC;
    if (i > 0) X_WC.translation().y() += i % 2 == 0 ? 0.004 : -0.004;
    if (i == 31) X_WC.translation().y() += 5;  // not claimed
    tasks::FusionSample s;
    s.exposure = rt::time_from_ns(ns);
    s.consumed = s.tracked = true;
    s.claimed = i != 31;
    const Eigen::Quaternionf q(X_WC.linear().cast<float>());
    s.q_WC = {q.x(), q.y(), q.z(), q.w()};
    for (std::size_t k = 0; k < 3; ++k)
      s.p_WC[k] = static_cast<float>(X_WC.translation()(static_cast<Eigen::Index>(k)));
    op.view.fusion.push_back(s);
  }
  const auto f = teletact::rendered_figures(*scene, op, robot);
  EXPECT_EQ(f.frames, 61U);
  EXPECT_EQ(f.claimed, 60U);
  EXPECT_NEAR(f.ate_first_pose_mm, 4 * std::sqrt(59.0 / 60.0), 1e-2);
  teletact::RobotHalf nothing;
  EXPECT_LT(teletact::rendered_figures(*scene, op, nothing).ate_first_pose_mm, 0);
}

}  // namespace
