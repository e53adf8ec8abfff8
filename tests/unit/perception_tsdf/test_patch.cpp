#include <gtest/gtest.h>

#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/patch/patch_copy.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_tsdf/patch_sample.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

struct PatchTest : testing::Test {
  rt::Startup startup;
  TsdfMap map{startup.token(), small_map(0.02)};
  std::unique_ptr<SurfacePatch> patch = std::make_unique<SurfacePatch>();

  // Round the origin, so that windows span negative and positive nodes.
  void SetUp() override {
    Scene s;
    s.planes = {{{0.4, 0, 0}, -Vec3::UnitX()}};
    s.spheres = {{{0.02, 0.01, -0.03}, 0.2}};
    for (int n = 0; n < 5; ++n) {
      const Pose X = look_at(Vec3(-1.0, 0.2 * n - 0.4, 0.1 * n - 0.2), Vec3(0.1, 0, 0));
      map.integrate(
          render(s, small_camera(), X, 0.002, 0.05, rt::Random(1, static_cast<std::uint64_t>(n)))
              .view(),
          X, 1);
    }
  }
};

TEST_F(PatchTest, EveryNodeIsTheMaps) {
  rt::Random random(31);
  for (const int nodes : {8, 12, 32, 60, 64}) {
    for (int round = 0; round < 6; ++round) {
      const Vec3 centre(random.uniform(-0.7, 0.7), random.uniform(-0.7, 0.7),
                        random.uniform(-0.7, 0.7));
      ASSERT_TRUE(copy_patch(map, centre, nodes, *patch));
      const auto o = patch->origin_node;
      int observed = 0;
      for (int x = 0; x < nodes; ++x)
        for (int y = 0; y < nodes; ++y)
          for (int z = 0; z < nodes; ++z) {
            const std::size_t n = patch->index(x, y, z);
            const std::uint32_t w = map.word_at(o[0] + x, o[1] + y, o[2] + z);
            const bool seen = TsdfMap::word_weight(w) >= 256;
            ASSERT_EQ(patch->material[n], seen ? 1 : 0)
                << nodes << ": " << x << " " << y << " " << z;
            ASSERT_EQ(patch->distance[n], seen ? TsdfMap::word_distance(w) : 0);
            ASSERT_EQ(patch->free_at(n), map.free_at(o[0] + x, o[1] + y, o[2] + z));
            observed += seen;
          }
      for (int a = 0; a < 3; ++a) {
        EXPECT_EQ(o[static_cast<std::size_t>(a)] % 4, 0);
        const double middle = 0.02 * (o[static_cast<std::size_t>(a)] + 0.5 * (nodes - 1));
        EXPECT_LE(std::fabs(middle - centre(a)), 2 * 0.02 + 1e-9);
      }
      if (nodes >= 60) {
        EXPECT_GT(observed, 0);
      }
    }
  }
  EXPECT_EQ(patch->voxel_size, 0.02);
  EXPECT_EQ(patch->map_id, map.map_id());
  EXPECT_NEAR(patch->truncation(), map.truncation(), 1e-7);
}

TEST_F(PatchTest, UnobservedIsZeroAndWindowsOverlapNodeOnNode) {
  auto other = std::make_unique<SurfacePatch>();
  ASSERT_TRUE(copy_patch(map, Vec3(0, 0, 0), 64, *patch));
  ASSERT_TRUE(copy_patch(map, Vec3(0.13, -0.2, 0.05), 40, *other));
  int shared = 0;
  for (int x = 0; x < 40; ++x)
    for (int y = 0; y < 40; ++y)
      for (int z = 0; z < 40; ++z) {
        const int i[3] = {x + other->origin_node[0] - patch->origin_node[0],
                          y + other->origin_node[1] - patch->origin_node[1],
                          z + other->origin_node[2] - patch->origin_node[2]};
        if (std::min({i[0], i[1], i[2]}) < 0 || std::max({i[0], i[1], i[2]}) >= 64) continue;
        const std::size_t a = patch->index(i[0], i[1], i[2]), b = other->index(x, y, z);
        EXPECT_EQ(patch->distance[a], other->distance[b]);
        EXPECT_EQ(patch->material[a], other->material[b]);
        EXPECT_EQ(patch->free_at(a), other->free_at(b));
        ++shared;
      }
  EXPECT_GT(shared, 30000);
}

