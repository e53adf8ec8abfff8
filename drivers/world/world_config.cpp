#include "drivers/world/world_config.hpp"

namespace drivers {

namespace {

void describe_name(config::Section& s, std::string& name) {
  s.text("name", name, {}, "unique name of the shape");
}
}  // namespace

void PaintConfig::describe(config::Section& s) {
  s.numbers("colour", colour, 0, 255, "red, green, blue");
  s.text("texture", texture, {"plain", "checker", "noise"}, "pattern of the surface");
  s.number("cell_m", cell_m, 0.005, 10, "edge of a cell of the pattern");
  s.number("contrast", contrast, 0, 1, "how much darker than the colour the darkest cell is");
}

void RoomConfig::describe(config::Section& s) {
  s.numbers("x_m", x_m, -kFar_m, kFar_m, "inner faces of the walls; equal values: no room");
  s.numbers("y_m", y_m, -kFar_m, kFar_m, "inner faces of the walls; equal values: no room");
  s.number("height_m", height_m, 0, kFar_m, "of the ceiling above the floor z = 0; 0: no ceiling");
  floor.describe(s.section("floor", "paint of the floor"));
  walls.describe(s.section("walls", "paint of the walls and the ceiling"));
}

void PlaneConfig::describe(config::Section& s) {
  describe_name(s, name);
  s.numbers("point_m", point_m, -kFar_m, kFar_m, "a point of the surface");
  s.numbers("normal", normal, -1, 1, "direction out of the solid half-space");
  s.flag("ground", ground, "the robot drives on it: never a collision");
  paint.describe(s);
}

void BoxConfig::describe(config::Section& s) {
  describe_name(s, name);
  s.numbers("size_m", size_m, 0.001, kFar_m, "edges along the box's own x, y, z");
  s.numbers("position_m", position_m, -kFar_m, kFar_m, "centre of the box");
  s.number("yaw_deg", yaw_deg, -360, 360, "rotation about z");
  s.number("pitch_deg", pitch_deg, -360, 360, "then about the box's y");
  s.number("roll_deg", roll_deg, -360, 360, "then about the box's x");
  paint.describe(s);
}

void CylinderConfig::describe(config::Section& s) {
  describe_name(s, name);
  s.numbers("position_m", position_m, -kFar_m, kFar_m, "centre of the bottom disc; axis vertical");
  s.number("radius_m", radius_m, 0.001, kFar_m, "radius");
  s.number("height_m", height_m, 0.001, kFar_m, "height");
  paint.describe(s);
}

void SphereConfig::describe(config::Section& s) {
  describe_name(s, name);
  s.numbers("position_m", position_m, -kFar_m, kFar_m, "centre");
  s.number("radius_m", radius_m, 0.001, kFar_m, "radius");
  paint.describe(s);
}

void CapsuleShapeConfig::describe(config::Section& s) {
  describe_name(s, name);
  s.numbers("from_m", from_m, -kFar_m, kFar_m, "one end of the axis");
  s.numbers("to_m", to_m, -kFar_m, kFar_m, "the other end; the same: a ball");
  s.number("radius_m", radius_m, 0.001, kFar_m, "about the axis");
  paint.describe(s);
}

void WorldConfig::describe(config::Section& s) {
  room.describe(s.section("room", "floor z = 0, four walls, a ceiling; absent: none"));
  const auto lister = [&s](const char* key, auto& items, const char* doc) {
    s.list(
        key, [&items](config::Section& item) { items.emplace_back().describe(item); }, doc);
  };
  lister("plane", planes, "half-spaces");
  lister("box", boxes, "boxes, turned any way");
  lister("cylinder", cylinders, "vertical cylinders");
  lister("sphere", spheres, "spheres");
  lister("capsule", capsules, "rods with round ends, turned any way");
  lister("mover", movers, "motions of shapes");
}

}  // namespace drivers
