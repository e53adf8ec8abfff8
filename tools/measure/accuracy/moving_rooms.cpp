// The rooms of the moving samples. The camera is near x = 0 and looks along x.
#include <cmath>

#include "tools/measure/accuracy/moving_sample.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

namespace {

using drivers::WorldConfig;

void box(WorldConfig& w, const std::string& name, std::array<double, 3> size,
         std::array<double, 3> at, double yaw_deg, std::array<double, 3> colour) {
  auto& b = w.boxes.emplace_back();
  b.name = name, b.size_m = size, b.position_m = at, b.yaw_deg = yaw_deg;
  b.paint.colour = colour;
}

void cylinder(WorldConfig& w, const std::string& name, std::array<double, 3> foot, double radius_m,
              double height_m) {
  auto& c = w.cylinders.emplace_back();
  c.name = name, c.position_m = foot, c.radius_m = radius_m, c.height_m = height_m;
}

WorldConfig kitchen() {
  WorldConfig w;
  w.room.x_m = {-1.2, 3.5};
  w.room.y_m = {-1.8, 2.0};
  w.room.height_m = 2.6;
  box(w, "worktop", {0.6, 2.2, 0.9}, {3.2, 0.7, 0.45}, 0, {170, 165, 155});
  box(w, "wall_cupboard", {0.35, 1.6, 0.7}, {3.32, 0.9, 1.75}, 0, {200, 190, 170});
  box(w, "fridge", {0.65, 0.6, 1.75}, {3.15, -0.85, 0.875}, 0, {215, 215, 220});
  box(w, "kitchen_table", {0.8, 0.6, 0.74}, {2.5, -1.35, 0.37}, 8, {150, 100, 60});
  box(w, "microwave", {0.35, 0.5, 0.3}, {3.2, 1.3, 1.05}, -6, {60, 60, 65});
  cylinder(w, "pot", {3.1, 0.4, 0.9}, 0.11, 0.2);
  cylinder(w, "stool", {1.9, 1.65, 0.0}, 0.18, 0.5);
  return w;
}

WorldConfig workshop() {
  WorldConfig w;
  w.room.x_m = {-1.2, 4.3};
  w.room.y_m = {-2.2, 2.1};
  w.room.height_m = 2.9;
  box(w, "shelf_left", {0.4, 1.0, 1.9}, {4.0, 1.4, 0.95}, 0, {110, 120, 100});
  box(w, "shelf_middle", {0.4, 0.9, 1.1}, {4.0, 0.1, 0.55}, 0, {120, 110, 90});
  box(w, "machine", {0.7, 0.8, 1.3}, {3.6, -1.3, 0.65}, 20, {70, 110, 80});
  box(w, "panel", {0.08, 0.9, 1.2}, {3.0, 1.95, 0.62}, 70, {90, 90, 140});
  w.boxes.back().pitch_deg = 15;
  box(w, "toolbox", {0.3, 0.5, 0.3}, {3.95, 0.1, 1.25}, 15, {170, 50, 50});
  cylinder(w, "pillar", {3.3, 0.75, 0.0}, 0.14, 2.9);
  cylinder(w, "drum", {2.6, -1.8, 0.0}, 0.28, 0.85);
  auto& s = w.spheres.emplace_back();
  s.name = "float", s.position_m = {3.9, -0.4, 1.5}, s.radius_m = 0.2;
  return w;
}

// Things on the floor, on the far half's ground and at its walls.
void furnish(rt::Random& rng, WorldConfig& w) {
  const double x0 = w.room.x_m[0] + 2.2, x1 = w.room.x_m[1] - 0.2;
  const auto any_y = [&] { return rng.uniform(w.room.y_m[0] + 0.2, w.room.y_m[1] - 0.2); };
  const auto n = rng.integer(4, 8);
  for (std::int64_t i = 0; i < n; ++i) {
    const std::string name = "thing_" + std::to_string(i);
    const double x = rng.uniform(x0, x1), y = any_y();
    const auto colour = [&] {
      return std::array<double, 3>{rng.uniform(50, 220), rng.uniform(50, 220),
                                   rng.uniform(50, 220)};
    };
    switch (rng.integer(0, 3)) {
      case 0:
      case 1: {
        const double h = rng.uniform(0.15, 1.2);
        box(w, name, {rng.uniform(0.15, 0.6), rng.uniform(0.15, 0.6), h}, {x, y, h / 2},
            rng.uniform(-90, 90), colour());
        break;
      }
      case 2:
        cylinder(w, name, {x, y, 0.0}, rng.uniform(0.06, 0.25), rng.uniform(0.2, 1.4));
        break;
      default: {  // hung up at the far wall
        const double d = rng.uniform(0.1, 0.35);
        box(w, name, {d, rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.6)},
            {w.room.x_m[1] - d / 2, y, rng.uniform(1.1, 1.9)}, 0, colour());
      }
    }
  }
}

}  // namespace

WorldConfig draw_room(rt::Random& rng, std::string& name) {
  WorldConfig w;
  switch (rng.integer(0, 2)) {
    case 0:
      name = "living", w = furnished_room().world;
      break;
    case 1:
      name = "kitchen", w = kitchen();
      break;
    default:
      name = "workshop", w = workshop();
  }
  furnish(rng, w);
  return w;
}

}  // namespace teletact
