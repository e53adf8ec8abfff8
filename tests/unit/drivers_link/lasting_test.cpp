// A transport that outlives its connections: either side may come first, end, and come again.
// Waits are for events with a generous limit.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/link/back_off.hpp"
#include "drivers/link/frame_asker.hpp"
#include "tests/unit/drivers_link/tcp_support.hpp"

namespace {

using namespace link_test;
using drivers::BackOff;
using drivers::MessageId;
using drivers::TcpLink;
using testing::HasSubstr;
using State = TcpLink::State;

TEST(BackOff, DoublesToASecondAndBeginsAgain) {
  BackOff b;
  std::int64_t wanted = 20;
  for (int i = 0; i < 6; ++i, wanted *= 2) EXPECT_EQ(b.next(), std::chrono::milliseconds{wanted});
  for (int i = 0; i < 5; ++i) EXPECT_EQ(b.next(), std::chrono::seconds{1});
  b.succeeded();
  EXPECT_EQ(b.next(), std::chrono::milliseconds{20});
}

// ---- the endpoint and who asks for frames

TEST(EndpointRenew, TellsWhoMustBeginAnew) {
  rt::Startup startup;
  drivers::LinkEndpoint end(startup.token(), rt::Box::kOperator);
  std::string order;
  end.on_renew([&] { order += "a"; });
  end.on_renew([&] { order += end.hello_ok() ? "?" : "b"; });
  EXPECT_EQ(order, "");
  end.renew();
  end.renew();
  EXPECT_EQ(order, "abab");
}

// A key is asked for at once, whatever was under way; a frame that was given up does not count
// among those that the other end can have seen.
TEST(FrameAskerRenew, AsksForAKeyAndHearsTheNextReport) {
  drivers::FrameAsker asker;
  rt::Time now = rt::time_from_ns(1'000'000'000);
  const auto step = [&] { return asker.poll(now += std::chrono::milliseconds{50}, {}, now); };
  for (int i = 0; i < 10; ++i) {
    const auto d = step();
    ASSERT_TRUE(d);
    ASSERT_EQ(d->key, i == 0 ? 1 : 0);
    ASSERT_TRUE(asker.sent(now, d->seq, d->key != 0, 1000));
  }
  const auto open = step();
  ASSERT_TRUE(open && asker.out());
  asker.renew();
  EXPECT_FALSE(asker.out());
  EXPECT_FALSE(asker.sent(now, open->seq, false, 1000)) << "of the connection before";
  const auto key = step();
  ASSERT_TRUE(key);
  EXPECT_GT(key->seq, open->seq);
  EXPECT_EQ(key->key, 1);
  ASSERT_TRUE(asker.sent(now, key->seq, true, 1000));
  const auto next = step();
  ASSERT_TRUE(next);
  EXPECT_EQ(next->key, 0);
  ASSERT_TRUE(asker.sent(now, next->seq, false, 1000));
  asker.report({10, 1});  // it speaks of one from before the key
  const auto still = step();
  ASSERT_TRUE(still);
  EXPECT_EQ(still->key, 0);
  ASSERT_TRUE(asker.sent(now, still->seq, false, 1000));
  asker.report({12, 1});  // the frame behind the key did not decode
  const auto again = step();
  ASSERT_TRUE(again);
  EXPECT_EQ(again->key, 1);
}

// ---- over TCP

int free_port() {
  auto l = TcpLink::listen("127.0.0.1", 0);
  return l ? l.value()->port() : 0;
}

struct LastingEnd : End {
  std::atomic<int> ends{0}, readies{0};
  std::atomic<State> last{State::kConnecting};
  LastingEnd(rt::Box box, bool listens, int port) : End(box, {}) {
    auto opened = listens ? TcpLink::listen_lasting("127.0.0.1", port)
                          : TcpLink::dial_lasting("127.0.0.1", port);
    EXPECT_TRUE(opened);
    link = std::move(opened).value();
    link->start(
        endpoint, [this] { return now(); }, {},
        [this] {
          const State s = link->state();
          if (s != last.exchange(s)) ++(s == State::kReady ? readies : ends);
        });
  }
  ~LastingEnd() { link->stop(); }
  bool ready() const { return link->state() == State::kReady; }
};

// Which of the two boxes dials, which of them starts first and which of them goes and comes again.
TEST(LastingLink, EitherSideMayComeFirstGoAndComeAgain) {
  for (const bool robot_listens : {true, false}) {
    for (const bool listener_first : {true, false}) {
      SCOPED_TRACE(testing::Message() << robot_listens << listener_first);
      const int port = free_port();
      std::unique_ptr<LastingEnd> ends[2];
      const auto make = [&](bool listens) {
        const bool robot = listens == robot_listens;
        ends[listens ? 1 : 0] = std::make_unique<LastingEnd>(
            robot ? rt::Box::kRobot : rt::Box::kOperator, listens, port);
      };
      make(listener_first);
      std::this_thread::sleep_for(std::chrono::milliseconds(60));
      EXPECT_EQ(ends[listener_first ? 1 : 0]->link->state(), State::kConnecting);
      make(!listener_first);
      ASSERT_TRUE(wait_for([&] { return ends[0]->ready() && ends[1]->ready(); }));
      for (const bool goes : {true, false}) {
        LastingEnd& stays = *ends[goes ? 0 : 1];
        const std::uint64_t before = stays.link->sessions();
        ends[goes ? 1 : 0].reset();
        ASSERT_TRUE(wait_for([&] { return !stays.ready(); })) << "the end is known";
        make(goes);
        ASSERT_TRUE(wait_for([&] { return stays.ready() && ends[goes ? 1 : 0]->ready(); }));
        EXPECT_EQ(stays.link->sessions(), before + 1);
        EXPECT_GE(stays.readies, 2);
        EXPECT_TRUE(stays.link->fault().empty());
      }
    }
  }
}

// Two hundred short connections: each is served. One that comes before the end of the last is known
// is turned away and dials again.
TEST(LastingLink, GoesOnAfterTwoHundredConnections) {
  const int port = free_port();
  LastingEnd robot(rt::Box::kRobot, true, port);
  for (std::uint64_t n = 1; n <= 200; ++n) {
    LastingEnd op(rt::Box::kOperator, false, port);
    ASSERT_TRUE(wait_for([&] { return op.ready() && robot.link->sessions() >= n; })) << n;
  }
  EXPECT_EQ(robot.link->sessions(), 200U);
}

// Nobody is told when a cable is cut; both ends give the session up by themselves.
TEST(LastingLink, ASilentSessionEndsAndTheNextOneIsFound) {
  const int port = free_port();
  LastingEnd robot(rt::Box::kRobot, true, port);
  LastingEnd op(rt::Box::kOperator, false, port);
  ASSERT_TRUE(wait_for([&] { return robot.ready() && op.ready(); }));
  const std::uint64_t n = robot.link->sessions();
  op.link->cut();
  ASSERT_TRUE(wait_for([&] { return !robot.ready() && !op.ready(); }));
  // The first end whose two seconds are over closes its socket. The other may hear that before its
  // own two seconds are over, and then it has nothing to say.
  EXPECT_THAT(robot.link->fault() + op.link->fault(), HasSubstr("nothing was heard"));
  op.link->mend();
  ASSERT_TRUE(wait_for([&] { return robot.ready() && op.ready(); }));
  EXPECT_GT(robot.link->sessions(), n);
  EXPECT_TRUE(robot.link->fault().empty());
}

int dial(int port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_port = htons(static_cast<std::uint16_t>(port));
  a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a), 0);
  return fd;
}

