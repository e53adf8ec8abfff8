// Section [world] of a scene file: a room, and lists of the things in it.
//
//   [world.room]            absent or size 0 = no floor and no walls
//   x_m = [-1.0, 4.0]
//   [[world.box]]
//   name = "crate"
//   size_m = [0.4, 0.4, 0.3]
//   position_m = [1.2, 0.4, 0.15]     # centre of the box
//   yaw_deg = 20
//   [[world.mover]]         mover.hpp
//   name = "crate_slides"
//   shapes = "crate"
//   velocity_m_per_s = [0.5, 0, 0]
#pragma once

#include <array>
#include <deque>
#include <string>

#include "config/schema.hpp"
#include "drivers/world/mover.hpp"

namespace drivers {

struct PaintConfig {
  std::array<double, 3> colour{160, 160, 160};  // sRGB, 0..255
  std::string texture = "noise";                // plain, checker, noise
  double cell_m = 0.05;
  double contrast = 0.35;
  void describe(config::Section& s);
};

struct RoomConfig {
  std::array<double, 2> x_m{0, 0}, y_m{0, 0};  // inner faces of the walls; equal = no room
  double height_m = 0;                         // 0 = no ceiling
  PaintConfig floor{{150, 140, 125}, "checker", 0.25, 0.2};
  PaintConfig walls{{205, 205, 195}, "noise", 0.10, 0.15};
  [[nodiscard]] bool present() const { return x_m[1] > x_m[0] && y_m[1] > y_m[0]; }
  void describe(config::Section& s);
};

struct PlaneConfig {
  std::string name;
  std::array<double, 3> point_m{0, 0, 0}, normal{0, 0, 1};  // normal points out of the solid
  bool ground = false;                                      // true: driven on, never a collision
  PaintConfig paint;
  void describe(config::Section& s);
};

struct BoxConfig {
  std::string name;
  std::array<double, 3> size_m{0.1, 0.1, 0.1}, position_m{0, 0, 0};  // centre
  double yaw_deg = 0, pitch_deg = 0, roll_deg = 0;  // R = Rz(yaw) Ry(pitch) Rx(roll)
  PaintConfig paint;
  void describe(config::Section& s);
};

struct CylinderConfig {
  std::string name;
  std::array<double, 3> position_m{0, 0, 0};  // centre of the bottom disc; the axis is vertical
  double radius_m = 0.1, height_m = 0.1;
  PaintConfig paint;
  void describe(config::Section& s);
};

struct SphereConfig {
  std::string name;
  std::array<double, 3> position_m{0, 0, 0};  // centre
  double radius_m = 0.1;
  PaintConfig paint;
  void describe(config::Section& s);
};

struct CapsuleShapeConfig {
  std::string name;
  std::array<double, 3> from_m{0, 0, 0}, to_m{0, 0, 0.1};  // ends of the axis
  double radius_m = 0.1;
  PaintConfig paint;
  void describe(config::Section& s);
};

struct WorldConfig {
  RoomConfig room;
  std::deque<PlaneConfig> planes;
  std::deque<BoxConfig> boxes;
  std::deque<CylinderConfig> cylinders;
  std::deque<SphereConfig> spheres;
  std::deque<CapsuleShapeConfig> capsules;
  std::deque<MoverConfig> movers;
  void describe(config::Section& s);
};

}  // namespace drivers
