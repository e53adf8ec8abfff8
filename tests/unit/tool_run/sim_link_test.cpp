// The virtual clock's link: the endpoints of the real one, moved in simulated time.
#include "tools/host/sim_link.hpp"

#include <gtest/gtest.h>

#include "tests/unit/tool_run/link_rig.hpp"

namespace {

using link_rig::kMs;
using link_rig::kSecond;
using link_rig::Rig;

TEST(SimLink, HandshakeMeasuresTheOtherClock) {
  Rig rig;
  ASSERT_TRUE(rig.link.handshake(kSecond, 2 * kSecond));
  const std::int64_t host = 2 * kSecond;
  const auto truth = rig.robot_clock.from_host(host) - rig.op_clock.from_host(host);
  EXPECT_LE(std::abs((rig.op.clock().offset() - truth).count()), rig.op_status.uncertainty_ns + 1);
  EXPECT_GT(rig.op_status.last_heard_ns, kSecond);
  EXPECT_GT(rig.robot_status.last_heard_ns, 1001 * kSecond) << "in the robot's own clock";
  EXPECT_FALSE(rig.op_status.refused);
}

TEST(SimLink, AHandshakeOverACutCableDoesNotComeAbout) {
  Rig rig;
  rig.link.cut();
  EXPECT_FALSE(rig.link.handshake(kSecond, 2 * kSecond));
}

TEST(SimLink, TheShapersDelayIsTheRoundTrip) {
  drivers::LinkShapeConfig shape;
  shape.delay_ms = 20;
  Rig rig(shape);
  ASSERT_TRUE(rig.link.handshake(kSecond, 2 * kSecond));
  // An answer leaves at the instant its question arrives; 50 ppm of 40 ms are 2 us.
  EXPECT_NEAR(static_cast<double>(rig.op_status.round_trip_ns), 40e6, 2500);
  EXPECT_NEAR(static_cast<double>(rig.robot_status.round_trip_ns), 40e6, 2500);
}

TEST(SimLink, SameInputSameBytes) {
  drivers::LinkShapeConfig shape;
  shape.delay_ms = 5;
  shape.jitter_ms = 3;
  shape.rate_Mbit_per_s = 10;
  Rig a(shape), b(shape);
  shape.seed = 2;
  Rig c(shape);
  for (Rig* rig : {&a, &b, &c}) rig->run(4 * kSecond);
  EXPECT_EQ(a.link.byte_hash(), b.link.byte_hash());
  EXPECT_EQ(a.got, b.got);
  EXPECT_GT(a.got, 250U);
  EXPECT_NE(a.link.byte_hash(), c.link.byte_hash()) << "other delays, other stamps in the answers";
}

TEST(SimLink, AfterTheCutNothingArrivesAndBothSidesSee) {
  Rig rig;
  rig.run(3 * kSecond);
  const auto got = rig.got;
  const std::int64_t op_heard = rig.op_status.last_heard_ns,
                     robot_heard = rig.robot_status.last_heard_ns;
  EXPECT_GT(got, 100U);
  rig.link.cut();
  rig.run(5 * kSecond);
  EXPECT_EQ(rig.got, got);
  EXPECT_EQ(rig.op_status.last_heard_ns, op_heard);
  EXPECT_EQ(rig.robot_status.last_heard_ns, robot_heard);
}

}  // namespace
