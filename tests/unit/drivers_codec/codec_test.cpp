// Depth and colour codecs and the wire form: round trips, worst cases, damaged input.
#include <gtest/gtest.h>

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <memory>
#include <numeric>
#include <span>
#include <string_view>
#include <vector>

#include "drivers/camera/render.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "drivers/link/depth_codec.hpp"
#include "drivers/link/frame_codec.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tasks/contract/table.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/tsan_libraries.hpp"
#include "tests/unit/drivers_camera/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using camera_test::load_world;
using camera_test::startup;
using drivers::EncodedFrame;
using drivers::FrameCodecScratch;
using drivers::FrameStatus;
using perception::Rgb;
using perception::RgbdFrame;

using Depth = std::vector<std::uint16_t>;
using Bytes = std::vector<std::uint8_t>;

Bytes encode(const Depth& d) {
  Bytes out(drivers::max_depth_bytes(d.size()));
  out.resize(drivers::encode_depth(d, out));
  return out;
}
bool round_trip(const Depth& d) {
  const Bytes b = encode(d);
  Depth back(d.size(), 12345);
  return !b.empty() && drivers::decode_depth(b, back) && back == d;
}

// Smooth surfaces with steps, holes and noise: what a depth camera gives.
Depth depth_like(rt::Random& rng, int w, int h) {
  Depth d(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
  double z = rng.uniform(500, 4000);
  for (auto& p : d) {
    if (rng.uniform() < 0.01) z = rng.uniform(500, 4000);
    p = rng.uniform() < 0.1 ? std::uint16_t{0} : static_cast<std::uint16_t>(z + 3 * rng.normal());
  }
  return d;
}

TEST(DepthCodec, LosslessOnHardCases) {
  EXPECT_TRUE(round_trip({}));
  EXPECT_TRUE(round_trip({0}));
  EXPECT_TRUE(round_trip({1}));
  EXPECT_TRUE(round_trip({65535}));
  EXPECT_TRUE(round_trip(Depth(10000, 0)));
  EXPECT_TRUE(round_trip(Depth(10000, 65535)));
  Depth alternating(10001);
  for (std::size_t i = 0; i < alternating.size(); ++i) alternating[i] = i % 2 == 0 ? 65535 : 0;
  EXPECT_TRUE(round_trip(alternating));
  for (std::size_t i = 0; i < alternating.size(); ++i) alternating[i] = i % 2 == 0 ? 65535 : 1;
  EXPECT_TRUE(round_trip(alternating));
  EXPECT_LE(encode(alternating).size(), 2 * alternating.size() + 1);  // went out plain
}

TEST(DepthCodec, LosslessOnRandomImages) {
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    rt::Random rng(seed, 1);
    Depth d(static_cast<std::size_t>(rng.integer(0, 3000)));
    const double empty = rng.uniform(), bits = rng.uniform(1, 16);
    for (auto& p : d) {
      p = rng.uniform() < empty
              ? std::uint16_t{0}
              : static_cast<std::uint16_t>(rng() & ((1U << static_cast<unsigned>(bits)) - 1));
    }
    ASSERT_TRUE(round_trip(d)) << "seed " << seed;
    ASSERT_TRUE(round_trip(depth_like(rng, 64, 48))) << "seed " << seed;
  }
}

TEST(DepthCodec, RefusesTheWrongNumberOfPixelsAndTooLittleRoom) {
  rt::Random rng(4);
  const Depth d = depth_like(rng, 40, 30);
  const Bytes b = encode(d);
  Depth shorter(d.size() - 1), longer(d.size() + 1);
  EXPECT_FALSE(drivers::decode_depth(b, shorter));
  EXPECT_FALSE(drivers::decode_depth(b, longer));
  EXPECT_FALSE(drivers::decode_depth({}, shorter));
  Bytes more = b;
  more.push_back(0);
  Depth same(d.size());
  EXPECT_FALSE(drivers::decode_depth(more, same));
  Bytes small(drivers::max_depth_bytes(d.size()) - 1);
  EXPECT_EQ(drivers::encode_depth(d, small), 0u);
}

