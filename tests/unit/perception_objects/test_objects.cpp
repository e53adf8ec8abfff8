// Touched objects in the map: what is fused, what bad masks do to it, what is refused.
#include <gtest/gtest.h>

#include <iostream>

#include "rt/memory/section.hpp"
#include "tests/support/rt_guard.hpp"
#include "tests/unit/perception_objects/table.hpp"

namespace tests {
namespace {

// What a ray cast, a patch and the summary see of an object: the voxels next to its surface.
constexpr double kSurface_m = 0.01;

void frame(Rig& rig, int n, std::uint64_t seed, const std::optional<Vec3>& touched = {},
           const std::vector<Solid>& solids = kTable) {
  rig.look(solids, n, seed);
  rig.objects.segment(rig.image.view(), rig.map, rig.X_WC, touched);
}

// Touches solid `what` in a frame that is already integrated and segmented as nothing.
std::uint8_t touch(Rig& rig, int what) {
  const Vec3 p_W = rig.surface_point(what);
  rig.objects.segment(rig.image.view(), rig.map, rig.X_WC, p_W);
  EXPECT_EQ(rig.objects.stats().answer, TouchAnswer::kObject)
      << text_of(rig.objects.stats().answer);
  return rig.objects.stats().touched;
}

// Empty, dilated by 12 px, or a neighbour's mask.
void spoil(ImageView<std::uint8_t> image, ImageView<const std::uint8_t> truth, std::uint8_t id,
           int neighbour, rt::Random& random) {
  const int kind = static_cast<int>(random.integer(0, 2));
  Image<std::uint8_t> was(kW, kH);
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) was.at(u, v) = image.at(u, v) == id ? 1 : 0;
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) {
      bool in = kind == 2 && truth.at(u, v) == neighbour;
      for (int b = std::max(0, v - 12); kind == 1 && !in && b <= std::min(kH - 1, v + 12); ++b)
        for (int a = std::max(0, u - 12); !in && a <= std::min(kW - 1, u + 12); ++a)
          in = was.at(a, b) != 0 && (a - u) * (a - u) + (b - v) * (b - v) <= 144;
      image.at(u, v) = in ? id : 0;
    }
}

// The map's labels at the true surface of the view against the masks of single frames. In a ray cast, which
// ends up to a voxel before an edge that was seen from one side only, the figure is lower and printed.
TEST(Objects, FusedIsBetterThanAFrameAfterThirty) {
  double fused_sum = 0, single_sum = 0;
  for (const std::uint64_t seed : {5U, 6U}) {
    for (int what = 1; what <= 3; ++what) {
      Rig rig;
      rig.noise = {3, 0.9, 0.03};
      frame(rig, 0, seed);
      const std::uint8_t id = touch(rig, what);
      double single = rig.frame_iou(what, id);
      rig.objects.fuse(rig.map);
      for (int n = 1; n < 30; ++n) {
        frame(rig, n, seed);
        single += rig.frame_iou(what, id);
        rig.objects.fuse(rig.map);
      }
      const double fused = rig.read_iou(what, id);
      std::cout << "solid " << what << ": single frame " << single / 30 << ", fused " << fused
                << ", in the ray cast " << rig.fused_iou(what, id) << "\n";
      EXPECT_GE(fused, 0.95) << what << " seed " << seed;
      fused_sum += fused / 6, single_sum += single / 30 / 6;
    }
  }
  std::cout << "mean: single frame " << single_sum << ", fused " << fused_sum << "\n";
  EXPECT_GT(fused_sum, single_sum);
}

