// What strangers and a hostile network can do to a listening robot: nothing but be refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <thread>

#include "rt/random.hpp"
#include "tests/unit/drivers_road/support.hpp"

namespace {

using namespace road_test;
using drivers::MessageId;
using testing::HasSubstr;

struct Robot {
  Lab lab;
  std::unique_ptr<End> end;
  explicit Robot(rt::Nanos handshake_limit = std::chrono::seconds{5},
                 rt::Nanos silence_limit = std::chrono::seconds{5}) {
    auto options = listening(lab, "rover", rt::Box::kRobot);
    options.handshake_limit = handshake_limit;
    options.silence_limit = silence_limit;
    end = std::make_unique<End>(options);
    end->talk();
    end->start();
  }
  int port() const { return end->link->port(); }
  std::unique_ptr<RawTls> raw(const std::string& name = "ada") {
    auto r =
        std::make_unique<RawTls>(port(), lab.box(name) + "/box.crt", lab.box(name) + "/box.key");
    EXPECT_TRUE(r->shaken);
    return r;
  }
  std::string last() { return end->link->last_refusal(); }
  bool says(const std::string& words) {
    return wait_for([&] {
      return last().find(words) != std::string::npos ||
             end->link->fault().find(words) != std::string::npos;
    });
  }
  void expect_friend_welcome() {
    End ada(dialling(lab, "ada", rt::Box::kOperator, port()));
    ada.start();
    EXPECT_TRUE(wait_for([&] { return ada.ready(); })) << ada.link->fault();
  }
};

Bytes frame(unsigned kind, std::uint32_t length, std::size_t bytes) {
  Bytes b{'R', 'D', 1, static_cast<std::uint8_t>(kind)};
  for (unsigned i = 0; i < 4; ++i) b.push_back(static_cast<std::uint8_t>(length >> (8 * i)));
  b.resize(b.size() + bytes, 0x5a);
  return b;
}

Bytes token_in(const Bytes& welcome) {
  EXPECT_EQ(welcome.size(), 24U);
  EXPECT_EQ(welcome.size() > 3 ? welcome[3] : 0, 2) << "a welcome";
  return welcome.size() == 24 ? Bytes(welcome.begin() + 8, welcome.end()) : Bytes(16);
}

// ---- before the handshake ----

TEST(Hostile, SlowHandshakesAreCutOffAndKeepNobodyOut) {
  Robot robot(std::chrono::milliseconds{400});
  std::vector<int> sockets;
  for (int i = 0; i < 8; ++i) sockets.push_back(dial_plain(robot.port()));
  // A byte now and then of a ClientHello's header: never a whole record.
  const std::uint8_t slow[] = {0x16, 0x03, 0x01};
  for (const std::uint8_t byte : slow) {
    for (const int fd : sockets) (void)!::send(fd, &byte, 1, MSG_NOSIGNAL);
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
  }
  robot.expect_friend_welcome();
  for (const int fd : sockets) {
    std::uint8_t byte = 0;
    EXPECT_LE(::recv(fd, &byte, 1, 0), 0) << "cut off";
    ::close(fd);
  }
  EXPECT_TRUE(wait_for([&] { return robot.end->link->counts().refused >= 8; }));
  EXPECT_THAT(robot.last(), HasSubstr("took too long"));
}

TEST(Hostile, ACrowdBeforeTheDoorKeepsNobodyOut) {
  Robot robot(std::chrono::seconds{30});
  std::vector<int> sockets;
  for (int i = 0; i < 40; ++i) sockets.push_back(dial_plain(robot.port()));
  ASSERT_TRUE(wait_for([&] { return robot.end->link->counts().crowded >= 20; }));
  robot.expect_friend_welcome();
  for (const int fd : sockets) ::close(fd);
}

TEST(Hostile, GarbageInsteadOfTlsIsRefused) {
  Robot robot;
  rt::Random r(7201);
  for (std::uint64_t n = 1; n <= 20; ++n) {
    const int fd = dial_plain(robot.port());
    Bytes b(static_cast<std::size_t>(r.integer(1, 20000)));
    for (auto& v : b) v = static_cast<std::uint8_t>(r());
    if (n == 1)
      b = {'G', 'E', 'T', ' ', '/', ' ', 'H', 'T', 'T', 'P', '/', '1', '.', '1', '\r', '\n'};
    (void)!::send(fd, b.data(), b.size(), MSG_NOSIGNAL);
    ::shutdown(fd, SHUT_WR);
    ASSERT_TRUE(wait_for([&] { return robot.end->link->counts().refused >= n; })) << n;
    if (n == 1) {
      EXPECT_THAT(robot.last(), HasSubstr("does not speak TLS"));
    }
    ::close(fd);
  }
  robot.expect_friend_welcome();
}

// ---- with a good certificate ----

TEST(Hostile, NothingButAGreetingIsTakenFirst) {
  Robot robot;
  struct Case {
    Bytes bytes;
    const char* words;
  };
  const Case cases[] = {
      {frame(4, 100, 100), "a frame longer than its kind may be"},
      {frame(4, 0xFFFFFFFF, 0), "a frame longer than its kind may be"},
      {frame(1, 0xFFFFFFF0, 0), "a frame longer than its kind may be"},
      {frame(1, 17, 17), "refused"},  // no such connection: 0x5a
      {frame(2, 16, 16), "refused"},
      {frame(3, 5, 5), "refused"},
      {frame(1, 0, 0), "a frame without a body"},
      {frame(9, 4, 4), "a frame of an unknown kind"},
      {Bytes(64, 'x'), "no frame begins here"},
      {Bytes{'R', 'D', 9, 1, 17, 0, 0, 0}, "another version"},
  };
  for (const Case& c : cases) {
    auto raw = robot.raw();
    const auto before = robot.end->link->counts().refused;
    raw->say(c.bytes);
    EXPECT_TRUE(raw->hear().empty());
    ASSERT_TRUE(wait_for([&] { return robot.end->link->counts().refused > before; }));
    EXPECT_THAT(robot.last(), HasSubstr(c.words));
  }
  EXPECT_EQ(robot.end->link->sessions(), 0U);
  robot.expect_friend_welcome();
}

TEST(Hostile, ATokenIsOfUseToItsOwnPeerAlone) {
  Robot robot;
  robot.lab.issue(rt::Box::kOperator, "bob");
  auto ada = robot.raw();
  const Bytes token = token_in(ada->greet());
  auto bob = robot.raw("bob");
  const Bytes said = bob->greet(1, token);
  EXPECT_THAT(std::string(said.begin(), said.end()), HasSubstr("does not belong to the first"));
  auto guess = robot.raw();
  Bytes wrong = token;
  wrong[15] ^= 1U;
  const Bytes no = guess->greet(1, wrong);
  EXPECT_THAT(std::string(no.begin(), no.end()), HasSubstr("does not belong to the first"));
  EXPECT_EQ(robot.end->link->sessions(), 0U);
  auto right = robot.raw();
  token_in(right->greet(1, token));
  EXPECT_TRUE(wait_for([&] { return robot.end->link->sessions() == 1; }));
}

// A session of raw connections: messages beyond the cap of their connection, silence, no reading.
struct RawSession {
  std::unique_ptr<RawTls> control, bulk;
  explicit RawSession(Robot& robot) : control(robot.raw()) {
    const Bytes token = token_in(control->greet());
    bulk = robot.raw();
    token_in(bulk->greet(1, token));
  }
};

TEST(Hostile, InASessionLengthsAreCappedPerConnection) {
  Robot robot;
  std::uint64_t sessions = 0;
  const auto longest_control = drivers::kHeaderSize + drivers::kMaxControlBody;
  const auto longest_bulk = drivers::kHeaderSize + drivers::kMaxBody;
  for (const bool bulk : {false, true}) {
    RawSession s(robot);
    ++sessions;
    ASSERT_TRUE(wait_for([&] { return robot.end->link->sessions() == sessions; }));
    const auto length = static_cast<std::uint32_t>((bulk ? longest_bulk : longest_control) + 1);
    (bulk ? s.bulk : s.control)->say(frame(4, length, 0));
    ASSERT_TRUE(wait_for([&] { return robot.end->closed == static_cast<int>(sessions); }));
    EXPECT_TRUE(robot.says("a frame longer than its kind may be")) << robot.end->link->fault();
  }
  {
    RawSession s(robot);
    s.control->say(frame(4, 60, 60));  // of the road's form, but no message of the link
    ASSERT_TRUE(wait_for([&] { return robot.end->faults == 1; }));
    EXPECT_TRUE(robot.says("link: bad magic"));
  }
  {
    RawSession s(robot);
    s.control->say(frame(1, 17, 17));
    ASSERT_TRUE(wait_for([&] { return robot.end->closed == 3; })) << "no second greeting";
  }
  robot.expect_friend_welcome();
}

// Anybody else reads "busy: operator 'ada'": so this box's own people must know too.
TEST(Hostile, WhoHoldsThePlaceIsToldBeforeItSaysAWord) {
  Robot robot;
  EXPECT_EQ(robot.end->link->notes().peer, "");
  RawSession s(robot);
  ASSERT_TRUE(wait_for([&] { return robot.end->link->sessions() == 1; }));
  EXPECT_EQ(robot.end->link->notes().peer, "operator 'ada' from 127.0.0.1");
  EXPECT_EQ(robot.end->link->state(), State::kHandshake);
  s.control->say(Bytes(64, 'x'));
  EXPECT_TRUE(wait_for([&] { return robot.end->link->notes().peer.empty(); }));
}

TEST(Hostile, WhoSaysNothingAndReadsNothingIsLeft) {
  Robot robot(std::chrono::seconds{5}, std::chrono::milliseconds{500});
  RawSession s(robot);
  ASSERT_TRUE(wait_for([&] { return robot.end->closed == 1; }));
  EXPECT_TRUE(robot.says("nothing was heard of the other box for too long"));
  robot.expect_friend_welcome();
}

TEST(Hostile, APromiseThatIsNotKeptHoldsThePlaceForAWhileOnly) {
  Robot robot;
  auto raw = robot.raw();
  token_in(raw->greet());
  End ada(dialling(robot.lab, "ada", rt::Box::kOperator, robot.port()));
  ada.start();
  ASSERT_TRUE(wait_for([&] { return ada.link->fault().find("busy") != std::string::npos; }));
  EXPECT_TRUE(wait_for([&] { return ada.ready(); })) << "5 s later: " << ada.link->fault();
}

// A second operator of the lab that only ever greets, again and again, from ada's own address.
TEST(Hostile, GreetingsAloneKeepTheOtherOperatorOutForSecondsOnly) {
  Robot robot;
  robot.lab.issue(rt::Box::kOperator, "bob");
  std::atomic<bool> stop{false};
  auto first = robot.raw("bob");
  token_in(first->greet());
  std::thread squatter([&] {
    while (!stop) {
      RawTls bob(robot.port(), robot.lab.box("bob") + "/box.crt",
                 robot.lab.box("bob") + "/box.key");
      if (bob.shaken) static_cast<void>(bob.greet());
      std::this_thread::sleep_for(std::chrono::milliseconds(150));
    }
  });
  const std::int64_t from = rt::monotonic_ns();
  End ada(dialling(robot.lab, "ada", rt::Box::kOperator, robot.port()));
  ada.start();
  EXPECT_TRUE(wait_for([&] { return ada.ready(); })) << ada.link->fault();
  const double took_s = 1e-9 * static_cast<double>(rt::monotonic_ns() - from);
  std::printf("let in after %.2f s\n", took_s);
  EXPECT_LT(took_s, 5) << "a promise of 5 s would still hold";
  stop = true;
  squatter.join();
}

// ---- on the wire ----

// The operator dials through a socket that changes what passes.
struct OnTheWire {
  Robot robot;
  Proxy proxy{robot.port()};
  End ada{dialling(robot.lab, "ada", rt::Box::kOperator, proxy.port())};
};

TEST(Hostile, ChangedRepeatedAndLostRecordsEndTheSessionAndWorkGoesOn) {
  const std::function<void(Bytes&)> harms[] = {
      [](Bytes& b) { b.back() ^= 1U; },
      [](Bytes& b) {
        const Bytes once = b;
        b.insert(b.end(), once.begin(), once.end());
      },
      [](Bytes& b) { b.clear(); },
      [](Bytes& b) { b.resize(b.size() / 2); },
  };
  for (const auto& harm : harms) {
    OnTheWire w;
    std::atomic<bool> armed{false};
    w.proxy.change = [&](std::size_t before, Bytes& piece) {
      if (before > 3000 && armed.exchange(false)) harm(piece);
    };
    w.ada.talk();
    w.ada.start();
    ASSERT_TRUE(wait_for([&] { return w.ada.ready() && w.robot.end->ready(); }))
        << w.ada.link->fault();
    ASSERT_TRUE(w.robot.end->alive());
    const int bad_before = w.robot.end->faults;
    armed = true;
    ASSERT_TRUE(wait_for([&] { return w.robot.end->closed >= 1; }));
    EXPECT_TRUE(w.robot.says("a record was changed, repeated or left out"))
        << w.robot.end->link->fault();
    ASSERT_TRUE(wait_for([&] { return w.ada.link->sessions() >= 2 && w.ada.ready(); }));
    EXPECT_TRUE(w.robot.end->alive());
    EXPECT_EQ(w.robot.end->faults, bad_before) << "no harmed byte reached the link";
  }
}

TEST(Hostile, ARecordedSessionPlayedAgainIsNoSession) {
  OnTheWire w;
  Bytes recorded;
  std::mutex mutex;
  w.proxy.change = [&](std::size_t, Bytes& piece) {
    const std::lock_guard lock(mutex);
    recorded.insert(recorded.end(), piece.begin(), piece.end());
  };
  w.ada.talk();
  w.ada.start();
  ASSERT_TRUE(wait_for([&] { return w.ada.ready(); }));
  ASSERT_TRUE(w.robot.end->alive());
  w.ada.link->stop();
  ASSERT_TRUE(wait_for([&] { return w.robot.end->closed >= 1; }));
  const auto before = w.robot.end->link->counts().refused;
  const int fd = dial_plain(w.robot.port());
  {
    const std::lock_guard lock(mutex);
    (void)!::send(fd, recorded.data(), recorded.size(), MSG_NOSIGNAL);
  }
  EXPECT_TRUE(wait_for([&] { return w.robot.end->link->counts().refused > before; }));
  EXPECT_EQ(w.robot.end->link->sessions(), 1U);
  ::close(fd);
}

TEST(Hostile, NoPlainTextOnTheWire) {
  OnTheWire w;
  static constexpr char kMarker[] = "NO PLAIN TEXT ON THE WIRE";
  static drivers::EncodedFrame picture;
  picture.intrinsics = {.fx = 365, .fy = 365, .cx = 256, .cy = 212, .width = 512, .height = 424};
  picture.depth_size = 30000;
  for (std::size_t at = 0; at + sizeof kMarker < picture.depth_size; at += sizeof kMarker)
    std::memcpy(picture.bytes.data() + at, kMarker, sizeof kMarker);
  const int port = w.robot.port();
  w.robot.end.reset();  // another one, whose endpoint sends pictures
  auto options = listening(w.robot.lab, "rover", rt::Box::kRobot);
  options.port = port;
  End robot(options);
  robot.talk();
  robot.endpoint.add_outgoing(MessageId::kFrame, rt::Nanos{20'000'000}, true,
                              [](auto out) { return drivers::write_wire(picture, out); });
  const auto holds = [](std::span<const std::uint8_t> bytes, std::string_view text) {
    return std::search(bytes.begin(), bytes.end(), text.begin(), text.end()) != bytes.end();
  };
  std::atomic<int> pictures{0};
  w.ada.endpoint.add_incoming(MessageId::kFrame, [&](auto body, rt::Time) {
    pictures += holds(body, kMarker) ? 1 : 0;
    return true;
  });
  w.proxy.keep();
  w.ada.talk();
  robot.start();
  w.ada.start();
  ASSERT_TRUE(wait_for([&] { return pictures > 10 && w.ada.got > 20 && robot.got > 20; }))
      << w.ada.link->fault();
  w.ada.link->stop();  // before the robot, or it would dial a closed port
  const Bytes seen = w.proxy.seen();
  ASSERT_GT(seen.size(), 300'000U) << "the pictures went through there";
  // Words, the link's and the road's magic, names of the certificates.
  for (const std::string_view text :
       {std::string_view("PLAIN TEXT"), std::string_view("TLT1\x01\x00", 6),
        std::string_view("RD\x01\x01\x11\x00\x00\x00", 8), std::string_view("rover"),
        std::string_view("teletact"), std::string_view("operator")}) {
    EXPECT_FALSE(holds(seen, text)) << text;
  }
}

}  // namespace
