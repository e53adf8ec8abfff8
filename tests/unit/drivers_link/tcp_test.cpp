// The transport over a real loopback connection. Waits are for events with a generous limit, so a
// loaded machine makes them slower, not red.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <functional>
#include <thread>

#include "drivers/link/tcp_link.hpp"
#include "tests/unit/drivers_link/tcp_support.hpp"

namespace {

using namespace link_test;
using drivers::LinkShapeConfig;
using drivers::MessageId;
using drivers::TcpLink;
using testing::HasSubstr;
using State = TcpLink::State;

struct Box2 {
  End op{rt::Box::kOperator, {}};
  End robot{rt::Box::kRobot, {1000 * kSecond, 50}};

  Box2() {
    auto listening = TcpLink::listen("127.0.0.1", 0);
    EXPECT_TRUE(listening);
    op.link = std::move(listening).value();
    EXPECT_GT(op.link->port(), 0);
    auto connected = TcpLink::connect("127.0.0.1", op.link->port(), rt::Nanos{5 * kSecond});
    EXPECT_TRUE(connected);
    robot.link = std::move(connected).value();
  }
  ~Box2() {
    op.link->stop();
    robot.link->stop();
  }
  bool ready() { return op.link->state() == State::kReady && robot.link->state() == State::kReady; }
};

TEST(TcpLink, StatesGoalsAndFramesCrossWithMeasuredOffset) {
  Box2 b;
  static drivers::EncodedFrame frame, received;
  frame.seq = 0;
  frame.exposure = {rt::Box::kRobot, 5};
  frame.intrinsics = {.fx = 365, .fy = 365, .cx = 256, .cy = 212, .width = 512, .height = 424};
  frame.depth_size = 100000;
  for (std::size_t i = 0; i < frame.depth_size; ++i)
    frame.bytes[i] = static_cast<std::uint8_t>(rt::mix64(i));
  b.robot.endpoint.add_outgoing(MessageId::kRobotState, rt::Nanos{10'000'000}, false,
                                [&](auto out) {
                                  auto s = random_state(b.robot.random);
                                  s.seq = ++b.robot.made;
                                  return encode(s, out);
                                });
  b.robot.endpoint.add_outgoing(MessageId::kFrame, rt::Nanos{33'333'333}, true, [&](auto out) {
    ++frame.seq;
    return drivers::write_wire(frame, out);
  });
  b.op.endpoint.add_outgoing(MessageId::kRobotGoal, rt::Nanos{50'000'000}, false, [&](auto out) {
    auto g = random_goal(b.op.random);
    g.seq = ++b.op.made;
    return encode(g, out);
  });
  // What was sent before a side knew the clocks was refused; from its first one on none is lost.
  std::uint64_t last_state = 0, last_goal = 0, last_frame = 0;
  const auto follows = [](std::uint64_t& last, std::uint64_t seq) {
    const bool ok = last == 0 || seq == last + 1;
    last = seq;
    return ok;
  };
  std::atomic<int> frames{0};
  b.op.endpoint.add_incoming(MessageId::kRobotState, [&](auto body, rt::Time sent) {
    drivers::RobotState s;
    if (!decode(body, s) || !follows(last_state, s.seq)) ++b.op.bad;
    b.op.note(sent);
    return true;
  });
  b.op.endpoint.add_incoming(MessageId::kFrame, [&](auto body, rt::Time) {
    if (read_wire(body, received) != drivers::FrameStatus::kOk ||
        !follows(last_frame, received.seq) || received.depth_size != frame.depth_size ||
        !std::equal(received.depth().begin(), received.depth().end(), frame.bytes.begin())) {
      ++b.op.bad;
    }
    ++frames;
    return true;
  });
  b.robot.endpoint.add_incoming(MessageId::kRobotGoal, [&](auto body, rt::Time sent) {
    drivers::RobotGoal g;
    if (!decode(body, g) || !follows(last_goal, g.seq)) ++b.robot.bad;
    b.robot.note(sent);
    return true;
  });
  b.op.start();
  b.robot.start();
  EXPECT_TRUE(
      wait_for([&] { return b.ready() && b.op.got > 50 && b.robot.got > 10 && frames > 15; }));
  EXPECT_EQ(b.op.bad, 0);
  EXPECT_EQ(b.robot.bad, 0);
  // Offset of 1000 s (and what 50 ppm of the host's uptime make of it), within the stated
  // uncertainty.
  const std::int64_t host = rt::monotonic_ns();
  const std::int64_t truth = (b.robot.clock.from_host(host) - b.op.clock.from_host(host)).count();
  EXPECT_GT(truth, 999 * kSecond);
  EXPECT_LE(std::abs(b.op.offset - truth), b.op.link->clock_uncertainty_ns() + 1'000'000);
  EXPECT_LE(std::abs(b.robot.offset + truth), b.robot.link->clock_uncertainty_ns() + 1'000'000);
  EXPECT_LT(b.op.worst_stamp, 20 * kSecond) << "an unconverted stamp would be 1000 s off";
  EXPECT_LT(b.robot.worst_stamp, 20 * kSecond);
  EXPECT_GT(b.op.link->last_heard_ns(), 0);
  EXPECT_GT(b.op.link->round_trip_ns(), 0);
  EXPECT_GT(b.op.link->thread_cpu_ns(), 0);
  b.robot.link->stop();
  EXPECT_TRUE(wait_for([&] { return b.op.link->state() == State::kClosed; })) << "an orderly end";
  b.op.link->stop();
  EXPECT_TRUE(b.op.endpoint.bye_received());
  EXPECT_TRUE(b.op.link->fault().empty());
  EXPECT_GE(b.robot.link->stats().sent[5], 50U);
  EXPECT_EQ(b.op.link->stats().received[5],
            b.op.link->stats().refused[5] + static_cast<std::uint64_t>(b.op.got));
}

TEST(TcpLink, ACutCableIsSilenceAndNothingElse) {
  Box2 b;
  b.op.start();
  b.robot.start();
  ASSERT_TRUE(wait_for([&] { return b.ready(); }));
  b.robot.link->cut();
  std::int64_t heard = -1;
  ASSERT_TRUE(wait_for([&] {
    const std::int64_t before = heard;
    heard = b.op.link->last_heard_ns();
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return heard == before;
  })) << "what was under way has arrived";
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(b.op.link->last_heard_ns(), heard) << "silence is silence";
  EXPECT_EQ(b.op.link->state(), State::kReady) << "nobody is told";
  EXPECT_EQ(b.robot.link->state(), State::kReady);
  EXPECT_FALSE(b.op.link->ended());
  b.op.link->stop();
  EXPECT_FALSE(b.op.endpoint.bye_received());
}

// The kernel ends the connections of a process that dies, however it dies: the other side is told
// at once, by the last call of its after_poll.
TEST(TcpLink, TheEndOfTheOtherProcessIsKnownAtOnce) {
  End op(rt::Box::kOperator, {});
  auto listening = TcpLink::listen("127.0.0.1", 0);
  ASSERT_TRUE(listening);
  op.link = std::move(listening).value();
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    End robot(rt::Box::kRobot, {1000 * kSecond, 50});
    auto connected = TcpLink::connect("127.0.0.1", op.link->port(), rt::Nanos{5 * kSecond});
    if (!connected) ::_exit(1);
    robot.link = std::move(connected).value();
    robot.start();
    ::pause();
    ::_exit(0);
  }
  std::atomic<bool> told{false};
  op.link->start(
      op.endpoint, [&] { return op.now(); }, {}, [&] { told = op.link->ended(); });
  const bool ready = wait_for([&] { return op.link->state() == State::kReady; });
  EXPECT_FALSE(told);
  ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(ready);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  EXPECT_TRUE(wait_for([&] { return told.load(); }));
  EXPECT_EQ(op.link->state(), State::kClosed);
  EXPECT_FALSE(op.endpoint.bye_received());
  op.link->stop();
}

