// The depth stream: what each mode promises of each pixel, equal states, keys, stripes on threads.
#include <algorithm>
#include <array>
#include <thread>

#include "drivers/codec/depth_motion.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/drivers_depth_stream/streams.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace depth_stream_test;

TEST(DepthStream, KeepsWhatEachModePromisesOnAnyImage) {
  const std::array<std::array<int, 2>, 7> sizes{
      {{1, 1}, {1, 40}, {8, 8}, {9, 17}, {63, 5}, {64, 48}, {80, 33}}};
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    rt::Random random(seed, 1);
    const auto [w, h] = sizes[seed % sizes.size()];
    const auto law = seed % 2 == 0 ? DepthNoiseLaw::kStrict : DepthNoiseLaw::kLenient;
    Streams s(w, h, law);
    Image image = wild_image(s.shown.size(), random);
    for (int frame = 0; frame < 25; ++frame) {
      const DepthDemand demand{kModes[random() % 4], static_cast<int>(random() % 9) - 1,
                               random.uniform() < 0.1};
      if (random.uniform() < 0.2) image = wild_image(s.shown.size(), random);
      for (auto& p : image) {
        if (random.uniform() < 0.02) p = static_cast<std::uint16_t>(random());
        if (p > 2 && random.uniform() < 0.5) p = static_cast<std::uint16_t>(p - random() % 3);
      }
      ASSERT_TRUE(s.pass(image, demand)) << "seed " << seed << " frame " << frame;
    }
  }
}

TEST(DepthStream, LargestImageAndExtremes) {
  Streams s(640, 480);
  const std::size_t n = s.shown.size();
  Image checks(n);
  for (std::size_t i = 0; i < n; ++i)
    checks[i] = i % 2 == 0 ? 65535 : static_cast<std::uint16_t>(i % 3);
  rt::Random random(5);
  Image white(n);
  for (auto& p : white) p = static_cast<std::uint16_t>(random());
  for (const DepthMode mode : kModes) {
    for (const Image& image : {Image(n, 0), Image(n, 65535), checks, white}) {
      ASSERT_TRUE(s.pass(image, {mode, 0, false})) << drivers::to_text(mode);
    }
  }
}

TEST(DepthStream, RefusesSizesAndShortBuffers) {
  EXPECT_THROW(drivers::DepthEncoder(startup.token(), {0, 10}), std::invalid_argument);
  EXPECT_THROW(drivers::DepthDecoder(startup.token(), {641, 480}), std::invalid_argument);
  Streams s(16, 16);
  Bytes out(drivers::max_depth_frame_bytes(256) - 1);
  DepthFrameInfo info;
  EXPECT_EQ(s.encoder.encode(Image(256, 900), {}, out, info), DepthStatus::kNoRoom);
  out.resize(out.size() + 1);
  EXPECT_EQ(s.encoder.encode(Image(255, 900), {}, out, info), DepthStatus::kNoRoom);
  const Bytes frame = s.encode(Image(256, 900), {});
  EXPECT_EQ(s.info.seq, 0u) << "a refused image is no frame";
  Image small(255);
  EXPECT_EQ(s.decoder.decode(frame, small, info), DepthStatus::kNoRoom);
  Streams other(16, 8);
  EXPECT_EQ(other.decode(frame), DepthStatus::kBadSize);
  EXPECT_EQ(s.decode(frame), DepthStatus::kOk);
}

TEST(DepthStream, AfterALostFrameOnlyAKeyIsTaken) {
  test_support::DepthScene scene(64, 48);
  scene.look(0);
  Streams s(64, 48);
  const DepthDemand quiet{DepthMode::kQuiet, -1, false};
  EXPECT_TRUE(s.decoder.needs_key());
  ASSERT_TRUE(s.pass(scene.image({}, 1, 0), quiet));
  EXPECT_EQ(s.info.kind, DepthFrameKind::kKey);
  ASSERT_TRUE(s.pass(scene.image({}, 1, 1), quiet));
  EXPECT_NE(s.info.kind, DepthFrameKind::kKey);
  static_cast<void>(s.encode(scene.image({}, 1, 2), quiet));  // lost
  const Image before = s.shown;
  EXPECT_EQ(s.decode(s.encode(scene.image({}, 1, 3), quiet)), DepthStatus::kNeedsKey);
  EXPECT_EQ(s.shown, before) << "a refused frame shows nothing";
  ASSERT_TRUE(s.pass(scene.image({}, 1, 4), {DepthMode::kQuiet, -1, true}));
  EXPECT_EQ(s.decoded.kind, DepthFrameKind::kKey);
  ASSERT_TRUE(s.pass(scene.image({}, 1, 5), quiet));
  s.encoder.restart();
  ASSERT_TRUE(s.pass(scene.image({}, 1, 6), quiet));
  EXPECT_EQ(s.decoded.kind, DepthFrameKind::kKey);
}

// A frame of another stream with the right number is none of this one's.
TEST(DepthStream, ADeltaFollowsTheVeryFrameItWasCodedAfter) {
  Streams a(32, 32), b(32, 32);
  ASSERT_TRUE(a.pass(Image(1024, 900), {}));
  ASSERT_TRUE(b.pass(Image(1024, 1200), {}));
  const Bytes next = b.encode(Image(1024, 1300), {});
  EXPECT_EQ(a.decode(next), DepthStatus::kBadCheck);
  EXPECT_FALSE(a.decoder.needs_key());
  EXPECT_EQ(b.decode(next), DepthStatus::kOk);
}

class Backwards final : public rt::ForkJoin {
 public:
  [[nodiscard]] int width() const noexcept override { return 1; }

