// An endpoint on its second connection (LinkEndpoint::renew).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/drivers_link/support.hpp"

namespace {

using namespace link_test;
using drivers::MessageId;
using testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1'000'000'000;
constexpr auto kReplies = static_cast<std::size_t>(MessageId::kClockReply);

// The robot's box starts again with another clock; the operator's end only gets a new connection.
TEST(Endpoint, ARenewedEndMeetsABoxThatStartedAgain) {
  Pair p;
  p.robot_clock = {1000 * kSecond, 0};
  std::uint64_t frames = 0;
  p.op.add_outgoing(MessageId::kFrameReport, rt::Nanos{10 * kMs}, false, [&](auto out) {
    return encode(drivers::FrameReport{++frames, 0}, out);
  });
  p.run(500 * kMs);
  ASSERT_TRUE(p.op.ready());
  p.op.send_bye(p.op_clock.from_host(p.host), p.to_robot());
  p.robot.send_bye(p.robot_clock.from_host(p.host), p.to_op());
  p.run(5 * kMs);
  ASSERT_TRUE(p.op.bye_received());
  const rt::Time heard = p.op.last_heard();
  const std::uint64_t received = p.op.stats().received[kReplies];
  p.for_robot.clear();
  p.for_op.clear();

  p.op.renew();
  EXPECT_FALSE(p.op.ready());
  EXPECT_FALSE(p.op.hello_ok());
  EXPECT_FALSE(p.op.bye_received());
  EXPECT_FALSE(p.op.clock().valid());
  EXPECT_EQ(p.op.arrived_seq(), 0U);
  EXPECT_TRUE(p.op.ever_heard());
  EXPECT_EQ(p.op.last_heard(), heard) << "the silence goes on";
  // As a fresh end does, it says Hello first and refuses to be told anything before one.
  EXPECT_FALSE(p.op.receive(whole(MessageId::kClockRequest, body_of(drivers::ClockRequest{1})),
                            p.op_clock.from_host(p.host), [](auto) {}));
  EXPECT_THAT(p.op.fault(), HasSubstr("before the handshake"));
  p.op.renew();
  EXPECT_TRUE(p.op.fault().empty());

  rt::Startup again;
  drivers::LinkEndpoint fresh(again.token(), rt::Box::kRobot);
  std::uint64_t last_report = 0;
  fresh.add_incoming(MessageId::kFrameReport, [&](auto, rt::Time) {
    EXPECT_GT(fresh.arrived_seq(), last_report);
    last_report = fresh.arrived_seq();
    return true;
  });
  p.robot_clock = {5 * kSecond, 0};  // its clock began anew
  std::vector<MessageId> said;
  for (const std::int64_t end = p.host + 400 * kMs; p.host < end; p.host += kMs) {
    p.deliver(p.for_robot, fresh, p.robot_clock, p.to_op());
    p.deliver(p.for_op, p.op, p.op_clock, p.to_robot());
    p.op.poll(p.op_clock.from_host(p.host), true, [&](auto m) {
      drivers::Header h;
      ASSERT_EQ(drivers::read_header(m, h), drivers::WireStatus::kOk);
      said.push_back(h.id);
      EXPECT_TRUE(said.size() > 1 || h.seq == 1U);
      p.to_robot()(m);
    });
    fresh.poll(p.robot_clock.from_host(p.host), true, p.to_op());
  }
  ASSERT_FALSE(p.broken);
  ASSERT_FALSE(said.empty());
  EXPECT_EQ(said.front(), MessageId::kHello);
  EXPECT_TRUE(p.op.ready());
  EXPECT_TRUE(fresh.ready());
  const auto true_offset = p.robot_clock.from_host(p.host) - p.op_clock.from_host(p.host);
  // The clock is the new one's, not a choice among old and new exchanges.
  EXPECT_NEAR(static_cast<double>(p.op.clock().offset().count()),
              static_cast<double>(true_offset.count()), 2.0 * kMs);
  // The first exchanges come fast again: one in 20 ms, not one in 200.
  EXPECT_GE(p.op.stats().received[kReplies], received + 8);
  EXPECT_GT(last_report, 20U) << "numbers of the edges go on from where they were";
  EXPECT_GT(p.op.last_heard(), heard);
}

}  // namespace
