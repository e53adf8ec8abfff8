// Colour of a frame through JPEG and H.264: how near it comes back, what a missing, damaged or
// foreign picture does, what rate and key do. Seeds are printed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <vector>

#include "drivers/codec/colour_picture.hpp"
#include "drivers/codec/colour_stream.hpp"
#include "perception/geometry/no_colour.hpp"
#include "rt/random.hpp"

namespace {

using drivers::ColourDecoder;
using drivers::ColourDemand;
using drivers::ColourEncoder;
using drivers::ColourStatus;
using drivers::ColourStreamConfig;
using perception::has_colour;
using perception::ImageView;
using perception::kNoColour;
using perception::Rgb;

rt::Startup startup;
using Bytes = std::vector<std::uint8_t>;

struct Picture {
  int w, h;
  std::vector<Rgb> rgb;
  Picture(int width, int height)
      : w(width),
        h(height),
        rgb(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), Rgb{9, 9, 9}) {}
  [[nodiscard]] ImageView<Rgb> view() { return {rgb.data(), w, h, w}; }
};

std::uint8_t wave(double phase) { return static_cast<std::uint8_t>(128 + 100 * std::sin(phase)); }

// Waves of colour that wander, and some noise, up to `rough` of 255 in red.
Picture scene(int w, int h, int n, rt::Random* noise = nullptr, int rough = 6) {
  Picture p(w, h);
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      const int more = noise != nullptr ? static_cast<int>(noise->integer(0, rough)) : 0;
      p.view().at(u, v) = {static_cast<std::uint8_t>(wave(0.05 * (u + 2 * n)) + more),
                           wave(0.04 * (v - n)), wave(0.02 * (u + v))};
    }
  }
  return p;
}

double psnr(Picture& a, Picture& b) {
  double squares = 0;
  for (std::size_t i = 0; i < a.rgb.size(); ++i) {
    const Rgb x = a.rgb[i], y = b.rgb[i];
    for (const int d : {x.r - y.r, x.g - y.g, x.b - y.b}) squares += d * d;
  }
  return 10 * std::log10(255.0 * 255 * 3 * static_cast<double>(a.rgb.size()) / (squares + 1e-9));
}

struct Chain {
  std::unique_ptr<ColourEncoder> encoder;
  ColourDecoder decoder{startup.token()};
  Bytes out = Bytes(drivers::kMostColourBytes);
  Chain(const char* method, int w, int h, bool half = false,
        int finest = ColourStreamConfig{}.finest) {
    ColourStreamConfig config;
    config.method = method, config.half = half, config.finest = finest;
    encoder = make_colour_encoder(startup.token(), config, w, h);
  }
  ColourEncoder::Coded encode(Picture& p, const ColourDemand& demand = {},
                              std::span<const std::uint16_t> depth = {}) {
    return encoder->encode(p.view(), depth, demand, out);
  }
  ColourStatus decode(const Bytes& bytes, Picture& to, std::span<const std::uint16_t> depth = {}) {
    return decoder.decode(bytes, depth, to.view());
  }
  Bytes bytes(const ColourEncoder::Coded& c) {
    return {out.begin(), out.begin() + static_cast<std::ptrdiff_t>(c.bytes)};
  }
};

std::vector<const char*> methods() {
  return drivers::h264_built_in() ? std::vector{"jpeg", "h264"} : std::vector{"jpeg"};
}

TEST(ColourPicture, PlanesAreTheStandardsFormula) {
  std::printf("  seed 5\n");
  rt::Random random(5);
  Picture p(34, 18), back(34, 18);
  for (Rgb& c : p.rgb)
    c = {static_cast<std::uint8_t>(random.integer(0, 255)),
         static_cast<std::uint8_t>(random.integer(0, 255)),
         static_cast<std::uint8_t>(random.integer(0, 255))};
  Bytes y(34 * 18), cb(17 * 9), cr(17 * 9);
  const drivers::Yuv420 planes{y.data(), cb.data(), cr.data(), 34, 17, 34, 18};
  to_yuv420(p.view(), planes);
  from_yuv420(planes, back.view());
  for (int v = 0; v < 18; ++v) {
    for (int u = 0; u < 34; ++u) {
      const Rgb c = p.view().at(u, v);
      const double luma = 0.299 * c.r + 0.587 * c.g + 0.114 * c.b;
      EXPECT_NEAR(y[static_cast<std::size_t>(34 * v + u)], luma, 0.51);
      double blue = 0, red = 0;
      for (int k = 0; k < 4; ++k) {
        const Rgb q = p.view().at(u / 2 * 2 + k % 2, v / 2 * 2 + k / 2);
        const double l = 0.299 * q.r + 0.587 * q.g + 0.114 * q.b;
        blue += (q.b - l) / 1.772 / 4, red += (q.r - l) / 1.402 / 4;
      }
      const auto at = static_cast<std::size_t>(17 * (v / 2) + u / 2);
      EXPECT_NEAR(cb[at], std::min(255.0, 128 + blue), 0.51);
      EXPECT_NEAR(cr[at], std::min(255.0, 128 + red), 0.51);
      const double l = y[static_cast<std::size_t>(34 * v + u)], b = cb[at] - 128.0,
                   r = cr[at] - 128.0;
      const Rgb to = back.view().at(u, v);
      EXPECT_NEAR(to.r, std::clamp(l + 1.402 * r, 0.0, 255.0), 0.51);
      EXPECT_NEAR(to.g, std::clamp(l - 0.344136 * b - 0.714136 * r, 0.0, 255.0), 0.51);
      EXPECT_NEAR(to.b, std::clamp(l + 1.772 * b, 0.0, 255.0), 0.51);
    }
  }
}

