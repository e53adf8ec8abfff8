// A bounded volume holds what the unbounded map holds there, and nothing else.
#include <gtest/gtest.h>

#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

constexpr double kVoxel_m = 0.02;

struct Pair {
  explicit Pair(rt::NonRealtime& nrt, double volume_m)
      : whole(nrt, small_map(kVoxel_m)), bounded(nrt, config(volume_m)) {
    Scene scene = room();
    scene.spheres.push_back({{0.3, 0.1, 1.1}, 0.2});  // crosses the cube's side
    for (int n = 0; n < 12; ++n) {
      const double a = 0.05 * n;
      const Pose X_WC =
          look_at(Vec3(-1.2, 0.1 * n, 1.2), Vec3(-1.2 + std::cos(a), 0.1 * n + std::sin(a), 1.15));
      if (n == 0) first_WC = X_WC;
      const Frame f = render(scene, small_camera(), X_WC, 0.002, 0.02, rt::Random(7, n));
      whole.integrate(f.view(true), X_WC, 1);
      EXPECT_FALSE(bounded.integrate(f.view(true), X_WC, 1).refused);
    }
  }
  static TsdfConfig config(double volume_m) {
    TsdfConfig c = small_map(kVoxel_m);
    c.volume_m = volume_m;
    return c;
  }
  TsdfMap whole, bounded;
  Pose first_WC;
};

TEST(Volume, HoldsWhatTheUnboundedMapHoldsThereAndNothingElse) {
  rt::Startup startup;
  constexpr double kEdge_m = 1.6;  // 10 blocks
  Pair maps(startup.token(), kEdge_m);
  const Vec3 centre_W = maps.first_WC * Vec3(0, 0, kEdge_m / 2);
  // The closed form: whole blocks, the cube's first corner within half a block of where it should
  // be.
  int lo[3], hi[3];
  for (int a = 0; a < 3; ++a) {
    lo[a] = 8 * static_cast<int>(std::floor((centre_W(a) - kEdge_m / 2) / (8 * kVoxel_m) + 0.5));
    hi[a] = lo[a] + 80;
  }
  int in = 0, out = 0, free_in = 0, free_out = 0;
  for (int i = lo[0] - 24; i < hi[0] + 24; ++i)
    for (int j = lo[1] - 24; j < hi[1] + 24; ++j)
      for (int k = lo[2] - 24; k < hi[2] + 24; ++k) {
        const bool inside =
            i >= lo[0] && i < hi[0] && j >= lo[1] && j < hi[1] && k >= lo[2] && k < hi[2];
        const std::uint32_t word = maps.whole.word_at(i, j, k);
        const bool free = maps.whole.free_at(i, j, k);
        ASSERT_EQ(maps.bounded.word_at(i, j, k), inside ? word : 0U) << i << " " << j << " " << k;
        ASSERT_EQ(maps.bounded.free_at(i, j, k), inside && free) << i << " " << j << " " << k;
        (inside ? in : out) += word != 0 ? 1 : 0;
        (inside ? free_in : free_out) += free ? 1 : 0;
      }
  std::printf("  known voxels inside %d, left out %d; free %d, %d\n", in, out, free_in, free_out);
  EXPECT_GT(in, 2000);
  EXPECT_GT(out, 10000);
  EXPECT_GT(free_in, 10000);
  EXPECT_GT(free_out, 10000);
}

TEST(Volume, IsPlacedAgainAfterClear) {
  rt::Startup startup;
  Pair maps(startup.token(), 1.6);
  const std::uint64_t before = maps.bounded.checksum();
  TsdfMap& map = maps.bounded;
  map.clear();
  const Pose X_WC = look_at(Vec3(3, 3, 1.2), Vec3(4, 3, 1.2));
  Scene wall;
  wall.planes = {{{4, 0, 0}, -Vec3::UnitX()}};
  map.integrate(render(wall, small_camera(), X_WC).view(), X_WC, 1);
  EXPECT_NE(map.checksum(), before);
  EXPECT_NE(map.word_at(200, 150, 60), 0U);  // on the wall before the new camera
}

}  // namespace
}  // namespace tests
