// A silence of the link that a held engage survives: of both ways, or of one alone.
#include <functional>

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
  for (const auto within : {1000ms, 300ms, 0ms}) {
    for (const auto silence : {100ms, 290ms, 320ms, 980ms, 1030ms}) {
      for (const auto absent : {0ms, 50ms, 2000ms}) {  // then a pause is told of
        SCOPED_TRACE(std::to_string(within.count()) + " ms are survived, " +
                     std::to_string(silence.count()) + " ms, absent for " +
                     std::to_string(absent.count()));
        SupervisionConfig config;
        config.resume_within_s = 1e-3 * static_cast<double>(within.count());
        Story s(Box::kRobot, {}, config);
        s.run(50ms);
        s.in.requests.engage = Engage::kAbsent;
        s.run(std::min(absent, silence));
        s.in.requests.engage = Engage::kPaused;
        if (silence > absent) s.run(silence - absent);
        EXPECT_EQ(s.mode(), Mode::kHold) << "neither is an act";
        s.in.requests.engage = Engage::kYes;
        s.run(10ms);
        EXPECT_EQ(s.mode(), silence < within ? Mode::kEngaged : Mode::kHold);
        s.run(1000ms);
        EXPECT_EQ(s.mode(), silence < within ? Mode::kEngaged : Mode::kHold);
      }
    }
  }
}

// A pause is no act: not without a release before it, not over another connection, not where
// anything but a silence lies between, and a console that is absent for a moment is the operator's
// own matter.
TEST(SupervisionResume, APauseEngagesNobody) {
  using Tell = std::function<void(Story&)>;
  struct Case {
    const char* name;
    Tell before, meanwhile;
    Box box = Box::kRobot;
  };
  const auto nothing = [](Story&) {};
  const auto never = [](Story& s) { s.in.requests.engage = Engage::kAbsent; };
  const auto used = [](Story& s) {
    s.run(50ms);
    s.in.requests.ramp_down = true;  // so the yes is not followed
    s.in.requests.engage = Engage::kYes;
    s.run(10ms);
    s.in.requests.ramp_down = false;
  };
  const auto other = [](Story& s) {
    s.in.link_session = 2;
    s.run(10ms);
  };
  const auto other_with_no = [&](Story& s) {  // the old goal's, in the very tick
    s.in.requests.engage = Engage::kNo;
    other(s);
    s.in.requests.engage = Engage::kPaused;
    s.run(10ms);
  };
  const auto closed = [](Story& s) {
    s.in.requests.engage = Engage::kNo;
    s.in.link_closed = true;
    s.run(100ms);
    s.in.requests.engage = Engage::kPaused;
    s.run(10ms);
    s.in.link_closed = false;
  };
  const auto fault = [](Story& s) {
    s.in.tasks[0].health = rt::Health::of(Severity::kRampDown, 103);
    s.run(10ms);
    s.in.tasks[0].health = rt::Health::ok();
  };
  const auto fault_unheard = [&](Story& s) {  // the line is silent, the last goal still says no
    s.in.requests.engage = Engage::kNo;
    s.link_up = false;
    s.run(300ms);
    fault(s);
    s.run(100ms);
    s.in.requests.engage = Engage::kPaused;
    s.link_up = true;
  };
  const auto too_long = [](Story& s) {
    s.in.requests.engage = Engage::kNo;
    s.link_up = false;
    s.run(1500ms);
    s.in.requests.engage = Engage::kPaused;
    s.link_up = true;
  };
  const auto stop = [](Story& s) {
    s.in.estop_closed = false;
    s.run(10ms);
    s.in.estop_closed = true;
    s.clear();
  };
  for (const Case& c :
       {Case{"no release", never, nothing}, Case{"used", used, nothing},
        Case{"another connection", nothing, other},
        Case{"another connection, an old no", nothing, other_with_no},
        Case{"closed", nothing, closed}, Case{"a fault", nothing, fault},
        Case{"a fault in a silence", nothing, fault_unheard},
        Case{"a long silence", nothing, too_long}, Case{"a safe stop", nothing, stop},
        Case{"the operator's box", nothing, nothing, Box::kOperator}}) {
    SCOPED_TRACE(c.name);
    Story s(c.box);
    s.in.link_session = 1;
    c.before(s);
    s.run(50ms);
    s.in.requests.engage = c.box == Box::kOperator ? Engage::kAbsent : Engage::kPaused;
    s.run(50ms);
    c.meanwhile(s);
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
