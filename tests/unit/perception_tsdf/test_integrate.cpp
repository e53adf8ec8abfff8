#include <gtest/gtest.h>

#include <set>
#include <tuple>

#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "tests/unit/perception_tsdf/dense_reference.hpp"

namespace tests {
namespace {

TEST(Integrate, SameWordsAsADenseIntegrator) {
  rt::Startup startup;
  for (const double voxel : {0.02, 0.035}) {
    TsdfConfig config = small_map(voxel);
    config.max_weight = 5;  // the cap is reached
    config.follow = false;  // a mean alone
    TsdfMap map(startup.token(), config);
    DepthPyramid pixels(startup.token());
    const int half = static_cast<int>(std::lround(0.64 / voxel));
    DenseReference dense(-half, 2 * half, config);
    const Intrinsics k = small_camera();
    std::vector<Pose> poses;
    for (int n = 0; n < 8; ++n) {
      poses.push_back(around(n));
      const Frame f = render(table_top(), k, poses.back(), 0.004, 0.03,
                             rt::Random(11, static_cast<std::uint64_t>(n)));
      const auto stats = map.integrate(f.view(n % 2 == 0), poses.back(), 1);
      ASSERT_FALSE(stats.refused);
      ASSERT_EQ(stats.blocks_refused, 0);
      pixels.build(f.depth.view(),
                   {0.2F, 5.0F, 0.04F, 0.02F, static_cast<float>(k.fx), static_cast<float>(k.fy),
                    static_cast<float>(k.cx), static_cast<float>(k.cy),
                    static_cast<float>(std::min(1.0, 2.5 * voxel / map.truncation())), false});
      dense.integrate(k, pixels.pixels(), poses.back(), [&](int i, int j, int l) {
        return map.find_block({i >> 3, j >> 3, l >> 3}) != TsdfMap::kNoBlock;
      });
    }
    int known = 0, free_bits = 0, free_ahead = 0;
    for (int i = -half; i < half; ++i)
      for (int j = -half; j < half; ++j)
        for (int l = -half; l < half; ++l) {
          const auto& want = dense.at(i, j, l);
          const std::uint32_t got = map.word_at(i, j, l);
          ASSERT_EQ(got, want.w == 0 ? 0U : TsdfMap::make_word(want.d, want.w))
              << "node " << i << " " << j << " " << l << " at voxel " << voxel;
          known += want.w > 0;
          const std::int32_t b = map.find_block({i >> 3, j >> 3, l >> 3});
          if (b == TsdfMap::kNoBlock) continue;
          const bool bit = ((map.block_free(b)[i & 7] >> ((j & 7) * 8 + (l & 7))) & 1U) != 0;
          // A block that is made later starts with the free space known by then.
          EXPECT_TRUE(bit || !want.free) << i << " " << j << " " << l;
          free_bits += bit, free_ahead += bit && !want.free;
        }
    EXPECT_GT(known, 4000);
    EXPECT_LT(free_ahead, free_bits / 4);
    std::printf("voxel %.0f mm: %d known nodes equal; %d free bits, %d from before the block\n",
                voxel * 1e3, known, free_bits, free_ahead);
  }
}

TEST(Integrate, AllocatesEveryBlockARayPassesThroughAndNoOther) {
  rt::Startup startup;
  const TsdfConfig config = small_map(0.01);
  TsdfMap map(startup.token(), config);
  const Intrinsics k = small_camera();
  const Pose X = around(3);
  const Frame f = render(table_top(), k, X);
  map.integrate(f.view(), X, 1);
  DepthPyramid pixels(startup.token());
  pixels.build(f.depth.view(),
               {0.2F, 5.0F, 0.04F, 0.02F, static_cast<float>(k.fx), static_cast<float>(k.fy),
                static_cast<float>(k.cx), static_cast<float>(k.cy), 0.5F, false});
  std::set<std::tuple<int, int, int>> sampled;
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u) {
      const std::uint32_t p = pixels.pixels()[v * k.width + u];
      if (((p >> 16U) & 0xffU) == 0) continue;
      const Vec3 ray = k.unproject(u, v, 1);
      const double z = (p & 0xffffU) * 1e-3, half = 0.05 * (p >> 24U) / 32.0 / ray.norm();
      for (double t = z - half + 1e-7; t < z + half; t += 0.0002) {
        const Vec3 q = (X * (t * ray)) / 0.08 + Vec3::Constant(1.0 / 16);
        sampled.insert({static_cast<int>(std::floor(q.x())), static_cast<int>(std::floor(q.y())),
                        static_cast<int>(std::floor(q.z()))});
      }
    }
  for (const auto& [x, y, z] : sampled)
    EXPECT_NE(map.find_block({x, y, z}), TsdfMap::kNoBlock) << x << " " << y << " " << z;
  int extra = 0;
  map.for_each_block([&](std::int32_t, BlockCoord b) {
    extra += !sampled.contains({b.x, b.y, b.z});
  });
  std::printf("%zu blocks sampled, %d more allocated\n", sampled.size(), extra);
  EXPECT_LE(extra,
            static_cast<int>(sampled.size() / 100));  // corners cut by less than the sampling
  EXPECT_GT(sampled.size(), 100U);
}

TEST(Integrate, FieldLiesOnTheSurface) {
  rt::Startup startup;
  const Scene scene = table_top();
  for (const auto& [voxel, limit_mm] : {std::pair{0.01, 2.0}, {0.02, 3.0}}) {
    TsdfMap map(startup.token(), small_map(voxel));
    Intrinsics k = kinect2();
    k.width = 384, k.height = 360, k.cx = 191.5, k.cy = 179.5;
    for (int n = 0; n < 6; ++n) map.integrate(render(scene, k, around(n)).view(), around(n), 2);
    // Walk outward rays of grid lines: zero crossings of the field along x against the truth.
    std::vector<double> error_mm;
    map.for_each_block([&](std::int32_t b, BlockCoord at) {
      const std::uint32_t* w = map.block_words(b);
      for (int n = 0; n + 64 < TsdfMap::kBlockVoxels; ++n) {
        if (TsdfMap::word_weight(w[n]) < 256 || TsdfMap::word_weight(w[n + 64]) < 256) continue;
        const double a = TsdfMap::word_distance(w[n]), c = TsdfMap::word_distance(w[n + 64]);
        if (a <= 0 || c > 0) continue;
        const Vec3 p = voxel * Vec3(at.x * 8 + (n >> 6) + a / (a - c), at.y * 8 + ((n >> 3) & 7),
                                    at.z * 8 + (n & 7));
        error_mm.push_back(std::fabs(scene.distance(p)) * 1e3);
      }
    });
    std::printf("voxel %.0f mm: %zu crossings, |error| median %.2f p95 %.2f p99 %.2f mm\n",
                voxel * 1e3, error_mm.size(), quantile(error_mm, 0.5), quantile(error_mm, 0.95),
                quantile(error_mm, 0.99));
    EXPECT_GT(error_mm.size(), 1000U);
    EXPECT_LT(quantile(error_mm, 0.5), limit_mm / 2);
    EXPECT_LT(quantile(error_mm, 0.95), 2 * limit_mm);
  }
}

TEST(Integrate, FreeUnknownAndBandDiffer) {
  rt::Startup startup;
  Scene scene;
  scene.planes = {{{2, 0, 0}, -Vec3::UnitX()}};
  TsdfMap map(startup.token(), small_map(0.02));
  const Pose X = look_at(Vec3::Zero(), Vec3::UnitX());
  const Frame f = render(scene, small_camera(), X);
  for (int n = 0; n < 2; ++n) map.integrate(f.view(), X, 1);
  int right = 0, total = 0;
  rt::Random random(5);
  for (int n = 0; n < 20000; ++n) {
    const Vec3 p(random.uniform(0.15, 3), random.uniform(-0.5, 0.5), random.uniform(-0.4, 0.4));
    const int i = static_cast<int>(std::floor(p.x() / 0.02)),
              j = static_cast<int>(std::floor(p.y() / 0.02)),
              k = static_cast<int>(std::floor(p.z() / 0.02));
    const double x = i * 0.02;
    if (std::max(std::fabs(p.y()), std::fabs(p.z())) > 0.5 * p.x() - 0.1)
      continue;  // rim of the view
    const double ray = std::sqrt(1 + (p.y() * p.y() + p.z() * p.z()) / (x * x));
    const double s = (2 - x) * ray;
    const Seen seen = map.seen_at(i, j, k);
    if (std::fabs(s) < 0.045) {
      EXPECT_EQ(seen, Seen::kBand) << p.transpose();
      EXPECT_EQ(map.free_at(i, j, k), s > 0) << p.transpose();
    } else if (s < -0.06) {
      EXPECT_EQ(seen, Seen::kUnknown) << p.transpose();
      EXPECT_FALSE(map.free_at(i, j, k));
    } else if (s > 0.06) {
      EXPECT_NE(seen, Seen::kBand);
      right += seen == Seen::kFree, ++total;
    }
  }
  std::printf("free space found: %d of %d nodes\n", right, total);
  EXPECT_GT(right, total * 97 / 100);
}

// Every free bit is true: some frame saw past the node.
TEST(Integrate, NothingIsFreeThatNoRayPassed) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k = small_camera();
  const Scene scene = room();
  std::vector<Frame> frames;
  std::vector<Pose> poses;
  for (int n = 0; n < 5; ++n) {
    poses.push_back(look_at(Vec3(-1.0 + 0.2 * n, -0.5, 1.3), Vec3(1.5, 0.4 * n - 0.5, 0.6)));
    frames.push_back(
        render(scene, k, poses.back(), 0, 0.02, rt::Random(3, static_cast<std::uint64_t>(n))));
    map.integrate(frames.back().view(), poses.back(), 1);
  }
  rt::Random random(6);
  int free_nodes = 0, in_solid = 0, seen_free = 0, found = 0;
  for (int n = 0; n < 200000; ++n) {
    const int i = static_cast<int>(random.integer(-120, 120)),
              j = static_cast<int>(random.integer(-95, 95)),
              l = static_cast<int>(random.integer(2, 120));
    const Vec3 p = 0.02 * Vec3(i, j, l);
    bool passed = false, deep = false;
    for (std::size_t f = 0; f < frames.size(); ++f) {
      const Vec3 q = poses[f].inverse() * p;
      if (q.z() < 0.06) continue;
      const auto uv = k.project(q);
      const int u = static_cast<int>(std::floor(uv.x() + 0.5)),
                v = static_cast<int>(std::floor(uv.y() + 0.5));
      if (!frames[f].depth.view().contains(u, v)) continue;
      double far = 0, near = 1e9;  // of the 3x3 neighbourhood: single holes are filled from it
      for (int du = -1; du <= 1; ++du)
        for (int dv = -1; dv <= 1; ++dv)
          if (frames[f].depth.view().contains(u + du, v + dv)) {
            const double z = frames[f].depth.at(u + du, v + dv) * 1e-3;
            far = std::max(far, z);
            near = std::min(near, z);
          }
      passed |= far > q.z();
      // A block's breadth from the rim of the view: there cubes are left for another frame.
      const double rim = k.fx * 0.3 / q.z();
      deep |= near > q.z() + 0.15 && q.z() > 0.35 && q.z() < 4.7 && u > rim && v > rim &&
              u < k.width - rim && v < k.height - rim;
    }
    const bool free = map.free_at(i, j, l);
    if (free) {
      ++free_nodes;
      EXPECT_TRUE(passed) << p.transpose();
      in_solid += scene.distance(p) < -0.01;
    }
    seen_free += deep, found += deep && free;
  }
  std::printf("%d free nodes; %d of %d clearly seen through are known free; %d inside a solid\n",
              free_nodes, found, seen_free, in_solid);
  EXPECT_GT(free_nodes, 1000);
  EXPECT_EQ(in_solid, 0);
  EXPECT_GT(found, seen_free * 9 / 10);
}