// Flips, overwrites, cuts and insertions. The decoder refuses or gives garbage, within its bounds:
// input and output stand between sentinels in exactly fitting heap blocks (for the sanitizers).
Bytes damage(Bytes b, rt::Random& rng) {
  const auto n = rng.integer(1, 8);
  for (std::int64_t i = 0; i < n && !b.empty(); ++i) {
    const auto at =
        static_cast<std::size_t>(rng.integer(0, static_cast<std::int64_t>(b.size()) - 1));
    switch (rng.integer(0, 4)) {
      case 0:
        b[at] = static_cast<std::uint8_t>(b[at] ^ (1U << (rng() % 8)));
        break;
      case 1:
        b[at] = static_cast<std::uint8_t>(rng());
        break;
      case 2:
        b.resize(at);
        break;
      case 3:
        b.insert(b.begin() + static_cast<std::ptrdiff_t>(at), static_cast<std::uint8_t>(rng()));
        break;
      default:
        b[at] = 0xff;
        break;
    }
  }
  b.shrink_to_fit();
  return b;
}

TEST(DepthCodec, DamagedInputNeverLeavesTheBounds) {
  rt::Random rng(2024);
  const Bytes good[] = {encode(depth_like(rng, 32, 24)), encode(Depth(768, 0)),
                        encode(Depth(768, 700))};
  int refused = 0, garbage = 0;
  std::vector<std::uint16_t> out(768 + 2, 0xabcd);
  for (int i = 0; i < 100000; ++i) {
    const Bytes b = damage(good[i % 3], rng);
    (drivers::decode_depth(b, std::span(out).subspan(1, 768)) ? garbage : refused)++;
    ASSERT_EQ(out.front(), 0xabcd);
    ASSERT_EQ(out.back(), 0xabcd);
  }
  EXPECT_GT(refused, 10000);
  EXPECT_GT(garbage, 10);
  std::printf("  damaged depth: %d refused, %d decoded to something else\n", refused, garbage);
}

TEST(DepthCodec, PureNoiseIsNeverTrusted) {
  rt::Random rng(77);
  constexpr std::size_t kPixels = 500, kGuard = 16;
  constexpr std::uint16_t kCanary = 0xa55a;
  Depth out(kPixels + kGuard, kCanary);
  int refused = 0;
  for (int i = 0; i < 20000; ++i) {
    Bytes b(static_cast<std::size_t>(rng.integer(0, 600)));
    for (auto& x : b) x = static_cast<std::uint8_t>(rng());
    if (!b.empty()) b[0] = 1;
    if (!drivers::decode_depth(b, std::span(out).first(kPixels))) ++refused;
    for (std::size_t k = 0; k < kGuard; ++k) ASSERT_EQ(out[kPixels + k], kCanary) << "input " << i;
  }
  EXPECT_GT(refused, 10000) << "noise is hardly ever a depth image";
}

