// Damaged and hostile bytes against the reader: nothing crashes, and nothing is handed on that an
// independent reading of the documented layout does not vouch for.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "drivers/link/wire.hpp"
#include "tests/unit/drivers_link/support.hpp"

namespace {

using namespace link_test;
using drivers::kHeaderSize;
using drivers::MessageId;

constexpr std::uint64_t kSeed = 77001;
constexpr int kInputs = 200000;

Bytes random_message(rt::Random& r) {
  const std::int64_t stamp = r.integer(0, 1'000'000'000'000'000);
  switch (r.integer(1, drivers::kMessageIds)) {
    case 1:
      return whole(MessageId::kHello, {}, r(), stamp);
    case 2:
      return whole(MessageId::kClockRequest,
                   body_of(drivers::ClockRequest{r.integer(0, 1'000'000'000'000)}), r(), stamp);
    case 3: {
      const std::int64_t t = r.integer(0, 1'000'000'000'000);
      return whole(MessageId::kClockReply, body_of(drivers::ClockReply{r.integer(0, t), t, t + 5}),
                   r(), stamp);
    }
    case 4: {
      Bytes body(static_cast<std::size_t>(r.integer(0, 400)));
      for (auto& b : body) b = static_cast<std::uint8_t>(r());
      return whole(MessageId::kFrame, body, r(), stamp);
    }
    case 5:
      return whole(MessageId::kRobotState, body_of(random_state(r)), r(), stamp);
    case 6:
      return whole(MessageId::kRobotGoal, body_of(random_goal(r)), r(), stamp);
    case 7:
      return whole(MessageId::kBye, {}, r(), stamp);
    case 8:
      return whole(MessageId::kFrameReport,
                   body_of(drivers::FrameReport{r(), static_cast<std::uint8_t>(r.integer(0, 1))}),
                   r(), stamp);
    case 9:
      return whole(MessageId::kCommandReport,
                   body_of(drivers::CommandReport{r(), r(), r(), r(), r(),
                                                  static_cast<std::uint8_t>(r.integer(0, 5))}),
                   r(), stamp);
    default:
      return whole(MessageId::kAlive, {}, r(), stamp);
  }
}

// Changes some bytes or the length. Half of the time the checksum and the length are made good
// again, so that what lies behind them is reached too.
void mutate(Bytes& b, rt::Random& r) {
  for (std::int64_t n = r.integer(1, 4); n > 0; --n) {
    switch (r.integer(0, 4)) {
      case 0:
        if (!b.empty())
          b[static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(b.size()) - 1))] ^=
              static_cast<std::uint8_t>(1U << r.integer(0, 7));
        break;
      case 1:
        if (!b.empty())
          b[static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(b.size()) - 1))] =
              static_cast<std::uint8_t>(r());
        break;
      case 2:
        b.resize(static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(b.size()))));
        break;
      case 3:
        for (std::int64_t i = r.integer(1, 64); i > 0; --i)
          b.push_back(static_cast<std::uint8_t>(r()));
        break;
      default:  // eight bytes of one extreme value: NaN, infinity, largest integers
        if (b.size() >= 8) {
          const std::uint64_t extremes[] = {~0ULL, 0x7FF0000000000000ULL, 0x7FFFFFFFFFFFFFFFULL,
                                            0x8000000000000000ULL, 0};
          set_field(b,
                    static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(b.size()) - 8)),
                    extremes[r.integer(0, 4)]);
        }
    }
  }
  if (b.size() >= kHeaderSize && r.uniform() < 0.5) {
    set_field(b, 8, static_cast<std::uint32_t>(b.size() - kHeaderSize));
    set_field(b, 12, slow_crc32c(std::span(b).subspan(kHeaderSize)));
    if (r.uniform() < 0.7) std::memcpy(b.data(), "TLT1\x01\0", 6);
  }
}

bool sane(double v) { return std::isfinite(v) && std::abs(v) <= 1e6; }

struct Tally {
  int delivered = 0, states = 0, goals = 0, refused = 0, closed = 0, replies = 0;
};

// Header as the documentation of the wire has it, read without the product's reader.
bool vouched_for(std::span<const std::uint8_t> m) {
  if (m.size() < kHeaderSize || std::memcmp(m.data(), "TLT1", 4) != 0) return false;
  const auto id = field<std::uint16_t>(m, 6);
  const auto length = field<std::uint32_t>(m, 8);
  if (id < 1 || id > 10 || length != m.size() - kHeaderSize) return false;
  if (field<std::uint16_t>(m, 4) != drivers::kSchemaVersion) return false;
  if (length > (id == 4 ? drivers::kMaxBody : drivers::kMaxControlBody)) return false;
  return slow_crc32c(m.subspan(kHeaderSize)) == field<std::uint32_t>(m, 12);
}