TEST(ColourStream, ComesBackNearlyAsItWas) {
  for (const char* method : methods()) {
    for (const bool half : {false, true}) {
      Chain chain(method, 161, 119, half);
      for (int n = 0; n < 20; ++n) {
        Picture in = scene(161, 119, n), out(161, 119);
        const auto coded = chain.encode(in);
        ASSERT_EQ(coded.status, ColourStatus::kOk);
        EXPECT_EQ(coded.key, n == 0 || std::strcmp(method, "jpeg") == 0);
        ASSERT_EQ(chain.decode(chain.bytes(coded), out), ColourStatus::kOk);
        EXPECT_GT(psnr(in, out), 30) << method << " half " << half << " picture " << n;
      }
    }
  }
}

TEST(ColourStream, OddAndTinySizes) {
  for (const auto& [w, h] : {std::pair{1, 1}, {2, 1}, {3, 5}, {17, 9}, {639, 479}}) {
    for (const bool half : {false, true}) {
      Chain chain("jpeg", w, h, half);
      Picture in(w, h), out(w, h);
      std::fill(in.rgb.begin(), in.rgb.end(), Rgb{200, 100, 50});
      const auto coded = chain.encode(in, {95, 1500, false});
      ASSERT_EQ(coded.status, ColourStatus::kOk);
      ASSERT_EQ(chain.decode(chain.bytes(coded), out), ColourStatus::kOk);
      for (const Rgb& p : out.rgb) {
        ASSERT_NEAR(p.r, 200, 3) << w << " x " << h;
        ASSERT_NEAR(p.g, 100, 3);
        ASSERT_NEAR(p.b, 50, 3);
      }
    }
  }
}

// A JPEG that states another size than the picture's header is refused before its pixels are made.
TEST(ColourStream, AJpegThatAsksForGigabytesIsRefused) {
  Chain chain("jpeg", 96, 64);
  Picture in = scene(96, 64, 3), out(96, 64);
  Bytes bytes = chain.bytes(chain.encode(in));
  for (std::size_t i = drivers::kColourHeader; i + 8 < bytes.size(); ++i) {
    if (bytes[i] != 0xff || bytes[i + 1] != 0xc0) continue;
    for (std::size_t k = 5; k < 9; ++k) bytes[i + k] = 0xff;
    break;
  }
  drivers::seal_colour(bytes);
  EXPECT_EQ(chain.decode(bytes, out), ColourStatus::kDamaged);
}

// Who named JPEG alone has no other library set up, and says so of its pictures.
TEST(ColourStream, ADecoderOfJpegAloneTakesNothingElse) {
  ColourDecoder decoder(startup.token(), false);
  for (const char* method : methods()) {
    Chain chain(method, 96, 64);
    Picture in = scene(96, 64, 3), out(96, 64);
    const Bytes bytes = chain.bytes(chain.encode(in));
    EXPECT_EQ(decoder.decode(bytes, {}, out.view()),
              std::strcmp(method, "jpeg") == 0 ? ColourStatus::kOk : ColourStatus::kFailed);
  }
}

// The decoder of OpenCV reads the payload as it stands.
TEST(ColourStream, JpegIsOneThatOthersRead) {
  Chain chain("jpeg", 96, 64);
  Picture in = scene(96, 64, 3), own(96, 64), other(96, 64);
  const Bytes bytes = chain.bytes(chain.encode(in, {90, 1500, false}));
  ASSERT_EQ(chain.decode(bytes, own), ColourStatus::kOk);
  const cv::Mat read =
      cv::imdecode(Bytes(bytes.begin() + drivers::kColourHeader, bytes.end()), cv::IMREAD_COLOR);
  ASSERT_EQ(read.cols, 96);
  ASSERT_EQ(read.rows, 64);
  for (int v = 0; v < 64; ++v)
    for (int u = 0; u < 96; ++u) {
      const auto c = read.at<cv::Vec3b>(v, u);
      other.view().at(u, v) = {c[2], c[1], c[0]};
    }
  EXPECT_GT(psnr(own, other), 45);
}