// The aim is 2 %; it is missed in the frames after a wrong one (docs/segmentation.md). The bound here only
// keeps what is reached.
TEST(Objects, OneWrongFrameInFiveChangesFivePercentAtMost) {
  for (const std::uint64_t seed : {11U, 12U}) {
    Rig clean, spoiled;
    frame(clean, 0, seed);
    frame(spoiled, 0, seed);
    const std::uint8_t id = touch(clean, 1);
    ASSERT_EQ(touch(spoiled, 1), id);
    clean.objects.fuse(clean.map);
    spoiled.objects.fuse(spoiled.map);
    rt::Random random(seed);
    double early = 0, worst = 0;
    int wrong = 0;
    for (int n = 1; n <= 60; ++n) {
      frame(clean, n, seed);
      frame(spoiled, n, seed);
      if (random.uniform() < 0.2) {
        spoil(spoiled.objects.label_image(), spoiled.image.truth.view(), id, 2, random);
        ++wrong;
      }
      clean.objects.fuse(clean.map);
      spoiled.objects.fuse(spoiled.map);
      if (n < 10) continue;
      double& most = n < 30 ? early : worst;
      most = std::max(most, change(clean.voxels(id, kSurface_m), spoiled.voxels(id, kSurface_m)));
    }
    std::cout << "seed " << seed << ": " << wrong << " wrong of 60; change at most " << early
              << " in frames 10 to 29, " << worst << " from 30 on; of all labelled voxels "
              << change(clean.voxels(id), spoiled.voxels(id)) << " at the end\n";
    EXPECT_GT(wrong, 6);
    EXPECT_LE(worst, 0.05) << "seed " << seed;
  }
}

TEST(Objects, FiveWrongFramesFirstAreOvercomeWithinFifteen) {
  for (const std::uint64_t seed : {21U, 22U, 23U}) {
    Rig rig;
    rt::Random random(seed);
    std::uint8_t id = 0;
    for (int n = 0; n < 5; ++n) {
      frame(rig, n, seed);
      if (n == 0) id = touch(rig, 1);
      spoil(rig.objects.label_image(), rig.image.truth.view(), id, 2, random);
      rig.objects.fuse(rig.map);
    }
    int needed = -1;
    double fused = 0;
    for (int n = 5; n < 20; ++n) {
      frame(rig, n, seed);
      rig.objects.fuse(rig.map);
      fused = rig.read_iou(1, id);
      if (needed < 0 && fused >= 0.9) needed = n - 4;
    }
    std::cout << "seed " << seed << ": IoU " << fused << " after 15 good frames, 0.9 after "
              << needed << "\n";
    EXPECT_GE(fused, 0.9) << "seed " << seed;
  }
}

TEST(Objects, PushedAwayItLosesItsOldVoxels) {
  const std::uint64_t seed = 31;
  Rig rig;
  frame(rig, 0, seed);
  const std::uint8_t id = touch(rig, 1);
  rig.objects.fuse(rig.map);
  for (int n = 1; n <= 45; ++n) {
    frame(rig, n, seed);
    rig.objects.fuse(rig.map);
  }
  const std::size_t before = rig.voxels(id).size();
  // Gone from one frame to the next.
  const std::vector<Solid> rest{{Vec3(9, 9, 9), Vec3(9.1, 9.1, 9.1), {}}, kTable[1], kTable[2]};
  int gone_after = -1;
  std::size_t left = before;
  for (int n = 46; n < 76; ++n) {
    frame(rig, n, seed, {}, rest);
    rig.objects.fuse(rig.map);
    left = rig.voxels(id).size();
    if (gone_after < 0 && left * 50 < before) gone_after = n - 45;
  }
  std::cout << before << " voxels, " << left << " after 30 frames, below 2 % after " << gone_after
            << "\n";
  EXPECT_GT(before, 1000U);
  EXPECT_LE(left, before / 50);
  // What remains lies in the table's own surface and goes by votes alone.
  for (int n = 76; n < 80; ++n) {
    frame(rig, n, seed, {}, rest);
    rig.objects.fuse(rig.map);
  }
  EXPECT_EQ(rig.voxels(id).size(), 0U);
  EXPECT_EQ(rig.objects.count(), 0);
  EXPECT_EQ(rig.map.label_block_count(), 0);
}

TEST(Objects, PushedSlowlyItIsFollowed) {
  const std::uint64_t seed = 41;
  Rig rig;
  std::vector<Solid> solids = kTable;
  frame(rig, 0, seed);
  const std::uint8_t id = touch(rig, 2);
  rig.objects.fuse(rig.map);
  for (int n = 1; n <= 90; ++n) {
    if (n > 30 && n <= 60) {  // 4 mm a frame to the side
      solids[1].low.x() -= 0.004, solids[1].high.x() -= 0.004;
      solids[1].low.y() -= 0.002, solids[1].high.y() -= 0.002;
    }
    frame(rig, n, seed, {}, solids);
    rig.objects.fuse(rig.map);
  }
  std::size_t old = 0;
  for (const auto& [x, y, z] : rig.voxels(id)) {
    const double px = 0.01 * x, py = 0.01 * y;
    old += px > solids[1].high.x() + 0.03 || py > solids[1].high.y() + 0.03;
  }
  std::cout << "followed " << rig.frame_iou(2, id) << ", voxels left behind " << old << " of "
            << rig.voxels(id).size() << "\n";
  EXPECT_GE(rig.frame_iou(2, id), 0.8);
  EXPECT_LE(old, rig.voxels(id).size() / 50);
}

