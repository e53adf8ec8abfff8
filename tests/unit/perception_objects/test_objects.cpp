// Touched objects in the map: what is fused, what bad masks do to it, what is refused.
#include <gtest/gtest.h>

#include <bit>
#include <iostream>
#include <set>

#include "rt/memory/section.hpp"
#include "tests/support/whole.hpp"
#include "tests/unit/perception_objects/table.hpp"
#include "tools/measure/support/rt_guard.hpp"

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

// The map's labels at the true surface of the view against the masks of single frames. In a ray
// cast, which ends up to a voxel before an edge that was seen from one side only, the figure is
// lower and printed.
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
      EXPECT_GT(fused, single / 30) << what << " seed " << seed;
      fused_sum += fused / 6, single_sum += single / 30 / 6;
    }
  }
  std::cout << "mean: single frame " << single_sum << ", fused " << fused_sum << "\n";
  EXPECT_GT(fused_sum, single_sum);
}

// Two percent from frame 30 on, but for three seeds of these eight: three or four of their first
// six masks are wrong, and what those name beside the object's foot stays (docs/segmentation.md,
// "Not before frame 30, and not always"). A further miss fails, and so does one that is mended:
// then it is to be taken off this list. Of the frames before, there is no aim: .03 (.13 of the
// three) is what they keep to, and more would be worse than it was.
TEST(Objects, OneWrongFrameInFiveChangesTwoPercentAtMost) {
  const std::set<std::uint64_t> kMissed{14, 15, 16};
  for (const std::uint64_t seed :
       whole_or<std::uint64_t>({11, 12, 13, 14, 15, 16, 17, 18}, {0, 3, 6})) {
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
    EXPECT_EQ(worst > 0.02, kMissed.contains(seed)) << "seed " << seed << ": " << worst;
    EXPECT_LE(worst, 0.08) << "seed " << seed << ": not more than was known";
    EXPECT_GT(early, 0.002) << "wrong masks do change something, seed " << seed;
    EXPECT_LE(early, kMissed.contains(seed) ? 0.13 : 0.03) << "frames 10 to 29, seed " << seed;
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

// What a frame shows of an object does not hang on its own mask: every second one is wrong.
TEST(Objects, TheImageOfAFrameStandsWrongMasks) {
  for (const std::uint64_t seed : {61U, 62U}) {
    Rig rig;
    rt::Random random(seed);
    frame(rig, 0, seed);
    const std::uint8_t id = touch(rig, 1);
    rig.objects.fuse(rig.map);
    Image<std::uint8_t> drawn(kW, kH);
    double worst = 1, mask_sum = 0, drawn_sum = 0;
    for (int n = 1; n <= 40; ++n) {
      frame(rig, n, seed);
      if (n > 20 && n % 2 == 0)
        spoil(rig.objects.label_image(), rig.image.truth.view(), id, 2, random);
      const double mask = rig.frame_iou(1, id);
      rig.objects.fuse(rig.map);
      if (n <= 20) continue;
      rig.objects.draw(rig.image.view(), rig.map, rig.X_WC, 1, drawn.view());
      const double shown = rig.iou(1, id, drawn.view());
      worst = std::min(worst, shown);
      mask_sum += mask / 20, drawn_sum += shown / 20;
    }
    std::cout << "seed " << seed << ": masks " << mask_sum << ", drawn " << drawn_sum
              << ", at least " << worst << "\n";
    EXPECT_LT(mask_sum, 0.8) << "seed " << seed;
    EXPECT_GE(worst, 0.95) << "seed " << seed;
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
  EXPECT_EQ(left, 0U);
  EXPECT_EQ(rig.objects.count(), 0);
  EXPECT_EQ(rig.map.label_block_count(), 0);
}

// Solid 2, to the side by `step_m` a frame, 120 mm in all.
void pushed(double step_m) {
  const std::uint64_t seed = 41;
  Rig rig;
  std::vector<Solid> solids = kTable;
  frame(rig, 0, seed);
  const std::uint8_t id = touch(rig, 2);
  rig.objects.fuse(rig.map);
  for (int n = 1; n <= 90; ++n) {
    if (n > 30 && n <= 30 + static_cast<int>(0.12 / step_m + 0.5)) {
      for (Vec3* corner : {&solids[1].low, &solids[1].high})
        *corner -= Vec3(step_m, 0.5 * step_m, 0);
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

// What hides an object is not its absence, and what stands in its place later is not it.
TEST(Objects, HiddenItIsKept) {
  const std::uint64_t seed = 33;
  Rig rig;
  frame(rig, 0, seed);
  const std::uint8_t id = touch(rig, 1);
  rig.objects.fuse(rig.map);
  for (int n = 1; n <= 20; ++n) {
    frame(rig, n, seed);
    rig.objects.fuse(rig.map);
  }
  const std::size_t before = rig.voxels(id, kSurface_m).size();
  std::vector<Solid> screened = kTable;
  screened.push_back({{-0.5, -0.3, 0}, {0.3, -0.28, 0.5}, {120, 90, 60}});
  for (int n = 21; n < 61; ++n) {
    frame(rig, n, seed, {}, screened);
    rig.objects.fuse(rig.map);
  }
  const std::size_t after = rig.voxels(id, kSurface_m).size();
  std::cout << before << " voxels, " << after << " after 40 frames behind a screen\n";
  ASSERT_EQ(rig.objects.count(), 1);
  EXPECT_GE(after * 10, before * 9);
  for (int n = 61; n < 71; ++n) {
    frame(rig, n, seed);
    rig.objects.fuse(rig.map);
  }
  EXPECT_GE(rig.read_iou(1, id), 0.95);
}

// Contradictions are held back, but not for ever: several in a row are what there is to see.
TEST(Objects, AMaskThatContradictsTheMapWaitsForOthers) {
  const std::uint64_t seed = 35;
  Rig rig;
  const ObjectsConfig config = Rig::on();
  frame(rig, 0, seed);
  const std::uint8_t id = touch(rig, 1);
  rig.objects.fuse(rig.map);
  for (int n = 1; n <= 15; ++n) {
    frame(rig, n, seed);
    rig.objects.fuse(rig.map);
    EXPECT_FALSE(rig.objects.stats().withheld) << n;
  }
  EXPECT_GE(rig.objects.stats().agreement, 0.9F);
  // From now on half of it is said to be the whole.
  const auto halve = [&] {
    double su = 0, m = 0;
    for (int v = 0; v < kH; ++v)
      for (int u = 0; u < kW; ++u)
        if (rig.objects.label_image().at(u, v) == id) su += u, m += 1;
    for (int v = 0; v < kH; ++v)
      for (int u = static_cast<int>(su / m); u < kW; ++u)
        if (rig.objects.label_image().at(u, v) == id) rig.objects.label_image().at(u, v) = 0;
  };
  const Voxels before = rig.voxels(id, kSurface_m);
  for (int n = 1; n <= 6; ++n) {
    frame(rig, 15 + n, seed);
    halve();
    rig.objects.fuse(rig.map);
    EXPECT_EQ(rig.objects.stats().withheld, n < config.held_masks) << n;
    if (n == config.held_masks - 1) {
      EXPECT_LE(change(before, rig.voxels(id, kSurface_m)), 0.03) << "nothing of them was fused";
    }
  }
  // One that agrees again ends the row.
  frame(rig, 22, seed);
  rig.objects.fuse(rig.map);
  EXPECT_FALSE(rig.objects.stats().withheld);
  frame(rig, 23, seed);
  halve();
  rig.objects.fuse(rig.map);
  EXPECT_TRUE(rig.objects.stats().withheld);
}

TEST(Objects, PushedSlowlyItIsFollowed) { pushed(0.004); }
// 12 mm a frame, 0.36 m/s: the agreement falls with each frame, but new ground contradicts nothing.
TEST(Objects, PushedFastItIsFollowed) { pushed(0.012); }

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
  int shared = 0, masks = 0;
  for (int i = 0; i < 60; ++i) {
    rig.look(kTable, n++, seed);
    rt_guard::reset();
    {
      rt::Section section;
      rig.objects.segment(rig.image.view(), rig.map, rig.X_WC, {});
      rig.objects.fuse(rig.map);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
    EXPECT_NE(rig.objects.stats().followed, 0);
    if (i < 30) continue;
    const int found = std::popcount(rig.objects.stats().with_mask);
    masks += found;
    shared += found > 1 ? 1 : 0;
  }
  std::cout << "last 30 frames: " << masks << " masks, " << shared << " frames with several\n";
  EXPECT_GE(masks, 40);
  EXPECT_GE(shared, 10);
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
  EXPECT_EQ(answer(Vec3(-0.02, -0.15, 0)), TouchAnswer::kSupport);
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