TEST(ColourStream, PixelsWithoutColourComeBackExactly) {
  for (const char* method : methods()) {
    Chain chain(method, 80, 60);
    for (int n = 0; n < 4; ++n) {
      Picture in = scene(80, 60, n), out(80, 60);
      std::vector<std::uint16_t> depth(in.rgb.size(), 1500);
      for (std::size_t i = 0; i < in.rgb.size(); ++i) {
        if (i % 13 == 0) depth[i] = 0;
        if (i % 13 == 0 || (i + static_cast<std::size_t>(n)) % 29 == 0) in.rgb[i] = kNoColour;
      }
      const Bytes bytes = chain.bytes(chain.encode(in, {}, depth));
      ASSERT_EQ(chain.decode(bytes, out, depth), ColourStatus::kOk);
      for (std::size_t i = 0; i < in.rgb.size(); ++i)
        ASSERT_EQ(has_colour(in.rgb[i]), has_colour(out.rgb[i])) << method << " pixel " << i;
    }
  }
}

TEST(ColourStream, SamePicturesAndDemandsGiveTheSameBytes) {
  for (const char* method : methods()) {
    Chain a(method, 128, 96), b(method, 128, 96);
    for (int n = 0; n < 12; ++n) {
      Picture in = scene(128, 96, n);
      const ColourDemand demand{50 + n, 600 + 100 * (n % 3), n == 7};
      ASSERT_EQ(a.bytes(a.encode(in, demand)), b.bytes(b.encode(in, demand))) << method << n;
    }
  }
}

TEST(ColourStream, QualityAndRateActWhileItRuns) {
  const auto mean_bytes = [](Chain& chain, const ColourDemand& demand, int first) {
    std::size_t sum = 0;
    std::printf("  seed 8\n");
    rt::Random noise(8);
    for (int n = 0; n < 30; ++n) {
      Picture in = scene(256, 208, first + n, &noise);
      const auto coded = chain.encode(in, demand);
      EXPECT_EQ(coded.status, ColourStatus::kOk);
      sum += coded.bytes;
    }
    return static_cast<double>(sum) / 30;
  };
  Chain jpeg("jpeg", 256, 208);
  EXPECT_GT(mean_bytes(jpeg, {90, 0, false}, 0), 1.5 * mean_bytes(jpeg, {40, 0, false}, 0));
  if (!drivers::h264_built_in()) GTEST_SKIP() << "H.264 is not built in";
  Chain h264("h264", 256, 208, false, 0);  // the rate alone
  for (const int kbit_s : {1500, 300, 900}) {
    const double share = kbit_s * 1000.0 / 8 / 30;
    static_cast<void>(mean_bytes(h264, {60, kbit_s, false}, 0));  // until the control has settled
    const double mean = mean_bytes(h264, {60, kbit_s, false}, 30);
    EXPECT_LT(mean, 1.1 * share) << kbit_s;
    EXPECT_GT(mean, 0.6 * share) << kbit_s;
  }
}

// A picture that stands still takes next to nothing once it is as fine as anyone sees; without a
// finest quantizer it goes on for longer. One that the rate holds down is not worse for it.
TEST(ColourStream, APictureAtRestTakesNoMoreThanItNeeds) {
  if (!drivers::h264_built_in()) GTEST_SKIP() << "H.264 is not built in";
  struct Mean {
    double bytes = 0, psnr_dB = 0;
  };
  const auto run = [](int finest, bool still) {
    rt::Random noise(31);
    Chain chain("h264", 256, 212, false, finest);
    Mean mean;
    Picture in = scene(256, 212, 0, &noise, 40), back(256, 212);
    for (int n = 0; n < 40; ++n) {
      if (!still) in = scene(256, 212, n, &noise, 40);
      const auto coded = chain.encode(in, {60, 900});
      EXPECT_EQ(chain.decode(chain.bytes(coded), back), ColourStatus::kOk);
      if (n < 20) continue;
      mean.bytes += static_cast<double>(coded.bytes) / 20, mean.psnr_dB += psnr(in, back) / 20;
    }
    std::printf("  seed 31, finest %d, %s: %.0f bytes, %.1f dB\n", finest,
                still ? "still" : "moving", mean.bytes, mean.psnr_dB);
    return mean;
  };
  const int finest = ColourStreamConfig{}.finest;
  const Mean still = run(finest, true), still_before = run(0, true);
  const Mean moving = run(finest, false), moving_before = run(0, false);
  EXPECT_LT(still.bytes, 200);
  EXPECT_GT(still_before.bytes, 5 * still.bytes);
  EXPECT_GT(still.psnr_dB, still_before.psnr_dB - 1);
  EXPECT_LE(moving.bytes, 1.1 * moving_before.bytes);
  EXPECT_GT(moving.psnr_dB, moving_before.psnr_dB - 0.2);
}

