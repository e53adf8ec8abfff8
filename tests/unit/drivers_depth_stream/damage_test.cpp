// Damaged frames: refused, or bounded where the check was made to fit; the decoder stays usable.
#include <array>

#include "drivers/codec/depth_frame.hpp"
#include "tests/unit/drivers_depth_stream/streams.hpp"

namespace {

using namespace depth_stream_test;

// Flips, overwrites, cuts and insertions, in an exactly fitting heap block (for the sanitizers).
Bytes damaged(Bytes b, rt::Random& random) {
  const auto n = random.integer(1, 6);
  for (std::int64_t i = 0; i < n && !b.empty(); ++i) {
    const auto at =
        static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(b.size()) - 1));
    switch (random.integer(0, 5)) {
      case 0:
        b.resize(at);
        break;
      case 1:
        b.insert(b.begin() + static_cast<std::ptrdiff_t>(at), static_cast<std::uint8_t>(random()));
        break;
      case 2:
        b[at] = static_cast<std::uint8_t>(random());
        break;
      default:
        b[at] = static_cast<std::uint8_t>(b[at] ^ (1U << (random() % 8)));
        break;
    }
  }
  b.shrink_to_fit();
  return b;
}

// Lengths and check as if an encoder had written it.
void seal(Bytes& b, std::uint64_t check_before, std::uint32_t seq) {
  drivers::codec::DepthFrameHeader h;
  if (b.size() < drivers::kDepthFrameHeader) return;
  for (std::size_t i = 0; i < 4; ++i) {
    b[12 + i] = static_cast<std::uint8_t>(seq >> (8 * i));
    b[20 + i] = static_cast<std::uint8_t>((b.size() - drivers::kDepthFrameHeader) >> (8 * i));
  }
  if (drivers::codec::read_header(b, h) != DepthStatus::kOk) return;
  drivers::codec::write_header(h, check_before, b);
}

class DepthDamage : public testing::Test {
 protected:
  static constexpr int kWidth = 48, kHeight = 40;
  static constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;

  // A stream up to some frame, and the frame after it.
  struct Case {
    std::vector<Bytes> before;
    Bytes frame;
  };
  void SetUp() override {
    test_support::DepthScene scene(kWidth, kHeight);
    scene.look(0);
    for (const DepthMode mode : kModes) {
      Streams s(kWidth, kHeight);
      Case c;
      for (std::uint64_t i = 0; i < 4; ++i) {
        c.frame = s.encode(scene.image({1, 0.3, 0.3}, 8, i), {mode, -1, false});
        c.before.push_back(c.frame);
        cases_.push_back({{c.before.begin(), c.before.end() - 1}, c.frame});
      }
    }
  }
  // The decoder as it was before the frame.
  static void prepare(Streams& s, const Case& c) {
    for (const Bytes& b : c.before) ASSERT_EQ(s.decode(b), DepthStatus::kOk);
  }
  std::vector<Case> cases_;
};

TEST_F(DepthDamage, AHundredThousandFramesAreRefusedByTheCheckAndHarmNothing) {
  constexpr int kFrames = 100000;
  rt::Random random(2026);
  std::array<int, 8> seen{};
  int unchanged = 0;
  for (const Case& c : cases_) {
    Streams s(kWidth, kHeight);
    prepare(s, c);
    const std::uint64_t state = s.decoder.state_hash();
    std::vector<std::uint16_t> guarded(kPixels + 2, 0xabcd);
    const auto inside = std::span(guarded).subspan(1, kPixels);
    for (int i = 0; i < kFrames / static_cast<int>(cases_.size()); ++i) {
      const Bytes b = damaged(c.frame, random);
      if (b == c.frame) {
        ++unchanged;
        continue;
      }
      const DepthStatus status = s.decoder.decode(b, inside, s.decoded);
      ++seen[static_cast<std::size_t>(status)];
      ASSERT_NE(status, DepthStatus::kOk) << "seed 2026, input " << i;
    }
    for (const std::uint16_t v : guarded) ASSERT_EQ(v, 0xabcd) << "a refused frame shows nothing";
    ASSERT_EQ(s.decoder.state_hash(), state);
    ASSERT_EQ(s.decode(c.frame), DepthStatus::kOk) << "the sound frame is still taken";
  }
  std::printf(
      "  seed 2026: %d truncated, %d bad header, %d bad size, %d bad check, %d need a key\n",
      seen[2], seen[3], seen[4], seen[5], seen[6]);
  EXPECT_EQ(unchanged + seen[2] + seen[3] + seen[4] + seen[5] + seen[6],
            kFrames / static_cast<int>(cases_.size()) * static_cast<int>(cases_.size()));
}

TEST_F(DepthDamage, ContentBehindAFittingCheckIsRefusedOrBounded) {
  rt::Random random(909);
  std::array<int, 8> seen{};
  for (const Case& c : cases_) {
    Streams s(kWidth, kHeight);
    prepare(s, c);
    std::uint64_t check = 0;
    if (!c.before.empty()) {
      drivers::codec::DepthFrameHeader h;
      ASSERT_EQ(drivers::codec::read_header(c.before.back(), h), DepthStatus::kOk);
      check = h.check;
    }
    const auto seq = static_cast<std::uint32_t>(c.before.size());
    for (int i = 0; i < 500; ++i) {
      Bytes b = damaged(c.frame, random);
      seal(b, check, seq);
      const DepthStatus status = s.decode(b);
      ++seen[static_cast<std::size_t>(status)];
      if (status != DepthStatus::kOk && status != DepthStatus::kBadData) continue;
      EXPECT_EQ(s.decoder.needs_key(), status == DepthStatus::kBadData);
      prepare(s, c);  // begins with a key, so whatever there was is gone
    }
  }
  std::printf("  seed 909: %d decoded to something, %d bad data, %d otherwise refused\n", seen[0],
              seen[7], seen[2] + seen[3] + seen[4] + seen[5] + seen[6]);
  EXPECT_GT(seen[7], 2000);
  EXPECT_EQ(seen[5], 0) << "the check was made to fit";
}

}  // namespace