TEST(Objects, SeveralAtOnceInTurn) {
  const std::uint64_t seed = 51;
  Rig rig;
  std::array<std::uint8_t, 4> id{};
  int n = 0;
  for (int what = 1; what <= 3; ++what) {
    for (int i = 0; i < 5; ++i) {
      frame(rig, n++, seed);
      rig.objects.fuse(rig.map);
    }
    frame(rig, n++, seed);
    id[static_cast<std::size_t>(what)] = touch(rig, what);
    rig.objects.fuse(rig.map);
  }
  for (int i = 0; i < 60; ++i) {
    frame(rig, n++, seed);
    EXPECT_NE(rig.objects.stats().followed, 0);
    rt_guard::reset();
    {
      rt::Section section;
      rig.objects.fuse(rig.map);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
  EXPECT_EQ(rig.objects.count(), 3);
  for (int what = 1; what <= 3; ++what) {
    const std::uint8_t k = id[static_cast<std::size_t>(what)];
    EXPECT_EQ(k, what);
    const double fused = rig.read_iou(what, k);
    const ObjectSummary& s = rig.objects.objects()[k - 1U].summary;
    const Solid& truth = kTable[static_cast<std::size_t>(what - 1)];
    const Vec3 centre = s.X_FO * s.centre_m;
    std::cout << "object " << what << ": fused " << fused << ", centre off "
              << 1000 * (centre - 0.5 * (truth.low + truth.high)).norm() << " mm, extent "
              << 1000 * s.extent_m.transpose() << " mm, colour " << int{s.colour.r} << " "
              << int{s.colour.g} << " " << int{s.colour.b} << "\n";
    EXPECT_GE(fused, 0.95);
    EXPECT_GT(s.points, 20);
    EXPECT_LT((centre - 0.5 * (truth.low + truth.high)).norm(), 0.04);
    EXPECT_LT(std::abs(int{s.colour.r} - int{truth.colour.r}), 12);
  }
  rig.objects.forget(rig.map, id[1]);
  EXPECT_EQ(rig.objects.count(), 2);
  EXPECT_TRUE(rig.voxels(id[1]).empty());
}

TEST(Objects, TouchesAreRefusedWithTheirReason) {
  Rig rig;
  frame(rig, 0, 1);
  const auto answer = [&](const Vec3& p_W) {
    rig.objects.segment(rig.image.view(), rig.map, rig.X_WC, p_W);
    const TouchAnswer a = rig.objects.stats().answer;
    rig.objects.fuse(rig.map);
    return a;
  };
  const Vec3 eye = rig.X_WC.translation();
  EXPECT_EQ(answer(eye + Vec3(0, -1, 0)), TouchAnswer::kOutOfView);
  EXPECT_EQ(answer(Vec3(3, 0, 0)), TouchAnswer::kOutOfView);
  EXPECT_EQ(answer(Vec3::Constant(std::nan(""))), TouchAnswer::kOutOfView);
  const Vec3 p = rig.surface_point(1);
  EXPECT_EQ(answer(p + 0.08 * (p - eye).normalized()), TouchAnswer::kHidden);
  EXPECT_EQ(answer(p - 0.08 * (p - eye).normalized()), TouchAnswer::kMoved);
  EXPECT_EQ(rig.objects.count(), 0);
  EXPECT_EQ(rig.map.label_block_count(), 0);  // nothing touched, nothing held
  EXPECT_EQ(answer(p), TouchAnswer::kObject);
  EXPECT_EQ(answer(p), TouchAnswer::kKnown);
  EXPECT_EQ(rig.objects.stats().touched, 1);
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) rig.image.depth.at(u, v) = 0;
  EXPECT_EQ(answer(p), TouchAnswer::kNoReading);
  EXPECT_EQ(text_of(TouchAnswer::kHidden), "refused: the touched point is hidden from the camera");
}

}  // namespace
}  // namespace tests
