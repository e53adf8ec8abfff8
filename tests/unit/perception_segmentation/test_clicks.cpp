// Several clicks for one object: what must hold for any clicks, and what clicks mend, on rendered
// tables whose truth is known. The scenes and IoU here share no code with the segmenter.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "perception/segmentation/click_segmenter.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace perception;

constexpr int kW = 240, kH = 180;
const Intrinsics kCamera{210, 210, 119.5, 89.5, kW, kH};

struct Scene {
  Image<Rgb> rgb{kW, kH};
  Image<std::uint16_t> depth{kW, kH};
  Image<std::uint8_t> truth{kW, kH};
};

// A wall 1 m away and two boards 0.15 m before it that touch at column 120; of one colour if
// `alike`, so that nothing parts them. A third board stands alone.
Scene boards(bool alike, rt::Random& random) {
  Scene s;
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) {
      const bool row = v >= 50 && v < 120;
      const int what = row && u >= 70 && u < 120    ? 1
                       : row && u >= 120 && u < 170 ? 2
                       : row && u >= 195 && u < 225 ? 3
                                                    : 0;
      s.truth.at(u, v) = static_cast<std::uint8_t>(what);
      const Rgb colours[] = {{170, 150, 120}, {60, 90, 170}, {170, 60, 70}, {60, 150, 80}};
      const Rgb c = colours[what == 2 && alike ? 1 : what];
      const auto n = [&](int value) {
        return static_cast<std::uint8_t>(value + random.integer(-4, 4));
      };
      s.rgb.at(u, v) = {n(c.r), n(c.g), n(c.b)};
      const double mm = (what != 0 ? 850 : 1000) + 1.2 * random.normal();
      s.depth.at(u, v) = static_cast<std::uint16_t>(mm);
    }
  return s;
}

double iou(const ClickSegmenter& s, const Scene& scene, int what) {
  double both = 0, either = 0;
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) {
      const bool a = s.in(u, v), b = scene.truth.at(u, v) == what;
      both += a && b ? 1 : 0, either += a || b ? 1 : 0;
    }
  return both / either;
}

void show(ClickSegmenter& s, const Scene& scene) {
  s.set_frame(scene.rgb.view(), scene.depth.view(), kCamera, 1);
}

bool same(const ClickSegmenter& a, const ClickSegmenter& b) {
  return std::equal(a.mask().data, a.mask().data + kW * kH, b.mask().data);
}

std::vector<Click> random_clicks(rt::Random& random, int most) {
  std::vector<Click> clicks;
  const auto count = random.integer(1, most);
  for (std::int64_t i = 0; i < count; ++i) {
    const Click k{static_cast<int>(random.integer(0, kW - 1)),
                  static_cast<int>(random.integer(0, kH - 1)), i == 0 || random.integer(0, 1) == 1};
    const bool taken = std::any_of(clicks.begin(), clicks.end(),
                                   [&](const Click& c) { return c.u == k.u && c.v == k.v; });
    if (!taken) clicks.push_back(k);
  }
  return clicks;
}

TEST(Clicks, OneClickIsTheTouch) {
  const std::uint64_t seed = 51;
  std::printf("  seed %llu\n", static_cast<unsigned long long>(seed));
  rt::Random random(seed);
  const Scene scene = boards(false, random);
  ClickSegmenter s(kW, kH);
  TouchSegmenter touch(kW, kH);
  show(s, scene);
  touch.set_frame(scene.rgb.view(), scene.depth.view(), kCamera, 1);
  for (int n = 0; n < 12; ++n) {
    const Click k{static_cast<int>(random.integer(0, kW - 1)),
                  static_cast<int>(random.integer(0, kH - 1)), true};
    const ClickAnswer answer = s.segment({&k, 1});
    EXPECT_EQ(answer == ClickAnswer::kDone, touch.touch(k.u, k.v));
    EXPECT_EQ(s.named_support(), touch.named_support());
    for (int v = 0; v < kH; ++v)
      for (int u = 0; u < kW; ++u) ASSERT_EQ(s.in(u, v), touch.in(u, v)) << u << "," << v;
  }
}

