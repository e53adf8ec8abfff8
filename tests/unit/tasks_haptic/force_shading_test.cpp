// The published method: its reduction against one point at a time, and its rules on a plane.
#include "tasks/haptic/force_shading.hpp"

#include <gtest/gtest.h>
#include <time.h>

#include "rt/random.hpp"
#include "tests/support/haptic_rig.hpp"

namespace {

using perception::Vec3;
using tasks::SurfacePoints;

TEST(ForceShading, ReductionEqualsOnePointAtATime) {
  constexpr std::uint64_t kSeed = 5;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  for (int round = 0; round < 60; ++round) {
    SurfacePoints s;
    s.resize(static_cast<std::size_t>(random.integer(1, 3000)));
    const double quantum = round % 2 == 0 ? 0 : 0.05;  // many ties
    const auto draw = [&] {
      const double v = random.uniform(-1, 1);
      return quantum > 0 ? quantum * std::round(v / quantum) : v;
    };
    for (std::size_t i = 0; i < s.count; ++i) {
      if (random.uniform() < 0.1) continue;  // a ray that met nothing
      s.set(i, Vec3(draw(), draw(), draw()), Vec3::UnitZ());
    }
    for (int k = 0; k < 20; ++k) {
      const Vec3 g(draw(), draw(), draw());
      ASSERT_EQ(tasks::nearest_index(s, g), tasks::nearest_index_scalar(s, g)) << "round " << round;
    }
  }
}

TEST(ForceShading, CostOfTheReduction) {
  SurfacePoints s;
  s.resize(512 * 424);
  rt::Random random(1);
  for (std::size_t i = 0; i < s.count; ++i) {
    s.set(i, Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)),
          Vec3::UnitZ());
  }
  std::vector<double> us;
  for (int k = 0; k < 200; ++k) {
    const Vec3 g(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    const double before = rig::thread_us();
    EXPECT_LT(tasks::nearest_index(s, g), s.count);
    us.push_back(rig::thread_us() - before);
  }
  std::printf("reduction over %zu points: thread CPU p50 %.1f us, p99 %.1f us (aim 80)\n", s.count,
              rig::percentile(us, 0.5), rig::percentile(us, 0.99));
}

// On a plane of points 1 mm apart: the force is K times the depth, within the spacing.
TEST(ForceShading, PlaneAndItsFriction) {
  auto points = std::make_unique<SurfacePoints>();
  points->resize(201 * 201);
  for (int i = 0; i < 201; ++i) {
    for (int k = 0; k < 201; ++k) {
      points->set(static_cast<std::size_t>(i * 201 + k),
                  Vec3(1e-3 * (i - 100), 1e-3 * (k - 100), 0), Vec3::UnitZ());
    }
  }
  for (const double mu : {0.0, 0.5}) {
    rig::Scene scene;
    scene.solid = [](const Vec3& p, double) { return p.z(); };
    scene.config.method = "force_shading";
    scene.config.paper_friction = mu;
    scene.config.guard = false;
    rig::Rig r(scene);
    r.in().surface = points.get();
    const rig::Path path({{0, 0, 0.01}, {0, 0, -0.006}, {0.03, 0, -0.006}, {0.03, 0, 0.01}}, 0.1);
    for (const rig::Row& row : r.run(path, 0, path.duration())) {
      if (row.h.z() > 0) continue;
      EXPECT_NEAR(row.f.z(), -1000 * row.h.z(), 1e-3);
      // The proxy lags by mu times the depth, and half a spacing either way.
      const double lag = row.h.x() - row.p.x();
      EXPECT_LE(lag, mu * -row.h.z() + 0.51e-3);
      EXPECT_GE(lag, -0.51e-3);
      if (mu > 0 && row.h.x() > 0.01 && row.h.z() < -0.00599) {
        EXPECT_GE(lag, mu * 0.006 - 1.01e-3);
      }
    }
    EXPECT_FALSE(r.tick({0.03, 0, 0.011}).telemetry.in_contact);
  }
}

}  // namespace
