// The cast that starts from every second ray, against the one that casts every ray in full.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "perception/raycast/sparse_cast.hpp"
#include "perception/simd/isa.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using perception::SparseCast;

const Intrinsics kCamera{182.5, 182.5, 127.5, 105.5, 256, 212};
constexpr int kStep = 3;  // 86 x 71 rays

// Small boxes in the air and on the floor, besides what room() holds.
Scene cluttered(rt::Random& random) {
  Scene s = room();
  for (int n = 0; n < 12; ++n) {
    const Vec3 at(random.uniform(-0.2, 2.2), random.uniform(-1.6, 1.6), random.uniform(0.1, 1.5));
    const Vec3 half(random.uniform(0.02, 0.12), random.uniform(0.02, 0.12),
                    random.uniform(0.02, 0.3));
    s.boxes.push_back({at - half, at + half});
  }
  return s;
}

Pose some_view(rt::Random& random) {
  const Vec3 eye(random.uniform(-1.5, -0.5), random.uniform(-0.8, 0.8), random.uniform(0.8, 1.6));
  return look_at(eye, Vec3(1.5, random.uniform(-1, 1), random.uniform(0.2, 1.0)));
}

void fuse(TsdfMap& map, const Scene& scene, rt::Random& random) {
  for (int n = 0; n < 4; ++n) {
    const Pose X = some_view(random);
    map.integrate(render(scene, kCamera, X, 0.002, 0.02, rt::Random(random())).view(), X, 1);
  }
}

struct Differences {
  int rays = 0, other = 0;            // of all
  int in_patch = 0, patch_other = 0;  // in the middle of 3 x 3 that see one thing, by the full cast
};

void compare(const RaycastMaps& full, const RaycastMaps& sparse, double voxel, Differences& d) {
  const auto depth = [&](int u, int v) { return static_cast<double>(full.at(u, v)[3]); };
  for (int v = 1; v < full.height() - 1; ++v) {
    for (int u = 1; u < full.width() - 1; ++u) {
      const double z = depth(u, v);
      const bool other = std::fabs(z - static_cast<double>(sparse.at(u, v)[3])) > voxel;
      ++d.rays;
      d.other += other ? 1 : 0;
      bool patch = z > 0;
      for (int k = 0; k < 9; ++k) {
        const double about = depth(u + k % 3 - 1, v + k / 3 - 1);
        patch = patch && about > 0 && std::fabs(about - z) < 0.03;
      }
      d.in_patch += patch ? 1 : 0;
      d.patch_other += patch && other ? 1 : 0;
    }
  }
}

TEST(SparseCast, SeesInPatchesWhatTheFullCastSees) {
  rt::Startup startup;
  rt::Random random(21);
  std::printf("  seed 21\n");
  RaycastMaps full(startup.token(), 86, 71), sparse(startup.token(), 86, 71);
  SparseCast caster(startup.token(), 86, 71);
  RaycastOptions o;
  o.pixel_step = kStep;
  o.min_weight = 0.2;
  o.smooth_normals = false;
  for (const double voxel : {0.01, 0.02}) {
    Differences d;
    std::int64_t full_steps = 0, sparse_steps = 0;
    for (int n = 0; n < 4; ++n) {
      const Scene scene = cluttered(random);
      TsdfConfig config = small_map(voxel);
      config.max_blocks = 20000;
      TsdfMap map(startup.token(), config);
      fuse(map, scene, random);
      for (int k = 0; k < 4; ++k) {  // also of places that were never seen
        const Pose X = some_view(random);
        full_steps += raycast(map, kCamera, X, o, full).steps;
        const auto stats = caster.cast(map, kCamera, X, o, sparse);
        sparse_steps += stats.steps;
        EXPECT_EQ(stats.rays, 86 * 71);
        int hits = 0;
        for (int i = 0; i < 86 * 71; ++i) hits += sparse.hit(i % 86, i / 86) ? 1 : 0;
        EXPECT_EQ(stats.hits, hits);
        compare(full, sparse, voxel, d);
      }
    }
    std::printf(
        "  %.0f mm: of %d rays %d see something else; of %d in patches %d; steps %.2f of the "
        "full cast's\n",
        1000 * voxel, d.rays, d.other, d.in_patch, d.patch_other,
        static_cast<double>(sparse_steps) / static_cast<double>(full_steps));
    EXPECT_GT(d.in_patch, d.rays / 8);
    EXPECT_LT(d.patch_other, d.in_patch / 500);
    EXPECT_LT(d.other, d.rays / 50);
    EXPECT_LT(sparse_steps,
              full_steps * 9 / 10);  // noise and clutter: rays disagree in many places
  }
}

