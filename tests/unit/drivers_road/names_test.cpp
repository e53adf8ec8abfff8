// Host names that are dialled: name servers that are slow, dead, or know no such name.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/unit/drivers_road/support.hpp"

namespace {

using namespace road_test;
using testing::HasSubstr;
using Addresses = rt::Result<std::vector<std::string>>;

// A name server that answers when it is let.
struct Slow {
  std::atomic<int> asked{0};
  std::atomic<bool> open{false};
};

drivers::RoadOptions by_name(const Lab& lab, int port, drivers::RoadLookup lookup) {
  auto options = dialling(lab, "ada", rt::Box::kOperator, port);
  options.address = "robot.lab";
  options.lookup = std::move(lookup);
  return options;
}

drivers::RoadLookup by(const std::shared_ptr<Slow>& slow) {
  return [slow](const std::string& host) -> Addresses {
    EXPECT_EQ(host, "robot.lab");
    ++slow->asked;
    wait_for([&] { return slow->open.load(); });
    return std::vector<std::string>{"127.0.0.1"};
  };
}

TEST(Names, AnEndDoesNotWaitForThem) {
  Lab lab;
  auto slow = std::make_shared<Slow>();
  auto op = std::make_unique<End>(by_name(lab, 47110, by(slow)));
  op->start();
  ASSERT_TRUE(wait_for([&] { return slow->asked == 1; }));
  const std::int64_t from = rt::monotonic_ns();
  op.reset();
  EXPECT_LT(1e-9 * static_cast<double>(rt::monotonic_ns() - from), 5) << "a service has 10 s";
  slow->open = true;
  EXPECT_TRUE(wait_for([&] { return slow.use_count() == 1; })) << "the look-up ends by itself";
}

TEST(Names, ALateAnswerIsOfUseToALaterAttempt) {
  Lab lab;
  End robot(listening(lab, "rover", rt::Box::kRobot));
  robot.start();
  auto slow = std::make_shared<Slow>();
  auto options = by_name(lab, robot.link->port(), by(slow));
  options.handshake_limit = std::chrono::seconds{1};
  End op(options);
  op.start();
  ASSERT_TRUE(wait_for([&] { return op.link->counts().failed >= 2; }));
  EXPECT_THAT(op.link->fault(), HasSubstr("no name server has answered in time"));
  EXPECT_EQ(slow->asked, 1) << "one at a time";
  slow->open = true;
  EXPECT_TRUE(wait_for([&] { return op.ready(); })) << op.link->fault();
}

TEST(Names, WhatIsWrongIsTold) {
  Lab lab;
  const std::pair<Addresses, const char*> cases[] = {
      {rt::Error{"Name or service not known"}, "robot.lab:47110: Name or service not known"},
      {std::vector<std::string>{}, "robot.lab:47110: the name has no address"},
  };
  for (const auto& [answer, words] : cases) {
    End op(by_name(lab, 47110, [a = answer](const std::string&) { return a; }));
    op.start();
    ASSERT_TRUE(wait_for([&] { return op.link->counts().failed > 0; }));
    EXPECT_THAT(op.link->fault(), HasSubstr(words));
  }
}

// Takes connections into a queue that is full: what else is sent to it is lost without a word.
struct DeafHost {
  int listener = -1;
  std::vector<int> queued;
  DeafHost(const char* address, int port) {
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(static_cast<std::uint16_t>(port));
    inet_pton(AF_INET, address, &at.sin_addr);
    const auto* where = reinterpret_cast<const sockaddr*>(&at);
    listener = socket(AF_INET, SOCK_STREAM, 0);
    EXPECT_EQ(bind(listener, where, sizeof at), 0);
    EXPECT_EQ(listen(listener, 0), 0);
    for (int i = 0; i < 4; ++i) {
      queued.push_back(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0));
      static_cast<void>(connect(queued.back(), where, sizeof at));
    }
  }
  ~DeafHost() {
    for (const int fd : queued) close(fd);
    close(listener);
  }
  DeafHost(const DeafHost&) = delete;
  DeafHost& operator=(const DeafHost&) = delete;
};

TEST(Names, AnAddressThatNeverAnswersDoesNotHideTheNext) {
  Lab lab;
  End robot(listening(lab, "rover", rt::Box::kRobot));
  robot.start();
  const DeafHost deaf("127.0.0.2", robot.link->port());
  auto options = by_name(lab, robot.link->port(), [](const std::string&) -> Addresses {
    return std::vector<std::string>{"127.0.0.2", "127.0.0.1"};
  });
  options.handshake_limit = std::chrono::seconds{1};
  End op(options);
  op.start();
  EXPECT_TRUE(wait_for([&] { return op.ready(); })) << op.link->fault();
  EXPECT_GE(op.link->counts().failed, 1U) << "the first one was tried";
}

// The system's own, with a text that it takes for an address without asking anybody.
TEST(Names, TheSystemAnswers) {
  Lab lab;
  End robot(listening(lab, "rover", rt::Box::kRobot));
  robot.start();
  auto options = dialling(lab, "ada", rt::Box::kOperator, robot.link->port());
  options.address = "127.1";
  End op(options);
  op.start();
  EXPECT_TRUE(wait_for([&] { return op.ready(); })) << op.link->fault();
}

}  // namespace
