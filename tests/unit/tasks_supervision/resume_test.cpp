// A silence of the link that a held engage survives: of both ways, or of one alone.
#include "tests/unit/tasks_supervision/story.hpp"

namespace tests {
namespace {

TEST(SupervisionResume, AHeldEngageSurvivesASilenceOfLessThanASecond) {  // F-SUP-02
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    for (const auto silence : {200ms, 300ms, 500ms, 900ms}) {
      Story s(box);
      s.engaged();
      s.link_up = false;
      s.run(180ms);
      EXPECT_EQ(s.mode(), Mode::kRampDown) << "outputs go to zero as ever";
      EXPECT_TRUE(s.out.mode.resumes);
      s.run(silence - 180ms);
      EXPECT_NE(s.mode(), Mode::kEngaged);
      EXPECT_TRUE(s.out.mode.resumes);
      s.link_up = true;
      s.run(200ms);  // not before the ramp is over
      EXPECT_EQ(s.mode(), Mode::kEngaged) << silence.count();
      EXPECT_FALSE(s.out.mode.resumes);
      EXPECT_EQ(s.out.mode.cause, rt::kNoFault);
      s.run(3000ms);
      EXPECT_EQ(s.mode(), Mode::kEngaged);
      EXPECT_EQ(s.task.count(tasks::kFaultLinkSilent), 1U) << "it was told";
      EXPECT_EQ(s.task.count(tasks::kFaultPeerNotEngaged), 0U);
    }
  }
}

TEST(SupervisionResume, ALongerSilenceDemandsAnAct) {
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    Story s(box);
    s.engaged();
    s.link_up = false;
    s.run(1100ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    EXPECT_FALSE(s.out.mode.resumes);
    s.link_up = true;
    s.run(5000ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.engage();
    EXPECT_EQ(s.mode(), Mode::kEngaged);
  }
}

// What ends it for good while the link is silent; and not even a link that is back in time, or the
// engage pressed and held, starts motion then without a new act.
TEST(SupervisionResume, WhateverElseHappensDemandsAnAct) {
  using Meddle = void (*)(Story&);
  struct Case {
    const char* what;
    Meddle happens, over;
  };
  const Case cases[] = {
      {"let go", [](Story& s) { s.in.requests.engage = Engage::kNo; }, [](Story&) {}},
      {"the connection ended", [](Story& s) { s.in.link_closed = true; },
       [](Story& s) { s.in.link_closed = false; }},
      {"another connection", [](Story& s) { s.in.link_session = 2; }, [](Story&) {}},
      {"ramp down asked for", [](Story& s) { s.in.requests.ramp_down = true; },
       [](Story& s) { s.in.requests.ramp_down = false; }},
      {"a task fell silent", [](Story& s) { s.silent[1] = true; },
       [](Story& s) { s.silent[1] = false; }},
  };
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    for (const Case& c : cases) {
      SCOPED_TRACE(c.what);
      Story s(box);
      s.in.link_session = 1;
      s.engaged();
      s.link_up = false;
      s.run(200ms);
      ASSERT_TRUE(s.out.mode.resumes);
      c.happens(s);
      s.run(400ms);
      EXPECT_FALSE(s.out.mode.resumes);
      c.over(s);
      s.link_up = true;
      s.run(30ms);
      EXPECT_NE(s.mode(), Mode::kEngaged);
      if (s.in.requests.engage == Engage::kYes) {
        s.run(3000ms);
        EXPECT_EQ(s.mode(), Mode::kHold);
      }
      s.run(300ms).engage();
      EXPECT_EQ(s.mode(), Mode::kEngaged);
    }
  }
}

// A ramp down for another cause is none of its business, also where the link falls silent
// afterwards.
TEST(SupervisionResume, OnlyASilenceResumes) {
  Story s;
  s.engaged();
  s.in.requests.ramp_down = true;
  s.run(20ms);
  s.in.requests.ramp_down = false;
  s.link_up = false;
  s.run(300ms);
  EXPECT_FALSE(s.out.mode.resumes);
  s.link_up = true;
  s.run(2000ms);
  EXPECT_EQ(s.mode(), Mode::kHold);
}

// The robot's box may have no goal of its own time yet when the line is back: it waits for one.
TEST(SupervisionResume, TheRobotWaitsForAGoalThatStillAsks) {
  Story s(Box::kRobot);
  s.engaged();
  s.link_up = false;
  s.run(400ms);
  s.in.requests.engage = Engage::kAbsent;
  s.link_up = true;
  s.run(100ms);
  EXPECT_EQ(s.mode(), Mode::kHold);
  EXPECT_TRUE(s.out.mode.resumes);
  s.in.requests.engage = Engage::kYes;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged);
}