// A pole that is less than two rays wide may be missed; a box of four is not. At its rim the band
// is less than a voxel wide: whether a ray meets it hangs on where its steps fall, and they begin
// elsewhere.
TEST(SparseCast, SeesASmallBoxWhereverItStands) {
  rt::Startup startup;
  RaycastMaps full(startup.token(), 86, 71), sparse(startup.token(), 86, 71);
  SparseCast caster(startup.token(), 86, 71);
  RaycastOptions o;
  o.pixel_step = kStep;
  o.smooth_normals = false;
  const Pose X = look_at(Vec3::Zero(), Vec3::UnitX());
  const double ray_m = kStep / kCamera.fx;  // between two, at 1 m
  for (int n = 0; n < 6; ++n) {
    Scene scene;
    scene.planes = {{{2, 0, 0}, -Vec3::UnitX()}};
    const double at = 0.5 * n * ray_m, half = 3.1 * ray_m;
    scene.boxes = {{{1.0, at - half, at - half}, {1.2, at + half, at + half}}};
    TsdfMap map(startup.token(), small_map(0.01));
    map.integrate(render(scene, kCamera, X).view(), X, 1);
    raycast(map, kCamera, X, o, full);
    static_cast<void>(caster.cast(map, kCamera, X, o, sparse));
    const auto on_box = [&](const RaycastMaps& m, int u, int v) {
      return m.at(u, v)[3] > 0 && m.at(u, v)[3] < 1.5F;
    };
    int seen = 0, missed = 0, inner = 0, inner_missed = 0;
    for (int v = 1; v < 70; ++v) {
      for (int u = 1; u < 85; ++u) {
        if (!on_box(full, u, v)) continue;
        int about = 0;
        for (int k = 0; k < 9; ++k) about += on_box(full, u + k % 3 - 1, v + k / 3 - 1) ? 1 : 0;
        const bool other = std::fabs(full.at(u, v)[3] - sparse.at(u, v)[3]) > 0.01F;
        ++seen, missed += other ? 1 : 0;
        if (about < 9) continue;
        ++inner, inner_missed += other ? 1 : 0;
      }
    }
    EXPECT_GE(seen, 9) << n;
    EXPECT_LE(seen, 49) << n;
    EXPECT_GE(inner, 1) << n;
    EXPECT_EQ(inner_missed, 0) << n << ": of " << inner;
    EXPECT_LE(missed, seen / 4) << n << ": of " << seen;
  }
}

TEST(SparseCast, SameBytesByEveryInstructionSetAndNoAllocation) {
  rt::Startup startup;
  rt::Random random(5);
  TsdfConfig config = small_map(0.02);
  config.max_blocks = 20000;
  TsdfMap map(startup.token(), config);
  fuse(map, cluttered(random), random);
  const Pose X = some_view(random);
  RaycastMaps a(startup.token(), 86, 71), b(startup.token(), 86, 71);
  SparseCast caster(startup.token(), 86, 71);
  RaycastOptions o;
  o.pixel_step = kStep;
  o.smooth_normals = false;
  EXPECT_TRUE(perception::simd::choose(perception::simd::Isa::kScalar));
  const auto reference = caster.cast(map, kCamera, X, o, a);
  EXPECT_GT(reference.hits, 1000);
  for (const auto isa : perception::simd::available()) {
    EXPECT_TRUE(perception::simd::choose(isa));
    rt_guard::reset();
    perception::RaycastStats stats;
    {
      rt::Section section;
      stats = caster.cast(map, kCamera, X, o, b);
    }
    if (rt_guard::linked()) {
      EXPECT_EQ(rt_guard::counts().total(), 0U);
    }
    EXPECT_EQ(stats.hits, reference.hits);
    EXPECT_EQ(stats.steps, reference.steps);
    EXPECT_EQ(std::memcmp(a.data(), b.data(), sizeof(float) * RaycastMaps::kStride * 86 * 71), 0)
        << perception::simd::name_of(isa);
  }
  EXPECT_TRUE(perception::simd::choose("auto"));
}

TEST(SparseCast, EmptyMapsAndBadInput) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  RaycastMaps maps(startup.token(), 86, 71);
  SparseCast caster(startup.token(), 86, 71);
  RaycastOptions o;
  o.pixel_step = kStep;
  EXPECT_EQ(caster.cast(map, kCamera, Pose::Identity(), o, maps).hits, 0);
  EXPECT_EQ(maps.width(), 86);
  for (int i = 0; i < 86 * 71; ++i) EXPECT_FALSE(maps.hit(i % 86, i / 86));
  Pose bad = Pose::Identity();
  bad.translation().y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(caster.cast(map, kCamera, bad, o, maps).rays, 0);
  EXPECT_EQ(maps.width(), 0);
  o.pixel_step = 0;
  EXPECT_EQ(caster.cast(map, kCamera, Pose::Identity(), o, maps).rays, 0);
  o.pixel_step = 2;  // more rays than there is room for
  EXPECT_EQ(caster.cast(map, kCamera, Pose::Identity(), o, maps).rays, 0);
  // One ray, one row, one column.
  for (const auto& [w, h] : {std::pair{1, 1}, std::pair{7, 1}, std::pair{1, 7}}) {
    const Intrinsics k{50, 50, 0.5 * w, 0.5 * h, w, h};
    o.pixel_step = 1;
    EXPECT_EQ(caster.cast(map, k, Pose::Identity(), o, maps).rays, w * h);
  }
}

}  // namespace
}  // namespace tests
