// From a touch to an object on a rendered table: a box, a can and a second box leaning on nothing.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "perception/segmentation/touch_segmenter.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/support/rt_guard.hpp"

namespace {

using namespace perception;

constexpr int kW = 320, kH = 240;
const Intrinsics kCamera{280, 280, 159.5, 119.5, kW, kH};

struct Solid {
  Vec3 low, high;  // in the table frame, z up
  Rgb colour;
};

struct Rendered {
  Image<Rgb> rgb{kW, kH};
  Image<std::uint16_t> depth{kW, kH};
  Image<std::uint8_t> truth{kW, kH};  // 0 table, else solid + 1
};

std::optional<double> hit(const Solid& s, const Vec3& o, const Vec3& d) {
  double t0 = 0, t1 = 1e9;
  for (int k = 0; k < 3; ++k) {
    const double a = (s.low[k] - o[k]) / d[k], b = (s.high[k] - o[k]) / d[k];
    t0 = std::max(t0, std::min(a, b));
    t1 = std::min(t1, std::max(a, b));
  }
  return t0 < t1 ? std::optional(t0) : std::nullopt;
}

// Camera 0.55 m above the table, looking 35 degrees down; noise of 1.5 mm at 1 m, growing with z^2.
Rendered render(const std::vector<Solid>& solids, rt::Random& random) {
  Rendered out;
  const double tilt = 35 * 3.14159265358979 / 180;
  const Vec3 eye(0, -0.75, 0.55);
  const Vec3 z(0, std::cos(tilt), -std::sin(tilt)), x(1, 0, 0), y = z.cross(x);
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) {
      const Vec3 d = z + x * ((u - kCamera.cx) / kCamera.fx) + y * ((v - kCamera.cy) / kCamera.fy);
      double t = d.z() < 0 ? -eye.z() / d.z() : 5;
      int what = 0;
      for (std::size_t k = 0; k < solids.size(); ++k) {
        const auto h = hit(solids[k], eye, d);
        if (h && *h < t) t = *h, what = static_cast<int>(k) + 1;
      }
      out.truth.at(u, v) = static_cast<std::uint8_t>(what);
      const Rgb c =
          what > 0 ? solids[static_cast<std::size_t>(what - 1)].colour : Rgb{170, 150, 120};
      const auto n = [&](int value) {
        return static_cast<std::uint8_t>(value + random.integer(-5, 5));
      };
      out.rgb.at(u, v) = {n(c.r), n(c.g), n(c.b)};
      out.depth.at(u, v) =
          static_cast<std::uint16_t>(std::max(0.0, 1000 * t + 1.5 * t * t * random.normal()));
    }
  }
  return out;
}

const std::vector<Solid> kSolids{{{-0.22, -0.05, 0}, {-0.08, 0.04, 0.12}, {40, 80, 170}},
                                 {{0.02, -0.1, 0}, {0.09, -0.03, 0.10}, {180, 40, 40}},
                                 {{0.10, 0.15, 0}, {0.26, 0.22, 0.18}, {60, 150, 60}}};

double iou(const TouchSegmenter& s, const Rendered& r, int what) {
  double both = 0, either = 0;
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) {
      const bool a = s.in(u, v), b = r.truth.at(u, v) == what;
      both += a && b ? 1 : 0;
      either += a || b ? 1 : 0;
    }
  }
  return both / either;
}

TEST(Touch, EachObjectFromAnyPixelOfIt) {
  const std::uint64_t seed = 31;
  RecordProperty("seed", std::to_string(seed));
  rt::Random random(seed);
  const Rendered r = render(kSolids, random);
  TouchSegmenter s(kW, kH);
  s.set_frame(r.rgb.view(), r.depth.view(), kCamera, 1);
  for (int what = 1; what <= 3; ++what) {
    double mean = 0;
    int n = 0;
    while (n < 12) {
      const int u = static_cast<int>(random.integer(0, kW - 1));
      const int v = static_cast<int>(random.integer(0, kH - 1));
      if (r.truth.at(u, v) != what) continue;
      EXPECT_TRUE(s.touch(u, v));
      EXPECT_TRUE(s.in(u, v));
      mean += iou(s, r, what);
      ++n;
    }
    EXPECT_GT(mean / n, 0.9) << "object " << what << " seed " << seed;
    EXPECT_NEAR(s.support().n.norm(), 1, 1e-5);
  }
}

