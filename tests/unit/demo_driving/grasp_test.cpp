// A mark on a box, its goal a grasp: the robot ends where the arm reaches the box as it is in the
// world, facing it, and has touched nothing.
#include <cstdio>
#include <cstdlib>

#include "tests/unit/demo_driving/drive.hpp"

namespace tests {
namespace {

TEST(GraspDriven, TheBaseEndsBesideTheObjectWhereTheArmReachesIt) {
  auto s = teletact::load_scene(teletact::find_config("scenes", "grasp"), {});
  const auto& parcel = s->world.boxes.front();
  ASSERT_EQ(parcel.name, "parcel");
  const char* folder = std::getenv("TELETACT_DISC_LOGS");
  const VirtualRun r = drive(*s, 16, folder != nullptr ? std::string(folder) + "/grasp" : "");
  const Driven d = judge(*s, r);
  const auto& objects = r.op.view.objects;
  for (int i = 0; i < objects.size; ++i) {
    const auto& e = objects.entries[static_cast<std::size_t>(i)];
    const Vec3 c = e.X_WO * e.centre_m;
    std::printf("  object %u: centre (%.3f, %.3f, %.3f), extent %.1f x %.1f x %.1f mm\n", e.serial,
                c.x(), c.y(), c.z(), 1e3 * e.extent_m.x(), 1e3 * e.extent_m.y(),
                1e3 * e.extent_m.z());
  }
  const double dx = parcel.position_m[0] - d.end_x_m, dy = parcel.position_m[1] - d.end_y_m;
  const double away = std::hypot(dx, dy);
  const double facing = std::remainder(d.end_yaw_rad - std::atan2(dy, dx), 2 * M_PI);
  std::printf(
      "  %s: base at (%.3f, %.3f), %.3f m from it, %.3f rad off, clearance %.1f mm, %u paths\n",
      d.arrived  ? "arrived"
      : d.failed ? "no way"
                 : "NEITHER",
      d.end_x_m, d.end_y_m, away, facing, 1e3 * d.clearance_m, d.paths);
  EXPECT_TRUE(d.arrived);
  EXPECT_EQ(d.collisions, 0U);
  EXPECT_GT(d.clearance_m, 0.02);
  // From above: 0.29 m of base and 50 mm before the box at the least, the arm's length at the most;
  // a cell of leeway.
  EXPECT_GT(away, 0.39);
  EXPECT_LT(away, 0.54);
  EXPECT_LT(std::abs(facing), 0.1) << "faces it";
}

}  // namespace
}  // namespace tests
