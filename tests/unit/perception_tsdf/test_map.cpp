// Limits, refusals, forgetting and reading of the map.
#include <gtest/gtest.h>

#include <set>

#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

TEST(Map, FullPoolsAreCountedAndLoseNothing) {
  rt::Startup startup;
  const Intrinsics k = small_camera();
  const Scene scene = room();
  const Pose X = look_at(Vec3(-1.5, 0, 1.2), Vec3(1, 0, 0.8));
  const Frame f = render(scene, k, X);
  TsdfConfig config = small_map(0.02);
  config.max_blocks = 64;
  TsdfMap few_blocks(startup.token(), config);
  const auto first = few_blocks.integrate(f.view(), X, 1);
  EXPECT_EQ(first.blocks_new, 64);
  EXPECT_GT(first.blocks_refused, 0);
  EXPECT_EQ(few_blocks.block_count(), 64);
  const auto second = few_blocks.integrate(f.view(), X, 1);
  EXPECT_EQ(second.blocks_new, 0);
  EXPECT_GT(second.blocks_refused, 0);
  EXPECT_EQ(second.voxels_fused, first.voxels_fused);

  config.max_blocks = 8192;
  config.max_chunks = 3;
  TsdfMap few_chunks(startup.token(), config);
  const auto third = few_chunks.integrate(f.view(), X, 1);
  EXPECT_GT(third.blocks_refused, 0);
  EXPECT_GT(third.chunks_refused, 0);
  EXPECT_EQ(few_chunks.chunk_count(), 3);
  EXPECT_GT(few_chunks.block_count(), 0);

  // Room after a clear.
  few_blocks.clear();
  EXPECT_EQ(few_blocks.block_count(), 0);
  EXPECT_EQ(few_blocks.integrate(f.view(), X, 1).blocks_new, 64);
}

TEST(Map, HashFindsEveryChunkWhenHalfFull) {
  rt::Startup startup;
  TsdfConfig config = small_map(0.02);
  config.max_chunks = 32;  // 64 slots, half of them taken: probes collide
  config.max_blocks = 2048;
  TsdfMap map(startup.token(), config);
  const Intrinsics k{60, 60, 15.5, 11.5, 32, 24};
  Scene scene;
  scene.spheres = {{Vec3::Zero(), 0.25}};
  rt::Random random(9);
  int n = 0;
  while (map.chunk_count() < 32 && n < 400) {  // small spheres strewn over a large world
    const Vec3 at(random.uniform(-400, 400), random.uniform(-400, 400), random.uniform(-400, 400));
    scene.spheres[0].centre = at;
    const Pose X = look_at(at + Vec3(-1, 0.1, 0.2), at);
    map.integrate(render(scene, k, X).view(), X, 1), ++n;
  }
  ASSERT_EQ(map.chunk_count(), 32);
  std::set<const TsdfMap::Chunk*> found;
  for (int c = 0; c < 32; ++c) {
    const BlockCoord b = map.chunk(c).coord;
    EXPECT_EQ(map.find_chunk(b.x, b.y, b.z), &map.chunk(c));
    found.insert(map.find_chunk(b.x, b.y, b.z));
    EXPECT_EQ(map.find_chunk(b.x, b.y, b.z + 1000), nullptr);
  }
  EXPECT_EQ(found.size(), 32U);
  map.for_each_block([&](std::int32_t b, BlockCoord at) { EXPECT_EQ(map.find_block(at), b); });
}

TEST(Map, RefusesWhatItCannotUse) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k = small_camera();
  const Pose X = around(0);
  const Frame f = render(table_top(), k, X);
  map.integrate(f.view(), X, 1);
  const std::uint64_t before = map.checksum();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [&](const FrameView& v, const Pose& p, int step = 1) {
    const auto s = map.integrate(v, p, step);
    return s.refused && map.checksum() == before;
  };
  Pose bad = X;
  bad.translation().x() = nan;
  EXPECT_TRUE(refused(f.view(), bad));
  bad = X;
  bad.translation().x() = 1e9;
  EXPECT_TRUE(refused(f.view(), bad));
  bad = X;
  bad.linear() *= 1.01;
  EXPECT_TRUE(refused(f.view(), bad));
  bad = X;
  bad.linear().col(0) *= -1;
  EXPECT_TRUE(refused(f.view(), bad));
  EXPECT_TRUE(refused(f.view(), X, 0));
  EXPECT_TRUE(refused({}, X));
  FrameView wrong = f.view();
  wrong.intrinsics.width -= 1;
  EXPECT_TRUE(refused(wrong, X));
  wrong = f.view();
  wrong.intrinsics.fx = nan;
  EXPECT_TRUE(refused(wrong, X));
  // An image without one reading is no error: nothing happens.
  Frame empty{k, Image<std::uint16_t>(k.width, k.height), Image<Rgb>(k.width, k.height)};
  const auto s = map.integrate(empty.view(), X, 1);
  EXPECT_FALSE(s.refused);
  EXPECT_EQ(s.rays, 0);
  EXPECT_EQ(map.checksum(), before);
}

TEST(Map, BadConfigIsNamed) {
  rt::Startup startup;
  TsdfConfig config = small_map();
  config.max_weight = 1;
  try {
    TsdfMap map(startup.token(), config);
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string(e.what()).find("max_weight"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("2 to 255"), std::string::npos) << e.what();
  }
  config = small_map();
  config.weighting = "cubic";
  EXPECT_THROW(TsdfMap(startup.token(), config), std::invalid_argument);
  config = small_map();
  config.voxel_size_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(TsdfMap(startup.token(), config), std::invalid_argument);
}

