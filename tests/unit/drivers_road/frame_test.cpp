#include "drivers/road/road_frame.hpp"

#include <gtest/gtest.h>

#include <cstdio>

#include "rt/random.hpp"

namespace {

using drivers::RoadFrameReader;
using drivers::RoadFrameStatus;
using drivers::RoadKind;
using Bytes = std::vector<std::uint8_t>;

struct Frame {
  RoadKind kind;
  Bytes body;
  bool operator==(const Frame&) const = default;
};

Bytes random_bytes(rt::Random& r, std::size_t n) {
  Bytes b(n);
  for (auto& v : b) v = static_cast<std::uint8_t>(r());
  return b;
}

// By hand, from the header's text: shares nothing with the product.
Bytes wire(unsigned kind, std::uint32_t length, const Bytes& body, unsigned version = 1) {
  Bytes b{'R', 'D', static_cast<std::uint8_t>(version), static_cast<std::uint8_t>(kind)};
  for (unsigned i = 0; i < 4; ++i) b.push_back(static_cast<std::uint8_t>(length >> (8 * i)));
  b.insert(b.end(), body.begin(), body.end());
  return b;
}

RoadFrameStatus feed_all(RoadFrameReader& reader, const Bytes& stream, std::vector<Frame>& got) {
  return reader.feed(stream, [&](RoadKind kind, std::span<const std::uint8_t> body) {
    got.push_back({kind, {body.begin(), body.end()}});
    return true;
  });
}

TEST(RoadFrame, AnyFramesInAnyPiecesComeOutAsTheyWentIn) {
  constexpr std::uint64_t kSeed = 7101;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 300; ++n) {
    const auto cap = static_cast<std::size_t>(r.integer(1, 5000));
    std::vector<Frame> sent, got;
    Bytes stream;
    for (std::int64_t i = r.integer(1, 12); i > 0; --i) {
      Frame f{RoadKind::kMessage, {}};
      const std::int64_t kind = r.integer(0, 5);
      if (kind == 0) f = {RoadKind::kGreet, random_bytes(r, 17)};
      if (kind == 1) f = {RoadKind::kWelcome, random_bytes(r, 16)};
      if (kind == 2)
        f = {RoadKind::kRefusal, random_bytes(r, static_cast<std::size_t>(r.integer(1, 200)))};
      if (kind > 2)
        f.body =
            random_bytes(r, static_cast<std::size_t>(r.integer(1, static_cast<std::int64_t>(cap))));
      const Bytes one =
          wire(static_cast<unsigned>(f.kind), static_cast<std::uint32_t>(f.body.size()), f.body);
      Bytes product;
      append_road_frame(f.kind, f.body, product);
      ASSERT_EQ(product, one);
      stream.insert(stream.end(), one.begin(), one.end());
      sent.push_back(std::move(f));
    }
    RoadFrameReader reader;
    reader.allow_messages(cap);
    for (std::size_t at = 0; at < stream.size();) {
      const auto most = static_cast<std::int64_t>(stream.size() - at);
      const auto size = static_cast<std::size_t>(
          r.integer(0, 3) == 0 ? 1 : r.integer(1, std::min<std::int64_t>(most, 3000)));
      const Bytes piece(stream.begin() + static_cast<std::ptrdiff_t>(at),
                        stream.begin() + static_cast<std::ptrdiff_t>(at + size));
      ASSERT_EQ(feed_all(reader, piece, got), RoadFrameStatus::kOk) << n;
      ASSERT_LE(reader.held(), 8 + std::max<std::size_t>(cap, 200));
      at += size;
    }
    ASSERT_EQ(got, sent) << "case " << n;
    EXPECT_EQ(reader.held(), 0U);
  }
}

TEST(RoadFrame, LengthsAreHeldAgainstTheirCapBeforeABodyComes) {
  struct Case {
    unsigned kind;
    std::uint32_t length;
    RoadFrameStatus status;
  };
  const Case cases[] = {{1, 17, RoadFrameStatus::kOk},
                        {1, 18, RoadFrameStatus::kTooLong},
                        {2, 16, RoadFrameStatus::kOk},
                        {2, 17, RoadFrameStatus::kTooLong},
                        {3, 200, RoadFrameStatus::kOk},
                        {3, 201, RoadFrameStatus::kTooLong},
                        {4, 1000, RoadFrameStatus::kOk},
                        {4, 1001, RoadFrameStatus::kTooLong},
                        {4, 0xFFFFFFFF, RoadFrameStatus::kTooLong},
                        {1, 0x80000000, RoadFrameStatus::kTooLong},
                        {4, 0, RoadFrameStatus::kEmpty},
                        {1, 0, RoadFrameStatus::kEmpty},
                        {0, 1, RoadFrameStatus::kBadKind},
                        {5, 1, RoadFrameStatus::kBadKind},
                        {255, 1, RoadFrameStatus::kBadKind}};
  for (const Case& c : cases) {
    RoadFrameReader reader;
    reader.allow_messages(1000);
    std::vector<Frame> got;
    EXPECT_EQ(feed_all(reader, wire(c.kind, c.length, {}), got), c.status)
        << c.kind << ", " << c.length;
    EXPECT_TRUE(got.empty());
    EXPECT_LE(reader.held(), 8U) << "nothing is stored for a body that has not come";
  }
}

