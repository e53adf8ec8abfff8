// A sample made by hand: a box slides sideways before a wall, the camera at rest.
#pragma once

#include "tools/measure/accuracy/moving_ghosts.hpp"
#include "tools/measure/accuracy/moving_study.hpp"

namespace moving_test {

inline rt::Startup startup;

// The box, 0.3 x 0.4 x 0.4 m, from y = 0.2 by -10 mm a frame in frames 10 .. 39, its face 1.05 m
// from the camera at 1 m above the floor; then it rests.
inline teletact::MovingSample sliding_box(int frames = 90) {
  teletact::MovingSample s;
  s.frames = frames, s.first_moving = 10, s.last_moving = 39;
  s.from_rest = true, s.kind = teletact::MoverKind::kBox;
  s.end = teletact::MoverEnd::kComesToRest;
  s.half_images = true;
  auto& w = s.plain;
  w.room.x_m = {-1, 3}, w.room.y_m = {-2, 2}, w.room.height_m = 2.5;
  auto& shelf = w.boxes.emplace_back();
  shelf.name = "shelf", shelf.size_m = {0.4, 0.8, 1.2}, shelf.position_m = {2.8, 0.9, 0.6};
  s.world = w;
  auto& box = s.world.boxes.emplace_back();
  box.name = "box", box.size_m = {0.3, 0.4, 0.4}, box.position_m = {1.2, 0.2, 1.0};
  auto& m = s.world.movers.emplace_back();
  m.name = "mover", m.shapes = "box", m.kind = "waypoints";
  m.waypoints.push_back({9 * teletact::MovingSample::kFrame_s, {0, 0, 0}, 0});
  m.waypoints.push_back({39 * teletact::MovingSample::kFrame_s, {0, -0.3, 0}, 0});
  s.movers = {"box"};
  s.way.eye_W = {0, 0, 1};
  return s;
}

}  // namespace moving_test
