// Labels in the map: the same bytes from every instruction set, where room for them is taken and
// given back, labels in ray cast maps.
#include <gtest/gtest.h>

#include "perception/raycast/raycast.hpp"
#include "perception/simd/isa.hpp"
#include "perception/tsdf/kernels/label_kernel.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

const Intrinsics kWide{150, 148, 91.3, 66.1, 187, 131};  // no multiple of any vector

// 1 on the sphere of table_top(), 2 on its box, 0 elsewhere; every tenth pixel at random, some
// mute.
Image<std::uint8_t> labels_of(const Scene& scene, const Intrinsics& k, const Pose& X_WC,
                              rt::Random& random, double wrong = 0.1) {
  Image<std::uint8_t> out(k.width, k.height);
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u) {
      const Vec3 d = X_WC.linear() * k.unproject(u, v, 1.0);
      const Vec3 p = X_WC.translation() + scene.cast(X_WC.translation(), d).t * d;
      const bool sphere = std::abs((p - scene.spheres[0].centre).norm() - 0.15) < 1e-6;
      const bool box = ((p - scene.boxes[0].lo).array() > -1e-6).all() &&
                       ((scene.boxes[0].hi - p).array() > -1e-6).all();
      std::uint8_t& label = out.at(u, v);
      label = sphere ? 1 : box ? 2 : 0;
      if (random.uniform() < wrong)
        label = random.uniform() < 0.5 ? kNoVote : static_cast<std::uint8_t>(random.integer(0, 40));
    }
  return out;
}

std::uint64_t voted_map(simd::Isa isa) {
  EXPECT_TRUE(simd::choose(isa));
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  rt::Random random(9);
  for (int n = 0; n < 6; ++n) {
    const Pose X = around(n);
    const Frame f = render(table_top(), kWide, X, 0.004, 0.03, rt::Random(3, 77U + n));
    map.integrate(f.view(true), X, 1);
    const Image<std::uint8_t> labels = labels_of(table_top(), kWide, X, random);
    const LabelStats s = map.vote_labels(labels.view(), n == 0 ? 1 : 0);
    EXPECT_FALSE(s.refused);
    EXPECT_GT(s.blocks_voted, 10);
    EXPECT_EQ(s.blocks_refused, 0);
  }
  EXPECT_TRUE(simd::choose("auto"));
  return map.checksum();
}

TEST(Labels, EveryInstructionSetGivesTheSame) {
  const std::uint64_t reference = voted_map(simd::Isa::kScalar);
  for (const simd::Isa isa : simd::available())
    EXPECT_EQ(voted_map(isa), reference) << simd::name_of(isa);
}

TEST(Labels, RoomOnlyWhereSomethingIsLabelled) {
  rt::Startup startup;
  TsdfConfig config = small_map(0.02);
  config.max_label_blocks = 8;
  TsdfMap map(startup.token(), config);
  const Intrinsics k = small_camera();
  Image<std::uint8_t> labels(k.width, k.height);
  EXPECT_TRUE(map.vote_labels(labels.view()).refused);  // no frame yet
  const Pose X = around(0);
  const Frame f = render(table_top(), k, X);
  map.integrate(f.view(), X, 1);
  const std::uint64_t before = map.checksum();
  EXPECT_TRUE(map.vote_labels({labels.data(), 10, 10, 10}).refused);
  rt_guard::reset();
  LabelStats s;
  {
    rt::Section section;
    s = map.vote_labels(labels.view());
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
  EXPECT_FALSE(s.refused);
  EXPECT_EQ(s.blocks_voted, 0);
  EXPECT_EQ(map.label_block_count(), 0);
  EXPECT_EQ(map.checksum(), before);
  // More than there is room for: what does not fit is counted, the rest is kept.
  rt::Random random(1);
  const Image<std::uint8_t> all = labels_of(table_top(), k, X, random, 0);
  s = map.vote_labels(all.view());
  EXPECT_EQ(s.blocks_new, 8);
  EXPECT_GT(s.blocks_refused, 0);
  EXPECT_EQ(map.label_block_count(), 8);
  map.forget_label(1);
  map.forget_label(2);
  EXPECT_EQ(map.label_block_count(), 0);
  EXPECT_EQ(map.checksum(), before);
  s = map.vote_labels(all.view());
  EXPECT_EQ(map.label_block_count(), 8);
  map.clear_region(Eigen::AlignedBox3d(Vec3(-2, -2, -2), Vec3(2, 2, 2)));
  EXPECT_EQ(map.label_block_count(), 0);
  EXPECT_TRUE(map.vote_labels(all.view()).refused);  // its blocks may have gone
  map.clear();
  EXPECT_EQ(map.label_block_count(), 0);
}

TEST(Labels, InRayCastMaps) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k = kinect2().subsampled(2);
  RaycastMaps maps(startup.token(), k.width, k.height);
  rt::Random random(4);
  for (int n = 0; n < 8; ++n) {
    const Pose X = around(n);
    map.integrate(render(table_top(), k, X).view(), X, 1);
    const Image<std::uint8_t> labels = labels_of(table_top(), k, X, random, 0);
    map.vote_labels(labels.view());
  }
  const Pose X = around(30);
  RaycastOptions o;
  o.labels = true;
  raycast(map, k, X, o, maps);
  const Image<std::uint8_t> truth = labels_of(table_top(), k, X, random, 0);
  int hits = 0, right = 0, labelled = 0;
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u) {
      if (!maps.hit(u, v)) {
        EXPECT_EQ(maps.labels().at(u, v), 0);
        continue;
      }
      ++hits;
      right += maps.labels().at(u, v) == truth.at(u, v);
      labelled += truth.at(u, v) != 0;
    }
  std::cout << right << " of " << hits << " pixels right, " << labelled << " on an object\n";
  EXPECT_GT(labelled, 500);
  EXPECT_GT(right, 0.97 * hits);
}

}  // namespace
}  // namespace tests