TEST(Integrate, CapLetsARemovedObjectVanish) {
  rt::Startup startup;
  TsdfConfig config = small_map(0.02);
  config.max_weight = 20;
  TsdfMap map(startup.token(), config);
  Scene with, without;
  with.planes = without.planes = {{{1.5, 0, 0}, -Vec3::UnitX()}};
  with.boxes = {{{0.9, -0.2, -0.2}, {1.1, 0.2, 0.2}}};
  const Pose X = look_at(Vec3::Zero(), Vec3::UnitX());
  const Frame a = render(with, small_camera(), X), b = render(without, small_camera(), X);
  for (int n = 0; n < 200; ++n) map.integrate(a.view(), X, 1);
  const int i = static_cast<int>(std::lround(0.92 / 0.02));  // 20 mm inside the box's face
  ASSERT_LT(TsdfMap::word_distance(map.word_at(i, 0, 0)), 0);
  EXPECT_EQ(TsdfMap::word_weight(map.word_at(i, 0, 0)), 20 * 128);
  int frames = 0;
  while (TsdfMap::word_distance(map.word_at(i, 0, 0)) <= 0 && frames < 100)
    map.integrate(b.view(), X, 1), ++frames;
  std::printf("removed object gone after %d frames\n", frames);
  EXPECT_LT(frames, 15);
  EXPECT_TRUE(map.free_at(i, 0, 0));
  // And a new one appears.
  for (int n = 0; n < 40; ++n) map.integrate(a.view(), X, 1);
  EXPECT_LT(TsdfMap::word_distance(map.word_at(i, 0, 0)), 0);
  EXPECT_FALSE(map.free_at(i, 0, 0));
}