// Only one direction is silent: the operator's box pauses, and the robot's, which hears it, goes
// out of the engaged mode with it and comes back with it.
TEST(SupervisionResume, TheRobotPausesWithTheOperator) {  // F-SUP-06
  for (const auto pause : {100ms, 500ms, 900ms}) {
    Story s(Box::kRobot);
    s.engaged();
    s.in.requests.engage = Engage::kPaused;
    s.run(10ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultEngageWithdrawn);
    s.run(pause - 10ms);
    EXPECT_NE(s.mode(), Mode::kEngaged);
    s.in.requests.engage = Engage::kYes;
    s.run(200ms);  // not before the ramp is over
    EXPECT_EQ(s.mode(), Mode::kEngaged) << pause.count();
  }
  for (const Engage then : {Engage::kNo, Engage::kPaused}) {
    Story s(Box::kRobot);
    s.engaged();
    s.in.requests.engage = Engage::kPaused;
    s.run(300ms);
    s.in.requests.engage = then;
    s.run(then == Engage::kNo ? 10ms : 1200ms);
    EXPECT_FALSE(s.out.mode.resumes);
    const Engage before = s.in.requests.engage;
    s.in.requests.engage = Engage::kYes;
    s.run(1000ms);
    EXPECT_EQ(s.mode(), before == Engage::kNo ? Mode::kEngaged : Mode::kHold)
        << "a yes after a no is an act; after a pause that was too long it is none";
  }
}

// The robot's box may hear of the act through a pause only, or after a while without a goal in time:
// the operator's box has engaged since its "no", and a silence has interrupted it at once.
TEST(SupervisionResume, ASilenceMayLieBetweenTheReleaseAndTheAct) {  // F-SUP-04
  for (const Engage between : {Engage::kPaused, Engage::kAbsent}) {
    for (const auto pause : {100ms, 900ms, 1100ms}) {
      Story s(Box::kRobot);
      s.run(50ms);
      s.in.requests.engage = between;
      s.run(pause);
      EXPECT_EQ(s.mode(), Mode::kHold) << "neither is an act";
      s.in.requests.engage = Engage::kYes;
      s.run(10ms);
      EXPECT_EQ(s.mode(), pause < 1s ? Mode::kEngaged : Mode::kHold) << pause.count();
      s.run(1000ms);
      EXPECT_EQ(s.mode(), pause < 1s ? Mode::kEngaged : Mode::kHold) << pause.count();
    }
  }
}