// Whatever is clicked: each click's pixel is on its side; neither the order of all but the first,
// nor repetitions, nor what was asked before changes a bit.
TEST(Clicks, EveryClickOnItsSideInAnyOrder) {
  const std::uint64_t seed = 52;
  std::printf("  seed %llu\n", static_cast<unsigned long long>(seed));
  rt::Random random(seed);
  for (const bool alike : {false, true}) {
    const Scene scene = boards(alike, random);
    ClickSegmenter s(kW, kH), other(kW, kH);
    show(s, scene);
    show(other, scene);
    for (int n = 0; n < 15; ++n) {
      auto clicks = random_clicks(random, 10);
      ASSERT_EQ(s.segment(clicks), ClickAnswer::kDone) << n;
      for (const Click& k : clicks)
        EXPECT_EQ(s.in(k.u, k.v), k.add) << n << ": " << k.u << "," << k.v;
      for (std::size_t i = clicks.size() - 1; i > 1; --i)
        std::swap(
            clicks[i],
            clicks[static_cast<std::size_t>(random.integer(1, static_cast<std::int64_t>(i)))]);
      const Click first = clicks.front(), last = clicks.back();
      clicks.push_back(first);
      clicks.push_back(last);
      ASSERT_EQ(other.segment(clicks), ClickAnswer::kDone);
      EXPECT_TRUE(same(s, other)) << n;
    }
  }
}

TEST(Clicks, WhatCanNotBeMeantIsRefused) {
  rt::Random random(53);
  const Scene scene = boards(false, random);
  ClickSegmenter s(kW, kH);
  show(s, scene);
  const auto ask = [&](std::vector<Click> clicks) {
    const ClickAnswer answer = s.segment(clicks);
    const auto* mask = s.mask().data;
    if (refused(answer)) {
      EXPECT_TRUE(std::all_of(mask, mask + kW * kH, [](std::uint8_t m) { return m == 0; }));
      EXPECT_GT(std::string(reason(answer)).size(), 10U);
    }
    return answer;
  };
  EXPECT_EQ(ask({{90, 80, true}, {100, 80, false}, {100, 80, true}}), ClickAnswer::kContradiction);
  EXPECT_EQ(ask({{90, 80, true}, {90, 80, false}}), ClickAnswer::kContradiction);
  EXPECT_EQ(ask({}), ClickAnswer::kNothingAdded);
  EXPECT_EQ(ask({{90, 80, false}}), ClickAnswer::kNothingAdded);
  for (const auto& [u, v] : {std::pair{-1, 5}, {5, -1}, {kW, 5}, {5, kH}, {1 << 30, -(1 << 30)}}) {
    EXPECT_EQ(ask({{90, 80, true}, {u, v, false}}), ClickAnswer::kOutside);
    EXPECT_EQ(ask({{u, v, true}}), ClickAnswer::kOutside);
  }
  std::vector<Click> many;
  for (int i = 0; i < 33; ++i) many.push_back({10 + i, 10, i == 0});
  EXPECT_EQ(ask(many), ClickAnswer::kTooMany);
  many.pop_back();
  EXPECT_EQ(ask(many), ClickAnswer::kDone);
  EXPECT_FALSE(s.in(-1, 0) || s.in(0, kH));
}

// Nothing parts the two boards but the clicks: the border runs half-way between them.
TEST(Clicks, TakeAwayPartsWhatLooksLikeOne) {
  rt::Random random(54);
  const Scene scene = boards(true, random);
  ClickSegmenter s(kW, kH);
  show(s, scene);
  const std::vector<Click> one{{95, 85, true}};
  ASSERT_EQ(s.segment(one), ClickAnswer::kDone);
  const double before = iou(s, scene, 1);
  EXPECT_LT(before, 0.6) << "the test shows nothing";
  const std::vector<Click> two{{95, 85, true}, {145, 85, false}};
  ASSERT_EQ(s.segment(two), ClickAnswer::kDone);
  std::printf("  IoU %.3f with one click, %.3f with a second\n", before, iou(s, scene, 1));
  EXPECT_GT(iou(s, scene, 1), 0.9);
}

TEST(Clicks, AddJoinsWhatLooksLikeTwo) {
  rt::Random random(55);
  Scene scene = boards(false, random);
  ClickSegmenter s(kW, kH);
  show(s, scene);
  for (int i = 0; i < kW * kH; ++i)
    if (scene.truth.data()[i] != 0) scene.truth.data()[i] = 1;
  const std::vector<Click> one{{95, 85, true}};
  ASSERT_EQ(s.segment(one), ClickAnswer::kDone);
  const double before = iou(s, scene, 1);
  const std::vector<Click> two{{95, 85, true}, {210, 85, true}};
  ASSERT_EQ(s.segment(two), ClickAnswer::kDone);
  std::printf("  IoU %.3f with one click, %.3f with a second\n", before, iou(s, scene, 1));
  EXPECT_LT(before, 0.8) << "the test shows nothing";
  EXPECT_GT(iou(s, scene, 1), 0.93);
}

