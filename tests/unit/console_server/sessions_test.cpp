// Who may do what, without a socket: codes, sessions, one operator.
#include "tools/console/console_sessions.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace {

using teletact::ConsoleRole;
using teletact::ConsoleSecret;
using teletact::ConsoleSessions;
using teletact::RoleEvent;
using teletact::secret_text;

constexpr std::int64_t kSecond = 1'000'000'000;

struct Desk {
  ConsoleSessions sessions{ConsoleSessions::Limits{}};
  std::int64_t now = 5 * kSecond;
  std::uint8_t count = 0;
  ConsoleSecret secret() {
    ConsoleSecret s{};
    s[0] = ++count;
    return s;
  }
  ConsoleSecret last;
  std::uint32_t join(bool view_only, std::uint32_t before = 0) {
    const ConsoleSecret code = secret();
    sessions.add_code(code, view_only, now);
    last = secret();
    return sessions.exchange(secret_text(code), before, last, "", now);
  }
  std::uint32_t here(bool view_only) {
    const std::uint32_t s = join(view_only);
    sessions.connected(s, now);
    return s;
  }
  ConsoleRole role(std::uint32_t s) const { return sessions.person(s).role; }
};

TEST(ConsoleSessionsTest, ACodeIsGoodOnceAndNotForEver) {
  Desk d;
  const ConsoleSecret code = d.secret();
  d.sessions.add_code(code, false, d.now);
  EXPECT_EQ(d.sessions.exchange("0000", 0, d.secret(), "", d.now), 0U);
  EXPECT_NE(d.sessions.exchange(secret_text(code), 0, d.secret(), "", d.now), 0U);
  EXPECT_EQ(d.sessions.exchange(secret_text(code), 0, d.secret(), "", d.now), 0U) << "used";
  const ConsoleSecret old = d.secret();
  d.sessions.add_code(old, false, d.now);
  d.now += 3601 * kSecond;
  EXPECT_EQ(d.sessions.exchange(secret_text(old), 0, d.secret(), "", d.now), 0U) << "expired";
}

TEST(ConsoleSessionsTest, OnlyTheNewestCodesOfASortAreGood) {
  Desk d;
  std::vector<ConsoleSecret> codes;
  const ConsoleSecret view = d.secret();
  d.sessions.add_code(view, true, d.now);
  for (std::size_t i = 0; i < ConsoleSessions::kMostCodes + 1; ++i) {
    codes.push_back(d.secret());
    d.sessions.add_code(codes.back(), false, d.now);
  }
  EXPECT_EQ(d.sessions.exchange(secret_text(codes[0]), 0, d.secret(), "", d.now), 0U);
  EXPECT_NE(d.sessions.exchange(secret_text(codes[1]), 0, d.secret(), "", d.now), 0U);
  EXPECT_NE(d.sessions.exchange(secret_text(view), 0, d.secret(), "", d.now), 0U);
}

TEST(ConsoleSessionsTest, ASecretFindsItsSessionUntilItEnds) {
  Desk d;
  const std::uint32_t s = d.join(false);
  EXPECT_EQ(d.sessions.find(secret_text(d.last), d.now), s);
  EXPECT_EQ(d.sessions.find("", d.now), 0U);
  EXPECT_EQ(d.sessions.find(secret_text(d.secret()), d.now), 0U);
  d.now += 13 * 3600 * kSecond;
  EXPECT_EQ(d.sessions.find(secret_text(d.last), d.now), 0U) << "12 h without a connection";
}