TEST(TcpLink, ShaperDelaysTheRoundTrip) {
  Box2 b;
  LinkShapeConfig shape;
  shape.delay_ms = 20;
  b.op.start(shape);
  b.robot.start(shape);
  ASSERT_TRUE(wait_for([&] { return b.ready(); }));
  EXPECT_GE(b.op.link->round_trip_ns(), 40'000'000);
  EXPECT_GE(b.robot.link->round_trip_ns(), 40'000'000);
}

TEST(TcpLink, OnlyLoopbackIsAllowed) {
  for (const char* address :
       {"0.0.0.0", "192.168.1.5", "8.8.8.8", "128.0.0.1", "126.255.255.255"}) {
    const auto a = TcpLink::listen(address, 0);
    const auto b = TcpLink::connect(address, 5000, rt::Nanos{0});
    for (const auto* r : {&a, &b}) {
      ASSERT_FALSE(*r) << address;
      EXPECT_EQ(r->error(),
                std::string("link.address = ") + address +
                    ": this link has no keys, so only loopback (127.0.0.0/8) is allowed");
    }
  }
  for (const char* address : {"", "localhost", "127.0.0", "::1", "127.0.0.1 "}) {
    const auto a = TcpLink::listen(address, 0);
    ASSERT_FALSE(a) << address;
    EXPECT_THAT(a.error(), HasSubstr("not an IPv4 address"));
  }
  for (const int port : {-1, 65536}) {
    const auto a = TcpLink::listen("127.0.0.1", port);
    ASSERT_FALSE(a);
    EXPECT_EQ(a.error(), "link.port = " + std::to_string(port) + ": allowed 0..65535");
  }
}

TEST(TcpLink, ATakenPortAndAnAbsentPeerAreOneMessageEach) {
  auto first = TcpLink::listen("127.0.0.1", 0);
  ASSERT_TRUE(first);
  const int port = first.value()->port();
  const auto second = TcpLink::listen("127.0.0.1", port);
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error(), HasSubstr("127.0.0.1:" + std::to_string(port)));
  first.value()->stop();
  const auto nobody = TcpLink::connect("127.0.0.1", port, rt::Nanos{50'000'000});
  ASSERT_FALSE(nobody);
  EXPECT_THAT(nobody.error(), HasSubstr("connect to 127.0.0.1:" + std::to_string(port)));
}

