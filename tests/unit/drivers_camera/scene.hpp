// The default room, and a view into it, for the camera tests.
#pragma once

#include <string>

#include "drivers/camera/synthetic_camera.hpp"
#include "tests/support/world_scene.hpp"

namespace camera_test {

inline rt::Startup startup;

inline drivers::World load_world(const std::string& scene) {
  return test_support::load_world(startup.token(), scene);
}

inline perception::Pose base_pose(double x, double y, double yaw) {
  perception::Pose X = perception::Pose::Identity();
  X.linear() = Eigen::AngleAxisd(yaw, perception::Vec3::UnitZ()).toRotationMatrix();
  X.translation() = perception::Vec3(x, y, 0);
  return X;
}

}  // namespace camera_test
