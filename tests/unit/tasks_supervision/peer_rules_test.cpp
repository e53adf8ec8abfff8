// What the other box's messages say, case by case.
#include "tasks/supervision/peer_rules.hpp"

#include <gtest/gtest.h>

namespace {

using namespace std::chrono_literals;
using tasks::asked_by_goal;
using tasks::GoalAsks;
using tasks::link_heard_with_state;
using tasks::Mode;
using Engage = tasks::SupervisionTask::Engage;
using Clear = tasks::SupervisionTask::Clear;

rt::Time at_ms(int ms) { return rt::time_from_ns(1'000'000LL * ms); }

TEST(PeerRules, TheLinkIsHeardWhenLineAndStateAre) {
  // Whichever is older counts.
  EXPECT_EQ(link_heard_with_state(at_ms(900), at_ms(950), false, at_ms(1000), 100ms), at_ms(900));
  EXPECT_EQ(link_heard_with_state(at_ms(950), at_ms(300), false, at_ms(1000), 100ms), at_ms(300));
}

TEST(PeerRules, AnOldStateIsSilenceThatTheLivenessSees) {
  EXPECT_EQ(link_heard_with_state(at_ms(999), at_ms(999), true, at_ms(1000), 100ms), at_ms(800));
  // A line that is silent for longer stays so.
  EXPECT_EQ(link_heard_with_state(at_ms(500), at_ms(999), true, at_ms(1000), 100ms), at_ms(500));
}

TEST(PeerRules, WithoutAGoalNothingIsAskedAndNothingReleased) {
  const auto asked = asked_by_goal(std::nullopt);
  EXPECT_EQ(asked.engage, Engage::kAbsent);
  EXPECT_EQ(asked.clear, Clear::kAbsent);
  EXPECT_EQ(asked.peer_mode, Mode::kHold);
}

TEST(PeerRules, AGoalAsksWhatItSays) {
  constexpr Engage kAsked[] = {Engage::kNo, Engage::kYes, Engage::kPaused};
  for (const int engaged : {0, 1, 2}) {
    for (const bool clear : {false, true}) {
      const auto asked = asked_by_goal(GoalAsks{engaged, clear});
      EXPECT_EQ(asked.engage, kAsked[engaged]);
      EXPECT_EQ(asked.clear, clear ? Clear::kYes : Clear::kNo);
      EXPECT_EQ(asked.peer_mode, engaged == 1 ? Mode::kEngaged : Mode::kHold);
    }
  }
}

}  // namespace