// A pause is no act: not without a release before it, not over another connection, and a console
// that is absent for a moment is the operator's own matter.
TEST(SupervisionResume, APauseEngagesNobody) {
  enum class Before { kNeverReleased, kUsed, kOtherConnection, kClosed, kOperator };
  for (const Before before : {Before::kNeverReleased, Before::kUsed, Before::kOtherConnection,
                              Before::kClosed, Before::kOperator}) {
    SCOPED_TRACE(static_cast<int>(before));
    Story s(before == Before::kOperator ? Box::kOperator : Box::kRobot);
    s.in.link_session = 1;
    if (before == Before::kNeverReleased) s.in.requests.engage = Engage::kAbsent;
    s.run(50ms);
    if (before == Before::kUsed) {
      s.in.requests.ramp_down = true;  // so the yes is not followed
      s.in.requests.engage = Engage::kYes;
      s.run(10ms);
      s.in.requests.ramp_down = false;
    }
    s.in.requests.engage = before == Before::kOperator ? Engage::kAbsent : Engage::kPaused;
    s.run(50ms);
    if (before == Before::kOtherConnection) s.in.link_session = 2;
    if (before == Before::kClosed) s.in.link_closed = true;
    s.run(10ms);
    s.in.link_closed = false;
    s.run(40ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.in.requests.engage = Engage::kYes;
    s.run(1000ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
  }
}

// The first states behind a stall were made before the robot noticed it: they still say "engaged".
TEST(SupervisionResume, StatesThatASilenceHeldUpAreNoAnswer) {  // F-SUP-04
  Story s;
  s.engaged();
  const rt::Time before = s.tick.start;
  s.peer_follows = false;
  s.link_up = false;
  s.run(300ms);
  s.link_up = true;
  s.in.peer_mode = Mode::kEngaged;
  s.in.peer_mode_at = before;
  s.run(100ms);
  ASSERT_EQ(s.mode(), Mode::kEngaged);
  s.in.peer_mode = Mode::kRampDown;
  s.in.peer_mode_at = s.tick.start - 90ms;
  s.run(100ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged) << "it has its grace";
  s.in.peer_mode = Mode::kEngaged;
  s.in.peer_mode_at = s.tick.start;
  s.run(50ms);
  s.in.peer_mode = Mode::kHold;
  s.run(20ms);
  EXPECT_EQ(s.mode(), Mode::kRampDown) << "it had followed, and left";
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultPeerNotEngaged);
}

// Goals alone were lost: the robot pauses, the operator's box has heard it all the time. It ramps
// down with it, and both go on.
TEST(SupervisionResume, TheOperatorPausesWithTheRobot) {  // F-SUP-04
  for (const auto pause : {100ms, 500ms, 900ms}) {
    Story s;
    s.engaged();
    s.run(100ms);
    s.robot_says(Mode::kRampDown, Pause::kSilent).run(10ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown) << "the hand goes limp with it";
    EXPECT_TRUE(s.out.mode.resumes);
    s.run(pause - 10ms);
    EXPECT_NE(s.mode(), Mode::kEngaged) << "not while it hears nothing";
    s.robot_says(Mode::kHold, Pause::kHears).run(220ms);
    EXPECT_EQ(s.mode(), Mode::kEngaged) << pause.count();
    s.robot_says(Mode::kEngaged).run(50ms);
    EXPECT_EQ(s.mode(), Mode::kEngaged) << pause.count();
    s.robot_says(Mode::kHold).run(20ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown) << "it left for another reason";
    EXPECT_FALSE(s.out.mode.resumes);
  }
}

// The news of a silence that is over already.
TEST(SupervisionResume, TheOperatorWaitsForARobotThatHearsAgain) {  // F-SUP-04
  Story s;
  s.engaged();
  s.run(100ms);
  s.robot_says(Mode::kRampDown, Pause::kHears).run(300ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged);
  s.run(950ms);
  EXPECT_EQ(s.mode(), Mode::kRampDown) << "not for ever";
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultPeerNotEngaged);
}

TEST(SupervisionResume, ARobotThatPausesNoLongerDemandsAnAct) {  // F-SUP-04
  for (const bool too_long : {true, false}) {
    Story s;
    s.engaged();
    s.run(100ms);
    s.robot_says(Mode::kHold, Pause::kSilent).run(too_long ? 1250ms : 300ms);
    s.robot_says(Mode::kHold, too_long ? Pause::kHears : Pause::kNone);
    for (int i = 0; i < 150; ++i) {
      s.run(10ms);
      EXPECT_NE(s.mode(), Mode::kEngaged);
    }
    EXPECT_EQ(s.mode(), Mode::kHold);
    EXPECT_FALSE(s.out.mode.resumes);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultPeerNotEngaged);
  }
}

// A robot that does not go on is noticed as one that does not follow.
TEST(SupervisionResume, ThePeerHasItsGraceAgain) {  // F-SUP-04
  Story s;
  s.engaged();
  s.link_up = false;
  s.run(300ms);
  s.peer_follows = false;
  s.in.peer_mode = Mode::kHold;
  s.link_up = true;
  s.run(500ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged);
  s.run(600ms);
  EXPECT_EQ(s.mode(), Mode::kRampDown);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultPeerNotEngaged);
}

}  // namespace
}  // namespace tests
