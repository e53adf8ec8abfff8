// Pixels without colour over the link: exactly these come back without, and none of their
// neighbours is darker for it.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "drivers/codec/colour_mask.hpp"
#include "drivers/link/frame_codec.hpp"
#include "perception/geometry/no_colour.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace {

using drivers::EncodedFrame;
using drivers::FrameCodecScratch;
using drivers::FrameStatus;
using perception::has_colour;
using perception::kNoColour;
using perception::Rgb;
using perception::RgbdFrame;

rt::Startup startup;
using Bytes = std::vector<std::uint8_t>;

struct Picture {
  int w = 0, h = 0;
  std::vector<Rgb> rgb;
  std::vector<std::uint16_t> depth;
  [[nodiscard]] perception::ImageView<Rgb> view() { return {rgb.data(), w, h, w}; }
};

// Holes of depth, most of which have no colour, and hidden strips; `noise`: any pixel either way.
Picture random_picture(rt::Random& random, bool noise) {
  Picture p;
  p.w = static_cast<int>(random.integer(1, 80)), p.h = static_cast<int>(random.integer(1, 60));
  for (int n = 0; n < p.w * p.h; ++n) {
    const bool hole = noise ? random.uniform() < 0.5 : (n / 7) % 11 == 0;
    const bool none = noise ? random.uniform() < 0.5 : hole || n % p.w < p.w / 5;
    p.depth.push_back(hole ? 0 : 1500);
    p.rgb.push_back(none ? kNoColour : Rgb{200, 100, 50});
  }
  return p;
}

Bytes mask_of(Picture& p, bool with_depth) {
  Bytes out(drivers::kMostColourMaskBytes);
  const auto depth =
      with_depth ? std::span<const std::uint16_t>(p.depth) : std::span<const std::uint16_t>{};
  out.resize(drivers::write_colour_mask(
      p.view(), depth, std::span<std::uint8_t, drivers::kMostColourMaskBytes>(out)));
  if (!out.empty()) out.insert(out.begin(), {0xff, 0xd8});  // as it stands in a JPEG
  return out;
}

TEST(ColourMask, ExactlyThesePixelsComeBackWithout) {
  std::printf("  seed 31\n");
  rt::Random random(31);
  int runs = 0, bits = 0;
  for (int round = 0; round < 400; ++round) {
    Picture p = random_picture(random, round % 2 == 0);
    const bool with_depth = round % 3 != 0;
    const Bytes mask = mask_of(p, with_depth);
    const bool lacks = std::find(p.rgb.begin(), p.rgb.end(), kNoColour) != p.rgb.end();
    ASSERT_EQ(mask.empty(), !lacks);
    if (!mask.empty()) (mask[10] == 1 ? runs : bits)++;
    Picture back = p;
    std::fill(back.rgb.begin(), back.rgb.end(), Rgb{9, 9, 9});
    ASSERT_TRUE(drivers::apply_colour_mask(
        mask,
        with_depth ? std::span<const std::uint16_t>(p.depth) : std::span<const std::uint16_t>{},
        back.view()));
    for (std::size_t n = 0; n < p.rgb.size(); ++n)
      ASSERT_EQ(has_colour(back.rgb[n]), has_colour(p.rgb[n])) << "round " << round;
  }
  EXPECT_GT(runs, 100);
  EXPECT_GT(bits, 50);
}

TEST(ColourMask, TheLargestImageFitsWhateverItHolds) {
  rt::Random random(32);
  Picture p;
  p.w = RgbdFrame::kMaxWidth, p.h = RgbdFrame::kMaxHeight;
  for (std::size_t n = 0; n < RgbdFrame::kMaxPixels; ++n) {
    p.rgb.push_back(n % 2 == 0 ? kNoColour : Rgb{1, 1, 1});
    p.depth.push_back(static_cast<std::uint16_t>(random() & 1U));
  }
  const Bytes mask = mask_of(p, false);
  EXPECT_EQ(mask.size(), drivers::kMostColourMaskBytes + 2);
  EXPECT_LT(mask.size(), 65535U) << "the length of a segment is 16 bits";
  Picture back = p;
  std::fill(back.rgb.begin(), back.rgb.end(), Rgb{9, 9, 9});
  ASSERT_TRUE(drivers::apply_colour_mask(mask, {}, back.view()));
  for (std::size_t n = 0; n < p.rgb.size(); ++n)
    ASSERT_EQ(has_colour(back.rgb[n]), has_colour(p.rgb[n]));
}

