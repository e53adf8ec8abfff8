// What lies beyond the map of the floor, and which keep-out the base reaches into.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tools/desk/intents/desk_bounds.hpp"

namespace {

using perception::Pose2;
using perception::Twist2;
using perception::Vec3;
using teletact::beyond_floor;
using teletact::beyond_map;
using teletact::DrawnObstacle;
using teletact::KeepOutWatch;
using teletact::reaches_into;
using testing::HasSubstr;

// x -2 to 6, y -4 to 4 m.
std::unique_ptr<perception::CostMap> floor_map() {
  auto map = std::make_unique<perception::CostMap>();
  map->seq = 1;
  map->ground_found = true;
  map->resolution = 0.05;
  map->width = map->height = 160;
  map->X_WM.translation() = Vec3(-2, -4, 0);
  return map;
}

DrawnObstacle disc(double x, double y, double radius, double z = 0) {
  return {3, false, Vec3(x, y, z), Vec3(radius, radius, 0.1), 0};
}

std::string of(const perception::CostMap& map, const Vec3& p) {
  return beyond_map(map, std::vector{p});
}

TEST(DeskBounds, APlaceOutsideTheMapIsRefusedWithItsReach) {
  const auto map = floor_map();
  EXPECT_EQ(beyond_floor(*map, 0, 0), "");
  EXPECT_EQ(beyond_floor(*map, 5.9, 3.9), "");
  EXPECT_THAT(beyond_floor(*map, 900, 900),
              HasSubstr("which reaches x -2.0 to 6.0, y -4.0 to 4.0 m"));
  EXPECT_NE(beyond_floor(*map, -2.1, 0), "");
  EXPECT_EQ(of(*map, Vec3(1, 1, 0.8)), "");
  EXPECT_NE(of(*map, Vec3(500, 500, 500)), "");
  EXPECT_EQ(of(*map, Vec3(1, 1, 900)), "900.0 m above the floor");
  EXPECT_EQ(of(*map, Vec3(1, 1, -20)), "20.0 m below the floor");
  EXPECT_NE(beyond_map(*map, std::vector{Vec3(1, 1, 0), Vec3(7, 1, 0)}), "") << "each point counts";
}

TEST(DeskBounds, AKeepOutStandsOnTheMapAndIsNoLarger) {
  const auto map = floor_map();
  EXPECT_EQ(beyond_map(*map, disc(1, 1, 0.2)), "");
  EXPECT_NE(beyond_map(*map, disc(9, 1, 0.2)), "");
  EXPECT_EQ(beyond_map(*map, disc(1, 1, 0.2, 900)), "900.0 m above the floor");
  EXPECT_EQ(beyond_map(*map, disc(1, 1, 20)), "larger than the map of the floor");
}

TEST(DeskBounds, WithoutAMapNothingIsBeyondIt) {
  auto map = floor_map();
  map->ground_found = false;
  EXPECT_EQ(beyond_floor(*map, 900, 900), "");
  map->ground_found = true;
  map->seq = 0;
  EXPECT_EQ(beyond_map(*map, disc(900, 0, 0.2)), "");
}

TEST(DeskBounds, ACircleReachesIntoADiscAndATurnedBox) {
  DrawnObstacle box{5, true, Vec3(3, 0, 0), Vec3(1.0, 0.1, 0.2), 3.14159265358979 / 2};
  const std::map<std::uint16_t, DrawnObstacle> drawn = {{3, disc(0, 0, 0.2)}, {5, box}};
  EXPECT_EQ(reaches_into(drawn, 0.49, 0, 0.3), 3);
  EXPECT_EQ(reaches_into(drawn, 0.51, 0, 0.3), 0);
  EXPECT_EQ(reaches_into(drawn, 2.65, 0.5, 0.3), 5) << "its long side lies along y";
  EXPECT_EQ(reaches_into(drawn, 2.5, 0.5, 0.3), 0);
  EXPECT_EQ(reaches_into(drawn, 3.0, 1.25, 0.3), 5);
  EXPECT_EQ(reaches_into(drawn, 3.3, 1.25, 0.3), 0) << "past its corner";
}

TEST(KeepOutWatch, SaysOnceWhatIsAheadAndOnceWhatItIsIn) {
  const std::map<std::uint16_t, DrawnObstacle> drawn = {{3, disc(1, 0, 0.2)}};
  KeepOutWatch watch;
  const Twist2 on{0.3, 0, 0}, back{-0.3, 0, 0};
  EXPECT_FALSE(watch.look(drawn, Pose2{0, 0, 0}, on, 0.3));
  EXPECT_EQ(watch.text(), "");
  EXPECT_TRUE(watch.look(drawn, Pose2{0.4, 0, 0}, on, 0.3));
  EXPECT_THAT(watch.text(), HasSubstr("Keep-out 3 is ahead"));
  EXPECT_FALSE(watch.look(drawn, Pose2{0.45, 0, 0}, on, 0.3)) << "said already";
  EXPECT_TRUE(watch.look(drawn, Pose2{0.6, 0, 0}, on, 0.3));
  EXPECT_EQ(watch.text(), "The base is in keep-out 3.");
  EXPECT_FALSE(watch.look(drawn, Pose2{0.4, 0, 0}, back, 0.3));
  EXPECT_EQ(watch.text(), "");
  EXPECT_FALSE(watch.look(drawn, Pose2{0.4, 0, 3.14159265358979}, on, 0.3)) << "it looks away";
}

}  // namespace
