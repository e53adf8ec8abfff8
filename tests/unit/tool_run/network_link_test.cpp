// The virtual clock's link over an emulated network.
#include <gtest/gtest.h>

#include "rt/effect_count.hpp"
#include "tests/unit/tool_run/link_rig.hpp"

namespace {

using drivers::NetworkConfig;
using drivers::Way;
using link_rig::kMs;
using link_rig::kSecond;
using link_rig::Rig;

struct Roaded : Rig {
  explicit Roaded(const NetworkConfig& c) : Rig(drivers::LinkShapeConfig{}) {
    link.emulate(c, kSecond);
  }
};

std::uint64_t built() {
  return rt::effect_counts[static_cast<std::size_t>(rt::Effect::kLinkNetwork)].built;
}

TEST(NetworkLink, NothingNamedIsNothingBuilt) {
  const std::uint64_t before = built();
  Roaded bare{NetworkConfig{}};
  Rig plain;
  bare.run(3 * kSecond);
  plain.run(3 * kSecond);
  EXPECT_EQ(built(), before);
  EXPECT_EQ(bare.link.road(Way::kToRobot), nullptr);
  EXPECT_EQ(bare.link.byte_hash(), plain.link.byte_hash());
  NetworkConfig c;
  c.delay_ms = 1;
  const Roaded with{c};
  EXPECT_EQ(built(), before + 1);
}

TEST(NetworkLink, ItsDelayIsTheRoundTrip) {
  NetworkConfig c;
  c.delay_ms = 20;
  Roaded rig{c};
  ASSERT_TRUE(rig.link.handshake(kSecond, 2 * kSecond));
  EXPECT_NEAR(static_cast<double>(rig.op_status.round_trip_ns), 40e6, 2500);
}

TEST(NetworkLink, SameInputSameBytes) {
  NetworkConfig c;
  c.delay_ms = 5;
  c.jitter_ms = 3;
  c.rate_Mbit_per_s = 10;
  c.stalls.push_back({1, 400, 2});
  Roaded a{c}, b{c};
  c.seed = 2;
  Roaded other{c};
  for (Rig* rig : {static_cast<Rig*>(&a), static_cast<Rig*>(&b), static_cast<Rig*>(&other)})
    rig->run(6 * kSecond);
  EXPECT_EQ(a.link.byte_hash(), b.link.byte_hash());
  EXPECT_EQ(a.got, b.got);
  EXPECT_GT(a.got, 350U);
  EXPECT_NE(a.link.byte_hash(), other.link.byte_hash());
}

TEST(NetworkLink, AStallIsSilenceAndThenAllArrives) {
  NetworkConfig c;
  c.delay_ms = 20;
  c.stalls.push_back({2, 400, 0});
  Roaded rig{c};
  rig.run(3 * kSecond + 20 * kMs);
  const std::int64_t heard = rig.op_status.last_heard_ns;
  const auto got = rig.got;
  rig.run(3 * kSecond + 419 * kMs);
  EXPECT_EQ(rig.op_status.last_heard_ns, heard);
  EXPECT_EQ(rig.got, got);
  rig.run(3 * kSecond + 425 * kMs);
  EXPECT_GE(rig.got, got + 38) << "what waited";
  EXPECT_FALSE(rig.op_status.closed);
  EXPECT_FALSE(rig.op_status.refused);
}

TEST(NetworkLink, AHalfOpenWayIsSilentForOneSide) {
  NetworkConfig c;
  c.delay_ms = 20;
  c.cuts.push_back({2, "to_robot"});
  Roaded rig{c};
  rig.run(10 * kSecond);
  EXPECT_LE(rig.robot_status.last_heard_ns, 1003 * kSecond + kMs);
  EXPECT_GT(rig.op_status.last_heard_ns, 10 * kSecond - 20 * kMs);
  EXPECT_FALSE(rig.op_status.closed);
}

// Both sides are told, no damaged message is taken, and another connection carries on.
TEST(NetworkLink, DamageEndsTheConnectionAndTheNextOneCarriesOn) {
  NetworkConfig c;
  c.delay_ms = 5;
  c.corrupt_per_MB = 100;
  c.corrupt_from_s = 1;
  Roaded rig{c};
  int told = 0, again = 0;
  for (std::int64_t t = 2000; t < 20000; ++t) {
    const bool before = rig.op_status.closed;
    rig.run(t * kMs);
    if (rig.op_status.closed != before) ++(before ? again : told);
  }
  EXPECT_GE(told, 3);
  EXPECT_GE(again, told - 1);
  EXPECT_GE(rig.op_status.session, static_cast<std::uint64_t>(again));
  EXPECT_FALSE(rig.op_status.refused);
  EXPECT_FALSE(rig.robot_status.refused);
  EXPECT_GT(rig.got, 1000U);
  EXPECT_EQ(rig.bad, 0U) << "the checksum stands before the fields";
}

// 10 flaps a minute for 20 minutes: 200 connections, the last as good as the first, no more memory.
TEST(NetworkLink, TwoHundredConnectionsLeaveNothingBehind) {
  NetworkConfig c;
  c.delay_ms = 30;
  c.rate_Mbit_per_s = 10;
  c.flaps_per_minute = 10;
  c.flap_down_ms = 400;
  Roaded rig{c};
  std::size_t first = 0, most = 0;
  std::uint64_t got = 0, least = 1000000;
  for (std::int64_t t = 2; t <= 1210; ++t) {
    rig.run(t * kSecond);
    most = std::max(most, rig.link.held_bytes());
    if (t == 60) first = most;
    if (t % 60 == 0) {
      if (t > 60) least = std::min(least, rig.got - got);
      got = rig.got;
    }
  }
  EXPECT_GE(rig.op_status.session, 200U);
  EXPECT_EQ(rig.op_status.session.load(), rig.robot_status.session.load());
  EXPECT_LE(most, 2 * first);
  // Of 6000 a minute: each flap costs its 400 ms, and at most 600 ms to talk again.
  EXPECT_GE(least, 6000U - 10 * 100U);
}

// Ten minutes on a road that is stalled for most of the time, then cut: what it holds stays
// bounded.
TEST(NetworkLink, WhatItHoldsDoesNotGrow) {
  NetworkConfig c;
  c.delay_ms = 75;
  c.rate_Mbit_per_s = 0.53;  // for states of 177 bytes: as full as 0.5 was for 169
  c.queue_kB = 10;
  c.stalls.push_back({1, 3000, 4});
  c.cuts.push_back({300, "both"});
  Roaded rig{c};
  std::size_t first = 0, most = 0;
  for (std::int64_t t = 2; t < 600; ++t) {
    rig.run(t * kSecond);
    most = std::max(most, rig.link.held_bytes());
    if (t == 60) first = most;
  }
  EXPECT_LE(most, first + 2000);
  EXPECT_LE(rig.link.held_bytes(), 2000U) << "nothing piles up before a cut";
}

}  // namespace