TEST(DepthCodec, AllocatesNothing) {
  rt::Random rng(5);
  const Depth d = depth_like(rng, 64, 48);
  Bytes out(drivers::max_depth_bytes(d.size()));
  Depth back(d.size());
  rt_guard::reset();
  {
    rt::Section section;
    const std::size_t n = drivers::encode_depth(d, out);
    EXPECT_TRUE(drivers::decode_depth({out.data(), n}, back));
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

// ---- colour ----------------------------------------------------------------------------------

struct Frames {
  Frames() {
    const auto world = load_world("default_room.toml");
    const drivers::SyntheticCameraConfig camera;
    drivers::RenderScratch scratch(startup.token(), world.shapes().size());
    const drivers::DepthNoise noise(startup.token(), drivers::DepthNoiseConfig{1, 0.3, 0.3, 0.1});
    drivers::render(world, camera.intrinsics(), camera.X_BC(), {}, noise, 1, 3, scratch, *source);
    source->exposure = rt::time_from_ns(123456789);
  }
  std::unique_ptr<RgbdFrame> source = std::make_unique<RgbdFrame>();
  std::unique_ptr<RgbdFrame> back = std::make_unique<RgbdFrame>();
  std::unique_ptr<EncodedFrame> encoded = std::make_unique<EncodedFrame>();
};

double psnr(const RgbdFrame& a, const RgbdFrame& b) {
  double sum = 0;
  const std::size_t n = static_cast<std::size_t>(a.intrinsics.width * a.intrinsics.height);
  for (std::size_t i = 0; i < n; ++i) {
    const auto square = [](int x, int y) { return static_cast<double>((x - y) * (x - y)); };
    sum += square(a.colour[i].r, b.colour[i].r) + square(a.colour[i].g, b.colour[i].g) +
           square(a.colour[i].b, b.colour[i].b);
  }
  return 10 * std::log10(255.0 * 255.0 * 3 * static_cast<double>(n) / sum);
}

TEST(ColourCodec, PictureComesBack) {
  Frames f;
  for (const bool half : {false, true}) {
    FrameCodecScratch scratch(startup.token(), {.quality = 80, .half = half});
    ASSERT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
    ASSERT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kOk);
    ASSERT_TRUE(f.back->has_colour);
    const double p = psnr(*f.source, *f.back);
    std::printf("  colour %s: %u bytes, PSNR %.1f dB\n", half ? "half" : "full",
                f.encoded->colour_size, p);
    EXPECT_GT(p, half ? 22 : 26);
    // Red stays red: no swapped channels.
    double swapped = 0;
    for (std::size_t i = 0; i < 512 * 424; ++i) {
      swapped += std::abs(f.source->colour[i].r - f.back->colour[i].b);
    }
    EXPECT_GT(swapped / (512 * 424), 20);
  }
}

// ---- whole frames ----------------------------------------------------------------------------

TEST(FrameCodec, RoundTripKeepsAllButTheColoursLastBits) {
  Frames f;
  FrameCodecScratch scratch(startup.token(), {});
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
  EXPECT_EQ(f.encoded->exposure, (rt::Stamp{rt::Box::kRobot, 123456789}));
  const rt::Time local = rt::time_from_ns(42);
  ASSERT_EQ(decode(*f.encoded, local, scratch, *f.back), FrameStatus::kOk);
  EXPECT_EQ(f.back->exposure, local);
  EXPECT_EQ(f.back->seq, f.source->seq);
  EXPECT_EQ(f.back->intrinsics, f.source->intrinsics);
  EXPECT_TRUE(std::equal(f.source->depth_mm.begin(), f.source->depth_mm.begin() + 512 * 424,
                         f.back->depth_mm.begin()));
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, false, scratch, *f.encoded), FrameStatus::kOk);
  EXPECT_EQ(f.encoded->colour_size, 0u);
  ASSERT_EQ(decode(*f.encoded, local, scratch, *f.back), FrameStatus::kOk);
  EXPECT_FALSE(f.back->has_colour);
}

TEST(FrameCodec, SameFrameSameBytes) {
  Frames f;
  const auto digest = [&f](FrameCodecScratch& scratch) {
    EXPECT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
    rt::Hash64 h;
    h.bytes(f.encoded->bytes.data(), f.encoded->depth_size + f.encoded->colour_size);
    return h.digest();
  };
  FrameCodecScratch a(startup.token(), {}), b(startup.token(), {});
  const auto first = digest(a);
  EXPECT_EQ(first, digest(a));
  EXPECT_EQ(first, digest(b));
  ++f.source->depth_mm[1000];
  EXPECT_NE(first, digest(a));
}

// A scene that names no step gets that of its mode and of its noise law.
TEST(FrameCodec, TheStepIsThatOfTheModeAndTheLaw) {
  Frames f;
  for (const auto mode :
       {drivers::DepthMode::kFaithful, drivers::DepthMode::kQuiet, drivers::DepthMode::kMoving}) {
    for (const auto law : {drivers::DepthNoiseLaw::kStrict, drivers::DepthNoiseLaw::kLenient}) {
      drivers::PictureConfig pictures;
      pictures.depth_codec = to_text(mode);
      pictures.depth_noise = to_text(law);
      const auto& k = f.source->intrinsics;
      FrameCodecScratch scratch(startup.token(), {}, pictures, k, drivers::CodecEnd::kEncodes);
      ASSERT_EQ(encode(*f.source, rt::Box::kRobot, false, scratch, *f.encoded), FrameStatus::kOk);
      drivers::DepthDecoder decoder(startup.token(), {k.width, k.height, law});
      Depth back(static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height));
      drivers::DepthFrameInfo info;
      ASSERT_EQ(decoder.decode(f.encoded->depth(), back, info), drivers::DepthStatus::kOk);
      EXPECT_EQ(info.step, drivers::default_depth_step(mode, law))
          << to_text(mode) << ' ' << to_text(law);
    }
  }
}

