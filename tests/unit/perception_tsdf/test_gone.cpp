// What stood in the map and is seen through is forgotten within ten frames, however long it stood;
// where there is no reading nothing is learned.
#include <gtest/gtest.h>

#include "perception/simd/isa.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "tests/unit/perception_tsdf/dense_reference.hpp"

namespace tests {
namespace {

constexpr int kStood = 60, kSeenFree = 10;  // frames

// A floor that is seen at a grazing angle, a wall, and what stands on the floor before it.
Scene floor_and_wall(bool wall = true) {
  Scene s;
  s.planes = {{{0, 0, -0.3}, Vec3::UnitZ()}};
  if (wall) s.planes.push_back({{2.5, 0, 0}, -Vec3::UnitX()});
  return s;
}
Scene::Box thing() { return {{0.5, -0.15, -0.3}, {0.7, 0.15, 0.0}}; }

Pose eye(int n) {
  return look_at(Vec3(-0.7, 0.02 * std::sin(1.1 * n), 0.02 * std::cos(0.8 * n)),
                 Vec3(0.6, 0, -0.15));
}

struct Rig {
  rt::Startup startup;
  TsdfConfig config;
  TsdfMap map;
  Intrinsics k{182.5, 182.5, 127.5, 105.5, 256, 212};
  int frame = 0;

  explicit Rig(double voxel, bool follow = true)
      : config(small_map(voxel)), map(startup.token(), [&] {
          config.follow = follow;
          return config;
        }()) {}
  void see(const Scene& scene, int frames, bool masked = false) {
    Image<std::uint8_t> all(k.width, k.height);
    std::fill_n(all.data(), k.width * k.height, std::uint8_t{1});
    for (int n = 0; n < frames; ++n, ++frame) {
      const Frame f =
          render(scene, k, eye(frame), 0.002, 0, rt::Random(5, static_cast<std::uint64_t>(frame)));
      FrameView view = f.view();
      if (masked) view.moving = {all.data(), k.width, k.height, k.width};
      ASSERT_FALSE(map.integrate(view, eye(frame), 1).refused);
    }
  }
  // Vertices of the mesh that are the thing's, and no surface's of `now`.
  [[nodiscard]] int ghosts(const Scene& now) {
    const Scene::Box b = thing();
    int n = 0;
    for (const auto& vertex : extract_mesh(startup.token(), map).vertices_W) {
      const Vec3 p = vertex.cast<double>();
      const bool there = ((p - b.lo).array() > -0.05).all() && ((b.hi - p).array() > -0.05).all();
      n += there && std::abs(now.distance(p)) > 0.03 ? 1 : 0;
    }
    return n;
  }
};

TEST(Gone, TenFramesAfterItIsSeenFree) {
  for (const double voxel : {0.01, 0.02}) {
    for (const bool masked : {false, true}) {  // what moves behind it is a way through as well
      Rig rig(voxel);
      Scene with = floor_and_wall(), without = floor_and_wall();
      with.boxes = {thing()};
      rig.see(with, kStood);
      EXPECT_GT(rig.ghosts(without), 100);
      rig.see(without, kSeenFree, masked);
      EXPECT_EQ(rig.ghosts(without), 0) << "voxel " << voxel << (masked ? ", masked" : "");
    }
  }
}

// The rule for a background without readings: a place is free when a reading lies behind it, and
// not before.
TEST(Gone, WithoutAReadingNothingIsLearned) {
  Rig rig(0.02);
  Scene with = floor_and_wall(), nothing;
  with.boxes = {thing()};
  rig.see(with, kStood);
  const int before = rig.ghosts(floor_and_wall());
  std::vector<std::uint32_t> words;
  const auto each = [&](auto&& use) {
    for (int i = 20; i < 40; ++i)
      for (int j = -12; j < 12; ++j)
        for (int l = -20; l < 4; ++l) use(rig.map.word_at(i, j, l));
  };
  each([&](std::uint32_t w) { words.push_back(w); });
  rig.see(nothing, 100);
  std::size_t n = 0, changed = 0;
  each([&](std::uint32_t w) { changed += w != words[n++] ? 1 : 0; });
  EXPECT_EQ(changed, 0U);
  EXPECT_EQ(rig.ghosts(floor_and_wall()), before);
  rig.see(floor_and_wall(), kSeenFree);
  EXPECT_EQ(rig.ghosts(floor_and_wall()), 0);
}

// Word for word, where what stood for longer than is remembered goes, before a wall and before a
// grazing floor; with every instruction set.
void same_words_as_dense() {
  Rig rig(0.02, false);
  DepthPyramid pixels(rig.startup.token());
  constexpr int kHalf = 36;
  DenseReference dense(-kHalf, 2 * kHalf, rig.config);
  const Intrinsics& k = rig.k;
  Scene with = floor_and_wall();
  with.boxes = {thing()};
  for (int n = 0; n < 36; ++n) {
    const Frame f = render(n < 26 ? with : floor_and_wall(), k, eye(n), 0.002, 0.01,
                           rt::Random(6, static_cast<std::uint64_t>(n)));
    ASSERT_FALSE(rig.map.integrate(f.view(), eye(n), 1).refused);
    const double reach = std::min(1.0, 2.5 * rig.config.voxel_size_m / rig.map.truncation());
    pixels.build(f.depth.view(), {0.2F, 5.0F, 0.04F, 0.02F, static_cast<float>(k.fx),
                                  static_cast<float>(k.fy), static_cast<float>(k.cx),
                                  static_cast<float>(k.cy), static_cast<float>(reach), false});
    dense.integrate(k, pixels.pixels(), eye(n), [&](int i, int j, int l) {
      return rig.map.find_block({i >> 3, j >> 3, l >> 3}) != TsdfMap::kNoBlock;
    });
  }
  for (int i = -kHalf; i < kHalf; ++i)
    for (int j = -kHalf; j < kHalf; ++j)
      for (int l = -kHalf; l < kHalf; ++l) {
        const auto& want = dense.at(i, j, l);
        ASSERT_EQ(rig.map.word_at(i, j, l), want.w == 0 ? 0U : TsdfMap::make_word(want.d, want.w))
            << "node " << i << " " << j << " " << l;
      }
  EXPECT_GT(dense.forgotten, 1000) << "voxels that counted for more when they were seen through";
  EXPECT_GT(dense.contradicted, 50) << "solid voxels far before a surface, inside its band";
}

TEST(Gone, SameWordsAsADenseIntegrator) {
  for (const simd::Isa isa : simd::available()) {
    ASSERT_TRUE(simd::choose(isa));
    same_words_as_dense();
  }
  EXPECT_TRUE(simd::choose("auto"));
}

}  // namespace
}  // namespace tests
