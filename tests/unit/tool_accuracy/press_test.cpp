// Force on a hand that presses into a fused room, against the true solids'.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "rt/quantile.hpp"
#include "tools/measure/accuracy/fusion_study.hpp"
#include "tools/measure/accuracy/press_error.hpp"
#include "tools/record/scenes.hpp"

namespace teletact {
namespace {

using perception::Pose;
using perception::Vec3;

TEST(PressError, IsThatOfTheMapAndSeesAMapThatIsOff) {
  rt::Startup startup;
  const SyntheticRoom room = scene_named("room");
  const drivers::World world(startup.token(), room.world);
  const FusionSequence sequence = synthetic_sequence(startup.token(), room, 30);
  std::vector<Vec3> seen = seen_surface(world, sequence.intrinsics, sequence.known_truth());
  const int floor = world.find("floor");
  ASSERT_GE(floor, 0);
  std::vector<Vec3> on_floor;
  for (const Vec3& p_W : seen)
    if (std::abs(world.signed_distance(p_W, floor)) < 1e-6) on_floor.push_back(p_W);
  ASSERT_GT(on_floor.size(), 20U);
  std::vector<double> right, again, high, gone;
  PressOptions o;
  o.places = 20;
  static_cast<void>(run_fusion(startup.token(), sequence, fusion_with_voxel(0.01),
                               [&](FusionFeed& feed, const Pose& X_WM) {
                                 right = press_errors_N(feed, X_WM, world, seen, o);
                                 again = press_errors_N(feed, X_WM, world, seen, o);
                                 // The map 2 mm too high: on the floor that is 2 N. Far away:
                                 // nothing is there.
                                 Pose X_off = X_WM;
                                 X_off.translation().z() += 0.002;
                                 high = press_errors_N(feed, X_off, world, on_floor, o);
                                 X_off.translation().z() += 30;
                                 gone = press_errors_N(feed, X_off, world, on_floor, o);
                               }));
  ASSERT_EQ(right.size(), 20U);
  EXPECT_EQ(right, again);
  std::printf(
      "  error of the force: p50 %.3f N, p95 %.3f N; 2 mm too high: p50 %.3f N on the floor\n",
      rt::quantile(right, 0.5), rt::quantile(right, 0.95), rt::quantile(high, 0.5));
  EXPECT_LT(rt::quantile(right, 0.5), 1.0);
  EXPECT_NEAR(rt::quantile(high, 0.5), 2.0, 1.0);
  ASSERT_FALSE(gone.empty());
  for (const double e : gone) EXPECT_NEAR(e, 4, 1e-9);  // K * depth
}

}  // namespace
}  // namespace teletact