// auto: quiet until the picture moves, moving from then on, quiet again when it has rested.
TEST(FrameCodec, AutoTakesTheModeThatTheCameraCallsFor) {
  Frames f;
  drivers::PictureConfig pictures;
  pictures.depth_codec = "auto";
  EXPECT_TRUE(pictures.on_demand());
  const auto& k = f.source->intrinsics;
  FrameCodecScratch robot(startup.token(), {}, pictures, k, drivers::CodecEnd::kEncodes),
      desk(startup.token(), {}, pictures, k, drivers::CodecEnd::kDecodes);
  std::string modes;
  for (int i = 0; i < 40; ++i) {
    if (i >= 10 && i < 20) {
      for (auto& mm : f.source->depth_mm) mm = static_cast<std::uint16_t>(mm == 0 ? 0 : mm + 12);
    }
    ASSERT_EQ(encode(*f.source, rt::Box::kRobot, false, robot, *f.encoded), FrameStatus::kOk);
    ASSERT_EQ(decode(*f.encoded, rt::Time{}, desk, *f.back), FrameStatus::kOk) << "frame " << i;
    modes += to_text(robot.depth_mode)[0];
  }
  std::printf("  %s\n", modes.c_str());
  EXPECT_EQ(modes.substr(0, 10), "qqqqqqqqqq");
  EXPECT_EQ(modes.substr(13, 7), "mmmmmmm");
  EXPECT_EQ(modes.substr(36), "qqqq");
}

// Pictures that stand alone: one that does not decode asks for no key, which depth would pay for.
TEST(FrameCodec, ADamagedJpegAsksForNoKey) {
  Frames f;
  FrameCodecScratch scratch(startup.token(), {});
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
  EXPECT_FALSE(f.encoded->needs_previous);
  f.encoded->bytes[f.encoded->depth_size + f.encoded->colour_size / 2] ^= 0x40U;
  EXPECT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kWithoutColour);
  EXPECT_FALSE(scratch.colour_wants_key);
}

TEST(FrameCodec, WorstCaseFits) {
  Frames f;
  rt::Random rng(12);
  f.source->intrinsics = {500, 500, 320, 240, 640, 480};
  for (auto& d : f.source->depth_mm) d = static_cast<std::uint16_t>(rng());
  for (auto& c : f.source->colour) {
    const auto bits = rng();
    c = {static_cast<std::uint8_t>(bits), static_cast<std::uint8_t>(bits >> 8U),
         static_cast<std::uint8_t>(bits >> 16U)};
  }
  FrameCodecScratch scratch(startup.token(), {.quality = 100, .half = false});
  // Noise at the best quality is more than the slot holds: depth goes out, colour does not.
  EXPECT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded),
            FrameStatus::kWithoutColour);
  ASSERT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kOk);
  EXPECT_EQ(f.source->depth_mm, f.back->depth_mm);
}

TEST(FrameCodec, FramesThatAreNoImagesAreRefused) {
  Frames f;
  FrameCodecScratch scratch(startup.token(), {});
  const auto with = [&](perception::Intrinsics k) {
    f.source->intrinsics = k;
    return encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded);
  };
  EXPECT_EQ(with({365, 365, 255, 211, 641, 424}), FrameStatus::kBadHeader);
  EXPECT_EQ(with({365, 365, 255, 211, 0, 424}), FrameStatus::kBadHeader);
  EXPECT_EQ(with({365, 365, 255, 211, 512, -1}), FrameStatus::kBadHeader);
  EXPECT_EQ(with({std::nan(""), 365, 255, 211, 512, 424}), FrameStatus::kBadHeader);
  EXPECT_EQ(with({365, 365, INFINITY, 211, 512, 424}), FrameStatus::kBadHeader);
  f.encoded->intrinsics = {365, 365, 255, 211, 512, 424};
  f.encoded->depth_size = EncodedFrame::kMaxDepthBytes + 1;
  EXPECT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kBadHeader);
}

