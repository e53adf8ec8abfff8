// An object that a person has accepted: a mask as boxes, boxes as an object of the map.
#include <gtest/gtest.h>

#include <iostream>
#include <limits>

#include "perception/objects/given_object.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_objects/table.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

// The true mask of these solids, and its middle.
struct Mask {
  Image<std::uint8_t> image{kW, kH};
  Click at;
};

Mask mask_of(const Rig& rig, const std::set<int>& solids) {
  Mask m;
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u)
      m.image.at(u, v) = solids.contains(rig.image.truth.at(u, v)) ? 1 : 0;
  // A pixel with eight of its kind around it, the first from the top left.
  for (int v = 4; v < kH - 4; ++v)
    for (int u = 4; u < kW - 4; ++u)
      if (m.image.at(u - 4, v) + m.image.at(u + 4, v) + m.image.at(u, v - 4) +
              m.image.at(u, v + 4) ==
          4) {
        m.at = {u, v, true};
        return m;
      }
  return m;
}

GivenObject given(const Rig& rig, const std::set<int>& solids) {
  const Mask m = mask_of(rig, solids);
  return boxes_of(rig.image.view(), m.image.view(), rig.X_WC, m.at);
}

// Of the readings in the boxes and those of the solids, how many are both.
double iou_of(const Rig& rig, const GivenObject& object, const std::set<int>& solids) {
  double both = 0, either = 0;
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) {
      const std::uint16_t mm = rig.image.depth.at(u, v);
      if (mm == 0) continue;
      const bool in = object.contains(rig.X_WC * kCamera.unproject(u, v, 1e-3 * mm));
      const bool is = solids.contains(rig.image.truth.at(u, v));
      both += in && is ? 1 : 0;
      either += in || is ? 1 : 0;
    }
  return both / either;
}

TEST(GivenObjects, AMaskBecomesAFewBoxesThatHoldItAndLittleElse) {
  Rig rig;
  rig.look(kTable, 0, 71);
  for (const std::set<int>& solids : {std::set{1}, std::set{2}, std::set{3}, std::set{1, 2}}) {
    const GivenObject object = given(rig, solids);
    ASSERT_GE(object.count, 1);
    EXPECT_LE(object.count, GivenObject::kMost);
    EXPECT_TRUE(object.contains(object.p_W));
    const double iou = iou_of(rig, object, solids);
    std::cout << solids.size() << " of " << *solids.begin() << " on: " << object.count
              << " boxes, IoU of readings " << iou << "\n";
    EXPECT_GE(iou, 0.8);
  }
}

TEST(GivenObjects, AMaskOfHardlyAnyReadingIsNone) {
  Rig rig;
  rig.look(kTable, 0, 72);
  Image<std::uint8_t> mask(kW, kH);
  EXPECT_EQ(boxes_of(rig.image.view(), mask.view(), rig.X_WC, {}).count, 0);
  for (int u = 100; u < 120; ++u) mask.at(u, 100) = 1;
  EXPECT_EQ(boxes_of(rig.image.view(), mask.view(), rig.X_WC, {100, 100, true}).count, 0);
  const Image<std::uint8_t> small(kW / 2, kH);
  EXPECT_EQ(boxes_of(rig.image.view(), small.view(), rig.X_WC, {}).count, 0);
}

// Then it is followed as one that was touched.
TEST(GivenObjects, ItIsNamedAndFollowed) {
  for (const std::set<int>& solids : {std::set{1}, std::set{2}, std::set{3}}) {
    Rig rig;
    const int what = *solids.begin();
    rig.look(kTable, 0, 73);
    const GivenObject object = given(rig, solids);
    rt_guard::reset();
    {
      rt::Section section;
      rig.objects.segment_given(rig.image.view(), rig.map, rig.X_WC, object);
      rig.objects.fuse(rig.map);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
    ASSERT_EQ(rig.objects.stats().answer, TouchAnswer::kObject)
        << text_of(rig.objects.stats().answer);
    const std::uint8_t id = rig.objects.stats().touched;
    EXPECT_TRUE(rig.objects.objects()[id - 1U].given);
    EXPECT_GE(rig.frame_iou(what, id), 0.8) << what;
    for (int n = 1; n < 30; ++n) {
      rig.look(kTable, n, 73);
      rig.objects.segment(rig.image.view(), rig.map, rig.X_WC, {});
      rig.objects.fuse(rig.map);
    }
    const double fused = rig.read_iou(what, id);
    std::cout << "solid " << what << ": IoU after 30 frames " << fused << "\n";
    EXPECT_GE(fused, 0.85) << what;
    EXPECT_GT(rig.objects.objects()[id - 1U].summary.points, 0);
    EXPECT_EQ(rig.objects.count(), 1);
  }
}

TEST(GivenObjects, WhatCanNotBeNamedSaysWhy) {
  Rig rig;
  rig.look(kTable, 0, 74);
  const GivenObject object = given(rig, {1});
  const auto answer = [&](const GivenObject& asked) {
    rig.objects.segment_given(rig.image.view(), rig.map, rig.X_WC, asked);
    rig.objects.fuse(rig.map);
    return rig.objects.stats().answer;
  };
  GivenObject wrong = object;
  const Vec3 eye = rig.X_WC.translation();
  wrong.p_W = eye - (object.p_W - eye);
  EXPECT_EQ(answer(wrong), TouchAnswer::kOutOfView);
  wrong.p_W = object.p_W + 0.2 * (object.p_W - eye).normalized();
  EXPECT_EQ(answer(wrong), TouchAnswer::kHidden);
  wrong.p_W = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(answer(wrong), TouchAnswer::kOutOfView);
  wrong = object;
  wrong.count = 0;
  EXPECT_EQ(answer(wrong), TouchAnswer::kNoReading) << "no boxes";
  wrong = object;
  for (auto& box_W : wrong.boxes_W) box_W.translate(Vec3(0, 0, 3));
  EXPECT_EQ(answer(wrong), TouchAnswer::kNoReading) << "boxes in the air";
  EXPECT_EQ(rig.objects.count(), 0);
  EXPECT_EQ(answer(object), TouchAnswer::kObject);
  EXPECT_EQ(answer(object), TouchAnswer::kKnown);
  EXPECT_EQ(rig.objects.count(), 1);
  rig.objects.forget(rig.map, 1);
  EXPECT_EQ(rig.objects.count(), 0);
  EXPECT_EQ(answer(object), TouchAnswer::kObject) << "its place is free again";
}

// However near it is, a frame costs no more than a touch looks at.
TEST(GivenObjects, ALargeOneCostsABoundedFrame) {
  Rig rig;
  rig.look(kTable, 0, 75);
  GivenObject object = given(rig, {1});
  object.boxes_W[0] = Eigen::AlignedBox3d(Vec3::Constant(-2), Vec3::Constant(2));
  object.count = 1;
  rig.objects.segment_given(rig.image.view(), rig.map, rig.X_WC, object);
  EXPECT_EQ(rig.objects.stats().answer, TouchAnswer::kObject);
  EXPECT_GT(rig.objects.stats().mask_pixels, kW * kH / 2);
  EXPECT_LE(rig.objects.stats().work, 2U * 36000U);
}

}  // namespace
}  // namespace tests
