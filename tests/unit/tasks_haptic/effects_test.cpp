// Friction, texture, materials, viscosity: each against its closed form, and off by default.
#include "tasks/haptic/effects.hpp"

#include <gtest/gtest.h>

#include <array>
#include <memory>

#include "rt/random.hpp"
#include "tools/measure/support/haptic_loops.hpp"
#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace {

using perception::SurfacePatch;
using rig::Path;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;

Scene floor_scene() {
  Scene s;
  s.solid = [](const Vec3& p, double) { return solids::floor(p); };
  s.still = true;
  return s;
}

TEST(Effects, AreOffByDefault) { EXPECT_FALSE(tasks::HapticConfig{}.effects()); }

TEST(Effects, SlidingFrictionIsMuTimesTheNormalForce) {
  Scene s = floor_scene();
  s.config.friction_static = 0.5;
  s.config.friction_dynamic = 0.4;
  Rig r(s);
  const Path path({{0, 0, 0.005}, {0, 0, -0.005}, {0.04, 0, -0.005}}, 0.1);
  const Row last = r.run(path, 0, path.duration()).back();
  EXPECT_NEAR(last.f.x(), -0.4 * 5, 0.02);
  EXPECT_NEAR(last.f.z(), 5, 0.02);
}

// Along a corner off the grid: where friction holds the proxy back into a wall it is at the free
// place nearest to there.
TEST(Effects, FrictionLiftsToTheNearestFreePlace) {
  constexpr std::uint64_t kSeed = 3;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  int held_back = 0, nearer = 0;
  for (const rig::Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::concave_edge(p); };
    s.still = true;
    s.X_WS = place.X_WS;
    s.config.friction_static = 0.3;
    s.config.friction_dynamic = 0.24;
    Rig r(s);
    const auto patch = std::make_unique<SurfacePatch>();
    r.fill(*patch, s.X_WS * Vec3(0, 0.015, 0), 0, 0);
    tasks::Field field;
    field.set(nullptr, patch.get(), 1);
    const Path path(
        {{-0.01, 0, 0.005}, {-0.01, 0, -0.008}, {0.008, 0, -0.008}, {0.008, 0.03, -0.008}}, 0.2);
    for (int tick = 0; tick < 1000 * path.duration(); ++tick) {
      const Row row = r.tick(path(1e-3 * tick));
      const tasks::ProxyState& state = r.task().proxy();
      if (tick % 3 != 0 || !state.anchored) continue;
      const Vec3 p_c = state.rendered_WP(), h = s.X_WS * row.h, p = s.X_WS * row.p;
      const Vec3 n = (p_c - h).normalized(), away = state.anchor_W() - p_c;
      const Vec3 end = p_c + away - away.dot(n) * n;
      const double off = (p - end).norm() - 2e-5;
      if (off < 1e-4) continue;
      ++held_back;
      bool found = false;
      for (int i = 0; i < 4000 && !found; ++i) {
        const Vec3 d(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
        found = d.norm() < 1 && field.seen_free(end + off * d);
      }
      if (found) {
        ++nearer;
        std::printf("%s, hand %.1f %.1f %.1f mm: lifted by %.3f mm\n", place.name.c_str(),
                    1e3 * row.h.x(), 1e3 * row.h.y(), 1e3 * row.h.z(), 1e3 * (p - end).norm());
      }
    }
  }
  std::printf("%d ticks held back into a wall, %d not at the nearest free place\n", held_back,
              nearer);
  EXPECT_GT(held_back, 50);
  EXPECT_EQ(nearer, 0);
}

// Height of the proxy = height of the texture over the foot of the hand on the smooth floor.
TEST(Effects, TextureIsAHeightOfTheSurface) {
  Scene s = floor_scene();
  s.config.texture_amplitude_m = 1e-4;
  s.config.texture_period_m = 4e-3;
  Rig r(s);
  const Path path({{0, 0, 0.005}, {0, 0, -0.0004}, {0.03, 0, -0.0004}}, 0.02);
  double low = 1, high = -1;
  for (const Row& row : r.run(path, 0, path.duration())) {
    if (!row.telemetry.in_contact || row.h.x() < 0.004) continue;
    double a = 0;
    for (int i = 0; i < 2; ++i) a += 1e-4 * std::sin(2 * std::numbers::pi * row.h[i] / 4e-3);
    EXPECT_NEAR(row.p.z(), a, 5e-6) << row.t;
    low = std::min(low, row.p.z());
    high = std::max(high, row.p.z());
  }
  EXPECT_NEAR(high - low, 2e-4, 0.5e-4);
}

