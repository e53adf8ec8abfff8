// Outlines over frames, alone: a disc whose masks are wrong by a pixel here and there, from a
// camera that moves.
#include <gtest/gtest.h>

#include <iostream>

#include "perception/objects/outline_memory.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using namespace perception;  // NOLINT: test only

constexpr int kWidth = 200, kHeight = 160;
constexpr std::uint8_t kDisc = 3, kOther = 5;
const Intrinsics kEye{300, 300, 99.5, 79.5, kWidth, kHeight};

struct Disc {
  Image<std::uint8_t> truth{kWidth, kHeight}, labels{kWidth, kHeight};
  Image<std::uint16_t> depth{kWidth, kHeight};
  Pose X_WC = Pose::Identity();

  // Centre of the disc in W, camera at x_m; a strip of another object beside it.
  void show(double centre_m, double x_m, rt::Random& random) {
    X_WC.translation().x() = x_m;
    for (int v = 0; v < kHeight; ++v)
      for (int u = 0; u < kWidth; ++u) {
        const Vec3 p = X_WC * kEye.unproject(u, v, 1.0);
        const bool in = std::hypot(p.x() - centre_m, p.y()) < 0.15;
        truth.at(u, v) = in ? kDisc : p.x() > centre_m + 0.13 ? kOther : std::uint8_t{0};
        depth.at(u, v) = in ? 1000 : 1500;
      }
    for (int v = 0; v < kHeight; ++v)
      for (int u = 0; u < kWidth; ++u) {
        const bool wrong =
            beside(truth, u, v) && truth.at(u, v) != kOther && random.uniform() < 0.15;
        labels.at(u, v) =
            wrong ? static_cast<std::uint8_t>(kDisc - truth.at(u, v)) : truth.at(u, v);
      }
  }
  // A pixel beside it is of the disc and it is not, or the other way round.
  static bool beside(const Image<std::uint8_t>& image, int u, int v) {
    const auto disc = [&](int a, int b) {
      return image.view().contains(a, b) && image.at(a, b) == kDisc;
    };
    const bool in = disc(u, v);
    return disc(u - 1, v) != in || disc(u + 1, v) != in || disc(u, v - 1) != in ||
           disc(u, v + 1) != in;
  }
  [[nodiscard]] int wrong(const Image<std::uint8_t>& image) const {
    int n = 0;
    for (int v = 0; v < kHeight; ++v)
      for (int u = 0; u < kWidth; ++u) n += (image.at(u, v) == kDisc) != (truth.at(u, v) == kDisc);
    return n;
  }
  void settle(OutlineMemory& memory, Image<std::uint8_t>& out) const {
    const FrameView frame{kEye, depth.view(), {}};
    OutlineMemory::Box box{kWidth, kHeight, -1, -1};
    for (int v = 0; v < kHeight; ++v)
      for (int u = 0; u < kWidth; ++u) {
        out.at(u, v) = labels.at(u, v);
        if (labels.at(u, v) != kDisc) continue;
        box = {std::min(box.u0, u), std::min(box.v0, v), std::max(box.u1, u), std::max(box.v1, v)};
      }
    const TsdfConfig edges;
    rt_guard::reset();
    {
      rt::Section section;
      memory.settle(frame, X_WC, kDisc, box, edges, out.view());
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
};

TEST(OutlineMemory, TheMeanIsBetterThanAMask) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    rt::Random random(seed, 5);
    OutlineMemory memory(kWidth, kHeight);
    Disc disc;
    Image<std::uint8_t> settled(kWidth, kHeight);
    int masks = 0, means = 0;
    for (int n = 0; n < 20; ++n) {
      disc.show(0, 0.004 * n - 0.04, random);
      disc.settle(memory, settled);
      if (n == 0) {
        EXPECT_EQ(disc.wrong(settled), disc.wrong(disc.labels)) << "nothing to go by";
      }
      for (int v = 0; v < kHeight; ++v)
        for (int u = 0; u < kWidth; ++u) {
          if (settled.at(u, v) == disc.labels.at(u, v)) continue;
          EXPECT_TRUE(Disc::beside(disc.labels, u, v)) << u << " " << v << " seed " << seed;
          EXPECT_NE(disc.labels.at(u, v), kOther);
          EXPECT_TRUE(settled.at(u, v) == kDisc || settled.at(u, v) == 0);
        }
      if (n < 5) continue;
      masks += disc.wrong(disc.labels), means += disc.wrong(settled);
    }
    std::cout << "seed " << seed << ": " << masks << " pixels wrong in masks, " << means
              << " in means\n";
    EXPECT_GT(masks, 300);
    EXPECT_LT(means, masks / 2);
  }
}

TEST(OutlineMemory, WhatHasMovedIsNotHeldBack) {
  rt::Random random(7, 5);
  OutlineMemory memory(kWidth, kHeight);
  Disc disc;
  Image<std::uint8_t> settled(kWidth, kHeight);
  for (int n = 0; n < 10; ++n) {
    disc.show(0, 0, random);
    disc.settle(memory, settled);
  }
  disc.show(-0.04, 0, random);  // 12 pixels
  disc.settle(memory, settled);
  EXPECT_EQ(disc.wrong(settled), disc.wrong(disc.labels));
  // And what is forgotten begins anew.
  memory.forget(kDisc);
  disc.show(-0.04, 0, random);
  disc.settle(memory, settled);
  EXPECT_EQ(disc.wrong(settled), disc.wrong(disc.labels));
  int masks = 0, means = 0;
  for (int n = 0; n < 10; ++n) {
    disc.show(-0.04, 0, random);
    disc.settle(memory, settled);
    masks += disc.wrong(disc.labels), means += disc.wrong(settled);
  }
  EXPECT_LT(means, masks);
}

}  // namespace
}  // namespace tests