TEST(Touch, SameBytesAndNothingLeftFromBefore) {
  rt::Random random(8);
  const Rendered r = render(kSolids, random), other = render({kSolids[2]}, random);
  TouchSegmenter fresh(kW, kH), used(kW, kH);
  used.set_frame(other.rgb.view(), other.depth.view(), kCamera, 1);
  static_cast<void>(used.touch(200, 60));
  for (auto* s : {&fresh, &used}) {
    s->set_frame(r.rgb.view(), r.depth.view(), kCamera, 1);
    s->touch(100, 120);
  }
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) ASSERT_EQ(fresh.in(u, v), used.in(u, v)) << u << "," << v;
  }
}

TEST(Touch, FollowsFromAShiftedSeed) {
  rt::Random random(12);
  const Rendered r = render(kSolids, random);
  TouchSegmenter s(kW, kH);
  for (int what = 1; what <= 3; ++what) {
    Image<std::uint8_t> seed(kW, kH, 0);
    for (int v = 3; v < kH; ++v) {
      for (int u = 3; u < kW; ++u) seed.at(u, v) = r.truth.at(u - 3, v - 2) == what;
    }
    ASSERT_TRUE(s.follow(r.rgb.view(), r.depth.view(), kCamera, 1, seed.view()));
    EXPECT_GT(iou(s, r, what), 0.88) << what;
  }
  const Image<std::uint8_t> nothing(kW, kH, 0);
  EXPECT_FALSE(s.follow(r.rgb.view(), r.depth.view(), kCamera, 1, nothing.view()));
}

TEST(Touch, AllocatesNothing) {
  rt::Random random(12);
  const Rendered r = render(kSolids, random);
  Image<std::uint8_t> seed(kW, kH, 0);
  for (int i = 0; i < kW * kH; ++i) seed.data()[i] = r.truth.data()[i] == 1;
  TouchSegmenter s(kW, kH);
  rt_guard::reset();
  {
    const rt::Section section;
    s.set_frame(r.rgb.view(), r.depth.view(), kCamera, 1);
    static_cast<void>(s.touch(100, 120));
    static_cast<void>(s.follow(r.rgb.view(), r.depth.view(), kCamera, 1, seed.view()));
  }
  if (rt_guard::linked()) {
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
}

TEST(Touch, DepthOfNoUse) {
  rt::Random random(2);
  const Rendered r = render(kSolids, random);
  TouchSegmenter s(kW, kH);
  for (const int kind : {0, 65535, 1, 2}) {
    Image<std::uint16_t> depth(kW, kH, static_cast<std::uint16_t>(kind == 2 ? 0 : kind));
    if (kind == 2) {
      for (int i = 0; i < kW * kH; ++i) depth.data()[i] = static_cast<std::uint16_t>(random());
    }
    s.set_frame(r.rgb.view(), depth.view(), kCamera, 1);
    for (const auto& [u, v] : {std::pair{0, 0}, {kW - 1, kH - 1}, {100, 120}}) {
      EXPECT_EQ(s.touch(u, v), kind == 1 || kind == 2) << kind;
      EXPECT_TRUE(s.in(u, v));
    }
  }
  // The smallest images that have a half.
  TouchSegmenter small(2, 3);
  const Image<Rgb> rgb(2, 3, {1, 2, 3});
  const Image<std::uint16_t> depth(2, 3, 500);
  small.set_frame(rgb.view(), depth.view(), {100, 100, 1, 1, 2, 3}, 1);
  EXPECT_TRUE(small.touch(1, 1));
  EXPECT_TRUE(small.in(1, 1));
}

}  // namespace