// F = K (elastic) is the slope of the energy K stretch^2 / 2, on one face and in the edge of two:
// within the reach, where f bends, and deeper.
TEST(Effects, TextureIsConservative) {
  constexpr std::uint64_t kSeed = 19;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  Scene scene;
  scene.solid = [](const Vec3& p, double) { return solids::concave_edge(p); };
  scene.still = true;
  Rig r(scene);
  const auto patch = std::make_unique<SurfacePatch>();
  r.fill(*patch, Vec3::Zero(), 0, 0);
  tasks::Field field;
  field.set(nullptr, patch.get(), 1);
  const tasks::ProxyConfig config;
  tasks::Surface wide, sharp;
  wide.add(3e-4, 2e-2);
  sharp.add(3e-4, 2e-3);
  sharp.add(5e-5, 7e-3);
  for (int k = 0; k < 300; ++k) {
    const bool edge = k % 3 == 0;
    const tasks::Surface& bumps = k % 2 == 0 ? wide : sharp;
    const Vec3 above(random.uniform(-0.03, -0.01), random.uniform(-0.02, 0.02), 0.01);
    const Vec3 h(edge ? random.uniform(0.002, 0.006) : above.x(), above.y(),
                 -random.uniform(0.001, 0.006));
    tasks::ProxyState state;
    const Path way({above, {above.x(), h.y(), h.z()}, h}, 0.1);
    for (int i = 0; i <= 40; ++i) {  // down, then aside
      tasks::step_constrained(field, way(way.duration() * i / 40), state, config);
    }
    ASSERT_EQ(state.phase, tasks::ProxyState::Phase::kContact);
    const double reach = std::array{0.034, 0.003, 0.0008, 0.0002}[static_cast<std::size_t>(k % 4)];
    const auto at = [&](const Vec3& x) {
      tasks::ProxyState s = state;
      tasks::step_constrained(field, x, s, config);
      return tasks::with_texture(field, x, s, bumps, reach, 0);
    };
    const tasks::Bumped here = at(h);
    ASSERT_TRUE(here.contact);
    for (int a = 0; a < 3; ++a) {
      constexpr double kStep = 1e-5;
      const double ahead = at(h + kStep * Vec3::Unit(a)).stretch_m,
                   behind = at(h - kStep * Vec3::Unit(a)).stretch_m;
      EXPECT_NEAR(-(ahead * ahead - behind * behind) / (4 * kStep), here.elastic_W[a], 2e-5)
          << edge << " " << a;
    }
  }
}

// Crests stand out of the smooth floor: they are met there, and without a step.
TEST(Effects, BumpsAreMetOneByOne) {
  Scene s = floor_scene();
  s.config.texture_amplitude_m = 3e-4;
  s.config.texture_period_m = 2e-3;
  s.config.guard = false;
  for (const double x : {0.5e-3, 1.0e-3, 1.5e-3}) {  // a crest, the mean, a trough; along y a crest
    Rig r(s);
    const Path path({{x, 5e-4, 0.003}, {x, 5e-4, -0.002}, {x, 5e-4, 0.003}}, 0.01);
    double first = -1;
    Vec3 f = Vec3::Zero();
    for (const Row& row : r.run(path, 0, path.duration())) {
      EXPECT_LE((row.f - f).norm(), 1000 * 1e-5 * 1.5) << row.h.z();
      f = row.f;
      if (first < 0 && f.norm() > 0) first = row.h.z();
    }
    EXPECT_NEAR(first, 3e-4 * (1 + std::sin(std::numbers::pi * x / 1e-3)), 1.5e-5) << x;
  }
}

TEST(Effects, ViscosityOpposesMotion) {
  Scene s = floor_scene();
  s.config.viscosity_N_s_per_m = 2;
  Rig r(s);
  const Path path({{0, 0, 0.02}, {0.05, 0, 0.02}}, 0.2);
  EXPECT_NEAR(r.run(path, 0, 0.2).back().f.x(), -0.4, 0.01);
}

TEST(Effects, MaterialsAreWeightedTrilinearly) {
  constexpr std::uint64_t kSeed = 11;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  auto patch = std::make_unique<SurfacePatch>();
  patch->seq = 1;
  patch->voxel_size = 0.01;
  patch->metres_per_unit = 1e-6F;
  patch->nodes = 8;
  for (auto& m : patch->palette) m.stiffness_scale = static_cast<float>(random.uniform(0.1, 1));
  for (std::size_t i = 0; i < patch->cells(); ++i) {
    patch->material[i] = static_cast<std::uint8_t>(random.integer(0, 16));
  }
  for (int k = 0; k < 500; ++k) {
    const Vec3 p(random.uniform(0, 0.07), random.uniform(0, 0.07), random.uniform(0, 0.07));
    double sum = 0, value = 0;
    for (int x = 0; x < 8; ++x) {
      for (int y = 0; y < 8; ++y) {
        for (int z = 0; z < 8; ++z) {
          const Vec3 away = (p / 0.01 - Vec3(x, y, z)).cwiseAbs();
          const std::uint8_t slot = patch->material[patch->index(x, y, z)];
          if (away.maxCoeff() >= 1 || slot == 0) continue;
          const double w = (Vec3::Ones() - away).prod();
          sum += w;
          value += w * static_cast<double>(patch->palette[slot - 1U].stiffness_scale);
        }
      }
    }
    tasks::Surface m;
    ASSERT_EQ(tasks::material_at(*patch, p, m), sum >= 1e-9);
    if (sum > 1e-6) {
      EXPECT_NEAR(m.stiffness_scale, value / sum, 1e-5);
    }
  }
}

