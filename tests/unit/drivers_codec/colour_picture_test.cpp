// Halved, grown and decoded pictures against the rules of the header, pixel by pixel: widths and
// heights odd and even, one pixel to the most, images with and without holes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/codec/colour_picture.hpp"
#include "perception/geometry/no_colour.hpp"
#include "rt/random.hpp"

namespace {

using perception::has_colour;
using perception::kNoColour;
using perception::Rgb;
using perception::RgbdFrame;

constexpr int kGuard = 5;  // pixels behind a picture that nobody may touch
constexpr Rgb kUntouched{7, 77, 177};

struct Picture {
  Picture(int width, int height)
      : w(width), h(height), rgb(static_cast<std::size_t>(w * h + kGuard), kUntouched) {}
  [[nodiscard]] perception::ImageView<Rgb> view() { return {rgb.data(), w, h, w}; }
  [[nodiscard]] Rgb at(int u, int v) const {
    return rgb[static_cast<std::size_t>(std::clamp(v, 0, h - 1) * w + std::clamp(u, 0, w - 1))];
  }
  [[nodiscard]] bool guarded() const {
    return std::all_of(rgb.end() - kGuard, rgb.end(), [](Rgb c) { return c == kUntouched; });
  }
  int w, h;
  std::vector<Rgb> rgb;
};

Picture random_picture(rt::Random& random, int w, int h, double holes) {
  Picture p(w, h);
  const auto byte = [&random] {  // often at an end of the range
    const auto b = random.integer(-60, 315);
    return static_cast<std::uint8_t>(std::clamp<std::int64_t>(b, 0, 255));
  };
  const int in_rows = static_cast<int>(random.integer(0, h));  // holes only from there on
  for (int n = 0; n < w * h; ++n) {
    Rgb& c = p.rgb[static_cast<std::size_t>(n)] = perception::lifted({byte(), byte(), byte()});
    if (n / w >= in_rows && random.uniform() < holes) c = kNoColour;
  }
  return p;
}

// Mean of the cell's pixels that have colour; none: the cell before.
Picture halved(const Picture& in) {
  Picture out((in.w + 1) / 2, (in.h + 1) / 2);
  Rgb last = perception::kNeutral;
  for (int n = 0; n < out.w * out.h; ++n) {
    int sum[3] = {0, 0, 0}, count = 0;
    for (int k = 0; k < 4; ++k) {
      const Rgb c = in.at(2 * (n % out.w) + k % 2, 2 * (n / out.w) + k / 2);
      if (!has_colour(c)) continue;
      sum[0] += c.r, sum[1] += c.g, sum[2] += c.b, ++count;
    }
    const auto mean = [&](int x) { return static_cast<std::uint8_t>((x + count / 2) / count); };
    if (count > 0) last = {mean(sum[0]), mean(sum[1]), mean(sum[2])};
    out.rgb[static_cast<std::size_t>(n)] = last;
  }
  return out;
}

// Weights of 9, 3, 3 and 1 of 16.
Picture grown(const Picture& in, int w, int h) {
  Picture out(w, h);
  for (int n = 0; n < w * h; ++n) {
    const int u = n % w, v = n / w, x = u / 2, y = v / 2;
    const int xo = x + (u % 2 == 0 ? -1 : 1), yo = y + (v % 2 == 0 ? -1 : 1);
    const Rgb own = in.at(x, y), side = in.at(xo, y), over = in.at(x, yo), far = in.at(xo, yo);
    const auto mix = [](int a, int b, int c, int d) {
      return static_cast<std::uint8_t>((9 * a + 3 * b + 3 * c + d + 8) / 16);
    };
    out.rgb[static_cast<std::size_t>(n)] = {mix(own.r, side.r, over.r, far.r),
                                            mix(own.g, side.g, over.g, far.g),
                                            mix(own.b, side.b, over.b, far.b)};
  }
  return out;
}

// Sizes that meet every end of a vector, and the largest.
template <typename Each>
void for_sizes(const Each& each) {
  constexpr unsigned kSeed = 5;
  std::printf("  seed %u\n", kSeed);
  rt::Random random(kSeed);
  for (int w = 1; w <= 70; ++w) each(random, w, static_cast<int>(random.integer(1, 9)));
  for (const int w : {RgbdFrame::kMaxWidth - 1, RgbdFrame::kMaxWidth}) {
    for (const int h : {1, RgbdFrame::kMaxHeight - 1, RgbdFrame::kMaxHeight}) each(random, w, h);
  }
}

TEST(ColourPicture, AHalfOneHasTheMeanOfWhatHasColour) {
  for_sizes([](rt::Random& random, int w, int h) {
    for (const double holes : {0.0, 0.02, 0.5, 1.0}) {
      Picture in = random_picture(random, w, h, holes);
      const Picture wanted = halved(in);
      Picture out(wanted.w, wanted.h);
      drivers::halve_colour(in.view(), out.view());
      ASSERT_EQ(out.rgb, wanted.rgb) << w << " x " << h << ", holes " << holes;
      ASSERT_TRUE(out.guarded());
    }
  });
}

TEST(ColourPicture, AGrownOneIsBilinear) {
  for_sizes([](rt::Random& random, int w, int h) {
    Picture in = random_picture(random, (w + 1) / 2, (h + 1) / 2, 0.1);
    const Picture wanted = grown(in, w, h);
    Picture out(w, h);
    drivers::grow_colour(in.view(), out.view());
    ASSERT_EQ(out.rgb, wanted.rgb) << w << " x " << h;
    ASSERT_TRUE(out.guarded());
  });
}

// BT.601 in real numbers: the integers of the codec are its nearest, and one beside it where half a
// level decides.
TEST(ColourPicture, AllOfYCbCrIsDecodedToTheNearestLevel) {
  for_sizes([](rt::Random& random, int w, int h) {
    const int even_w = w + w % 2, even_h = h + h % 2;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(even_w * even_h * 3 / 2));
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random.integer(0, 255));
    std::uint8_t* const cb = bytes.data() + even_w * even_h;
    const drivers::Yuv420 in{bytes.data(), cb,    cb + even_w * even_h / 4, even_w, even_w / 2,
                             even_w,       even_h};
    Picture out(w, h);
    drivers::from_yuv420(in, out.view());
    ASSERT_TRUE(out.guarded());
    for (int n = 0; n < w * h; ++n) {
      const int u = n % w, v = n / w, c = v / 2 * in.c_stride + u / 2;
      const double y = in.y[v * in.y_stride + u], b = in.cb[c] - 128.0, r = in.cr[c] - 128.0;
      const Rgb got = out.rgb[static_cast<std::size_t>(n)];
      const auto close = [](int level, double exact) {
        return std::abs(level - std::clamp(exact, 0.0, 255.0)) <= 0.5 + 1e-2;
      };
      ASSERT_TRUE(close(got.r, y + 1.402 * r) && close(got.b, y + 1.772 * b) &&
                  close(got.g, y - 0.344136 * b - 0.714136 * r))
          << u << " " << v << " of " << w << " x " << h;
    }
  });
}

}  // namespace