 protected:
  void run(int parts, Body body, const void* context) noexcept override {
    for (int p = parts; p-- > 0;) body(context, p);
  }
};
class Threads final : public rt::ForkJoin {
 public:
  [[nodiscard]] int width() const noexcept override { return 2; }

 protected:
  void run(int parts, Body body, const void* context) noexcept override {
    std::vector<std::thread> members;
    for (int p = 0; p < parts; ++p) members.emplace_back([=] { body(context, p); });
    for (auto& m : members) m.join();
  }
};

TEST(DepthStream, SameBytesAndImagesWhoeverCodesTheStripes) {
  test_support::DepthScene scene(128, 104);
  Streams one(128, 104), backwards(128, 104), two(128, 104);
  Backwards last_first;
  Threads threads;
  for (std::uint64_t i = 0; i < 24; ++i) {
    scene.look(i < 12 ? 0.0 : 0.03 * static_cast<double>(i));
    const Image image = scene.image({}, 3, i);
    const DepthDemand demand{kModes[i / 6], -1, i == 9};
    const Bytes bytes = one.encode(image, demand);
    ASSERT_EQ(bytes, backwards.encode(image, demand, last_first));
    ASSERT_EQ(bytes, two.encode(image, demand, threads));
    ASSERT_EQ(one.decode(bytes), DepthStatus::kOk);
    ASSERT_EQ(two.decode(bytes, threads), DepthStatus::kOk);
    ASSERT_EQ(one.shown, two.shown);
  }
}

TEST(DepthStream, StatesAreEqualOverTenThousandFrames) {
  constexpr std::size_t kViews = 10, kImages = 8;  // at rest in a view for 50 frames
  test_support::DepthScene scene(64, 48);
  std::vector<Image> images;
  for (std::size_t i = 0; i < kViews * kImages; ++i) {
    if (i % kImages == 0) scene.look(0.1 * static_cast<double>(i));
    images.push_back(scene.image({1, 0.3, 0.3}, 77, i));
  }
  Streams s(64, 48);
  rt::Random random(77);
  DepthDemand demand;
  std::array<int, 3> kinds{};
  for (std::uint64_t frame = 0; frame < 10000; ++frame) {
    if (frame % 50 == 0) demand = {kModes[random() % 4], static_cast<int>(random() % 9) - 1, false};
    demand.key = random.uniform() < 0.01;
    const std::size_t view = demand.mode == DepthMode::kMoving ? frame : frame / 50;
    const Bytes bytes = s.encode(images[view % kViews * kImages + random() % kImages], demand);
    ASSERT_EQ(s.decode(bytes), DepthStatus::kOk);
    ASSERT_EQ(s.encoder.state_hash(), s.decoder.state_hash()) << "frame " << frame;
    ++kinds[static_cast<std::size_t>(s.decoded.kind)];
  }
  EXPECT_GT(kinds[0], 50);
  EXPECT_GT(kinds[1], 1000);
  std::printf("  %d keys, %d deltas, %d refinements\n", kinds[0], kinds[1], kinds[2]);
}

// Integers in, bytes out: the same on every machine, compiler and instruction set.
TEST(DepthStream, BytesAreThoseOfEveryMachine) {
  rt::Random random(4);
  rt::Hash64 hash;
  // Where the frame names none: fixed here, so that a better default is no other form.
  constexpr int kSteps[2][4] = {{0, 4, 2, 6}, {0, 2, 0, 2}};
  for (const auto law : {DepthNoiseLaw::kStrict, DepthNoiseLaw::kLenient}) {
    Streams s(72, 56, law);
    for (int frame = 0; frame < 40; ++frame) {
      Image image(s.shown.size());
      for (std::size_t i = 0; i < image.size(); ++i) {
        const std::uint64_t r = random();
        const std::size_t x = i % 72, y = i / 72;
        const std::size_t z = (x < 30 ? 900 : 1700) + 3 * y + (frame < 30 ? 0 : 5 * x) + r % 5;
        image[i] = static_cast<std::uint16_t>(r >> 32U < 0x08000000U ? 0 : z);
      }
      const DepthMode mode = kModes[frame / 10];
      const int own = kSteps[law == DepthNoiseLaw::kStrict ? 0 : 1][static_cast<std::size_t>(mode)];
      const int step = frame % 9 - 1;
      const Bytes bytes = s.encode(image, {mode, step < 0 ? own : step, false});
      hash.bytes(bytes.data(), bytes.size());
    }
  }
  EXPECT_EQ(hash.digest(), 3555358007399558345u)
      << "a change of the coded form: raise the magic of the header too";
}

TEST(DepthStream, NeitherAllocatesNorLocks) {
  test_support::DepthScene scene(64, 48);
  scene.look(0);
  Streams s(64, 48);
  Bytes out(drivers::max_depth_frame_bytes(64 * 48));
  for (const DepthMode mode : kModes) {
    const Image image = scene.image({}, 1, 1);
    rt_guard::reset();
    {
      const rt::Section section;
      EXPECT_EQ(s.encoder.encode(image, {mode, -1, false}, out, s.info), DepthStatus::kOk);
      EXPECT_EQ(s.decoder.decode({out.data(), s.info.bytes}, s.shown, s.decoded), DepthStatus::kOk);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0u);
  }
  drivers::DepthMotion motion(startup.token(), {64, 48, DepthNoiseLaw::kStrict});
  const Image image = scene.image({}, 1, 1);
  rt_guard::reset();
  {
    const rt::Section section;
    for (int i = 0; i < 20; ++i) EXPECT_EQ(motion.judge(image), DepthMode::kQuiet);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

}  // namespace
