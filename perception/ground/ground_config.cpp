#include <numbers>

#include "perception/ground/ground_map.hpp"

namespace perception {

namespace {

constexpr double kRadPerDegree = std::numbers::pi / 180;

}  // namespace

void VirtualObstacleConfig::describe(config::Section& s) {
  s.text("shape", shape, {"disc", "box"}, "of the no-go area")
      .numbers("position_m", position_m, -1000, 1000, "of its centre in the world")
      .numbers("size_m", size_m, 0.01, 100, "edges of a box")
      .number("yaw_deg", yaw_deg, -360, 360, "of a box, about up")
      .number("radius_m", radius_m, 0.01, 100, "of a disc");
}

VirtualObstacle VirtualObstacleConfig::obstacle() const {
  VirtualObstacle o;
  o.kind = shape == "box" ? VirtualObstacle::Kind::kBox : VirtualObstacle::Kind::kDisc;
  o.centre_W = Vec3(position_m[0], position_m[1], position_m[2]);
  o.half_x_m = size_m[0] / 2;
  o.half_y_m = size_m[1] / 2;
  o.yaw_rad = yaw_deg * kRadPerDegree;
  o.radius_m = radius_m;
  return o;
}

void GroundConfig::describe(config::Section& s) {
  plane.describe(s.section("plane", "search for the ground plane"));
  moving.describe(s.section("moving", "what moves, as an obstacle"));
  s.integer("cells", cells, 16, CostMap::kMaxCells, "along an edge of the cost map")
      .number("resolution_m", resolution_m, 0.01, 1, "edge of a cell")
      .number("range_m", range_m, 0.5, 20, "points farther from the camera are not used")
      .number("ground_tolerance_m", ground_tolerance_m, 0.005, 0.5, "height that is still ground")
      .number("tolerance_per_m2", tolerance_per_m2, 0, 0.1, "and its growth with range squared")
      .number("robot_height_m", robot_height_m, 0.05, 5, "higher surfaces are overhead")
      .number("bridge_m", bridge_m, 0, 2, "longest gap between ground points that is ground")
      .number("obstacle_area", obstacle_area, 0.01, 10,
              "share of a cell's area seen as obstacle in one frame, to count")
      .integer("occupied_at", occupied_at, 1, 255, "evidence that makes a cell occupied")
      .integer("evidence_gain", evidence_gain, 1, 255, "a frame that shows an obstacle")
      .integer("evidence_loss", evidence_loss, 0, 255, "a frame that shows the floor")
      .integer("evidence_cap", evidence_cap, 1, 255, "so that changes are learned")
      .number("robot_radius_m", robot_radius_m, 0.01, 2, "radius of the body round its centre")
      .number("inflation_m", inflation_m, 0, 2, "rising cost beyond the radius")
      .number("start_radius_m", start_radius_m, 0, 3, "disc declared free at the start")
      .list(
          "virtual_obstacle",
          [this](config::Section& item) { virtual_obstacles.emplace_back().describe(item); },
          "no-go areas");
}

}  // namespace perception
