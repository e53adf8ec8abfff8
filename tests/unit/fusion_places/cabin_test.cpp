// A lift cabin of 1.1 x 1.4 m: all that is seen lies within 0.4 to 1.2 m.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "tests/support/whole.hpp"
#include "tests/unit/fusion_places/film.hpp"

namespace {

using fusion_places::Film;
using fusion_places::Pose;
using fusion_places::Told;
using fusion_places::Vec3;

constexpr double kTurn = 2 * std::numbers::pi;
// By hand, looking down at the floor and a corner; pitch and yaw about these.
Pose carried(double t, double yaw, double pitch) {
  const Vec3 eye(-0.1 + 0.10 * std::sin(kTurn * t / 5.0), 0.08 * std::sin(kTurn * t / 7.0),
                 1.00 + 0.06 * std::sin(kTurn * t / 4.0));
  return teletact::looking(eye, yaw + 0.35 * std::sin(kTurn * t / 9.0),
                           pitch + 0.08 * std::sin(kTurn * t / 6.0),
                           0.05 * std::sin(kTurn * t / 5.0));
}
Pose down_path(double t) { return carried(t, 0.4, 0.6); }
Pose turning_path(double t) { return carried(t, 0.26 * t, 0.6); }
// Walls alone: nothing tells how high the camera is, but what hangs on them.
Pose level_path(double t) { return carried(t, 0.4, 0.25); }

teletact::SyntheticRoom cabin(Pose (*path)(double), bool furnished) {
  teletact::SyntheticRoom room;
  auto& w = room.world;
  w.room.x_m = {-0.7, 0.7};
  w.room.y_m = {-0.55, 0.55};
  w.room.height_m = 2.2;
  if (furnished) {
    auto& panel = w.boxes.emplace_back();
    panel.name = "panel", panel.size_m = {0.22, 0.04, 1.0}, panel.position_m = {0.4, 0.53, 1.1};
    auto& rail = w.capsules.emplace_back();
    rail.name = "rail", rail.from_m = {0.63, -0.45, 0.9}, rail.to_m = {0.63, 0.45, 0.9};
    rail.radius_m = 0.02;
  }
  room.noise = {1.0, 0.3, 0.3, 0.1};
  room.path = path;
  return room;
}

constexpr double kSilentlyWrong_m = 0.05;

Told told(const char* what, const teletact::SyntheticRoom& room, double voxel_m,
          std::uint64_t seed) {
  Film film(room, voxel_m, seed);
  for (int i = 0; i < 120; ++i) film.see();
  const Told& t = film.told();
  std::printf("%s, %.0f mm, seed %d: %.3f claimed, worst %.1f mm\n", what, 1e3 * voxel_m,
              static_cast<int>(seed), t.share(), 1e3 * t.worst_m);
  EXPECT_LE(t.worst_m, kSilentlyWrong_m);
  return t;
}

TEST(FusionPlaces, ALiftCabinIsClaimedWhereFloorAndWallsAreSeen) {
  for (const std::uint64_t seed : tests::whole_or<std::uint64_t>({1, 2, 3}, {0}))
    for (const bool furnished : {false, true})
      for (const double voxel_m : tests::whole_or<double>({0.02, 0.01}, {0})) {
        EXPECT_GE(told("down", cabin(down_path, furnished), voxel_m, seed).share(), 0.8);
        EXPECT_GE(told("turning", cabin(turning_path, furnished), voxel_m, seed).share(), 0.8);
      }
}

TEST(FusionPlaces, WallsOfALiftCabinAloneMakeNoWrongClaim) {
  for (const std::uint64_t seed : tests::whole_or<std::uint64_t>({1, 2, 3}, {0}))
    for (const bool furnished : {false, true})
      for (const double voxel_m : tests::whole_or<double>({0.02, 0.01}, {0}))
        told("level", cabin(level_path, furnished), voxel_m, seed);
}

}  // namespace
