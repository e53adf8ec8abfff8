// Worlds of random solids, and places and directions in them.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "drivers/world/world.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace tests {

using drivers::World;
using drivers::WorldConfig;
using perception::Vec3;

inline rt::Startup startup;

inline World make(const WorldConfig& c) { return World(startup.token(), c); }

// A room with `n` solids of every kind, turned at random, some of them overlapping.
inline WorldConfig random_world(rt::Random& rng, int n) {
  WorldConfig c;
  c.room.x_m = {-2, 3};
  c.room.y_m = {-2.5, 2};
  c.room.height_m = 2.2;
  const auto place = [&rng](std::array<double, 3>& p) {
    p = {rng.uniform(-1.8, 2.8), rng.uniform(-2.3, 1.8), rng.uniform(0.0, 1.5)};
  };
  for (int i = 0; i < n; ++i) {
    auto& b = c.boxes.emplace_back();
    b.name = "box" + std::to_string(i);
    place(b.position_m);
    b.size_m = {rng.uniform(0.05, 0.8), rng.uniform(0.05, 0.8), rng.uniform(0.05, 0.8)};
    b.yaw_deg = rng.uniform(-180, 180);
    if (i % 2 == 0) b.pitch_deg = rng.uniform(-90, 90), b.roll_deg = rng.uniform(-90, 90);
    auto& y = c.cylinders.emplace_back();
    y.name = "cyl" + std::to_string(i);
    place(y.position_m);
    y.radius_m = rng.uniform(0.03, 0.4);
    y.height_m = rng.uniform(0.05, 1.0);
    auto& s = c.spheres.emplace_back();
    s.name = "sph" + std::to_string(i);
    place(s.position_m);
    s.radius_m = rng.uniform(0.03, 0.4);
    auto& r = c.capsules.emplace_back();
    r.name = "rod" + std::to_string(i);
    place(r.from_m);
    for (std::size_t a = 0; a < 3; ++a) r.to_m[a] = r.from_m[a] + rng.uniform(-0.6, 0.6);
    if (i % 4 == 3) r.to_m = r.from_m;  // a ball
    r.radius_m = rng.uniform(0.02, 0.2);
  }
  return c;
}

inline Vec3 random_direction(rt::Random& rng) {
  Vec3 d;
  do {
    d = {rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)};
  } while (d.norm() > 1 || d.norm() < 1e-3);
  return d.normalized();
}

inline Vec3 free_point(const World& w, rt::Random& rng, double clearance = 0.02) {
  for (;;) {
    const Vec3 p{rng.uniform(-2, 3), rng.uniform(-2.5, 2), rng.uniform(0, 2.2)};
    if (w.signed_distance(p) > clearance) return p;
  }
}

}  // namespace tests