TEST(RoadFrame, NoMessageBeforeItIsAllowed) {
  for (const std::uint32_t length : {1U, 100U}) {
    RoadFrameReader reader;
    std::vector<Frame> got;
    EXPECT_EQ(feed_all(reader, wire(4, length, Bytes(length)), got), RoadFrameStatus::kTooLong);
    EXPECT_TRUE(got.empty());
  }
}

TEST(RoadFrame, TheTakerMayAllowMessagesAndMayStop) {
  RoadFrameReader reader;
  Bytes stream = wire(2, 16, Bytes(16)), more = wire(4, 3, {1, 2, 3});
  stream.insert(stream.end(), more.begin(), more.end());
  stream.insert(stream.end(), more.begin(), more.end());
  int messages = 0;
  EXPECT_EQ(reader.feed(stream,
                        [&](RoadKind kind, auto body) {
                          if (kind == RoadKind::kWelcome) reader.allow_messages(3);
                          if (kind == RoadKind::kMessage) {
                            ++messages;
                            EXPECT_EQ(body.size(), 3U);
                          }
                          return messages == 0;
                        }),
            RoadFrameStatus::kStopped);
  EXPECT_EQ(messages, 1);
}

TEST(RoadFrame, OtherVersionsAndOtherBytesAreNamed) {
  RoadFrameReader a, b;
  std::vector<Frame> got;
  EXPECT_EQ(feed_all(a, wire(1, 17, Bytes(17), 2), got), RoadFrameStatus::kBadVersion);
  EXPECT_EQ(feed_all(b, {'G', 'E', 'T', ' ', '/', ' ', 'H', 'T'}, got), RoadFrameStatus::kBadMagic);
  EXPECT_TRUE(got.empty());
  EXPECT_STREQ(to_text(RoadFrameStatus::kBadVersion),
               "a frame of another version: install the same teletact on both boxes");
}

// Damage anywhere: a status, never more than the cap in memory. (Sanitizers watch the rest.)
TEST(RoadFrame, DamagedStreamsEndOrGoOnWithinTheCaps) {
  constexpr std::uint64_t kSeed = 7102;
  rt::Random r(kSeed);
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  int refused = 0;
  for (int n = 0; n < 4000; ++n) {
    RoadFrameReader reader;
    reader.allow_messages(600);
    Bytes stream;
    for (int i = 0; i < 4; ++i) {
      const auto size = static_cast<std::size_t>(r.integer(1, 600));
      const Bytes one = wire(4, static_cast<std::uint32_t>(size), random_bytes(r, size));
      stream.insert(stream.end(), one.begin(), one.end());
    }
    for (std::int64_t i = r.integer(1, 3); i > 0; --i)
      stream[static_cast<std::size_t>(
          r.integer(0, static_cast<std::int64_t>(stream.size()) - 1))] ^=
          static_cast<std::uint8_t>(1U << static_cast<unsigned>(r.integer(0, 7)));
    bool ended = false;
    for (std::size_t at = 0; at < stream.size() && !ended; at += 97) {
      const auto piece =
          std::span(stream).subspan(at, std::min<std::size_t>(97, stream.size() - at));
      ended = reader.feed(piece, [](auto, auto body) {
        EXPECT_LE(body.size(), 600U);
        return true;
      }) != RoadFrameStatus::kOk;
      ASSERT_LE(reader.held(), 608U);
    }
    refused += ended ? 1 : 0;
  }
  EXPECT_GT(refused, 10) << "damage in a header is seen";
  EXPECT_LT(refused, 4000) << "damage in a body is not this reader's to see: TLS has, and the CRC";
}

TEST(RoadFrame, GreetWelcomeAndRefusalBodies) {
  drivers::RoadGreet greet{drivers::RoadConnectionKind::kBulk, {}};
  for (std::size_t i = 0; i < greet.token.size(); ++i)
    greet.token[i] = static_cast<std::uint8_t>(i * 7);
  Bytes out;
  append_greet(greet, out);
  drivers::RoadGreet back;
  ASSERT_TRUE(read_greet(std::span(out).subspan(8), back));
  EXPECT_EQ(back.connection, greet.connection);
  EXPECT_EQ(back.token, greet.token);
  out[8] = 2;
  EXPECT_FALSE(read_greet(std::span(out).subspan(8), back)) << "no such connection";
  EXPECT_FALSE(read_greet(std::span(out).subspan(9), back));
  drivers::RoadToken token{};
  EXPECT_TRUE(drivers::read_welcome(Bytes(16, 9), token));
  EXPECT_EQ(token[15], 9);
  EXPECT_FALSE(drivers::read_welcome(Bytes(15), token));

  const auto said = [](const std::string& text) {
    Bytes b;
    drivers::append_refusal(text, b);
    std::string words;
    EXPECT_TRUE(drivers::read_refusal(std::span(b).subspan(8), words));
    return words;
  };
  EXPECT_EQ(said("busy"), "busy");
  EXPECT_EQ(said(""), "refused");
  EXPECT_EQ(said("a\x1b[2Jb\xff"), "a?[2Jb?") << "a terminal is not told to do things";
  EXPECT_EQ(said(std::string(500, 'x')), std::string(200, 'x'));
  std::string words;
  EXPECT_FALSE(drivers::read_refusal(Bytes{'a', 7}, words));
  EXPECT_FALSE(drivers::read_refusal(Bytes{}, words));
  EXPECT_FALSE(drivers::read_refusal(Bytes(201, 'a'), words));
}

}  // namespace