TEST(Wire, RoundTripAndEveryByteCounts) {
  Frames f;
  f.source->intrinsics = {36.5, 36.25, 15.5, 11.5, 32, 24};
  FrameCodecScratch scratch(startup.token(), {});
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
  Bytes wire(wire_size(*f.encoded));
  ASSERT_EQ(write_wire(*f.encoded, wire), wire.size());
  auto back = std::make_unique<EncodedFrame>();
  ASSERT_EQ(read_wire(wire, *back), FrameStatus::kOk);
  EXPECT_EQ(back->exposure, f.encoded->exposure);
  EXPECT_EQ(back->seq, f.encoded->seq);
  EXPECT_EQ(back->intrinsics, f.encoded->intrinsics);
  EXPECT_EQ(back->has_colour, f.encoded->has_colour);
  EXPECT_TRUE(std::ranges::equal(back->depth(), f.encoded->depth()));
  EXPECT_TRUE(std::ranges::equal(back->colour(), f.encoded->colour()));
  Bytes small(wire.size() - 1);
  EXPECT_EQ(write_wire(*f.encoded, small), 0u);
  for (std::size_t n = 0; n < wire.size(); ++n) {  // every truncation
    ASSERT_NE(read_wire({wire.data(), n}, *back), FrameStatus::kOk) << n;
  }
  Bytes longer = wire;
  longer.push_back(0);
  EXPECT_EQ(read_wire(longer, *back), FrameStatus::kBadHeader) << "bytes that nothing vouches for";
  for (std::size_t bit = 0; bit < wire.size() * 8; ++bit) {  // every single flipped bit
    Bytes b = wire;
    b[bit / 8] = static_cast<std::uint8_t>(b[bit / 8] ^ (1U << (bit % 8)));
    ASSERT_NE(read_wire(b, *back), FrameStatus::kOk) << bit;
  }
}

// What the sender spares is said at the moment of sending; what no sender says is refused.
TEST(Wire, EachFrameSaysWhatIsSpared) {
  using drivers::Spared;
  Frames f;
  f.source->intrinsics = {36.5, 36.25, 15.5, 11.5, 32, 24};
  FrameCodecScratch scratch(startup.token(), {});
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
  Bytes wire(wire_size(*f.encoded));
  auto back = std::make_unique<EncodedFrame>();
  for (std::uint8_t rungs = 0; rungs <= Spared::kMost; ++rungs) {
    for (const auto why : {Spared::Why::kBusy, Spared::Why::kLate}) {
      ASSERT_EQ(write_wire(*f.encoded, wire, {rungs, why}), wire.size());
      ASSERT_EQ(read_wire(wire, *back), FrameStatus::kOk);
      EXPECT_EQ(back->spared, rungs == 0 ? Spared{} : (Spared{rungs, why}));
      EXPECT_EQ(back->has_colour, f.encoded->has_colour);
    }
  }
  constexpr std::size_t kFlags = 5;
  for (const unsigned bad : {6U << 2U, 7U << 2U, 32U, 64U, 128U}) {
    Bytes b = wire;
    b[kFlags] = static_cast<std::uint8_t>((b[kFlags] & 3U) | bad);
    EXPECT_EQ(read_wire(b, *back), FrameStatus::kBadHeader) << bad;
  }
}

perception::JointAngles some_joints() {
  perception::JointAngles q;
  q.count = 5;
  for (std::size_t i = 0; i < 5; ++i) {
    q.position[i] = 0.25F * static_cast<float>(i) - 0.3F;
    q.speed[i] = 0.5F - 0.1F * static_cast<float>(i);
  }
  q.error = 0.01F, q.age_s = 0.02F;
  return q;
}