// A thing 11 mm high on a support of two colours: a colour that much of the support has is no thing
// of its own, or the thing would be joined with all checks of it.
TEST(Clicks, OnASupportOfTwoColours) {
  rt::Random random(57);
  Scene scene = boards(false, random);
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) {
      if (scene.truth.at(u, v) == 0)
        scene.rgb.at(u, v) = (u / 20 + v / 20) % 2 == 0 ? Rgb{40, 150, 60} : Rgb{170, 60, 150};
      scene.depth.at(u, v) =
          static_cast<std::uint16_t>((scene.truth.at(u, v) == 3 ? 989 : 1000) + random.normal());
    }
  ClickSegmenter s(kW, kH);
  show(s, scene);
  const std::vector<Click> one{{210, 85, true}};
  ASSERT_EQ(s.segment(one), ClickAnswer::kDone);
  std::printf("  IoU %.3f with one click\n", iou(s, scene, 3));
  EXPECT_GT(iou(s, scene, 3), 0.9);
}

// Without a reading, at the image's corners, on depth of no use.
TEST(Clicks, WhereThereIsNoDepth) {
  rt::Random random(56);
  Scene scene = boards(false, random);
  for (int v = 70; v < 100; ++v)
    for (int u = 100; u < 112; ++u) scene.depth.at(u, v) = v % 2 == 0 ? 0 : 65535;
  ClickSegmenter s(kW, kH);
  show(s, scene);
  const std::vector<Click> hole{
      {80, 85, true}, {106, 85, true}, {104, 75, true}, {0, 0, false}, {kW - 1, kH - 1, false}};
  EXPECT_EQ(s.segment(hole), ClickAnswer::kDone);
  for (const Click& k : hole) EXPECT_EQ(s.in(k.u, k.v), k.add);
  for (int i = 0; i < kW * kH; ++i)  // of one plane, they are one thing
    if (scene.truth.data()[i] == 2) scene.truth.data()[i] = 1;
  EXPECT_GT(iou(s, scene, 1), 0.85);
  for (const std::uint16_t nothing : {std::uint16_t{0}, std::uint16_t{65535}}) {
    const Image<std::uint16_t> depth(kW, kH, nothing);
    s.set_frame(scene.rgb.view(), depth.view(), kCamera, 1);
    EXPECT_EQ(s.segment(hole), ClickAnswer::kNoDepth);
    EXPECT_FALSE(refused(ClickAnswer::kNoDepth));
    for (const Click& k : hole) EXPECT_EQ(s.in(k.u, k.v), k.add);
  }
  Image<std::uint16_t> noise(kW, kH);
  for (int i = 0; i < kW * kH; ++i) noise.data()[i] = static_cast<std::uint16_t>(random());
  s.set_frame(scene.rgb.view(), noise.view(), kCamera, 1);
  for (int n = 0; n < 5; ++n) {
    const auto clicks = random_clicks(random, 32);
    static_cast<void>(s.segment(clicks));
    for (const Click& k : clicks) EXPECT_EQ(s.in(k.u, k.v), k.add);
  }
}

TEST(Clicks, SmallestImages) {
  ClickSegmenter s(2, 3);
  const Image<Rgb> rgb(2, 3, {1, 2, 3});
  const Image<std::uint16_t> depth(2, 3, 500);
  s.set_frame(rgb.view(), depth.view(), {100, 100, 1, 1, 2, 3}, 1);
  const std::vector<Click> all{{0, 0, true}, {1, 0, false}, {0, 1, false},
                               {1, 1, true}, {0, 2, true},  {1, 2, false}};
  EXPECT_EQ(s.segment(all), ClickAnswer::kDone);
  for (const Click& k : all) EXPECT_EQ(s.in(k.u, k.v), k.add);
}

TEST(Clicks, AllocatesNothing) {
  rt::Random random(57);
  const Scene scene = boards(true, random);
  const auto clicks = random_clicks(random, 32);
  ClickSegmenter s(kW, kH);
  rt_guard::reset();
  {
    const rt::Section section;
    show(s, scene);
    static_cast<void>(s.segment(clicks));
  }
  if (rt_guard::linked()) {
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
}

}  // namespace