TEST(Mutation, NothingUnvouchedIsHandedOn) {
  std::printf("seed %llu, %d inputs\n", static_cast<unsigned long long>(kSeed), kInputs);
  Pair pair;
  pair.robot_clock = {1'000'000'000'000, 50};
  pair.run(200'000'000);
  ASSERT_TRUE(pair.op.ready());

  Tally tally;
  std::span<const std::uint8_t> current;
  bool ours = false;
  const auto vouch = [&] {
    ++tally.delivered;
    ASSERT_TRUE(ours) << "handed on although header, length or checksum do not hold";
  };
  pair.op.add_incoming(MessageId::kRobotState, [&](std::span<const std::uint8_t> body, rt::Time) {
    vouch();
    drivers::RobotState s;
    if (!decode(body, s)) return false;
    ++tally.states;
    EXPECT_TRUE(s.mode <= 4 && s.moving <= 1);
    for (const double v : {s.x_m, s.y_m, s.yaw_rad, s.vx, s.vy, s.wz, s.cmd_vx, s.cmd_vy, s.cmd_wz})
      EXPECT_TRUE(sane(v));
    EXPECT_TRUE(drivers::plausible_instant(rt::ns_of(s.taken)));
    return true;
  });
  pair.op.add_incoming(MessageId::kRobotGoal, [&](std::span<const std::uint8_t> body, rt::Time) {
    vouch();
    drivers::RobotGoal g;
    if (!decode(body, g)) return false;
    ++tally.goals;
    EXPECT_TRUE(g.engaged <= 1 && g.operator_engaged <= 2 && g.operator_clear <= 1);
    for (const double v : {g.x_m, g.y_m, g.yaw_rad, g.vx, g.vy, g.wz, g.speed_limit_m_per_s})
      EXPECT_TRUE(sane(v));
    return true;
  });
  pair.op.add_incoming(MessageId::kFrameReport, [&](std::span<const std::uint8_t> body, rt::Time) {
    vouch();
    drivers::FrameReport report;
    if (!decode(body, report)) return false;
    EXPECT_LE(report.key_wanted, 1);
    return true;
  });
  pair.op.add_incoming(MessageId::kFrame, [&](std::span<const std::uint8_t> body, rt::Time) {
    vouch();
    static drivers::EncodedFrame frame;
    return drivers::read_wire(body, frame) == drivers::FrameStatus::kOk;
  });
  rt::Random r(kSeed);
  for (int n = 0; n < kInputs; ++n) {
    Bytes b = random_message(r);
    mutate(b, r);
    drivers::Header h;
    const auto status = drivers::read_header(b, h);
    if (status == drivers::WireStatus::kOk) {
      ASSERT_GE(static_cast<int>(h.id), 1);
      ASSERT_LE(static_cast<int>(h.id), drivers::kMessageIds);
      ASSERT_LE(h.length, drivers::kMaxBody);
    }
    ours = vouched_for(b);
    const bool open = pair.op.receive(
        b, rt::time_from_ns(2'000'000'000 + n), [&](std::span<const std::uint8_t> m) {
          ++tally.replies;
          EXPECT_TRUE(vouched_for(m)) << "an answer of ours must be well formed";
        });
    if (!open) {
      ++tally.closed;
      ASSERT_FALSE(pair.op.fault().empty());
    }
    if (!ours && open) {
      // The one message of another version that is read is a Hello, and that one closes.
      FAIL() << "case " << n << ": a damaged message left the connection open";
    }
    if (::testing::Test::HasFailure()) FAIL() << "seed " << kSeed << " case " << n;
  }
  std::printf("closed %d, handed on %d, states %d, goals %d, clock replies sent %d\n", tally.closed,
              tally.delivered, tally.states, tally.goals, tally.replies);
  // The mutations reach behind the checksum, and most inputs are damaged.
  EXPECT_GT(tally.closed, kInputs / 4);
  EXPECT_GT(tally.delivered, 1000);
  EXPECT_GT(tally.replies, 100);
  EXPECT_TRUE(pair.op.hello_ok());
}

// Any single flipped bit behind the header is caught by the checksum: a CRC of 32 bits finds all.
TEST(Mutation, EverySingleBitOfABodyIsCovered) {
  rt::Random r(kSeed, 1);
  Pair pair;
  pair.run(200'000'000);
  ASSERT_TRUE(pair.op.ready());
  const Bytes good = whole(MessageId::kRobotState, body_of(random_state(r)));
  for (std::size_t bit = 8 * kHeaderSize; bit < 8 * good.size(); ++bit) {
    Bytes b = good;
    b[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    EXPECT_FALSE(pair.op.receive(b, rt::time_from_ns(3'000'000'000), [](auto) {})) << bit;
    EXPECT_EQ(pair.op.fault(), "link: bad checksum");
  }
}

}  // namespace
