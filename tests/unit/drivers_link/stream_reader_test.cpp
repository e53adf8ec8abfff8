// Messages out of a stream: in whatever pieces it comes, and whatever has happened to its bytes.
#include "drivers/link/stream_reader.hpp"

#include <gtest/gtest.h>

#include "tests/unit/drivers_link/support.hpp"

namespace {

using drivers::StreamReader;
using drivers::WireStatus;
using Bytes = std::vector<std::uint8_t>;

std::vector<Bytes> messages(rt::Random& random, int count) {
  std::vector<Bytes> out;
  for (int i = 0; i < count; ++i) {
    drivers::Header h;
    h.id = i % 3 == 0 ? drivers::MessageId::kFrame : drivers::MessageId::kRobotState;
    h.seq = static_cast<std::uint64_t>(i);
    const std::int64_t most = h.id == drivers::MessageId::kFrame ? 5000 : 200;
    Bytes body(static_cast<std::size_t>(random.integer(0, most)));
    for (auto& b : body) b = static_cast<std::uint8_t>(random());
    Bytes m(drivers::kHeaderSize + body.size());
    m.resize(drivers::write_message(h, body, m));
    out.push_back(m);
  }
  return out;
}

TEST(StreamReader, AnyPiecesGiveTheSameMessages) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    rt::Random random(seed);
    const auto sent = messages(random, 40);
    Bytes stream;
    for (const Bytes& m : sent) stream.insert(stream.end(), m.begin(), m.end());
    StreamReader reader;
    std::vector<Bytes> got;
    for (std::size_t at = 0; at < stream.size();) {
      const auto n = std::min(stream.size() - at, static_cast<std::size_t>(random.integer(1, 900)));
      ASSERT_EQ(reader.feed(std::span(stream).subspan(at, n),
                            [&](auto m) {
                              got.emplace_back(m.begin(), m.end());
                              return true;
                            }),
                WireStatus::kOk);
      at += n;
    }
    EXPECT_EQ(got, sent);
    EXPECT_EQ(reader.held(), 0U);
  }
}

TEST(StreamReader, ATakerThatRefusesStopsIt) {
  rt::Random random(3);
  const auto sent = messages(random, 5);
  Bytes stream;
  for (const Bytes& m : sent) stream.insert(stream.end(), m.begin(), m.end());
  StreamReader reader;
  int taken = 0;
  const auto second = [&](auto) { return ++taken < 2; };
  EXPECT_EQ(reader.feed(stream, second), WireStatus::kOk);
  EXPECT_TRUE(reader.stopped());
  EXPECT_EQ(taken, 2);
  EXPECT_EQ(reader.feed(stream, second), WireStatus::kOk);
  EXPECT_EQ(taken, 2) << "not one more";
  reader.renew();
  EXPECT_FALSE(reader.stopped());
  EXPECT_EQ(reader.held(), 0U);
}

// Damage: messages are whole by their own header, or the stream ends; it never holds more than one.
TEST(StreamReader, DamagedStreamsEndOrGoOnWithinBounds) {
  int ended = 0;
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    rt::Random random(seed);
    Bytes stream;
    for (const Bytes& m : messages(random, 20)) stream.insert(stream.end(), m.begin(), m.end());
    for (int i = 0; i < 40; ++i) {
      const auto at = random.integer(0, static_cast<std::int64_t>(stream.size()) - 1);
      stream[static_cast<std::size_t>(at)] ^= static_cast<std::uint8_t>(random.integer(1, 255));
    }
    StreamReader reader;
    WireStatus status = WireStatus::kOk;
    for (std::size_t at = 0; at < stream.size() && status == WireStatus::kOk; at += 500) {
      const auto piece =
          std::span(stream).subspan(at, std::min<std::size_t>(500, stream.size() - at));
      status = reader.feed(piece, [&](std::span<const std::uint8_t> m) {
        drivers::Header h;
        EXPECT_EQ(drivers::read_header(m, h), WireStatus::kOk);
        EXPECT_EQ(m.size(), drivers::kHeaderSize + h.length);
        return true;
      });
      EXPECT_LE(reader.held(), drivers::kHeaderSize + drivers::kMaxBody + 500);
    }
    ended += status != WireStatus::kOk ? 1 : 0;
  }
  EXPECT_GT(ended, 50);
  EXPECT_LT(ended, 400) << "most damage is in bodies, and theirs to see by the checksum";
}

}  // namespace
