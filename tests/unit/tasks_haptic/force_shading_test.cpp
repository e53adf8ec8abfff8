// The published method: its reduction against one point at a time, and its rules on a plane.
#include "tasks/haptic/force_shading.hpp"

#include <gtest/gtest.h>
#include <time.h>

#include "rt/quantile.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_score.hpp"
#include "tools/measure/support/haptic_solids.hpp"

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
              rt::quantile(us, 0.5), rt::quantile(us, 0.99));
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

// The published method once more, one point at a time and straight from its text.
struct Literal {
  std::vector<Vec3> s, n;
  Vec3 p = Vec3::Zero(), at = Vec3::Zero();  // p', n'
  bool contact = false, outside = false;

  std::size_t nearest(const Vec3& g) const {
    std::size_t best = 0;
    for (std::size_t i = 1; i < s.size(); ++i) {
      const auto away = [&](std::size_t k) {  // in float, as the reduction
        return (s[k].cast<float>() - g.cast<float>()).eval();
      };
      const perception::Vec3f a = away(i), b = away(best);
      if (a.x() * a.x() + a.y() * a.y() + a.z() * a.z() <
          b.x() * b.x() + b.y() * b.y() + b.z() * b.z()) {
        best = i;
      }
    }
    return best;
  }
  // p - h, zero without contact.
  Vec3 tick(const Vec3& h, double phi, double mu) {
    const bool first = !contact && outside && phi <= 0;
    outside = phi > 0;
    if (!contact && !first) return Vec3::Zero();
    bool stays = false;
    Vec3 g = h;
    if (contact) {
      g = h - (h - p).dot(at) * at;
      const double radius = mu * (h - g).norm(), away = (p - g).norm();
      stays = mu > 0 && away <= radius;
      if (mu > 0) g += (radius / std::max(away, 1e-300)) * (p - g);
    }
    if (!stays) {
      const std::size_t i = nearest(g);
      p = s[i];
      at = n[i];
    }
    contact = first || (h - p).dot(at) < 0;
    return contact ? Vec3(p - h) : Vec3(Vec3::Zero());
  }
};