// A stranger on the port: raw bytes over a plain socket.
struct Stranger {
  End op{rt::Box::kOperator, {}};
  int fd = -1;
  explicit Stranger(const std::optional<LinkShapeConfig>& shape = {}) {
    auto listening = TcpLink::listen("127.0.0.1", 0);
    EXPECT_TRUE(listening);
    op.link = std::move(listening).value();
    op.start(shape);
    fd = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_port = htons(static_cast<std::uint16_t>(op.link->port()));
    a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a), 0);
  }
  ~Stranger() {
    op.link->stop();
    ::close(fd);
  }
  void say(std::span<const std::uint8_t> b) { (void)!::send(fd, b.data(), b.size(), MSG_NOSIGNAL); }
  std::string fault() {
    EXPECT_TRUE(wait_for([&] { return op.link->state() == State::kFault; }));
    return op.link->fault();
  }
};

TEST(TcpLink, GarbageClosesWithAFault) {
  rt::Random r(31);
  for (int n = 0; n < 20; ++n) {
    Stranger s;
    Bytes b(static_cast<std::size_t>(r.integer(40, 100000)));
    for (auto& v : b) v = static_cast<std::uint8_t>(r());
    s.say(b);
    EXPECT_EQ(s.fault(), "link: bad magic") << n;
  }
}

TEST(TcpLink, EachKindOfBadMessageHasItsFault) {
  const auto hello = whole(MessageId::kHello, {});
  struct Case {
    const char* fault;
    Bytes bytes;
  };
  std::vector<Case> cases;
  Bytes b = whole(MessageId::kClockRequest, body_of(drivers::ClockRequest{1}));
  b.back() ^= 1U;
  cases.push_back({"link: bad checksum", b});
  b = whole(MessageId::kClockRequest, body_of(drivers::ClockRequest{1}));
  set_field<std::uint32_t>(b, 8, 0xFFFFFFFFU);
  cases.push_back({"link: body too long", b});
  b = whole(MessageId::kBye, {});
  set_field<std::uint16_t>(b, 6, 99);
  cases.push_back({"link: unknown message id", b});
  b = whole(MessageId::kBye, {});
  set_field<std::uint16_t>(b, 4, 9);
  cases.push_back({"link: other schema version", b});
  for (const auto& c : cases) {
    Stranger s;
    s.say(hello);
    s.say(c.bytes);
    EXPECT_EQ(s.fault(), c.fault);
    s.op.link->stop();
    EXPECT_TRUE(s.op.endpoint.hello_ok());
  }
  Stranger s;
  b = hello;
  set_field<std::uint64_t>(b, 32, drivers::schema_hash() + 1);
  s.say(b);
  EXPECT_THAT(s.fault(), HasSubstr("install the same teletact on both boxes"));
}

// The refused side must be able to name both schemas as well: our Hello reaches it before we close,
// even over a slow network.
TEST(TcpLink, AStrangerStillGetsOurHello) {
  for (const double delay_ms : {0.0, 60.0}) {
    LinkShapeConfig shape;
    shape.delay_ms = delay_ms;
    Stranger s(shape);
    Bytes b = whole(MessageId::kHello, {});
    set_field<std::uint16_t>(b, 4, drivers::kSchemaVersion + 1);
    s.say(b);
    EXPECT_THAT(s.fault(),
                HasSubstr("schema version " + std::to_string(drivers::kSchemaVersion + 1)));
    Bytes got(1000);
    std::size_t n = 0;
    for (ssize_t k = 0; (k = ::recv(s.fd, got.data() + n, got.size() - n, 0)) > 0;) {
      n += static_cast<std::size_t>(k);
    }
    drivers::Header h;
    ASSERT_EQ(drivers::read_header(std::span(got).first(n), h), drivers::WireStatus::kOk)
        << delay_ms;
    EXPECT_EQ(h.id, MessageId::kHello);
    EXPECT_EQ(h.schema, drivers::schema_hash());
    EXPECT_EQ(n, drivers::kHeaderSize) << "and nothing else";
  }
}

// A valid stream handed over byte by byte, and torn in the middle of a message.
TEST(TcpLink, ReassemblesAndSurvivesATornEnd) {
  Stranger s;
  Bytes stream = whole(MessageId::kHello, {});
  for (int i = 0; i < 5; ++i) {
    const Bytes m = whole(MessageId::kClockRequest, body_of(drivers::ClockRequest{i}));
    stream.insert(stream.end(), m.begin(), m.end());
  }
  for (const std::uint8_t byte : stream) s.say({&byte, 1});
  s.say(std::span(stream).first(50));  // a Hello and ten bytes
  ::shutdown(s.fd, SHUT_WR);
  EXPECT_TRUE(wait_for([&] { return s.op.link->state() == State::kClosed; }));
  s.op.link->stop();
  EXPECT_EQ(s.op.link->stats().received[static_cast<std::size_t>(MessageId::kClockRequest)], 5U);
  EXPECT_EQ(s.op.link->stats().sent[static_cast<std::size_t>(MessageId::kClockReply)], 5U);
}

}  // namespace
