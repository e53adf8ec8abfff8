// Which goals the robot's box takes: each rule alone, and random roads against a slow oracle.
#include "drivers/link/command_gate.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>
#include <vector>

#include "rt/random.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::CommandFault;
using drivers::CommandGate;
using drivers::RobotGoal;

rt::Time at(std::int64_t ms) { return rt::time_from_ns(10'000'000'000 + ms * 1'000'000); }

RobotGoal goal(std::uint64_t seq, std::int64_t made_ms, std::int64_t life_ms = 400) {
  RobotGoal g;
  g.seq = seq;
  g.made = at(made_ms);
  g.valid_until = at(made_ms + life_ms);
  g.x_m = 1;
  g.speed_limit_m_per_s = 0.5;
  g.engaged = g.operator_engaged = 1;
  return g;
}

std::uint64_t count(const CommandGate& gate, CommandFault f) {
  return gate.report().counts[static_cast<std::size_t>(f)];
}

TEST(CommandGate, TakesWhatComesInOrderAndInTime) {
  CommandGate gate;
  std::uint64_t message = 0;
  // Each goal goes out twice; that is no replay of a message.
  for (std::uint64_t n = 1; n <= 50; ++n) {
    const auto made = static_cast<std::int64_t>(100 * n);
    EXPECT_EQ(gate.judge(goal(n, made), ++message, at(made + 90), 5ms), CommandFault::kNone);
    EXPECT_EQ(gate.judge(goal(n, made), ++message, at(made + 140), 5ms), CommandFault::kNone);
  }
  EXPECT_EQ(gate.report().all(), 0U);
  EXPECT_EQ(gate.report().newest, 0);
}

TEST(CommandGate, AReplayedMessageIsRefused) {
  CommandGate gate;
  ASSERT_EQ(gate.judge(goal(5, 0), 7, at(50), 0ms), CommandFault::kNone);
  for (const std::uint64_t again : {7, 6, 1, 0})
    EXPECT_EQ(gate.judge(goal(5, 0), again, at(60), 0ms), CommandFault::kReplayed);
  EXPECT_EQ(gate.judge(goal(6, 50), 7, at(60), 0ms), CommandFault::kReplayed)
      << "a number that was used, whatever it brings now";
  EXPECT_EQ(count(gate, CommandFault::kReplayed), 5U);
  EXPECT_EQ(gate.judge(goal(6, 50), 8, at(60), 0ms), CommandFault::kNone);
}

TEST(CommandGate, AnOlderGoalUnderANewNumberIsRefused) {
  CommandGate gate;
  ASSERT_EQ(gate.judge(goal(5, 100), 1, at(150), 1ms), CommandFault::kNone);
  EXPECT_EQ(gate.judge(goal(4, 100), 2, at(160), 1ms), CommandFault::kReordered);
  EXPECT_EQ(gate.judge(goal(6, 90), 3, at(160), 1ms), CommandFault::kReordered);
  EXPECT_EQ(gate.judge(goal(6, 200), 4, at(210), 1ms), CommandFault::kNone);
  EXPECT_EQ(count(gate, CommandFault::kReordered), 2U);
}

// Of a refused one nothing is remembered: it can not push good ones out.
TEST(CommandGate, ARefusedGoalLeavesNoTrace) {
  CommandGate gate;
  ASSERT_EQ(gate.judge(goal(1, 0), 1, at(10), 0ms), CommandFault::kNone);
  EXPECT_EQ(gate.judge(goal(1'000'000, 500'000), 1'000'000, at(20), 0ms), CommandFault::kFromAhead);
  RobotGoal wide = goal(2'000'000, 15);
  wide.x_m = 1e5;
  EXPECT_EQ(gate.judge(wide, 2'000'000, at(20), 0ms), CommandFault::kOutOfRange);
  EXPECT_EQ(gate.judge(goal(2, 15), 2, at(20), 0ms), CommandFault::kNone);
}

TEST(CommandGate, LateIsWhatIsNoLongerValidBeyondDoubt) {
  CommandGate gate;
  EXPECT_EQ(gate.judge(goal(1, 0), 1, at(395), 5ms), CommandFault::kNone);
  EXPECT_EQ(gate.judge(goal(1, 0), 2, at(396), 5ms), CommandFault::kLate);
  EXPECT_EQ(gate.judge(goal(2, 100), 3, at(5000), 0ms), CommandFault::kLate);
  EXPECT_EQ(gate.report().newest, static_cast<std::uint8_t>(CommandFault::kLate));
  EXPECT_EQ(gate.judge(goal(3, 4990), 4, at(5000), 0ms), CommandFault::kNone);
  EXPECT_EQ(gate.judge(goal(2, 100), 5, at(5000), 0ms), CommandFault::kReordered)
      << "late ones count for the order";
}

TEST(CommandGate, FromAheadBeyondWhatTheClocksAllow) {
  CommandGate gate;
  EXPECT_EQ(gate.judge(goal(1, 55), 1, at(0), 5ms), CommandFault::kNone);
  EXPECT_EQ(gate.judge(goal(2, 56), 2, at(0), 5ms), CommandFault::kFromAhead);
}

TEST(CommandGate, EachFieldHasItsRange) {
  const double kNaN = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](auto change) {
    CommandGate gate;
    RobotGoal g = goal(1, 0);
    change(g);
    return gate.judge(g, 1, at(10), 0ms) == CommandFault::kOutOfRange;
  };
  for (const double v : {10001.0, -10001.0, kNaN, 1e300}) {
    EXPECT_TRUE(refused([v](RobotGoal& g) { g.x_m = v; }));
    EXPECT_TRUE(refused([v](RobotGoal& g) { g.y_m = v; }));
    EXPECT_TRUE(refused([v](RobotGoal& g) { g.yaw_rad = v; }));
    EXPECT_TRUE(refused([v](RobotGoal& g) { g.vx = v; }));
    EXPECT_TRUE(refused([v](RobotGoal& g) { g.vy = v; }));
    EXPECT_TRUE(refused([v](RobotGoal& g) { g.wz = v; }));
    EXPECT_TRUE(refused([v](RobotGoal& g) { g.speed_limit_m_per_s = v; }));
  }
  EXPECT_TRUE(refused([](RobotGoal& g) { g.speed_limit_m_per_s = -0.1; }));
  EXPECT_TRUE(refused([](RobotGoal& g) { g.valid_until = g.made - 1ms; }));
  EXPECT_TRUE(refused([](RobotGoal& g) { g.valid_until = g.made + 5001ms; }));
  EXPECT_FALSE(refused([](RobotGoal& g) { g.valid_until = g.made + 5000ms; }));
  EXPECT_FALSE(refused([](RobotGoal& g) { g.x_m = g.y_m = -10000; }));
}

TEST(CommandGate, AnotherConnectionBeginsAnewAndKeepsTheCounts) {
  CommandGate gate;
  ASSERT_EQ(gate.judge(goal(900, 1000), 800, at(1010), 0ms), CommandFault::kNone);
  ASSERT_EQ(gate.judge(goal(900, 1000), 800, at(1010), 0ms), CommandFault::kReplayed);
  gate.renew();
  EXPECT_EQ(gate.judge(goal(1, 1100), 1, at(1110), 0ms), CommandFault::kNone);
  EXPECT_EQ(gate.report().all(), 1U);
}

// A road that delays, drops, repeats and reorders: what is taken to be followed comes in order,
// each message once, and none past its validity; and nothing else is refused.
TEST(CommandGate, RandomRoads) {
  constexpr std::uint64_t kSeed = 20110;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  struct Copy {
    std::int64_t arrives, made;
    std::uint64_t message;
  };
  for (int run = 0; run < 300; ++run) {
    std::vector<Copy> road;
    for (std::uint64_t n = 1; n <= 60; ++n) {
      const auto made = static_cast<std::int64_t>(50 * n);
      for (std::int64_t copies = r.integer(0, 5) == 0 ? 3 : 1; copies > 0; --copies)
        road.push_back({made + r.integer(5, r.integer(0, 3) == 0 ? 900 : 60), made, n});
    }
    std::stable_sort(road.begin(), road.end(),
                     [](const Copy& a, const Copy& b) { return a.arrives < b.arrives; });
    CommandGate gate;
    std::set<std::uint64_t> seen;
    for (const Copy& c : road) {
      const auto fault = gate.judge(goal(c.message, c.made), c.message, at(c.arrives), 3ms);
      const bool newer = seen.empty() || c.message > *seen.rbegin();
      const bool in_time = c.arrives + 3 <= c.made + 400;
      ASSERT_EQ(fault == CommandFault::kNone, newer && in_time);
      ASSERT_EQ(fault == CommandFault::kLate, newer && !in_time);
      if (newer) seen.insert(c.message);
    }
  }
}

}  // namespace