TEST(Integrate, SameInputSameBytes) {
  rt::Startup startup;
  std::uint64_t sums[2];
  for (std::uint64_t& sum : sums) {
    TsdfMap map(startup.token(), small_map(0.02));
    for (int n = 0; n < 4; ++n)
      map.integrate(render(table_top(), small_camera(), around(n), 0.003, 0.02,
                           rt::Random(8, static_cast<std::uint64_t>(n)))
                        .view(true),
                    around(n), 2);
    map.clear_region({Vec3(-0.1, -0.1, -0.1), Vec3(0.1, 0.1, 0.1)});
    map.integrate(render(table_top(), small_camera(), around(5)).view(true), around(5), 2);
    sum = map.checksum();
  }
  EXPECT_EQ(sums[0], sums[1]);
}

TEST(Integrate, ColourIsTheSurfaces) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Scene scene = table_top();
  for (int n = 0; n < 4; ++n)
    map.integrate(render(scene, small_camera(), around(n)).view(true), around(n), 1);
  MapReader reader(map);
  Rgb c;
  ASSERT_TRUE(reader.colour(Vec3(0.45, 0.35, 0.3), c));  // the wall: normal -x
  EXPECT_NEAR(c.r, 28, 2);
  EXPECT_NEAR(c.g, 128, 2);
  EXPECT_NEAR(c.b, 128, 2);
  EXPECT_FALSE(reader.colour(Vec3(-0.5, 0, 0), c));
}