TEST_F(PatchTest, LabelsBecomeMaterialSlots) {
  std::array<std::uint8_t, 256> slots{};
  slots[3] = 5;
  slots[4] = 200;  // no such slot: the default material
  map.for_each_block([&](std::int32_t b, BlockCoord) {
    std::array<LabelVoxel, 512> labels;
    for (std::size_t n = 0; n < 512; ++n) labels[n] = {static_cast<std::uint8_t>(n % 5), 1};
    ASSERT_TRUE(map.store_labels(b, labels));
  });
  ASSERT_TRUE(copy_patch(map, Vec3::Zero(), 64, *patch, slots));
  int fives = 0;
  for (int x = 0; x < 64; ++x)
    for (int y = 0; y < 64; ++y)
      for (int z = 0; z < 64; ++z) {
        const std::size_t n = patch->index(x, y, z);
        if (patch->material[n] == 0) continue;
        const int at = TsdfMap::in_block(patch->origin_node[0] + x, patch->origin_node[1] + y,
                                         patch->origin_node[2] + z);
        ASSERT_EQ(patch->material[n], at % 5 == 3 ? 6 : 1);
        fives += at % 5 == 3;
      }
  EXPECT_GT(fives, 100);
}

TEST_F(PatchTest, RefusesBadArguments) {
  ASSERT_TRUE(copy_patch(map, Vec3::Zero(), 32, *patch));
  const std::uint64_t sum = patch_checksum(*patch);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const int nodes : {0, 4, 10, 68, -8})
    EXPECT_FALSE(copy_patch(map, Vec3::Zero(), nodes, *patch));
  EXPECT_FALSE(copy_patch(map, Vec3(0, nan, 0), 32, *patch));
  EXPECT_FALSE(copy_patch(map, Vec3(0, 1e15, 0), 32, *patch));
  std::array<std::uint8_t, 3> short_table{};
  EXPECT_FALSE(copy_patch(map, Vec3::Zero(), 32, *patch, short_table));
  EXPECT_EQ(patch_checksum(*patch), sum);
}

TEST_F(PatchTest, ChecksumSeesEveryPart) {
  ASSERT_TRUE(copy_patch(map, Vec3::Zero(), 32, *patch));
  const std::uint64_t sum = patch_checksum(*patch);
  auto copy = std::make_unique<SurfacePatch>(*patch);
  EXPECT_EQ(patch_checksum(*copy), sum);
  copy->distance[12345] = static_cast<std::int16_t>(copy->distance[12345] ^ 1);
  EXPECT_NE(patch_checksum(*copy), sum);
  *copy = *patch;
  copy->material[7] ^= 1U;
  EXPECT_NE(patch_checksum(*copy), sum);
  *copy = *patch;
  copy->set_free(999, !copy->free_at(999));
  EXPECT_NE(patch_checksum(*copy), sum);
  *copy = *patch;
  ++copy->origin_node[1];
  EXPECT_NE(patch_checksum(*copy), sum);
}

