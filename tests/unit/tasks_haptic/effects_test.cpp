// Friction, texture, materials, viscosity: each against its closed form, and off by default.
#include "tasks/haptic/effects.hpp"

#include <gtest/gtest.h>

#include <memory>

#include "rt/random.hpp"
#include "tests/support/haptic_rig.hpp"
#include "tests/support/haptic_solids.hpp"

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

// F = K (elastic) is the slope of the energy K D^2 / 2, on one face and in the edge of two.
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
  for (int k = 0; k < 300; ++k) {
    const bool edge = k % 3 == 0;
    const Vec3 above(random.uniform(-0.03, -0.01), random.uniform(-0.02, 0.02), 0.01);
    const Vec3 h(edge ? random.uniform(0.002, 0.006) : above.x(), above.y(),
                 -random.uniform(0.001, 0.006));
    tasks::ProxyState state;
    const Path way({above, {above.x(), h.y(), h.z()}, h}, 0.1);
    for (int i = 0; i <= 40; ++i) {  // down, then aside
      tasks::step_constrained(field, way(way.duration() * i / 40), state, config);
    }
    ASSERT_EQ(state.phase, tasks::ProxyState::Phase::kContact);
    const auto at = [&](const Vec3& x) {
      tasks::ProxyState s = state;
      tasks::step_constrained(field, x, s, config);
      return tasks::with_texture(field, x, s, 3e-4, 2e-2, 0);  // r = 34 mm
    };
    const tasks::Bumped here = at(h);
    ASSERT_TRUE(here.contact);
    for (int a = 0; a < 3; ++a) {
      constexpr double kStep = 1e-5;
      const double ahead = at(h + kStep * Vec3::Unit(a)).stretch_m,
                   behind = at(h - kStep * Vec3::Unit(a)).stretch_m;
      EXPECT_NEAR(-(ahead * ahead - behind * behind) / (4 * kStep), here.elastic_W[a], 1e-5)
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
    perception::Material m;
    ASSERT_EQ(tasks::material_at(*patch, p, m), sum >= 1e-9);
    if (sum > 1e-6) {
      EXPECT_NEAR(static_cast<double>(m.stiffness_scale), value / sum, 1e-5);
    }
  }
}

// 1.0 beside 0.4 of the stiffness, and a label that flips every frame: the force follows softly.
TEST(Effects, BordersAndFlickeringLabelsAreFollowedSoftly) {
  perception::Material hard, soft;
  soft.stiffness_scale = 0.4F;
  perception::Material now = hard;
  double before = 8;
  for (int tick = 0; tick < 500; ++tick) {
    tasks::follow(now, (tick / 33) % 2 == 0 ? soft : hard, 1000, 0.008, 0.1);
    const double f = 8 * static_cast<double>(now.stiffness_scale);
    EXPECT_LE(std::abs(f - before), 0.1 + 1e-5);
    before = f;
  }
}

}  // namespace
