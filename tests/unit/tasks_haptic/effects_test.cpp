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

// Height of the proxy = height of the texture there, for a light touch that follows every bump.
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
    for (int i = 0; i < 3; ++i) a += 1e-4 * std::sin(2 * std::numbers::pi * row.p[i] / 4e-3);
    EXPECT_NEAR(row.p.z(), a, 5e-6) << row.t;
    low = std::min(low, row.p.z());
    high = std::max(high, row.p.z());
  }
  EXPECT_NEAR(high - low, 2e-4, 0.5e-4);
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
