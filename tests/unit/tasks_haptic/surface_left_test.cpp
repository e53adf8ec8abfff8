// A hand on a face that starts to move, or that is no longer known: let go by a fade, told by one
// event, not carried.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>

#include "tests/unit/tasks_haptic/floor.hpp"

namespace {

using rig::floor_scene;
using rig::press;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;
using Kind = tasks::TouchEvent::Kind;

constexpr double kAt_s = 0.55, kDepth_m = 0.008;

struct Told {
  double first_window_s = -1;  // taken, with the motion in it
  double event_s = -1, released_s = -1;
  double j_N = 0, force_max_N = 0, booked_J = 0, moved_by_N = 0;
  int events = 0, ends = 0, not_finite = 0;
  double at_the_end_N = 0;
};

// The floor stands until kAt_s; then every image has it `step_m` higher than the one before.
Scene moving(double step_m) {
  Scene s = floor_scene();
  s.solid = [=](const Vec3& p, double t) {
    return solids::floor(p) - step_m * std::max(0.0, std::floor((t - kAt_s) * 30 + 1));
  };
  return s;
}

Told run(Scene s, double depth = kDepth_m) {
  Rig r(std::move(s));
  press(r, depth);
  Told out;
  double last_N = std::min(12.0, depth * 1000), booked_before = -1;
  for (int i = 0; i < 700; ++i) {
    const Row row = r.tick(Vec3(0, 0, -depth));
    if (booked_before < 0) booked_before = row.telemetry.booked_J;
    const double f = row.f.norm();
    out.not_finite += row.f.allFinite() ? 0 : 1;
    out.j_N = std::max(out.j_N, std::abs(f - last_N));
    if (row.t > kAt_s) out.moved_by_N = std::max(out.moved_by_N, f - 1000 * depth);
    last_N = out.at_the_end_N = f;
    out.force_max_N = std::max(out.force_max_N, f);
    out.booked_J = std::max(out.booked_J, row.telemetry.booked_J - booked_before);
    for (int e = 0; e < r.out().event_count; ++e) {
      const Kind kind = r.out().events[static_cast<std::size_t>(e)].kind;
      if (kind == Kind::kSurfaceLeft && out.events++ == 0) out.event_s = row.t;
      out.ends += kind == Kind::kContactEnd ? 1 : 0;
    }
    if (row.t > kAt_s && out.released_s < 0 && f < 1e-9) out.released_s = row.t;
  }
  return out;
}

void expect_let_go(const Told& t, const std::string& what) {
  std::printf("%s: told %.0f ms after the start, let go after %.0f, J %.3f N, booked %.1f mJ\n",
              what.c_str(), 1e3 * (t.event_s - kAt_s), 1e3 * (t.released_s - kAt_s), t.j_N,
              1e3 * t.booked_J);
  EXPECT_EQ(t.events, 1) << what;
  EXPECT_EQ(t.ends, 1) << what;
  EXPECT_EQ(t.not_finite, 0) << what;
  ASSERT_GT(t.released_s, 0) << what;
  EXPECT_LE(t.released_s - kAt_s, 0.1) << what;
  EXPECT_LE(t.j_N, 0.3 + 1e-9) << what;  // 300 N/s: the hand stands
  EXPECT_LE(t.booked_J, 0.05) << what;
  EXPECT_LE(t.moved_by_N, 1e-6) << what;  // it is not pushed harder on its way
  EXPECT_EQ(t.at_the_end_N, 0) << what;   // and not taken again from within
}

TEST(SurfaceLeft, AFaceThatStartsToMoveLetsTheHandGo) {
  for (const double mm : {10.0, 50.0, 100.0, -10.0, -50.0, -100.0})
    expect_let_go(run(moving(1e-3 * mm)), std::to_string(mm) + " mm a frame");
}

TEST(SurfaceLeft, SoDoesOneThatIsGoneOrNoLongerKnown) {
  Scene gone = floor_scene();
  gone.solid = [](const Vec3& p, double t) { return t > kAt_s ? 1.0 : solids::floor(p); };
  expect_let_go(run(std::move(gone)), "gone");
  Scene unknown = floor_scene();
  unknown.solid = [](const Vec3& p, double t) {
    return t > kAt_s ? std::nan("") : solids::floor(p);
  };
  expect_let_go(run(std::move(unknown)), "unknown");
}

// The motion mask says that it moves, the field stands still: what moves is neither fused nor
// carved.
TEST(SurfaceLeft, AFaceThatIsSeenToMoveLetsTheHandGo) {
  for (const double voxel : {0.01, 0.02}) {
    Scene s = floor_scene();
    s.voxel = voxel;
    s.truncation = 5 * voxel;
    s.moves = [](double t) { return t > kAt_s; };
    expect_let_go(run(std::move(s)), "seen to move");
  }
}

// What the hand is let go from does not depend on where the world's origin is.
TEST(SurfaceLeft, AHandThatIsLetGoIsNotTakenAgainFarFromTheOrigin) {
  for (const double voxel : {0.01, 0.02})
    for (const double step_mm : {10.0, 50.0}) {
      Scene s = moving(1e-3 * step_mm);
      s.voxel = voxel;
      s.truncation = 5 * voxel;
      s.X_WS.translation() =
          Vec3(0.5, -0.3, -1.9);  // the origin lies in free space above the floor
      expect_let_go(run(std::move(s)), "far from the origin");
    }
}

// Deeper than the force limit: the fade begins where the force does.
TEST(SurfaceLeft, AHandAtTheForceLimitIsLetGoAsFast) {
  const Told t = run(moving(0.05), 0.03);
  EXPECT_GT(t.force_max_N, 11.9);
  ASSERT_GT(t.released_s, 0);
  EXPECT_LE(t.released_s - kAt_s, 0.1);
  EXPECT_LE(t.j_N, 0.3 + 1e-9);
}

// What a hand can be carried by is no such thing: 100 mm/s, and a step of 5 mm, either way.
TEST(SurfaceLeft, ASlowFaceAndASmallStepCarryTheHand) {
  for (const double mm : {1.0, -0.2}) {
    const Told t = run(moving(1e-3 * mm));
    EXPECT_EQ(t.events, 0) << mm;
    EXPECT_EQ(t.ends, 0) << mm;
  }
  for (const double step : {0.005, -0.005}) {
    Scene s = floor_scene();
    s.solid = [=](const Vec3& p, double t) { return solids::floor(p) - (t > kAt_s ? step : 0.0); };
    const Told t = run(std::move(s));
    EXPECT_EQ(t.events, 0) << step;
    EXPECT_NEAR(t.at_the_end_N, std::min(12.0, 8 + 1e3 * step), 0.05);
  }
}

// A window that is somewhere else than the hand does not say that the surface has gone: the last
// frame is held.
TEST(SurfaceLeft, AWindowThatLagsBehindTheHandIsNoSurfaceThatLeft) {
  for (const double aside : {0.13, 0.3}) {  // within two voxels of its edge, and outside of it
    Scene s = floor_scene();
    const double voxel = s.voxel, truncation = s.truncation;
    s.X_WS = rig::Pose::Identity();
    s.window = [=](const Vec3& centre, int nodes, double t, perception::SurfacePatch& out) {
      out.voxel_size = voxel;
      out.metres_per_unit = static_cast<float>(truncation / 32767.0);
      out.nodes = nodes;
      const Vec3 at = centre + Vec3(t > kAt_s ? aside : 0, 0, 0);
      for (int a = 0; a < 3; ++a)
        out.origin_node[static_cast<std::size_t>(a)] =
            static_cast<int>(std::lround(at[a] / voxel)) - nodes / 2;
      for (int x = 0; x < nodes; ++x)
        for (int y = 0; y < nodes; ++y)
          for (int z = 0; z < nodes; ++z) {
            const std::size_t i = out.index(x, y, z);
            const double d = std::clamp(voxel * (out.origin_node[2] + z), -truncation, truncation);
            out.distance[i] = static_cast<std::int16_t>(std::lround(d / truncation * 32767));
            out.material[i] = 1;
            out.set_free(i, d > 0);
          }
    };
    const Told t = run(std::move(s));
    EXPECT_EQ(t.events, 0) << aside;
    EXPECT_NEAR(t.at_the_end_N, 8, 0.05) << aside;
  }
}

}  // namespace