// A chunk carved in one frame may wait for the next: seen twice, everything that either view alone
// shows to be free is free.
TEST(Integrate, FreeSpaceThatWaitsForTheNextFrameIsNotLost) {
  rt::Startup startup;
  const TsdfConfig config = small_map(0.02);
  const Intrinsics k{120, 120, 79.5, 59.5, 160, 120};
  const Pose X_A = look_at(Vec3(-0.8, 0, 1.2), Vec3(1.4, -0.2, 0.7));
  const Pose X_B = look_at(Vec3(-0.7, 0.1, 1.25), Vec3(1.4, 0.5, 0.6));
  const Frame a = render(room(), k, X_A, 0, 0, rt::Random(1, 1));
  const Frame b = render(room(), k, X_B, 0, 0, rt::Random(1, 2));
  TsdfMap both(startup.token(), config), only_a(startup.token(), config),
      only_b(startup.token(), config);
  only_a.integrate(a.view(), X_A, 1);
  only_b.integrate(b.view(), X_B, 1);
  both.integrate(a.view(), X_A, 1);
  both.integrate(b.view(), X_B, 1);
  int waiting = 0, lost = 0, free = 0;
  const auto count = [&](int& missing) {
    missing = free = 0;
    for (int i = -60; i < 140; i += 3)
      for (int j = -100; j < 100; j += 3)
        for (int l = -10; l < 120; l += 3) {
          if (both.find_block({i >> 3, j >> 3, l >> 3}) != TsdfMap::kNoBlock) continue;
          if (!only_a.free_at(i, j, l) && !only_b.free_at(i, j, l)) continue;
          ++free;
          missing += both.free_at(i, j, l) ? 0 : 1;
        }
  };
  count(waiting);
  both.integrate(b.view(), X_B, 1);
  count(lost);
  EXPECT_GT(free, 10000);
  EXPECT_GT(waiting, 0) << "nothing waited: the case shows nothing";
  EXPECT_EQ(lost, 0);
}

}  // namespace
}  // namespace tests
