// The default room, and a view into it, for the camera tests.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "drivers/camera/synthetic_camera.hpp"

namespace camera_test {

inline rt::Startup startup;

inline drivers::World load_world(const std::string& scene) {
  drivers::WorldConfig config;
  config::Section root;
  config.describe(root.section("world"));
  const auto ok =
      config::load_file(std::string(TELETACT_SOURCE_DIR) + "/config/scenes/" + scene, root);
  EXPECT_TRUE(ok.has_value()) << (ok ? "" : ok.error());
  return drivers::World(startup.token(), config);
}

inline perception::Pose base_pose(double x, double y, double yaw) {
  perception::Pose X = perception::Pose::Identity();
  X.linear() = Eigen::AngleAxisd(yaw, perception::Vec3::UnitZ()).toRotationMatrix();
  X.translation() = perception::Vec3(x, y, 0);
  return X;
}

}  // namespace camera_test
