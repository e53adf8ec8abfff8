// The worlds of the scene files: what their heads say of them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <utility>
#include <vector>

#include "config/schema.hpp"
#include "drivers/world/world.hpp"
#include "tests/support/world_scene.hpp"
#include "tests/unit/drivers_world/random_world.hpp"

namespace tests {
namespace {

using drivers::Shape;

World load(const std::string& scene) { return test_support::load_world(startup.token(), scene); }

// Point of the first press of the scene's hand: where the mark on the floor will be.
Vec3 first_press(const std::string& scene) {
  std::ifstream file(test_support::scene_path(scene));
  Vec3 p = Vec3::Constant(std::nan(""));
  for (std::string line; std::getline(file, line);) {
    if (line != "kind = \"press\"") continue;
    std::getline(file, line);
    EXPECT_EQ(std::sscanf(line.c_str(), "point_m = [%lf, %lf, %lf]", &p[0], &p[1], &p[2]), 3);
    break;
  }
  return p;
}

bool free_any_heading(const World& w, double x, double y) {
  for (double yaw = -3.2; yaw < 3.2; yaw += 0.1) {
    if (w.robot_collision(x, y, yaw) >= 0) return false;
  }
  return true;
}

// Flood fill on a 5 cm grid of places that are free at any heading.
bool way_exists(const World& w, double x1, double y1) {
  constexpr int kN = 61;  // -1 ... 2 m in x and y
  const auto cell = [](double v) { return static_cast<int>(std::lround((v + 1) / 0.05)); };
  std::vector<char> seen(kN * kN, 0);
  std::vector<std::pair<int, int>> open{{cell(0), cell(0)}};
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    if (i < 0 || j < 0 || i >= kN || j >= kN || seen[static_cast<std::size_t>(i * kN + j)])
      continue;
    seen[static_cast<std::size_t>(i * kN + j)] = 1;
    if (!free_any_heading(w, i * 0.05 - 1, j * 0.05 - 1)) continue;
    if (i == cell(x1) && j == cell(y1)) return true;
    for (const auto& [di, dj] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      open.emplace_back(i + di, j + dj);
    }
  }
  return false;
}

TEST(Scenes, DefaultRoomIsWhatItsHeadSays) {
  const World w = load("default_room.toml");
  const Vec3 goal = first_press("default_room.toml");
  ASSERT_TRUE(goal.allFinite());
  EXPECT_EQ(goal.z(), 0);
  EXPECT_GT(goal.norm(), 1.5);
  EXPECT_TRUE(free_any_heading(w, 0, 0));
  EXPECT_TRUE(free_any_heading(w, goal.x(), goal.y()));
  // The straight way to it is not free, a way round is.
  bool blocked = false;
  for (double a = 0; a <= 1; a += 0.01) {
    blocked = blocked || w.robot_collision(a * goal.x(), a * goal.y(), 0) >= 0;
  }
  EXPECT_TRUE(blocked);
  EXPECT_TRUE(way_exists(w, goal.x(), goal.y()));
  // From the start the camera sees the floor of the goal, and the pedestal's top and one side.
  const Vec3 lens{-0.2, 0, 0.95};
  for (const double dx : {-0.05, 0.0, 0.05}) {
    for (const double dy : {-0.05, 0.0, 0.05}) {
      EXPECT_EQ(w.ray_cast(lens, goal + Vec3(dx, dy, 0) - lens).shape, w.find("floor"));
    }
  }
  const int pedestal = w.find("pedestal");
  ASSERT_GE(pedestal, 0);
  const Shape& shape = w.shapes()[static_cast<std::size_t>(pedestal)];
  const Vec3 top = shape.X_WS * Vec3(0, 0, shape.half.z());
  const Vec3 front = shape.X_WS * Vec3(-shape.half.x(), 0, 0.05);
  const auto on_top = w.ray_cast(lens, (top - lens).normalized());
  const auto on_front = w.ray_cast(lens, (front - lens).normalized());
  EXPECT_EQ(on_top.shape, pedestal);
  EXPECT_GT(on_top.normal_W.z(), 0.99);
  EXPECT_EQ(on_front.shape, pedestal);
  EXPECT_LT(std::abs(on_front.normal_W.z()), 1e-9);
  EXPECT_GT(on_front.t, 1.2);
  EXPECT_LT(on_front.t, 2.0);
}

TEST(Scenes, OtherScenesLoadAndStartFree) {
  for (const char* scene : {"corridor.toml", "empty_room.toml"}) {
    const World w = load(scene);
    EXPECT_EQ(w.robot_collision(0, 0, 0), -1);
    EXPECT_GE(w.find("floor"), 0);
  }
  EXPECT_EQ(load("empty_room.toml").shapes().size(), 6u);
}

TEST(Scenes, WrongKeysAreNamed) {
  WorldConfig c;
  config::Section root;
  c.describe(root.section("world"));
  const auto bad =
      config::load_text("[[world.box]]\nname = \"a\"\nsize_m = [0, 1, 1]\n", "s.toml", root);
  ASSERT_FALSE(bad.has_value());
  EXPECT_NE(bad.error().find("size_m"), std::string::npos);
  EXPECT_NE(bad.error().find("s.toml"), std::string::npos);
}

}  // namespace
}  // namespace tests