TEST(Wire, JointsTravelAndEveryByteOfThemCounts) {
  Frames f;
  f.source->intrinsics = {36.5, 36.25, 15.5, 11.5, 32, 24};
  FrameCodecScratch scratch(startup.token(), {});
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, false, scratch, *f.encoded), FrameStatus::kOk);
  const std::size_t without = wire_size(*f.encoded);
  f.source->joints = some_joints();
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, false, scratch, *f.encoded), FrameStatus::kOk);
  Bytes wire(wire_size(*f.encoded));
  EXPECT_EQ(wire.size(), without + 8 + 5 * 8);
  ASSERT_EQ(write_wire(*f.encoded, wire), wire.size());
  auto back = std::make_unique<EncodedFrame>();
  ASSERT_EQ(read_wire(wire, *back), FrameStatus::kOk);
  EXPECT_EQ(back->joints, f.source->joints);
  ASSERT_EQ(decode(*back, rt::Time{}, scratch, *f.back), FrameStatus::kOk);
  EXPECT_EQ(f.back->joints, f.source->joints);
  EXPECT_TRUE(std::equal(f.source->depth_mm.begin(), f.source->depth_mm.begin() + 32 * 24,
                         f.back->depth_mm.begin()));
  for (std::size_t n = 0; n < wire.size(); ++n)
    ASSERT_NE(read_wire({wire.data(), n}, *back), FrameStatus::kOk) << n;
  for (std::size_t bit = 0; bit < wire.size() * 8; ++bit) {
    Bytes b = wire;
    b[bit / 8] = static_cast<std::uint8_t>(b[bit / 8] ^ (1U << (bit % 8)));
    ASSERT_NE(read_wire(b, *back), FrameStatus::kOk) << bit;
  }
  // A frame of before, and one after it without joints, carry none of the last.
  f.source->joints = {};
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, false, scratch, *f.encoded), FrameStatus::kOk);
  wire.resize(wire_size(*f.encoded));
  ASSERT_EQ(write_wire(*f.encoded, wire), without);
  ASSERT_EQ(read_wire(wire, *back), FrameStatus::kOk);
  EXPECT_EQ(back->joints.count, 0);
  ASSERT_EQ(decode(*back, rt::Time{}, scratch, *f.back), FrameStatus::kOk);
  EXPECT_EQ(f.back->joints.count, 0);
}

TEST(FrameCodec, JointsThatSayNothingAreLeftOut) {
  Frames f;
  FrameCodecScratch scratch(startup.token(), {});
  const auto sent = [&](auto&& spoil) {
    f.source->joints = some_joints();
    spoil(f.source->joints);
    EXPECT_EQ(encode(*f.source, rt::Box::kRobot, false, scratch, *f.encoded), FrameStatus::kOk);
    return f.encoded->joints.count;
  };
  using Q = perception::JointAngles;
  EXPECT_EQ(sent([](Q&) {}), 5);
  EXPECT_EQ(sent([](Q& q) { q.position[2] = std::nanf(""); }), 0);
  EXPECT_EQ(sent([](Q& q) { q.speed[4] = INFINITY; }), 0);
  EXPECT_EQ(sent([](Q& q) { q.error = -1; }), 0);
  EXPECT_EQ(sent([](Q& q) { q.age_s = std::nanf(""); }), 0);
  EXPECT_EQ(sent([](Q& q) { q.count = 17; }), 0);
  EXPECT_EQ(sent([](Q& q) { q.position[7] = std::nanf(""); }), 5);  // beyond the count: nobody's
  // What arrives so all the same is refused.
  (void)sent([](Q&) {});
  f.encoded->joints.position[0] = std::nanf("");
  EXPECT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kBadHeader);
}

TEST(Wire, DamagedFramesAreRefused) {
  Frames f;
  f.source->intrinsics = {36.5, 36.25, 15.5, 11.5, 32, 24};
  FrameCodecScratch scratch(startup.token(), {});
  ASSERT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
  Bytes wire(wire_size(*f.encoded));
  ASSERT_EQ(write_wire(*f.encoded, wire), wire.size());
  auto back = std::make_unique<EncodedFrame>();
  rt::Random rng(31);
  int accepted = 0;
  for (int i = 0; i < 100000; ++i) {
    const Bytes b = damage(wire, rng);
    if (read_wire(b, *back) != FrameStatus::kOk) continue;
    // Damage that undid itself or came behind the end.
    ++accepted;
    ASSERT_TRUE(std::equal(wire.begin(), wire.end(), b.begin()));
  }
  EXPECT_LT(accepted, 1000);
}

// ---- cost and the real recording ---------------------------------------------------------------

