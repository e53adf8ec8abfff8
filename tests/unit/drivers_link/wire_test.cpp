#include "drivers/link/wire.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "drivers/link/command_gate.hpp"
#include "tests/unit/drivers_link/support.hpp"

namespace {

using namespace link_test;
using drivers::Header;
using drivers::kHeaderSize;
using drivers::MessageId;
using drivers::WireStatus;

constexpr std::uint64_t kSeed = 20240611;

std::span<const std::uint8_t> text(const char* s) {
  return {reinterpret_cast<const std::uint8_t*>(s), std::strlen(s)};
}

// Check value of the CRC catalogue, and the examples of RFC 3720 B.4.
TEST(Crc32c, PublishedValues) {
  EXPECT_EQ(drivers::crc32c(text("123456789")), 0xE3069283U);
  EXPECT_EQ(drivers::crc32c({}), 0U);
  Bytes b(32, 0);
  EXPECT_EQ(drivers::crc32c(b), 0x8A9136AAU);
  b.assign(32, 0xFF);
  EXPECT_EQ(drivers::crc32c(b), 0x62A8AB43U);
  std::iota(b.begin(), b.end(), std::uint8_t{0});
  EXPECT_EQ(drivers::crc32c(b), 0x46DD794EU);
  std::reverse(b.begin(), b.end());
  EXPECT_EQ(drivers::crc32c(b), 0x113FDB5CU);
}

TEST(Crc32c, EqualsTheBitwiseDefinition) {
  RecordProperty("seed", std::to_string(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 500; ++n) {
    Bytes b(static_cast<std::size_t>(r.integer(0, 300)));
    for (auto& v : b) v = static_cast<std::uint8_t>(r());
    ASSERT_EQ(drivers::crc32c(b), slow_crc32c(b)) << "seed " << kSeed << " case " << n;
  }
}

TEST(Header, LayoutIsTheDocumentedOne) {
  Header h;
  h.id = MessageId::kRobotGoal;
  h.length = 0x11223344;
  h.crc = 0x55667788;
  h.seq = 0x0102030405060708;
  h.stamp_ns = -2;
  h.schema = 0x1112131415161718;
  h.version = 0x0A0B;
  Bytes b(kHeaderSize);
  drivers::write_header(h, std::span<std::uint8_t, kHeaderSize>(b));
  EXPECT_EQ(std::memcmp(b.data(), "TLT1", 4), 0);
  EXPECT_EQ(field<std::uint16_t>(b, 4), 0x0A0B);
  EXPECT_EQ(field<std::uint16_t>(b, 6), 6);
  EXPECT_EQ(field<std::uint32_t>(b, 8), 0x11223344U);
  EXPECT_EQ(field<std::uint32_t>(b, 12), 0x55667788U);
  EXPECT_EQ(field<std::uint64_t>(b, 16), 0x0102030405060708U);
  EXPECT_EQ(field<std::uint64_t>(b, 24), static_cast<std::uint64_t>(-2));
  EXPECT_EQ(field<std::uint64_t>(b, 32), 0x1112131415161718U);
}

TEST(Header, RoundTripsRandomValues) {
  rt::Random r(kSeed, 1);
  for (int n = 0; n < 2000; ++n) {
    Header h, back;
    h.id = static_cast<MessageId>(r.integer(1, drivers::kMessageIds));
    h.length = static_cast<std::uint32_t>(r.integer(0, drivers::kMaxControlBody));
    h.crc = static_cast<std::uint32_t>(r());
    h.seq = r();
    h.stamp_ns = static_cast<std::int64_t>(r());
    h.schema = r();
    Bytes b(kHeaderSize);
    drivers::write_header(h, std::span<std::uint8_t, kHeaderSize>(b));
    ASSERT_EQ(drivers::read_header(b, back), WireStatus::kOk);
    EXPECT_EQ(back.id, h.id);
    EXPECT_EQ(back.length, h.length);
    EXPECT_EQ(back.crc, h.crc);
    EXPECT_EQ(back.seq, h.seq);
    EXPECT_EQ(back.stamp_ns, h.stamp_ns);
    EXPECT_EQ(back.schema, h.schema);
    EXPECT_EQ(back.version, h.version);
  }
}

TEST(Header, EveryRefusalHasItsOwnStatus) {
  const Bytes good = whole(MessageId::kClockRequest, body_of(drivers::ClockRequest{7}));
  Header h;
  EXPECT_EQ(drivers::read_header(good, h), WireStatus::kOk);
  for (std::size_t n = 0; n < kHeaderSize; ++n) {
    EXPECT_EQ(drivers::read_header(std::span(good).first(n), h), WireStatus::kIncomplete);
  }
  Bytes b = good;
  b[0] ^= 1U;
  EXPECT_EQ(drivers::read_header(b, h), WireStatus::kBadMagic);
  b = good;
  set_field<std::uint16_t>(b, 4, drivers::kSchemaVersion + 1);
  EXPECT_EQ(drivers::read_header(b, h), WireStatus::kBadVersion);
  for (const int id : {0, drivers::kMessageIds + 1, 0xFFFF}) {
    b = good;
    set_field<std::uint16_t>(b, 6, static_cast<std::uint16_t>(id));
    EXPECT_EQ(drivers::read_header(b, h), WireStatus::kBadId) << id;
  }
  for (int id = 1; id <= drivers::kMessageIds; ++id) {
    const bool bulk = static_cast<MessageId>(id) == MessageId::kFrame;
    const auto cap =
        static_cast<std::uint32_t>(bulk ? drivers::kMaxBody : drivers::kMaxControlBody);
    b = good;
    set_field<std::uint16_t>(b, 6, static_cast<std::uint16_t>(id));
    set_field<std::uint32_t>(b, 8, cap);
    EXPECT_EQ(drivers::read_header(b, h), WireStatus::kOk) << id;
    set_field<std::uint32_t>(b, 8, cap + 1);
    EXPECT_EQ(drivers::read_header(b, h), WireStatus::kTooLong) << id;
    set_field<std::uint32_t>(b, 8, 0xFFFFFFFFU);
    EXPECT_EQ(drivers::read_header(b, h), WireStatus::kTooLong) << id;
  }
  for (int s = 0; s <= static_cast<int>(WireStatus::kBadCrc); ++s) {
    EXPECT_STRNE(drivers::to_text(static_cast<WireStatus>(s)), "?");
  }
}

TEST(WriteMessage, RefusesAShortBufferAndBuildsInPlace) {
  const Bytes body = body_of(drivers::ClockRequest{42});
  Bytes out(kHeaderSize + body.size() - 1, 0xEE);
  EXPECT_EQ(drivers::write_message({}, body, out), 0U);
  EXPECT_EQ(out, Bytes(out.size(), 0xEE)) << "nothing is written when it does not fit";
  // As the endpoint does it: the body already stands behind the header's place.
  Bytes b(kHeaderSize + body.size());
  std::copy(body.begin(), body.end(), b.begin() + kHeaderSize);
  Header h;
  h.id = MessageId::kClockRequest;
  EXPECT_EQ(drivers::write_message(h, std::span(b).subspan(kHeaderSize), b), b.size());
  EXPECT_EQ(b, whole(MessageId::kClockRequest, body, 0, 0));
}

// What went in comes out: encoding the decoded message gives the same bytes, and the same fields.
TEST(Bodies, RoundTripRandomValues) {
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed, 2);
  for (int n = 0; n < 3000; ++n) {
    const drivers::RobotState s = random_state(r);
    drivers::RobotState s2;
    ASSERT_TRUE(decode(body_of(s), s2));
    EXPECT_EQ(body_of(s2), body_of(s));
    EXPECT_EQ(s2.seq, s.seq);
    EXPECT_EQ(s2.made, s.made);
    EXPECT_EQ(s2.taken, s.taken);
    EXPECT_EQ(s2.x_m, s.x_m);
    EXPECT_EQ(s2.y_m, s.y_m);
    EXPECT_EQ(s2.yaw_rad, s.yaw_rad);
    EXPECT_EQ(s2.vx, s.vx);
    EXPECT_EQ(s2.vy, s.vy);
    EXPECT_EQ(s2.wz, s.wz);
    EXPECT_EQ(s2.cmd_vx, s.cmd_vx);
    EXPECT_EQ(s2.cmd_vy, s.cmd_vy);
    EXPECT_EQ(s2.cmd_wz, s.cmd_wz);
    EXPECT_EQ(s2.goal_seq, s.goal_seq);
    EXPECT_EQ(s2.mode, s.mode);
    EXPECT_EQ(s2.moving, s.moving);
    EXPECT_EQ(s2.fault, s.fault);

    const drivers::RobotGoal g = random_goal(r);
    drivers::RobotGoal g2;
    ASSERT_TRUE(decode(body_of(g), g2));
    EXPECT_EQ(body_of(g2), body_of(g));
    EXPECT_EQ(g2.seq, g.seq);
    EXPECT_EQ(g2.made, g.made);
    EXPECT_EQ(g2.valid_until, g.valid_until);
    EXPECT_EQ(g2.x_m, g.x_m);
    EXPECT_EQ(g2.y_m, g.y_m);
    EXPECT_EQ(g2.yaw_rad, g.yaw_rad);
    EXPECT_EQ(g2.vx, g.vx);
    EXPECT_EQ(g2.vy, g.vy);
    EXPECT_EQ(g2.wz, g.wz);
    EXPECT_EQ(g2.speed_limit_m_per_s, g.speed_limit_m_per_s);
    EXPECT_EQ(g2.engaged, g.engaged);
    EXPECT_EQ(g2.operator_engaged, g.operator_engaged);
    EXPECT_EQ(g2.operator_clear, g.operator_clear);
    EXPECT_EQ(g2.path_seq, g.path_seq);

    const drivers::ClockRequest q{r.integer(0, 1'000'000'000'000'000)};
    drivers::ClockRequest q2;
    ASSERT_TRUE(decode(body_of(q), q2));
    EXPECT_EQ(q2.t0_ns, q.t0_ns);
    const std::int64_t t1 = r.integer(0, 1'000'000'000'000'000);
    const drivers::ClockReply a{r.integer(0, 1'000'000'000'000'000), t1,
                                t1 + r.integer(0, 1000000)};
    drivers::ClockReply a2;
    ASSERT_TRUE(decode(body_of(a), a2));
    EXPECT_EQ(a2.t0_ns, a.t0_ns);
    EXPECT_EQ(a2.t1_ns, a.t1_ns);
    EXPECT_EQ(a2.t2_ns, a.t2_ns);
  }
}

template <class Message>
void expect_exact_size(const Message& m) {
  Bytes b = body_of(m);
  Message out;
  ASSERT_TRUE(decode(b, out));
  for (std::size_t n = 0; n < b.size(); ++n) {
    EXPECT_FALSE(decode(std::span(b).first(n), out)) << n << " of " << b.size();
    Bytes room(n);
    EXPECT_EQ(encode(m, room), 0U) << n;
  }
  b.push_back(0);
  EXPECT_FALSE(decode(b, out));
}

TEST(Bodies, OnlyTheExactSizeIsTaken) {
  rt::Random r(kSeed, 3);
  expect_exact_size(random_state(r));
  expect_exact_size(random_goal(r));
  expect_exact_size(drivers::ClockRequest{1});
  expect_exact_size(drivers::ClockReply{1, 2, 3});
}

TEST(Bodies, EveryFieldOutOfRangeIsRefused) {
  rt::Random r(kSeed, 4);
  const double bad[] = {std::numeric_limits<double>::quiet_NaN(),
                        std::numeric_limits<double>::infinity(),
                        -std::numeric_limits<double>::infinity(), 1.0000001e6, -1e300};
  using S = drivers::RobotState;
  using G = drivers::RobotGoal;
  for (const double v : bad) {
    for (double S::*f : {&S::x_m, &S::y_m, &S::yaw_rad, &S::vx, &S::vy, &S::wz, &S::cmd_vx,
                         &S::cmd_vy, &S::cmd_wz}) {
      S m = random_state(r);
      m.*f = v;
      S out;
      EXPECT_FALSE(decode(body_of(m), out)) << v;
    }
    for (double G::*f :
         {&G::x_m, &G::y_m, &G::yaw_rad, &G::vx, &G::vy, &G::wz, &G::speed_limit_m_per_s}) {
      G m = random_goal(r);
      m.*f = v;
      G out;
      EXPECT_FALSE(decode(body_of(m), out)) << v;
    }
  }
  for (int v = 0; v < 256; ++v) {
    S s = random_state(r), s_out;
    s.mode = static_cast<std::uint8_t>(v);
    EXPECT_EQ(decode(body_of(s), s_out), v <= 4) << v;
    s = random_state(r);
    s.moving = static_cast<std::uint8_t>(v);
    EXPECT_EQ(decode(body_of(s), s_out), v <= 1) << v;
    G g = random_goal(r), g_out;
    g.engaged = static_cast<std::uint8_t>(v);
    EXPECT_EQ(decode(body_of(g), g_out), v <= 1) << v;
    g = random_goal(r);
    g.operator_engaged = static_cast<std::uint8_t>(v);
    EXPECT_EQ(decode(body_of(g), g_out), v <= 2) << v;
    drivers::CommandReport c, c_out;
    c.newest = static_cast<std::uint8_t>(v);
    EXPECT_EQ(decode(body_of(c), c_out), v < drivers::kCommandFaults) << v;
    g = random_goal(r);
    g.operator_clear = static_cast<std::uint8_t>(v);
    EXPECT_EQ(decode(body_of(g), g_out), v <= 1) << v;
  }
}

// An instant that would overflow the conversion between clocks is no instant.
TEST(Bodies, InstantsBeyondAnyClockAreRefused) {
  rt::Random r(kSeed, 5);
  constexpr auto kMax = std::numeric_limits<std::int64_t>::max();
  constexpr auto kMin = std::numeric_limits<std::int64_t>::min();
  for (const std::int64_t v : {kMax, kMin, std::int64_t{1'000'000'000'000'000'001}}) {
    drivers::RobotState s = random_state(r), s_out;
    s.taken = rt::time_from_ns(v);
    EXPECT_FALSE(decode(body_of(s), s_out));
    s = random_state(r);
    s.made = rt::time_from_ns(v);
    EXPECT_FALSE(decode(body_of(s), s_out));
    drivers::RobotGoal g = random_goal(r), g_out;
    g.made = rt::time_from_ns(v);
    EXPECT_FALSE(decode(body_of(g), g_out));
    g = random_goal(r);
    g.valid_until = rt::time_from_ns(v);
    EXPECT_FALSE(decode(body_of(g), g_out));
    drivers::ClockRequest q;
    EXPECT_FALSE(decode(body_of(drivers::ClockRequest{v}), q));
    drivers::ClockReply a;
    EXPECT_FALSE(decode(body_of(drivers::ClockReply{v, 0, 0}), a));
    EXPECT_FALSE(decode(body_of(drivers::ClockReply{0, kMin, v}), a));
  }
  drivers::ClockReply a;
  EXPECT_FALSE(decode(body_of(drivers::ClockReply{0, 2, 1}), a)) << "sent before it was received";
}

TEST(Schema, HashIsStable) {
  EXPECT_EQ(drivers::schema_hash(), drivers::schema_hash());
  EXPECT_NE(drivers::schema_hash(), 0U);
}

}  // namespace
