// The votes of whole label images against a slow reference: random scenes, poses and images, some
// of them nonsense, by every instruction set.
#include <gtest/gtest.h>

#include "perception/simd/isa.hpp"
#include "tests/support/label_oracle.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

const Intrinsics kCamera{100, 98, 55.2, 41.7, 109, 83};

Scene random_scene(rt::Random& random) {
  Scene s = table_top();
  s.spheres[0].centre += Vec3(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), 0.05);
  for (int i = 0; i < 2; ++i) {
    const Vec3 lo(random.uniform(-0.2, 0.2), random.uniform(-0.4, 0.2), random.uniform(-0.3, 0.1));
    s.boxes.push_back({lo, lo + Vec3(random.uniform(0.04, 0.2), random.uniform(0.04, 0.2),
                                     random.uniform(0.04, 0.2))});
  }
  return s;
}

// Rectangles of random labels on background, and single pixels that say anything.
Image<std::uint8_t> random_labels(rt::Random& random) {
  Image<std::uint8_t> out(kCamera.width, kCamera.height);
  const auto rectangles = random.integer(0, 3);
  for (std::int64_t i = 0; i < rectangles; ++i) {
    const int u = static_cast<int>(random.integer(0, 80)),
              v = static_cast<int>(random.integer(0, 60));
    const int w = static_cast<int>(random.integer(5, 50)),
              h = static_cast<int>(random.integer(5, 50));
    const auto label =
        static_cast<std::uint8_t>(random.uniform() < 0.2 ? kNoVote : random.integer(0, 4));
    for (int y = v; y < std::min(v + h, kCamera.height); ++y)
      for (int x = u; x < std::min(u + w, kCamera.width); ++x) out.at(x, y) = label;
  }
  for (int i = 0; i < 60; ++i)
    out.at(static_cast<int>(random.integer(0, kCamera.width - 1)),
           static_cast<int>(random.integer(0, kCamera.height - 1))) =
        static_cast<std::uint8_t>(random.integer(0, 255));
  return out;
}

TEST(LabelOracle, EveryVoxelOfRandomRuns) {
  std::size_t compared = 0, labelled = 0, doubtful = 0;
  const auto sets = simd::available();
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    ASSERT_TRUE(simd::choose(sets[seed % sets.size()]));
    rt::Random random(seed, 71);
    rt::Startup startup;
    TsdfConfig config = small_map(0.02);
    TsdfMap map(startup.token(), config);
    const double truncation = config.effective_truncation();
    LabelOracle oracle({0.02, config.min_depth_m, config.max_depth_m, config.edge_base_m,
                        config.edge_per_m, std::min(1.0, 2.5 * 0.02 / truncation)});
    Scene scene = random_scene(random);
    const int first = static_cast<int>(random.integer(0, 100));
    for (int n = 0; n < 10; ++n) {
      if (n == 6) scene.boxes.pop_back();  // something goes
      const Pose X = around(first + n / 2);
      const Frame f = render(scene, kCamera, X, 0.003, 0.03, rt::Random(seed, 100U + n));
      ASSERT_FALSE(map.integrate(f.view(), X, 1).refused);
      const Image<std::uint8_t> labels = random_labels(random);
      const auto fresh =
          static_cast<std::uint8_t>(random.uniform() < 0.3 ? random.integer(1, 4) : 0);
      const LabelStats s = map.vote_labels(labels.view(), fresh);
      ASSERT_FALSE(s.refused || s.blocks_refused > 0);
      oracle.vote(map, kCamera, f.depth.view(), X, labels.view(), fresh);
      std::size_t held = 0, wrong = 0;
      map.for_each_block([&](std::int32_t b, BlockCoord at) {
        const auto expected = oracle.blocks().find({at.x, at.y, at.z});
        const LabelVoxel* got = map.block_labels(b);
        ASSERT_EQ(got != nullptr, expected != oracle.blocks().end())
            << "seed " << seed << " frame " << n << " block " << at.x << " " << at.y << " " << at.z;
        if (got == nullptr) return;
        ++held;
        for (std::size_t i = 0; i < 512; ++i) {
          const LabelOracle::Voxel& e = expected->second[i];
          ++compared;
          labelled += e.label > 0;
          doubtful += !e.sure;
          if (e.sure) wrong += got[i].label != e.label || got[i].weight != e.weight;
        }
      });
      ASSERT_EQ(wrong, 0U) << "seed " << seed << " frame " << n;
      ASSERT_EQ(held, oracle.blocks().size());
    }
  }
  EXPECT_TRUE(simd::choose("auto"));
  std::cout << compared << " voxels, " << labelled << " labelled, " << doubtful << " in doubt\n";
  EXPECT_GT(labelled, 20000U);
  EXPECT_LT(doubtful, compared / 50);
}

}  // namespace
}  // namespace tests