TEST(Map, ClearRegionForgetsOnlyTheBox) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  for (int n = 0; n < 4; ++n)
    map.integrate(render(table_top(), small_camera(), around(n)).view(true), around(n), 1);
  const Eigen::AlignedBox3d box(Vec3(-0.13, 0.0, -0.1), Vec3(0.21, 0.31, 0.27));
  struct Node {
    int i, j, k;
    std::uint32_t word;
    bool free;
  };
  std::vector<Node> before;
  for (int i = -32; i < 32; ++i)
    for (int j = -32; j < 32; ++j)
      for (int k = -32; k < 32; ++k)
        before.push_back({i, j, k, map.word_at(i, j, k), map.free_at(i, j, k)});
  const int blocks = map.block_count();
  map.clear_region(box);
  int cleared = 0, coarsened = 0;
  for (const Node& n : before) {
    const Vec3 p = 0.02 * Vec3(n.i, n.j, n.k);
    if (box.contains(p)) {
      EXPECT_EQ(map.word_at(n.i, n.j, n.k), 0U);
      EXPECT_FALSE(map.free_at(n.i, n.j, n.k));
      cleared += n.word != 0 || n.free;
    } else {
      EXPECT_EQ(map.word_at(n.i, n.j, n.k), n.word) << p.transpose();
      if (map.free_at(n.i, n.j, n.k) != n.free) {  // 2^3 cells at the box's face are given up whole
        EXPECT_TRUE(n.free);
        EXPECT_LT(box.exteriorDistance(p), 0.17);
        ++coarsened;
      }
    }
  }
  EXPECT_GT(cleared, 100);
  EXPECT_LT(map.block_count(), blocks);
  int live = 0;
  map.for_each_block([&](std::int32_t b, BlockCoord at) {
    ++live;
    EXPECT_EQ(map.find_block(at), b);
  });
  EXPECT_EQ(live, map.block_count());
  // Returned blocks are used again, clean.
  const auto s = map.integrate(render(table_top(), small_camera(), around(1)).view(), around(1), 1);
  EXPECT_GT(s.blocks_new, 0);
  EXPECT_LE(map.block_slots(), blocks + 1);
  std::printf("%d nodes cleared, %d free nodes given up at the faces\n", cleared, coarsened);
}

TEST(Map, AllocatesNothing) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in";
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Frame f = render(table_top(), small_camera(), around(0));
  rt_guard::reset();
  {
    rt::Section section;
    map.integrate(f.view(true), around(0), 1);
    map.clear_region({Vec3(-0.1, -0.1, -0.1), Vec3(0.1, 0.1, 0.1)});
    map.integrate(f.view(true), around(0), 1);
    map.clear();
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

TEST(Reader, TrilinearAndGradientMatchPlainReads) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  for (int n = 0; n < 4; ++n)
    map.integrate(render(table_top(), small_camera(), around(n)).view(), around(n), 1);
  MapReader reader(map, 2.0);
  rt::Random random(21);
  int valid = 0, gradients = 0;
  for (int n = 0; n < 60000; ++n) {
    const Vec3 p(random.uniform(-0.3, 0.6), random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5));
    const Vec3 g = p / 0.02;
    const int i = static_cast<int>(std::floor(g.x())), j = static_cast<int>(std::floor(g.y())),
              k = static_cast<int>(std::floor(g.z()));
    double want = 0;
    bool all = true;
    for (int c = 0; c < 8; ++c) {
      const int x = i + (c >> 2), y = j + ((c >> 1) & 1), z = k + (c & 1);
      const std::uint32_t w = map.word_at(x, y, z);
      all &= TsdfMap::word_weight(w) >= 256;
      want += (1 - std::fabs(g.x() - x)) * (1 - std::fabs(g.y() - y)) * (1 - std::fabs(g.z() - z)) *
              TsdfMap::word_distance(w);
    }
    const auto s = reader.sample(p);
    ASSERT_EQ(s.valid, all) << p.transpose();
    if (!all) continue;
    ++valid;
    EXPECT_NEAR(s.distance_m, want * 0.05 / 32767, 1e-6);
    // The cell's analytic gradient against a small difference inside the cell.
    const auto c = reader.cell(g.x(), g.y(), g.z());
    float a[3];
    c.gradient(a);
    const double e = 1e-3;
    for (int axis = 0; axis < 3; ++axis) {
      Vec3 q0 = g, q1 = g;
      q0(axis) -= e, q1(axis) += e;
      if (std::floor(q0(axis)) != std::floor(q1(axis))) continue;
      const double difference = static_cast<double>(reader.cell(q1.x(), q1.y(), q1.z()).value() -
                                                    reader.cell(q0.x(), q0.y(), q0.z()).value()) /
                                (2 * e);
      EXPECT_NEAR(a[axis], difference, 12.0);  // floats of up to 32767, differenced over 0.002
      ++gradients;
    }
  }
  EXPECT_GT(valid, 1000);
  EXPECT_GT(gradients, 3000);
  EXPECT_FALSE(reader.sample(Vec3(std::numeric_limits<double>::quiet_NaN(), 0, 0)).valid);
  EXPECT_FALSE(reader.sample(Vec3(1e12, 0, 0)).valid);
}

}  // namespace
}  // namespace tests
