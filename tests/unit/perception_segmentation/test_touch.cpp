// From a touch to an object on a rendered table: a box, a can and a second box leaning on nothing.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "perception/geometry/no_colour.hpp"
#include "perception/segmentation/touch_segmenter.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace perception;

constexpr int kW = 320, kH = 240;
const Intrinsics kCamera{280, 280, 159.5, 119.5, kW, kH};

struct Solid {
  Vec3 low, high;  // in the table frame, z up
  Rgb colour;
};

// An upright thin wall round (x, y), open above; what is seen of it through the opening is
// `inside`.
struct Cup {
  double x, y, radius, height;
  Rgb outside, inside;
};

struct Rendered {
  Image<Rgb> rgb{kW, kH};
  Image<std::uint16_t> depth{kW, kH};
  Image<std::uint8_t> truth{kW, kH};  // 0 table, else solid + 1; cups follow the solids
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

struct CupHit {
  double t;
  bool inside;
};
std::optional<CupHit> hit(const Cup& c, const Vec3& o, const Vec3& d) {
  const double px = o.x() - c.x, py = o.y() - c.y, a = d.x() * d.x() + d.y() * d.y(),
               b = px * d.x() + py * d.y(),
               root2 = b * b - a * (px * px + py * py - c.radius * c.radius);
  if (root2 <= 0) return std::nullopt;
  const double near = (-b - std::sqrt(root2)) / a, far = (-b + std::sqrt(root2)) / a;
  const double z_near = o.z() + near * d.z(), z_far = o.z() + far * d.z();
  if (near > 0 && z_near >= 0 && z_near <= c.height) return CupHit{near, false};
  if (z_near < c.height || z_far > c.height) return std::nullopt;
  return CupHit{z_far >= 0 ? far : -o.z() / d.z(), true};
}

// Camera 0.55 m above the table, looking 35 degrees down; noise of 1.5 mm at 1 m, growing with z^2.
Rendered render(const std::vector<Solid>& solids, rt::Random& random,
                const std::vector<Cup>& cups = {}) {
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
      Rgb cup_colour;
      for (std::size_t k = 0; k < cups.size(); ++k) {
        const auto h = hit(cups[k], eye, d);
        if (!h || h->t >= t) continue;
        t = h->t, what = static_cast<int>(solids.size() + k) + 1;
        cup_colour = h->inside ? cups[k].inside : cups[k].outside;
      }
      out.truth.at(u, v) = static_cast<std::uint8_t>(what);
      const Rgb c = what > static_cast<int>(solids.size()) ? cup_colour
                    : what > 0 ? solids[static_cast<std::size_t>(what - 1)].colour
                               : Rgb{170, 150, 120};
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

// Mean over touches, and the worst of them.
struct Touched {
  double mean = 0, worst = 1;
};
Touched touched(TouchSegmenter& s, const Rendered& r, int what, rt::Random& random) {
  Touched out;
  constexpr int kTouches = 12;
  for (int n = 0; n < kTouches;) {
    const int u = static_cast<int>(random.integer(0, kW - 1));
    const int v = static_cast<int>(random.integer(0, kH - 1));
    if (r.truth.at(u, v) != what) continue;
    s.touch(u, v);
    const double x = iou(s, r, what);
    out.mean += x / kTouches;
    out.worst = std::min(out.worst, x);
    ++n;
  }
  return out;
}

// Neither colour nor a smooth way leads from the outside to what is seen beyond the near rim.
TEST(Touch, TheInsideOfACupBelongsToIt) {
  const std::uint64_t seed = 41;
  RecordProperty("seed", std::to_string(seed));
  rt::Random random(seed);
  for (const double radius : {0.04, 0.055, 0.075}) {
    for (const double height : {0.07, 0.10}) {
      const Rendered r =
          render({}, random, {{0.01, -0.05, radius, height, {70, 130, 60}, {215, 150, 170}}});
      TouchSegmenter s(kW, kH);
      s.set_frame(r.rgb.view(), r.depth.view(), kCamera, 1);
      const Touched t = touched(s, r, 1, random);
      TouchConfig without;
      without.graph.hollow_gap_m = 0;
      TouchSegmenter apart(kW, kH, without);
      apart.set_frame(r.rgb.view(), r.depth.view(), kCamera, 1);
      EXPECT_LT(touched(apart, r, 1, random).worst, 0.6) << "the test shows nothing";
      EXPECT_GT(t.mean, 0.85) << "radius " << radius << " height " << height << " seed " << seed;
      EXPECT_GT(t.worst, 0.8) << "radius " << radius << " height " << height << " seed " << seed;
    }
  }
}

// As high or higher, narrower or wider, near or far: what stands behind something else is no inside
// of it.
TEST(Touch, WhatStandsBehindIsNoInside) {
  const std::uint64_t seed = 43;
  RecordProperty("seed", std::to_string(seed));
  rt::Random random(seed);
  for (const double height : {0.10, 0.12, 0.20}) {
    for (const double half_width : {0.05, 0.11}) {
      for (const double gap : {0.03, 0.08}) {
        const double y = -0.03 + gap;
        const Rendered r =
            render({{{-0.07, -0.10, 0}, {0.07, -0.03, 0.10}, {40, 80, 170}},
                    {{-half_width, y, 0}, {half_width, y + 0.07, height}, {190, 60, 50}}},
                   random);
        TouchSegmenter s(kW, kH);
        s.set_frame(r.rgb.view(), r.depth.view(), kCamera, 1);
        TouchConfig without;
        without.graph.hollow_gap_m = 0;
        TouchSegmenter apart(kW, kH, without);
        apart.set_frame(r.rgb.view(), r.depth.view(), kCamera, 1);
        for (const int what : {1, 2}) {
          rt::Random same(seed, 1);
          rt::Random again = same;
          const double one = touched(s, r, what, same).mean;
          EXPECT_NEAR(one, touched(apart, r, what, again).mean, 0.02)
              << "box " << what << ", height " << height << ", half width " << half_width
              << ", gap " << gap << ", seed " << seed;
          EXPECT_GT(one, 0.7);
        }
      }
    }
  }
}

// Left of every object a strip of the table, and of what stands there, that a colour camera to the
// right does not see, and every hundredth pixel. Only what has colour is compared by it.
TEST(Touch, HiddenFromTheColourCamera) {
  const std::uint64_t seed = 37;
  RecordProperty("seed", std::to_string(seed));
  rt::Random random(seed);
  const Rendered r = render(kSolids, random);
  Image<Rgb> hidden = r.rgb;
  int lacking = 0;
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u) {
      bool behind = random.uniform() < 0.01;
      for (int x = u; x < std::min(kW, u + 14); ++x)
        behind = behind || (r.truth.at(x, v) != 0 && r.depth.at(u, v) > r.depth.at(x, v) + 30);
      if (r.truth.at(u, v) != 0 && u > 0 && r.truth.at(u - 1, v) == 0) behind = true;
      if (behind) hidden.at(u, v) = kNoColour, ++lacking;
    }
  ASSERT_GT(lacking, 1000);
  Image<Rgb> black = hidden;
  lift_black(black.view());
  const auto mean_iou = [&](const Image<Rgb>& rgb) {
    TouchSegmenter s(kW, kH);
    s.set_frame(rgb.view(), r.depth.view(), kCamera, 1);
    rt::Random draw(seed);
    double sum = 0;
    int n = 0;
    while (n < 30) {
      const int u = static_cast<int>(draw.integer(0, kW - 1));
      const int v = static_cast<int>(draw.integer(0, kH - 1));
      const int what = r.truth.at(u, v);
      if (what == 0) continue;
      EXPECT_TRUE(s.touch(u, v));
      EXPECT_TRUE(s.in(u, v));
      sum += iou(s, r, what);
      ++n;
    }
    return sum / n;
  };
  const double all = mean_iou(r.rgb), some = mean_iou(hidden);
  // Of the touches on the hidden part of the table, how many name the table?
  const auto named_table = [&](const Image<Rgb>& rgb) {
    TouchSegmenter s(kW, kH);
    s.set_frame(rgb.view(), r.depth.view(), kCamera, 1);
    int named = 0, tried = 0;
    for (int v = 4; v < kH - 4; v += 3)
      for (int u = 4; u < kW - 4; u += 3) {
        bool deep = true;  // all round it is hidden table
        for (int y = -3; y <= 3; ++y)
          for (int x = -3; x <= 3; ++x)
            deep = deep && !has_colour(hidden.at(u + x, v + y)) && r.truth.at(u + x, v + y) == 0;
        if (!deep) continue;
        ++tried;
        EXPECT_TRUE(s.touch(u, v));
        named += s.named_support() ? 1 : 0;
      }
    EXPECT_GT(tried, 15);
    return static_cast<double>(named) / tried;
  };
  const double table = named_table(hidden), dark_table = named_table(black);
  std::printf("  IoU with all colours %.3f, without those %.3f\n", all, some);
  std::printf("  a touch on the hidden table names it: %.2f; taken for black %.2f\n", table,
              dark_table);
  EXPECT_GT(some, 0.9);
  EXPECT_GT(some, all - 0.03);
  EXPECT_GT(table, 0.9);
  EXPECT_LT(dark_table, 0.5) << "the case shows nothing";
}

// No colour at all: by distance alone, as if everything were of one colour.
TEST(Touch, WithoutAnyColour) {
  rt::Random random(41);
  const Rendered r = render(kSolids, random);
  const Image<Rgb> none(kW, kH, kNoColour);
  TouchSegmenter s(kW, kH);
  s.set_frame(none.view(), r.depth.view(), kCamera, 1);
  for (const auto& [u, v] : {std::pair{0, 0}, {kW - 1, kH - 1}, {kW / 2, kH / 2}}) {
    EXPECT_TRUE(s.touch(u, v));
    EXPECT_TRUE(s.in(u, v));
  }
  for (int what = 1; what <= 3; ++what) {
    double us = 0, vs = 0, n = 0;
    for (int v = 0; v < kH; ++v)
      for (int u = 0; u < kW; ++u)
        if (r.truth.at(u, v) == what) us += u, vs += v, n += 1;
    const int u = static_cast<int>(us / n), v = static_cast<int>(vs / n);
    EXPECT_TRUE(s.touch(u, v));
    EXPECT_GT(iou(s, r, what), 0.8) << what;
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