TEST(ConsoleSessionsTest, OneOperatorAndTheSecondLooksOn) {
  Desk d;
  const auto a = d.here(false), b = d.here(false), c = d.here(true);
  EXPECT_EQ(d.role(a), ConsoleRole::kOperator);
  EXPECT_EQ(d.role(b), ConsoleRole::kViewer);
  EXPECT_EQ(d.role(c), ConsoleRole::kViewer);
  EXPECT_NE(d.sessions.take(b, d.now), "");
  EXPECT_NE(d.sessions.give(a, d.now), "") << "nobody asks";
  EXPECT_NE(d.sessions.give(b, d.now), "");
  EXPECT_EQ(d.sessions.ask(b, d.now), "");
  EXPECT_NE(d.sessions.ask(c, d.now), "") << "b has asked before";
  EXPECT_EQ(d.sessions.give(a, d.now), "");
  EXPECT_EQ(d.role(a), ConsoleRole::kViewer);
  EXPECT_EQ(d.role(b), ConsoleRole::kOperator);
  const auto events = d.sessions.take_events();
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.back().kind, RoleEvent::Kind::kOperator);
  EXPECT_EQ(events.back().person.session, b);
  EXPECT_EQ(events.back().other.session, a);
  EXPECT_TRUE(d.sessions.take_events().empty());
}

TEST(ConsoleSessionsTest, TheRoleIsTakenFromOneWhoIsAwayOrSilent) {
  Desk d;
  const auto a = d.here(false), b = d.here(false), viewer = d.here(true);
  d.sessions.disconnected(a, d.now);
  EXPECT_NE(d.sessions.take(b, d.now + 1 * kSecond), "") << "a reload takes a second";
  EXPECT_NE(d.sessions.take(viewer, d.now + 9 * kSecond), "") << "a view link looks on";
  EXPECT_EQ(d.sessions.take(b, d.now + 4 * kSecond), "");
  EXPECT_EQ(d.role(b), ConsoleRole::kOperator);
  EXPECT_EQ(d.role(a), ConsoleRole::kViewer);
  // And now a asks, and is not answered.
  d.now += 10 * kSecond;
  d.sessions.connected(a, d.now);
  EXPECT_EQ(d.sessions.ask(a, d.now), "");
  EXPECT_NE(d.sessions.take(a, d.now + 9 * kSecond), "");
  EXPECT_EQ(d.sessions.ask(a, d.now + 9 * kSecond), "") << "asking again does not start anew";
  EXPECT_EQ(d.sessions.take(a, d.now + 10 * kSecond), "");
  EXPECT_EQ(d.role(a), ConsoleRole::kOperator);
}

TEST(ConsoleSessionsTest, WhoAskedAndLeftIsForgotten) {
  Desk d;
  const auto a = d.here(false), b = d.here(true), c = d.here(true);
  EXPECT_EQ(d.sessions.ask(b, d.now), "");
  d.sessions.disconnected(b, d.now);
  EXPECT_NE(d.sessions.give(a, d.now), "");
  EXPECT_EQ(d.sessions.ask(c, d.now), "");
  d.now += 61 * kSecond;
  EXPECT_NE(d.sessions.give(a, d.now), "") << "asked a minute ago";
  EXPECT_EQ(d.role(a), ConsoleRole::kOperator);
}

TEST(ConsoleSessionsTest, TheSameBrowserKeepsItsRole) {
  Desk d;
  const auto a = d.here(false);
  const auto again = d.join(false, a);
  EXPECT_EQ(d.role(again), ConsoleRole::kOperator);
  EXPECT_EQ(d.sessions.person(a).session, 0U);
  const auto by_link = d.join(true, again);
  EXPECT_EQ(d.role(by_link), ConsoleRole::kOperator) << "opened a view link of its own";
  EXPECT_FALSE(d.sessions.person(by_link).view_only);
}

TEST(ConsoleSessionsTest, SessionsAreBoundedAndTheOperatorStays) {
  Desk d;
  const auto a = d.join(false);
  for (int i = 0; i < 100; ++i) {
    d.now += kSecond;
    EXPECT_NE(d.join(true), 0U);
  }
  EXPECT_EQ(d.sessions.people().size(), ConsoleSessions::kMostSessions);
  EXPECT_EQ(d.role(a), ConsoleRole::kOperator);
  Desk full;
  for (std::size_t i = 0; i < ConsoleSessions::kMostSessions; ++i) EXPECT_NE(full.here(true), 0U);
  EXPECT_EQ(full.join(false), 0U) << "all are connected";
}

}  // namespace