TEST(LastingLink, ASecondOperatorIsTurnedAwayAndTheFirstIsNotDisturbed) {
  const int port = free_port();
  LastingEnd robot(rt::Box::kRobot, true, port);
  LastingEnd op(rt::Box::kOperator, false, port);
  ASSERT_TRUE(wait_for([&] { return robot.ready() && op.ready(); }));
  LastingEnd second(rt::Box::kOperator, false, port);
  ASSERT_TRUE(wait_for([&] { return robot.link->turned_away() >= 3; }));
  EXPECT_FALSE(second.ready());
  EXPECT_EQ(second.link->sessions(), 0U);
  EXPECT_EQ(robot.link->sessions(), 1U);
  EXPECT_TRUE(robot.ready() && op.ready());
}

// Garbage, another version, and somebody who says nothing: each is put away, and the next peer is
// served.
TEST(LastingLink, StrangersDoNotEndIt) {
  const int port = free_port();
  LastingEnd robot(rt::Box::kRobot, true, port);
  int fd = dial(port);
  const Bytes garbage(200, 0x5A);
  (void)!::send(fd, garbage.data(), garbage.size(), MSG_NOSIGNAL);
  EXPECT_TRUE(wait_for([&] { return robot.link->fault() == "link: bad magic"; }));
  ::close(fd);
  fd = dial(port);
  Bytes other = whole(MessageId::kHello, {});
  set_field<std::uint64_t>(other, 32, drivers::schema_hash() + 1);
  (void)!::send(fd, other.data(), other.size(), MSG_NOSIGNAL);
  EXPECT_TRUE(wait_for(
      [&] { return robot.link->fault().find("install the same teletact") != std::string::npos; }));
  ::close(fd);
  fd = dial(port);  // and not a word
  EXPECT_TRUE(wait_for([&] { return robot.link->fault() == "link: nothing was heard for 2 s"; }));
  EXPECT_EQ(robot.link->sessions(), 0U);
  LastingEnd op(rt::Box::kOperator, false, port);
  EXPECT_TRUE(wait_for([&] { return robot.ready() && op.ready(); }));
  ::close(fd);
}

TEST(LastingLink, OnlyLoopbackAndNobodyThereIsNoError) {
  EXPECT_FALSE(TcpLink::listen_lasting("0.0.0.0", 0));
  EXPECT_FALSE(TcpLink::dial_lasting("192.168.1.5", 5000));
  LastingEnd alone(rt::Box::kOperator, false, free_port());
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(alone.link->state(), State::kConnecting);
  alone.link->stop();  // and ends at once
}

}  // namespace
