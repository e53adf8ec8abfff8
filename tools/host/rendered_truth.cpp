
#include "perception/geometry/pose.hpp"
#include "tools/host/run_truth.hpp"

namespace teletact {

TrackingFigures rendered_figures(const Scene& scene, const OperatorHalf& op,
                                 const RobotHalf& robot) {
  if (!scene.rgbd_dir.empty() || !scene.camera_choice.in_process() || robot.view.truth.empty())
    return {};
  const perception::Pose X_BC = scene.camera.true_X_BC();
  return tracking_figures(op.view.fusion,
                          [&](rt::Time exposure) -> std::optional<perception::Pose> {
                            const auto X = true_base_at(robot, exposure);
                            if (!X) return std::nullopt;
                            perception::Pose X_WB = perception::Pose::Identity();
                            X_WB.linear() = perception::rotation_about_z(X->yaw);
                            X_WB.translation() = perception::Vec3(X->x, X->y, 0);
                            return X_WB * X_BC;
                          });
}

}  // namespace teletact
