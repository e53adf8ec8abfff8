#include "tools/record/scenes.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kTurn = 2 * std::numbers::pi;

// 54 deg/s about the vertical: once round in 200 frames, the eye on a small circle as an arm would.
Pose turning_pose(double t) {
  const double yaw = 54.0 / 360.0 * kTurn * t;
  return looking(Vec3(1.4 + 0.15 * std::cos(yaw), 0.15 * std::sin(yaw), 1.2), yaw,
                 0.30 + 0.05 * std::sin(kTurn * t / 3.0));
}

// Up beside the stairs, looking at them: 0.3 m/s.
Pose climbing_pose(double t) {
  return looking(Vec3(-0.6 + 0.26 * t, 0.10 * std::sin(kTurn * t / 5.0), 1.30 + 0.16 * t),
                 0.12 * std::sin(kTurn * t / 6.0), 0.42 + 0.06 * std::sin(kTurn * t / 4.0));
}

// Round a point of the table's top at 0.35 to 0.9 m from it.
Pose table_pose(double t) {
  const Vec3 point(3.15, 0.85, 0.75);
  const double distance = 0.65 - 0.25 * std::cos(kTurn * t / 8.0);
  const double yaw = 0.35 * std::sin(kTurn * t / 9.0),
               pitch = 0.75 + 0.1 * std::sin(kTurn * t / 5.0);
  const Vec3 forward(std::cos(yaw) * std::cos(pitch), std::sin(yaw) * std::cos(pitch),
                     -std::sin(pitch));
  return looking(point - distance * forward, yaw, pitch, 0.05 * std::sin(kTurn * t / 7.0));
}

SyntheticRoom stairs() {
  SyntheticRoom s;
  s.name = "stairs";
  s.path = climbing_pose;
  s.noise = furnished_room().noise;
  s.world.room.x_m = {-1.5, 4.0};
  s.world.room.y_m = {-1.1, 1.3};
  s.world.room.height_m = 3.4;
  for (int k = 0; k < 8; ++k) {
    auto& b = s.world.boxes.emplace_back();
    b.name = "step_" + std::to_string(k + 1);
    const double top = 0.17 * (k + 1), front = 0.8 + 0.28 * k;
    // Each step reaches under those above it, as a flight cast in one piece does.
    b.size_m = {4.0 - front, 1.8, top};
    b.position_m = {(4.0 + front) / 2, -0.2, top / 2};
    b.paint.colour = {150.0 + 8 * (k % 2), 140, 125};
  }
  auto& rail = s.world.cylinders.emplace_back();
  rail.name = "post", rail.position_m = {0.9, 0.9, 0.0}, rail.radius_m = 0.05, rail.height_m = 1.1;
  return s;
}

// What the other scenes never see: the half of the room behind the camera.
void furnish_behind(drivers::WorldConfig& w) {
  const auto box = [&](const char* name, std::array<double, 3> size, std::array<double, 3> at,
                       double yaw_deg) {
    auto& b = w.boxes.emplace_back();
    b.name = name, b.size_m = size, b.position_m = at, b.yaw_deg = yaw_deg;
  };
  box("shelf", {0.30, 0.80, 1.60}, {-0.80, 1.30, 0.80}, 0);
  box("chest", {0.50, 0.90, 0.70}, {-0.65, -0.60, 0.35}, 10);
  box("case", {0.50, 0.35, 0.60}, {1.20, -1.70, 0.30}, -15);
  box("radiator", {1.00, 0.12, 0.60}, {0.60, 1.90, 0.45}, 0);
  auto& stool = w.cylinders.emplace_back();
  stool.name = "stool", stool.position_m = {0.20, 1.20, 0.0}, stool.radius_m = 0.18;
  stool.height_m = 0.45;
  auto& lamp = w.cylinders.emplace_back();
  lamp.name = "lamp", lamp.position_m = {0.20, -1.60, 0.0}, lamp.radius_m = 0.06;
  lamp.height_m = 1.5;
}

}  // namespace

const std::vector<std::string>& scene_names() {
  static const std::vector<std::string> names{"room", "stairs", "turn", "sixth", "near"};
  return names;
}

SyntheticRoom scene_named(const std::string& name) {
  if (name == "stairs") return stairs();
  SyntheticRoom room = furnished_room();
  room.name = name;
  if (name == "room") return room;
  if (name == "turn") {
    room.path = turning_pose;
    furnish_behind(room.world);
  } else if (name == "sixth") {
    room.stride = 6;
  } else if (name == "near") {
    room.path = table_pose;
    room.range_min_m = 0.35;
  } else {
    throw std::runtime_error("scene " + name + ": must be one of room, stairs, turn, sixth, near");
  }
  return room;
}

}  // namespace teletact
