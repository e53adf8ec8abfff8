// Every instruction set against the plain loops: the same map, the same cast, to the last bit.
#include <gtest/gtest.h>

#include <cstring>

#include "perception/raycast/raycast.hpp"
#include "perception/simd/isa.hpp"
#include "perception/tsdf/integrate/band_kernel.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

struct Outcome {
  std::uint64_t map = 0;
  IntegrateStats stats;
  RaycastStats cast;
  std::vector<float> records;
};

// A few frames with colour, noise, holes and flying pixels, and the hinted cast after each.
Outcome run(simd::Isa isa, double voxel, bool range_weight) {
  EXPECT_TRUE(simd::choose(isa));
  rt::Startup startup;
  TsdfConfig config = small_map(voxel);
  config.max_blocks = 20000;
  config.weighting = range_weight ? "range" : "uniform";
  TsdfMap map(startup.token(), config);
  const Intrinsics k{150, 148, 91.3, 66.1, 187, 131};  // no multiple of any vector
  RaycastMaps maps(startup.token(), k.width, k.height);
  Image<float> hint(k.width, k.height);
  Outcome out;
  for (int n = 0; n < 4; ++n) {
    const Pose X =
        look_at(Vec3(-0.8 + 0.02 * n, -0.05 * n, 1.2), Vec3(1.4, 0.1 * n - 0.2, 0.7 + 0.05 * n));
    const Frame f = render(room(), k, X, 0.002, 0.03, rt::Random(4, static_cast<std::uint64_t>(n)));
    out.stats = map.integrate(f.view(true), X, n == 3 ? 2 : 1);
    for (int i = 0; i < k.width * k.height; ++i)
      hint.data()[i] = static_cast<float>(f.depth.data()[i]) * 1e-3F;
    RaycastOptions o;
    o.smooth_normals = false;
    o.hint_depth_m = hint.view();
    o.hinted_only = n % 2 == 0;
    out.cast = raycast(map, k, X, o, maps);
    out.records.insert(out.records.end(), maps.data(),
                       maps.data() + RaycastMaps::kStride * k.width * k.height);
  }
  out.map = map.checksum();
  EXPECT_TRUE(simd::choose("auto"));
  return out;
}

TEST(Isa, EveryOneGivesTheSameMapAndCast) {
  for (const double voxel : {0.01, 0.03}) {
    const bool range_weight = voxel > 0.02;
    const Outcome reference = run(simd::Isa::kScalar, voxel, range_weight);
    EXPECT_GT(reference.stats.voxels_fused, 1000);
    EXPECT_GT(reference.stats.voxels_carved, 100);
    EXPECT_GT(reference.cast.hits, 1000);
    for (const simd::Isa isa : simd::available()) {
      const Outcome o = run(isa, voxel, range_weight);
      EXPECT_EQ(o.map, reference.map) << simd::name_of(isa);
      EXPECT_EQ(o.stats.rays, reference.stats.rays) << simd::name_of(isa);
      EXPECT_EQ(o.stats.voxels_fused, reference.stats.voxels_fused) << simd::name_of(isa);
      EXPECT_EQ(o.stats.voxels_carved, reference.stats.voxels_carved) << simd::name_of(isa);
      EXPECT_EQ(o.cast.hits, reference.cast.hits) << simd::name_of(isa);
      EXPECT_EQ(o.cast.steps, reference.cast.steps) << simd::name_of(isa);
      ASSERT_EQ(o.records.size(), reference.records.size());
      EXPECT_EQ(
          std::memcmp(o.records.data(), reference.records.data(), o.records.size() * sizeof(float)),
          0)
          << simd::name_of(isa);
    }
  }
}

TEST(Isa, NamesAreChosenOrRefused) {
  EXPECT_FALSE(simd::choose("pentium"));
  EXPECT_FALSE(simd::choose(""));
  for (const simd::Isa isa : simd::available()) {
    EXPECT_TRUE(simd::choose(simd::name_of(isa)));
    EXPECT_EQ(simd::chosen(), isa);
  }
  EXPECT_TRUE(simd::choose("auto"));
  EXPECT_EQ(simd::chosen(), simd::available().back());
}

TEST(Isa, BlockKeysComeBackAndSortByCoordinate) {
  rt::Random random(5);
  std::uint64_t before = 0;
  std::array<std::int32_t, 3> last{};
  for (int n = 0; n < 1000; ++n) {
    std::array<std::int32_t, 3> at{};
    for (auto& a : at) a = static_cast<std::int32_t>(random.uniform(-500000, 500000));
    const std::uint64_t key = block_key(at[0], at[1], at[2]);
    for (std::size_t a = 0; a < 3; ++a) EXPECT_EQ(block_key_axis(key, static_cast<int>(a)), at[a]);
    if (n > 0) {
      EXPECT_EQ(before < key, last < at);
    }
    before = key, last = at;
  }
}

}  // namespace
}  // namespace tests