// Code that a sanitizer instruments is not what the budget is for.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

// What the robot's box declares for a capture job of that level (tasks/contract/table.hpp), in ms.
double capture_budget_ms(std::string_view level) {
  for (const auto& row : tasks::kTaskTable) {
    if (row.id != tasks::TaskId::kCapture) continue;
    for (const auto& v : row.variants) {
      if (v.name == level) return static_cast<double>(v.budget_us) * 1e-3;
    }
  }
  return 0;
}

struct Sizes {
  std::uint32_t depth = 0, colour = 0;
};

// Medians of thread CPU; coding must fit the budget of the task that does it.
Sizes check_cost(const char* what, Frames& f, bool half) {
  FrameCodecScratch scratch(startup.token(), {.quality = 60, .half = half});
  std::vector<double> enc, dec, depth_enc, depth_dec;
  for (int i = 0; i < 15; ++i) {
    double t = cpu_ms();
    EXPECT_EQ(encode(*f.source, rt::Box::kRobot, false, scratch, *f.encoded), FrameStatus::kOk);
    depth_enc.push_back(cpu_ms() - t), t = cpu_ms();
    EXPECT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kOk);
    depth_dec.push_back(cpu_ms() - t), t = cpu_ms();
    EXPECT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
    enc.push_back(cpu_ms() - t), t = cpu_ms();
    EXPECT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kOk);
    dec.push_back(cpu_ms() - t);
  }
  for (auto* v : {&enc, &dec, &depth_enc, &depth_dec}) std::sort(v->begin(), v->end());
  std::printf(
      "  %-28s depth %6u B enc %.2f dec %.2f ms; with colour %s %5u B enc %.2f dec %.2f ms\n", what,
      f.encoded->depth_size, depth_enc[7], depth_dec[7], half ? "half" : "full",
      f.encoded->colour_size, enc[7], dec[7]);
  if (!kSanitized) {
    EXPECT_LE(enc[7], capture_budget_ms("colour")) << what;
    EXPECT_LE(depth_enc[7], capture_budget_ms("depth")) << what;
  }
  EXPECT_LT(depth_enc[7], enc[7]) << "colour is work of its own";
  return {f.encoded->depth_size, f.encoded->colour_size};
}

TEST(Codec, CostFitsTheBudgetOfCapture) {
  ASSERT_GT(capture_budget_ms("depth"), 0);
  ASSERT_GT(capture_budget_ms("colour"), capture_budget_ms("depth"));
  Frames f;
  const Sizes half = check_cost("synthetic 512x424, noisy", f, true);
  const Sizes full = check_cost("synthetic 512x424, noisy", f, false);
  EXPECT_EQ(half.depth, full.depth) << "the depth does not know of the colour";
  EXPECT_LT(half.depth, 512U * 424U * 2U);
  EXPECT_GT(half.colour, 0U);
  EXPECT_LT(half.colour, full.colour) << "a quarter of the pixels";
}

TEST(Codec, RealFramesAreLossless) {
  const std::string kitchen = tests::in_tree("../shared/data/rgbd/7scenes_redkitchen");
  if (!std::filesystem::exists(kitchen)) GTEST_SKIP() << kitchen << " is not there";
  const auto s = drivers::TumSequence::open(kitchen, {.register_colour = true, .to_512x424 = true});
  ASSERT_TRUE(s.has_value()) << s.error();
  Frames f;
  FrameCodecScratch scratch(startup.token(), {});
  for (int i = 0; i < 150; i += 30) {
    ASSERT_TRUE(s.value().read(i, *f.source).has_value());
    ASSERT_EQ(encode(*f.source, rt::Box::kRobot, true, scratch, *f.encoded), FrameStatus::kOk);
    ASSERT_EQ(decode(*f.encoded, rt::Time{}, scratch, *f.back), FrameStatus::kOk);
    ASSERT_TRUE(std::equal(f.source->depth_mm.begin(), f.source->depth_mm.begin() + 512 * 424,
                           f.back->depth_mm.begin()));
    // Half of the plain image at most; measured 106 kB.
    EXPECT_LT(f.encoded->depth_size, 217088u);
  }
  (void)check_cost("kitchen 512x424", f, true);
}

}  // namespace