TEST(ColourStream, AMissingPictureAsksForAKeyAndAKeyHeals) {
  if (!drivers::h264_built_in()) GTEST_SKIP() << "H.264 is not built in";
  Chain chain("h264", 96, 80);
  Picture out(96, 80);
  for (int n = 0; n < 12; ++n) {
    Picture in = scene(96, 80, n);
    const auto coded = chain.encode(in, {60, 1500, n == 8});
    EXPECT_EQ(coded.key, n == 0 || n == 8);
    if (n == 4) continue;  // lost on the way
    const ColourStatus status = chain.decode(chain.bytes(coded), out);
    EXPECT_EQ(status, n < 4 || n >= 8 ? ColourStatus::kOk : ColourStatus::kNeedsKey) << n;
    if (n >= 8) {
      EXPECT_GT(psnr(in, out), 30);
    }
  }
}

TEST(ColourStream, WhatDidNotFitIsFollowedByAKey) {
  for (const char* method : methods()) {
    Chain chain(method, 96, 80);
    Picture in = scene(96, 80, 0), out(96, 80);
    ASSERT_EQ(chain.decode(chain.bytes(chain.encode(in)), out), ColourStatus::kOk);
    Bytes little(60);
    in = scene(96, 80, 40);
    EXPECT_EQ(chain.encoder->encode(in.view(), {}, {}, little).status, ColourStatus::kNoRoom);
    const auto coded = chain.encode(in);
    EXPECT_TRUE(coded.key);
    EXPECT_EQ(chain.decode(chain.bytes(coded), out), ColourStatus::kOk);
  }
}

TEST(ColourStream, RefusesSizesThatAreNotItsOwn) {
  ColourStreamConfig config;
  EXPECT_THROW(static_cast<void>(make_colour_encoder(startup.token(), config, 641, 10)),
               std::runtime_error);
  EXPECT_THROW(static_cast<void>(make_colour_encoder(startup.token(), config, 10, 0)),
               std::runtime_error);
  for (const char* method : methods()) {
    Chain chain(method, 96, 80);
    Picture in = scene(96, 80, 0), other(80, 96), empty(0, 0);
    const Bytes bytes = chain.bytes(chain.encode(in));
    EXPECT_EQ(chain.decode(bytes, other), ColourStatus::kBadSize);
    EXPECT_EQ(chain.decode(bytes, empty), ColourStatus::kBadSize);
    EXPECT_EQ(chain.encode(empty).status, ColourStatus::kBadSize);
    std::vector<std::uint16_t> depth(7);
    EXPECT_EQ(chain.decode(bytes, in, depth), ColourStatus::kBadSize);
  }
}

// Without its check made good a damaged picture is always refused; with it the library gets to see
// it, and whatever it says must be a status.
TEST(ColourStream, DamageIsAStatus) {
  std::printf("  seed 12\n");
  rt::Random random(12);
  for (const char* method : methods()) {
    Chain chain(method, 96, 80);
    Picture first = scene(96, 80, 0), second = scene(96, 80, 1), out(96, 80);
    const Bytes key = chain.bytes(chain.encode(first)), next = chain.bytes(chain.encode(second));
    int refused = 0, garbage = 0;
    for (int n = 0; n < 1500; ++n) {
      ASSERT_EQ(chain.decode(key, out), ColourStatus::kOk);
      Bytes bad = n % 2 == 0 ? key : next;
      if (n % 5 == 0) bad.resize(static_cast<std::size_t>(random.integer(0, bad.size() - 1)));
      for (auto k = random.integer(1, 4); k > 0 && !bad.empty(); --k)
        bad[static_cast<std::size_t>(random.integer(0, bad.size() - 1))] ^=
            static_cast<std::uint8_t>(1U << random.integer(0, 7));
      if (bad == key || bad == next) continue;
      const bool sealed = n % 4 >= 2;
      if (sealed) drivers::seal_colour(bad);
      const ColourStatus status = chain.decode(bad, out);
      EXPECT_TRUE(sealed || status != ColourStatus::kOk);
      ++(status == ColourStatus::kOk ? garbage : refused);
    }
    std::printf("  %s: %d refused, %d decoded\n", method, refused, garbage);
    EXPECT_GT(refused, 750);
    ASSERT_EQ(chain.decode(key, out), ColourStatus::kOk);
    EXPECT_GT(psnr(first, out), 30);
  }
}

}  // namespace