TEST_F(PatchTest, SampleAgreesWithTheMap) {
  ASSERT_TRUE(copy_patch(map, Vec3(-0.05, 0, 0), 64, *patch));
  MapReader reader(map, 2.0);
  rt::Random random(41);
  int complete = 0, gradients = 0;
  for (int n = 0; n < 50000; ++n) {
    const Vec3 p(random.uniform(-0.6, 0.5), random.uniform(-0.55, 0.55),
                 random.uniform(-0.55, 0.55));
    const PatchCell cell = patch_cell(*patch, p);
    ASSERT_EQ(cell.inside, inside_window(*patch, p));
    if (!cell.inside) continue;
    const auto want = reader.sample(p);
    ASSERT_EQ(cell.complete(), want.valid);
    if (!cell.complete()) continue;
    ++complete;
    EXPECT_NEAR(cell.value(), want.distance_m, 2e-7);
    const Vec3 g = cell.gradient(0.02);
    const double e = 1e-5;
    for (int a = 0; a < 3; ++a) {
      const PatchCell lo = patch_cell(*patch, p - e * Vec3::Unit(a)),
                      hi = patch_cell(*patch, p + e * Vec3::Unit(a));
      if (std::fabs(static_cast<double>(hi.f[static_cast<std::size_t>(a)] -
                                        lo.f[static_cast<std::size_t>(a)])) > 0.5)
        continue;
      EXPECT_NEAR(g(a), (hi.value() - lo.value()) / (2 * e), 2e-3);
    }
    Vec3 far, from_map;
    if (patch_gradient(*patch, p, 0.02, far)) {
      ASSERT_TRUE(reader.gradient(p, from_map));
      EXPECT_LT((far - from_map).norm(), 1e-4);
      ++gradients;
    }
  }
  EXPECT_GT(complete, 1000);
  EXPECT_GT(gradients, 500);
}

TEST_F(PatchTest, SampleAtTheEdgesOfTheWindow) {
  SurfacePatch empty_header;
  EXPECT_FALSE(inside_window(empty_header, Vec3::Zero()));
  EXPECT_FALSE(patch_cell(empty_header, Vec3::Zero()).inside);
  auto& p = *patch;
  p.nodes = 8, p.voxel_size = 0.01, p.metres_per_unit = 0.05F / 32767;
  p.origin_node = {-4, -4, -4};
  for (int x = 0; x < 8; ++x)
    for (int y = 0; y < 8; ++y)
      for (int z = 0; z < 8; ++z) {
        p.distance[p.index(x, y, z)] = static_cast<std::int16_t>(1000 * x + 100 * y + 10 * z);
        p.material[p.index(x, y, z)] = 1;
      }
  const auto units = [&](const Vec3& q) {
    return patch_cell(p, q).value() / static_cast<double>(p.metres_per_unit);
  };
  EXPECT_NEAR(units(p.node_W(0, 0, 0)), 0, 1e-2);
  EXPECT_NEAR(units(p.node_W(7, 7, 7)), 7770, 1e-2);
  EXPECT_NEAR(units(p.node_W(3, 7, 0)), 3700, 1e-2);
  EXPECT_NEAR(units(p.node_W(3, 3, 3) + Vec3(0.005, 0, 0)), 3830, 1e-1);
  EXPECT_FALSE(inside_window(p, p.node_W(7, 7, 7) + Vec3(1e-6, 0, 0)));
  EXPECT_FALSE(inside_window(p, p.node_W(0, 0, 0) - Vec3(0, 1e-6, 0)));
  EXPECT_FALSE(inside_window(p, Vec3(0, 0, std::numeric_limits<double>::quiet_NaN())));
  p.material[p.index(1, 1, 1)] = 0;
  const PatchCell cell = patch_cell(p, p.node_W(0, 0, 0) + Vec3(0.001, 0.001, 0.001));
  EXPECT_EQ(cell.observed, 0x7f);
  EXPECT_EQ(cell.d[7], 0.0F);
  EXPECT_FALSE(cell.complete());
  const Vec3 g =
      patch_cell(p, p.node_W(3, 3, 3) + Vec3(0.002, 0.003, 0.004)).gradient(p.voxel_size);
  EXPECT_NEAR(g.x() / (1000 * static_cast<double>(p.metres_per_unit) / 0.01), 1, 1e-5);
  EXPECT_NEAR(g.y() / (100 * static_cast<double>(p.metres_per_unit) / 0.01), 1, 1e-5);
  EXPECT_NEAR(g.z() / (10 * static_cast<double>(p.metres_per_unit) / 0.01), 1, 1e-5);
}

TEST_F(PatchTest, AllocatesNothing) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in";
  rt_guard::reset();
  {
    rt::Section section;
    copy_patch(map, Vec3::Zero(), 64, *patch);
    patch->checksum = patch_checksum(*patch);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace
}  // namespace tests
