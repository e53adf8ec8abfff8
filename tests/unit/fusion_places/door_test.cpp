// A door that opens: what appears behind it is new, and does not move.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "perception/tsdf/blocks/map_reader.hpp"
#include "tests/support/whole.hpp"
#include "tests/unit/fusion_places/film.hpp"

namespace {

using fusion_places::Film;
using fusion_places::Pose;
using fusion_places::Vec3;

constexpr double kDoor_m = 1.8, kOpens_s = 1.5, kRound = 2 * std::numbers::pi;

Pose still_path(double) { return teletact::looking(Vec3(0, 0.1, 1.2), 0.03, 0.15); }
Pose carried_path(double t) {
  const Vec3 eye(0.05 + 0.10 * std::sin(kRound * t / 7.0), 0.12 * std::sin(kRound * t / 9.0),
                 1.20 + 0.05 * std::sin(kRound * t / 4.0));
  return teletact::looking(eye, 0.1 * std::sin(kRound * t / 11.0),
                           0.15 + 0.05 * std::sin(kRound * t / 6.0));
}

enum class Opens { kAway, kTowards, kSlides };

teletact::SyntheticRoom door_room(Opens how, double seconds, bool carried, double behind_m) {
  teletact::SyntheticRoom room;
  auto& w = room.world;
  w.room.x_m = {-1.5, 4.2};
  w.room.y_m = {-2.0, 2.0};
  w.room.height_m = 2.5;
  const auto box = [&](const char* name, std::array<double, 3> size, std::array<double, 3> at,
                       double yaw_deg = 0) {
    auto& b = w.boxes.emplace_back();
    b.name = name, b.size_m = size, b.position_m = at, b.yaw_deg = yaw_deg;
  };
  const double x = kDoor_m + 0.05;
  box("wall_left", {0.1, 1.55, 2.5}, {x, 1.225, 1.25});
  box("wall_right", {0.1, 1.55, 2.5}, {x, -1.225, 1.25});
  box("lintel", {0.1, 0.9, 0.5}, {x, 0, 2.25});
  box("door", {0.04, 0.88, 1.98}, {x, 0, 1.0});
  box("chest", {0.4, 0.5, 0.8}, {1.4, -0.95, 0.4}, 20);  // before the wall
  box("stand", {0.3, 0.3, 1.1}, {1.5, 0.9, 0.55}, -15);
  box("shelf", {0.4, 0.8, 1.6}, {3.6, -0.35, 0.8});  // behind it
  if (behind_m > 0) box("back", {0.04, 1.2, 2.1}, {x + 0.05 + behind_m, 0, 1.05});
  box("crate", {0.5, 0.4, 0.5}, {2.9, 0.35, 0.25}, 30);
  auto& m = w.movers.emplace_back();
  m.name = "opens", m.shapes = "door", m.start_s = kOpens_s;
  if (how == Opens::kSlides) {
    m.kind = "line", m.duration_s = seconds;
    m.velocity_m_per_s = {0, 0.9 / seconds, 0};
  } else {
    m.kind = "hinge", m.point_m = {x, 0.45, 0};
    m.angle_deg = how == Opens::kAway ? 95 : -95;
    m.rate_deg_per_s = 95 / seconds;
  }
  room.noise = {1.0, 0.3, 0.3, 0.1};
  room.path = carried ? carried_path : still_path;
  return room;
}

// Of what is seen beyond the door in the newest image, the share that the map has within a voxel
// and 10 mm.
double mapped(const Film& film, double voxel_m) {
  const auto& frame = film.frame();
  const Pose X_WC = film.truth();
  perception::MapReader reader(film.task().map(), 1.0);
  int seen = 0, has = 0;
  for (int v = 2; v < frame.intrinsics.height; v += 4)
    for (int u = 2; u < frame.intrinsics.width; u += 4) {
      const double z =
          1e-3 * frame.depth_mm[static_cast<std::size_t>(v * frame.intrinsics.width + u)];
      if (!(z > 0)) continue;
      const Vec3 p_W = X_WC * frame.intrinsics.unproject(u, v, z);
      if (p_W.x() < kDoor_m + 0.13 || std::abs(p_W.y()) > 1.9) continue;
      ++seen;
      const auto s = reader.sample(p_W);
      has += s.valid && std::abs(static_cast<double>(s.distance_m)) < voxel_m + 0.01 ? 1 : 0;
    }
  return seen > 0 ? static_cast<double>(has) / seen : 0;
}

// Away, towards the camera or aside; onto a room, or onto a wall close behind it.
TEST(FusionPlaces, WhatAppearsBehindADoorIsMapped) {
  constexpr double kVoxel_m = 0.02, kSeconds = 0.5;
  const char* const names[] = {"away", "towards", "aside"};
  struct Case {
    bool carried;
    Opens how;
    double behind_m;
  };
  std::vector<Case> cases;
  for (const bool carried : {false, true})
    for (const Opens how : {Opens::kAway, Opens::kTowards, Opens::kSlides})
      for (const double behind_m : {0.0, 0.15}) cases.push_back({carried, how, behind_m});
  for (const Case& c : tests::whole_or(cases, {1, 8, 10})) {
    Film film(door_room(c.how, kSeconds, c.carried, c.behind_m), kVoxel_m, 1);
    const int from = static_cast<int>((kOpens_s + kSeconds) * 30) + 1;
    while (film.told().frames <= from + 40) film.see();
    const double share = mapped(film, kVoxel_m);
    std::printf("%s, camera %s, wall %.2f m behind: %.3f mapped, %.3f claimed, worst %.1f mm\n",
                names[static_cast<int>(c.how)], c.carried ? "carried" : "stands", c.behind_m, share,
                film.told().share(), 1e3 * film.told().worst_m);
    EXPECT_GE(share, 0.5);
    EXPECT_GE(film.told().share(), 0.98);
    EXPECT_LE(film.told().worst_m, 0.02);
  }
}

}  // namespace