// Corner, edge and ball, hands that wander in and out: the same force in every tick, and no force
// after an end until the hand has been outside.
TEST(ForceShading, EqualsTheTextOnRandomPaths) {
  constexpr std::uint64_t kSeed = 44;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  struct Solid {
    double (*phi)(const Vec3&);
    std::vector<Vec3> points;
  };
  std::vector<Solid> solids(3);
  solids[0].phi = &solids::concave_edge;
  solids[1].phi = &solids::convex_edge;
  solids[2].phi = [](const Vec3& p) { return p.norm() - 0.03; };
  for (int i = 0; i <= 24; ++i) {
    for (int k = 0; k <= 24; ++k) {
      const double a = 0.003 * i, y = 0.003 * (k - 12);
      for (const std::size_t c : {0U, 1U}) {
        const double down = c == 0 ? 1 : -1;
        solids[c].points.emplace_back(-a, y, 0);
        solids[c].points.emplace_back(0, y, down * a);
      }
      const double u = 2 * std::numbers::pi * i / 24, v = std::numbers::pi * k / 24;
      solids[2].points.emplace_back(0.03 * std::sin(v) * std::cos(u),
                                    0.03 * std::sin(v) * std::sin(u), 0.03 * std::cos(v));
    }
  }
  int ends_inside = 0, contacts = 0;
  for (int round = 0; round < 36; ++round) {
    const Solid& solid = solids[static_cast<std::size_t>(round % 3)];
    rig::Scene scene;
    scene.solid = [&](const Vec3& p, double) { return solid.phi(p); };
    scene.still = true;
    scene.config.method = "force_shading";
    const rig::Rig r(scene);
    const auto patch = std::make_unique<perception::SurfacePatch>();
    r.fill(*patch, Vec3::Zero(), 0, 0);
    tasks::Field field;
    field.set(nullptr, patch.get(), 1);
    Literal text;
    SurfacePoints points;
    points.resize(solid.points.size());
    for (std::size_t i = 0; i < solid.points.size(); ++i) {
      Vec3 normal;
      for (int a = 0; a < 3; ++a) {
        normal[a] = solid.phi(solid.points[i] + 1e-5 * Vec3::Unit(a)) -
                    solid.phi(solid.points[i] - 1e-5 * Vec3::Unit(a));
      }
      points.set(i, solid.points[i], normal.normalized());
      text.s.push_back(points.point(i));
      text.n.push_back(points.normal(i));
    }
    tasks::ProxyConfig config;
    config.surface = &points;
    config.paper_friction = round % 2 == 0 ? 0 : 0.4;
    tasks::ProxyState state;
    Vec3 h(-0.01, 0, 0.035), v = Vec3::Zero();
    for (int k = 0; k < 3000; ++k) {
      const Vec3 jerk(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
      v = 0.995 * v + 2e-5 * jerk - 2e-5 * (h - Vec3(-0.005, 0, 0.005)) / 0.02;
      h += v;
      const bool was = text.contact;
      const double phi = field.sample(h).value;
      const Vec3 expected = text.tick(h, phi, config.paper_friction);
      tasks::step_force_shading(field, h, state, config);
      ASSERT_NEAR((state.p_WP() - h - expected).norm(), 0, 1e-9) << "round " << round << " " << k;
      ASSERT_EQ(state.phase == tasks::ProxyState::Phase::kContact, text.contact);
      contacts += text.contact ? 1 : 0;
      ends_inside += was && !text.contact && phi <= 0 ? 1 : 0;
    }
  }
  EXPECT_GT(contacts, 1000);
  EXPECT_GT(ends_inside, 0) << "no path ended a contact inside the solid";
  std::printf("%d ticks in contact, %d contacts ended inside\n", contacts, ends_inside);
}

// A wall that the method stands on: points 1 mm apart on z = 0, about a hand that rests 6 mm deep.
struct OnAPlane {
  SurfacePoints points;
  rig::Scene scene;
  OnAPlane() {
    points.resize(61 * 61);
    for (int i = 0; i < 61 * 61; ++i)
      points.set(static_cast<std::size_t>(i), Vec3(1e-3 * (i % 61 - 30), 1e-3 * (i / 61 - 30), 0),
                 Vec3::UnitZ());
    scene.solid = [](const Vec3& p, double) { return p.z(); };
    scene.config.method = "force_shading";
  }
  // Down to 6 mm in 160 ms, and there until 500 ms.
  void press(rig::Rig& r) const {
    const rig::Path path({{0, 0, 0.01}, {0, 0, -0.006}}, 0.1);
    (void)r.run(path, 0, path.duration());
    for (int k = 0; k < 300; ++k) (void)r.tick({0, 0, -0.006});
  }
};

// None came for its liveness: the force ramps to zero in haptic.ramp_s, with a fault, and returns
// with the next one.
TEST(ForceShading, AStaleRayCastRampsTheForceDown) {
  const OnAPlane plane;
  rig::Rig r(plane.scene);
  r.in().surface = &plane.points;
  plane.press(r);
  const double pressed = r.tick({0, 0, -0.006}).f.norm();
  EXPECT_NEAR(pressed, 6, 0.05);
  r.in().surface_stale = true;
  double before = pressed;
  for (int k = 0; k < 150; ++k) {
    const rig::Row row = r.tick({0, 0, -0.006});
    EXPECT_EQ(row.health.fault, tasks::kFaultHapticSurfaceStale);
    EXPECT_TRUE(row.telemetry.stale);
    EXPECT_LE(row.f.norm(), before + 1e-9) << k;
    EXPECT_LE(before - row.f.norm(), 0.3 + 1e-9) << "no step";
    before = row.f.norm();
    if (k > 105) {
      EXPECT_EQ(row.f.norm(), 0) << k;
    }
  }
  r.in().surface_stale = false;
  rig::Row row;
  for (int k = 0; k < 150; ++k) row = r.tick({0, 0, -0.006});
  EXPECT_EQ(row.health.fault, rt::kNoFault);
  EXPECT_NEAR(row.f.norm(), pressed, 0.01);
}

// Whatever is wrong with a ray cast, no force is made of it; and the next good one is touched
// again.
TEST(ForceShading, AMalformedRayCastIsRefused) {
  const double nan = std::nan("");
  for (const int what : {0, 1, 2}) {
    const OnAPlane plane;
    SurfacePoints bad = plane.points;
    if (what == 0) bad.X_WC.matrix().setConstant(nan);
    if (what == 1) bad.count = bad.x.size() + 1;
    if (what == 2) std::fill(bad.x.begin(), bad.x.end(), std::nanf(""));  // no header says so
    rig::Rig r(plane.scene);
    r.in().surface = &plane.points;
    plane.press(r);
    EXPECT_GT(r.tick({0, 0, -0.006}).f.norm(), 5);
    r.in().surface = &bad;
    rig::Row row;
    for (int k = 0; k < 60; ++k) {
      row = r.tick({0, 0, -0.006});
      EXPECT_TRUE(row.f.allFinite());
      if (what < 2) {
        EXPECT_EQ(row.health.fault, tasks::kFaultHapticBadPatch);
      }
    }
    EXPECT_EQ(row.f.norm(), 0);
    r.in().surface = &plane.points;
    const rig::Path out_and_in({{0, 0, -0.006}, {0, 0, 0.01}, {0, 0, -0.006}}, 0.1);
    (void)r.run(out_and_in, 0, out_and_in.duration());
    for (int k = 0; k < 100; ++k) row = r.tick({0, 0, -0.006});
    EXPECT_NEAR(row.f.norm(), 6, 0.05) << what;
    EXPECT_EQ(row.health.fault, rt::kNoFault);
  }
}

// A cast that met nothing is no surface.
TEST(ForceShading, ACastOfNothingIsNoContact) {
  SurfacePoints none;
  none.resize(100);
  rig::Scene scene;
  scene.solid = [](const Vec3& p, double) { return p.z(); };
  scene.config.method = "force_shading";
  rig::Rig r(scene);
  r.in().surface = &none;
  const rig::Path path({{0, 0, 0.01}, {0, 0, -0.006}}, 0.1);
  for (const rig::Row& row : r.run(path, 0, path.duration())) EXPECT_EQ(row.f.norm(), 0);
}

}  // namespace