TEST(ColourMask, WhatIsNotOneValueAPixelIsRefused) {
  std::printf("  seed 33\n");
  rt::Random random(33);
  int refused = 0, taken = 0;
  for (int round = 0; round < 4000; ++round) {
    Picture p = random_picture(random, round % 2 == 0);
    Bytes mask = mask_of(p, true);
    if (mask.size() < 13) continue;
    const auto last = static_cast<std::int64_t>(mask.size()) - 1;
    const auto at = static_cast<std::size_t>(random.integer(10, last));
    if (round % 4 == 3) {
      mask.resize(at);  // the segment's length says more than there is
    } else {
      mask[at] = static_cast<std::uint8_t>(random());
    }
    // A frame round what may be written.
    std::vector<Rgb> guarded(p.rgb.size() + 2, Rgb{1, 2, 3});
    (drivers::apply_colour_mask(mask, p.depth, {guarded.data() + 1, p.w, p.h, p.w}) ? taken
                                                                                    : refused)++;
    ASSERT_EQ(guarded.front(), (Rgb{1, 2, 3}));
    ASSERT_EQ(guarded.back(), (Rgb{1, 2, 3}));
  }
  std::printf("  %d refused, %d taken\n", refused, taken);
  EXPECT_GT(refused, 500);
  Picture p{4, 1, std::vector<Rgb>(4, Rgb{9, 9, 9}), std::vector<std::uint16_t>(4, 1000)};
  const auto with = [&](Bytes body) {
    Bytes b{0xff, 0xd8, 0xff, 0xfe, 0, static_cast<std::uint8_t>(6 + body.size()),
            'T',  'N',  'C',  '1'};
    b.insert(b.end(), body.begin(), body.end());
    return drivers::apply_colour_mask(b, p.depth, p.view());
  };
  EXPECT_TRUE(with({1, 1, 2, 1}));
  EXPECT_EQ(p.rgb, (std::vector<Rgb>{{9, 9, 9}, kNoColour, kNoColour, {9, 9, 9}}));
  EXPECT_TRUE(with({1, 0, 4}));
  EXPECT_FALSE(with({1, 1, 2})) << "too short";
  EXPECT_FALSE(with({1, 1, 2, 2})) << "too long";
  EXPECT_FALSE(with({1, 1, 0, 3})) << "an empty run";
  EXPECT_FALSE(with({1, 4, 0})) << "something behind";
  EXPECT_FALSE(with({1, 0xff, 0xff, 0xff, 0xff, 1})) << "no end";
  EXPECT_TRUE(with({2, 0x0f}));
  EXPECT_FALSE(with({2, 0x1f})) << "a bit of no pixel";
  EXPECT_FALSE(with({2, 1, 1}));
  EXPECT_FALSE(with({3, 1}));
}

// A wall with a strip, a hole and single pixels without colour.
void paint(RgbdFrame& f, bool holes) {
  f.intrinsics = {300, 300, 99.5, 74.5, 200, 150};
  f.has_colour = true;
  for (int v = 0; v < 150; ++v) {
    for (int u = 0; u < 200; ++u) {
      const bool hole = u > 120 && u < 150 && v > 40 && v < 90;
      const bool strip = u > 50 && u < 71;
      f.depth().at(u, v) = hole ? 0 : 1200;
      f.rgb().at(u, v) = {static_cast<std::uint8_t>(180 + v / 10), 150,
                          static_cast<std::uint8_t>(90 + u / 10)};
      if (holes && (hole || strip || (u % 23 == 3 && v % 17 == 5))) f.rgb().at(u, v) = kNoColour;
    }
  }
}

TEST(ColourMask, AFrameKeepsItAndItsNeighboursTheirColours) {
  const auto full = std::make_unique<RgbdFrame>(), holed = std::make_unique<RgbdFrame>(),
             back = std::make_unique<RgbdFrame>();
  const auto encoded = std::make_unique<EncodedFrame>();
  paint(*full, false);
  paint(*holed, true);
  for (const bool half : {true, false}) {
    FrameCodecScratch scratch(startup.token(), {.quality = 80, .half = half});
    ASSERT_EQ(encode(*full, rt::Box::kRobot, true, scratch, *encoded), FrameStatus::kOk);
    const std::uint32_t before = encoded->colour_size;
    ASSERT_EQ(encode(*holed, rt::Box::kRobot, true, scratch, *encoded), FrameStatus::kOk);
    std::printf("  %s: %u bytes with all colours, %u with the mask\n", half ? "half" : "full",
                before, encoded->colour_size);
    ASSERT_EQ(decode(*encoded, rt::Time{}, scratch, *back), FrameStatus::kOk);
    int worst = 0;
    for (std::size_t n = 0; n < 200 * 150; ++n) {
      ASSERT_EQ(has_colour(back->colour[n]), has_colour(holed->colour[n])) << n;
      if (!has_colour(back->colour[n])) continue;
      const Rgb a = back->colour[n], b = full->colour[n];
      worst = std::max({worst, std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)});
    }
    EXPECT_LE(worst, 8) << "quality 80";
  }
}

TEST(ColourMask, RealBlackIsAColourThatComesBack) {
  const auto frame = std::make_unique<RgbdFrame>(), back = std::make_unique<RgbdFrame>();
  const auto encoded = std::make_unique<EncodedFrame>();
  paint(*frame, false);
  for (std::size_t n = 0; n < 200 * 150; ++n) frame->colour[n] = perception::kBlack;
  FrameCodecScratch scratch(startup.token(), {});
  ASSERT_EQ(encode(*frame, rt::Box::kRobot, true, scratch, *encoded), FrameStatus::kOk);
  ASSERT_EQ(decode(*encoded, rt::Time{}, scratch, *back), FrameStatus::kOk);
  for (std::size_t n = 0; n < 200 * 150; ++n) ASSERT_TRUE(has_colour(back->colour[n]));
}

}  // namespace
