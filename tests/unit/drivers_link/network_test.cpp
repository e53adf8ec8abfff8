// TCP over an emulated network: what a scene names meets the bytes of both ends. Waits are for
// events with a generous limit.
#include <gtest/gtest.h>

#include "tests/unit/drivers_link/tcp_support.hpp"

namespace {

using namespace link_test;
using drivers::MessageId;
using drivers::NetworkConfig;
using drivers::TcpLink;
using State = TcpLink::State;

// An end that sends states, if it is the robot's, over `network`; the epoch is now.
struct NetworkEnd : End {
  NetworkEnd(rt::Box box, std::unique_ptr<TcpLink> made_link, const NetworkConfig& network)
      : End(box, {}) {
    link = std::move(made_link);
    endpoint.add_outgoing(MessageId::kRobotState, std::chrono::milliseconds{2}, false,
                          [this](auto out) { return encode(random_state(random), out); });
    endpoint.add_incoming(MessageId::kRobotState, [this](auto body, rt::Time) {
      drivers::RobotState s;
      const bool good = decode(body, s);
      ++(good ? got : bad);
      return good;
    });
    EXPECT_TRUE(link->emulate(network, rt::monotonic_ns()));
    start();
  }
  ~NetworkEnd() { link->stop(); }
};

struct NetworkPair {
  std::unique_ptr<NetworkEnd> op, robot;
  explicit NetworkPair(const NetworkConfig& c, bool lasting = false) {
    auto listening =
        lasting ? TcpLink::listen_lasting("127.0.0.1", 0) : TcpLink::listen("127.0.0.1", 0);
    EXPECT_TRUE(listening);
    const int port = listening.value()->port();
    auto dialled = lasting ? TcpLink::dial_lasting("127.0.0.1", port)
                           : TcpLink::connect("127.0.0.1", port, std::chrono::seconds{5});
    EXPECT_TRUE(dialled);
    // The operator's box listens here: which way is which is the box's, not the socket's.
    op = std::make_unique<NetworkEnd>(rt::Box::kOperator, std::move(listening).value(), c);
    robot = std::make_unique<NetworkEnd>(rt::Box::kRobot, std::move(dialled).value(), c);
  }
  [[nodiscard]] bool ready() const {
    return op->link->state() == State::kReady && robot->link->state() == State::kReady;
  }
};

TEST(TcpNetwork, ItsDelayIsTheRoundTrip) {
  NetworkConfig c;
  c.delay_ms = 20;
  const NetworkPair p(c);
  ASSERT_TRUE(wait_for([&] { return p.ready(); }));
  EXPECT_GE(p.op->link->round_trip_ns(), 40'000'000);
  EXPECT_GE(p.robot->link->round_trip_ns(), 40'000'000);
  ASSERT_TRUE(wait_for([&] { return p.op->got >= 50; }));
  EXPECT_EQ(p.op->bad, 0);
}

TEST(TcpNetwork, AHalfOpenWayIsSilentForOneBoxAndToldToNone) {
  NetworkConfig c;
  c.delay_ms = 5;
  c.cuts.push_back({1.5, "to_robot"});
  const NetworkPair p(c);
  ASSERT_TRUE(wait_for([&] { return p.ready(); }));
  std::int64_t heard = -1;
  ASSERT_TRUE(wait_for([&] {
    const std::int64_t before = heard;
    heard = p.robot->link->last_heard_ns();
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    return heard == before;
  }));
  const std::int64_t got = p.op->got;
  ASSERT_TRUE(wait_for([&] { return p.op->got >= got + 50; })) << "the other way goes on";
  EXPECT_EQ(p.robot->link->last_heard_ns(), heard);
  EXPECT_EQ(p.robot->link->state(), State::kReady);
  EXPECT_EQ(p.op->link->state(), State::kReady);
}

// A single link ends with its first flap; a lasting one comes again after each.
TEST(TcpNetwork, AFlapEndsTheConnectionAndALastingLinkComesAgain) {
  NetworkConfig c;
  c.delay_ms = 5;
  c.flaps_per_minute = 60;
  c.flap_down_ms = 100;
  const NetworkPair once(c);
  ASSERT_TRUE(wait_for([&] { return once.op->link->ended() && once.robot->link->ended(); }));
  EXPECT_EQ(once.op->link->fault(), "");
  const NetworkPair p(c, true);
  ASSERT_TRUE(wait_for([&] { return p.op->link->sessions() >= 4; }, 60));
  const std::int64_t got = p.op->got;
  ASSERT_TRUE(wait_for([&] { return p.op->got > got; }));
  EXPECT_EQ(p.op->bad, 0);
}

TEST(TcpNetwork, DamagedBytesAreNeverTakenAndALastingLinkComesAgain) {
  NetworkConfig c;
  c.corrupt_per_MB = 300;
  const NetworkPair p(c, true);
  ASSERT_TRUE(wait_for([&] { return p.op->link->sessions() >= 3 && p.op->got >= 20; }, 60));
  EXPECT_EQ(p.op->bad, 0) << "the checksum stands before the fields";
}

}  // namespace