// 1.0 beside 0.4 of the stiffness, and a label that flips every frame: the force follows softly.
TEST(Effects, BordersAndFlickeringLabelsAreFollowedSoftly) {
  tasks::Surface hard, soft;
  soft.stiffness_scale = 0.4;
  tasks::Surface now = hard;
  double before = 8;
  for (int tick = 0; tick < 500; ++tick) {
    tasks::follow(now, (tick / 33) % 2 == 0 ? soft : hard, 1000, 0.008, 1, 0.1);
    const double f = 8 * now.stiffness_scale;
    EXPECT_LE(std::abs(f - before), 0.1 + 1e-5);
    before = f;
  }
}

// Every parameter at once, at random: what follows changes the force by 0.1 N at most, all
// parameters together, and arrives. Nothing sweeps through the periods between two.
TEST(Effects, AllParametersTogetherAreFollowedSoftly) {
  constexpr std::uint64_t kSeed = 23;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  Rig r(floor_scene());
  const auto patch = std::make_unique<SurfacePatch>();
  r.fill(*patch, Vec3::Zero(), 0, 0);
  tasks::Field field;
  field.set(nullptr, patch.get(), 1);
  constexpr double kStiffness = 1000, kSide = 2000, kStep = 0.1;
  const auto draw = [&] {
    tasks::Surface s;
    s.stiffness_scale = random.uniform(0.3, 1);
    s.friction_static = random.uniform(0, 0.6);
    s.friction_dynamic = s.friction_static * random.uniform(0.6, 1);
    for (int i = 0; i < static_cast<int>(random.integer(0, 3)); ++i) {
      s.add(random.uniform(1e-5, 5e-4), 1e-3 * static_cast<double>(random.integer(1, 6)));
    }
    return s;
  };
  double worst = 0;
  for (int round = 0; round < 60; ++round) {
    const double depth = random.uniform(0.0005, 0.011);
    const Vec3 above(random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02), 0.01);
    const Vec3 h(above.x(), above.y(), -depth);
    tasks::ProxyState state;
    const tasks::ProxyConfig config;
    const Path way({above, h}, 0.1);
    for (int i = 0; i <= 40; ++i) {
      tasks::step_constrained(field, way(way.duration() * i / 40), state, config);
    }
    tasks::Surface now = draw();
    const auto reach = [&] {
      const double stiffest = kStiffness * now.stiffness_scale * now.curvature_per_m();
      return stiffest > 0 ? kSide / (tasks::kPlateau * stiffest) : 1e9;
    };
    // With slip along x.
    const auto force = [&] {
      Vec3 pull = tasks::with_texture(field, h, state, now, reach(), 0).elastic_W;
      pull.x() += now.friction_dynamic * depth;
      return Vec3(kStiffness * now.stiffness_scale * pull);
    };
    for (int goal_no = 0; goal_no < 3; ++goal_no) {
      const tasks::Surface goal = draw();
      int ticks = 0;
      Vec3 before = force();
      for (; ticks < 4000; ++ticks) {
        tasks::follow(now, goal, kStiffness, depth, reach(), kStep);
        const Vec3 f = force();
        worst = std::max(worst, (f - before).norm());
        ASSERT_LE((f - before).norm(), kStep + 1e-6) << round << " " << ticks;
        before = f;
        bool same = now.patterns == goal.patterns;
        for (std::size_t i = 0; i < now.patterns; ++i) {
          bool known = false;
          for (std::size_t k = 0; k < goal.patterns; ++k) {
            known =
                known || (now.bumps[i].period_m == goal.bumps[k].period_m &&
                          std::abs(now.bumps[i].amplitude_m - goal.bumps[k].amplitude_m) < 1e-9);
          }
          same = same && known;
        }
        if (same && std::abs(now.stiffness_scale - goal.stiffness_scale) < 1e-9) break;
      }
      EXPECT_LT(ticks, 4000) << "never arrives";
    }
  }
  std::printf("largest change of force a tick %.4f N\n", worst);
}

Scene bumpy_floor(double stiffness, double damping) {
  Scene s = floor_scene();
  s.config.stiffness_N_per_m = stiffness;
  s.config.texture_amplitude_m = 3e-4;
  s.config.texture_period_m = 2e-3;
  s.device.damping_N_s_per_m = damping;
  return s;
}

// 200 closed loops, 0.6 to 8 mm deep, legs of 5 to 100 mm/s; the perturbed normal costs energy over
// many of them.
TEST(Effects, TextureLoopsCostNothing) {
  constexpr std::uint64_t kSeed = 1000;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  for (const double stiffness : {300.0, 1000.0}) {
    for (const double damping : {2.0, 20.0}) {
      Scene s = bumpy_floor(stiffness, damping);
      const loops::Worst height = loops::worst_of(s, kSeed, 200);
      s.config.bump_normal = true;
      const loops::Worst normal = loops::worst_of(s, kSeed, 200);
      std::printf("K %.1f N/mm, b %g: worst loop %.4f mJ (seed %llu), perturbed normal %.3f mJ\n",
                  1e-3 * stiffness, damping, 1e3 * height.energy_J,
                  static_cast<unsigned long long>(height.seed), 1e3 * normal.energy_J);
      EXPECT_LE(height.energy_J, loops::kLimit_J);
      EXPECT_GT(normal.energy_J, 10 * loops::kLimit_J);
    }
  }
}

// The height felt is the texture's below 100 Hz as deep as the reach goes, though the slew guard is
// on. The reach is the same at every speed.
TEST(Effects, TextureKeepsItsHeightAtSpeed) {
  for (const double stiffness : {300.0, 1000.0}) {
    double first = 0;
    for (const double speed : {0.02, 0.1, 0.19}) {
      Rig r(bumpy_floor(stiffness, 20));
      const double reach = r.task().texture_reach_m(), depth = 0.6 * reach;
      const Vec3 from(-0.04, 0, -depth);
      const Path down({Vec3(-0.04, 0, 0.005), from}, 0.1), there({from, {0.04, 0, -depth}}, speed);
      r.run(down, 0, down.duration());
      double low = 1e9, high = 0, right_low = 1e9, right_high = 0;
      for (const Row& row : r.run(there, 0, there.duration())) {
        if (row.h.x() < -0.02) continue;
        const double right =
            std::max(0.0, depth + 3e-4 * std::sin(2 * std::numbers::pi * row.h.x() / 2e-3));
        low = std::min(low, row.f.z());
        high = std::max(high, row.f.z());
        right_low = std::min(right_low, right);
        right_high = std::max(right_high, right);
      }
      EXPECT_NEAR(0.5 * (high - low) / stiffness, 0.5 * (right_high - right_low), 3e-5)
          << stiffness << " " << depth << " " << speed;
      EXPECT_EQ(r.task().texture_reach_m(), reach) << speed;
      if (first == 0) first = reach;
      EXPECT_EQ(reach, first) << speed;
    }
  }
}

// A device of 0.2 kg and b 2 N s/m, its encoder's step 10 um, that rests on bumps under a push: how
// fast it still moves after 3 s.
double speed_at_rest(double stiffness, double push_N) {
  Rig r(bumpy_floor(stiffness, 2));
  Vec3 x(0.0004, 0.0003, 0.001), v = Vec3::Zero();
  double fastest = 0;
  for (int k = 0; k < 3000; ++k) {
    const Vec3 reading = (x / 1e-5).array().round().matrix() * 1e-5;
    const Vec3 f = r.tick(reading).f + Vec3(0, 0, -push_N);
    constexpr int kPieces = 100;
    for (int i = 0; i < kPieces; ++i) {
      v = (0.2 * v + (1e-3 / kPieces) * f) / (0.2 + (1e-3 / kPieces) * 2);
      x += (1e-3 / kPieces) * v;
    }
    if (k >= 2900) fastest = std::max(fastest, v.norm());
  }
  return fastest;
}

TEST(Effects, BumpsHoldADeviceQuietly) {
  const double soft = speed_at_rest(300, 1), deep = speed_at_rest(300, 3);
  double quiet = 0;
  for (double k = 300; k < 3000 && speed_at_rest(k, 1) < 0.003; k *= 1.25) quiet = k;
  std::printf("at 0.3 N/mm under 1 N %.2f mm/s, under 3 N %.2f; under 1 N quiet up to %.2f N/mm\n",
              1e3 * soft, 1e3 * deep, 1e-3 * quiet);
  EXPECT_LT(soft, 0.003);
  EXPECT_LT(deep, 0.003);
  EXPECT_GE(quiet, 1000);
}

}  // namespace
