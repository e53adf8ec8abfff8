// Stories: what the boxes do, tick by tick, when something happens. One for every fault of the
// table.
#include "tasks/supervision/supervision_task.hpp"

#include <gtest/gtest.h>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace std::chrono_literals;
using rt::Box;
using rt::Severity;
using tasks::ClearRule;
using tasks::kFaultTable;
using tasks::Mode;
using tasks::SupervisionConfig;
using tasks::SupervisionTask;
using Engage = SupervisionTask::Engage;
using Pause = SupervisionTask::Pause;
using Clear = SupervisionTask::Clear;

rt::Startup startup;

// A box whose world is fine unless the story says otherwise.
struct Story {
  std::array<tasks::Watch, 2> watches{{{190, 50ms}, {390, 300ms}}};
  SupervisionTask task;
  SupervisionTask::In in;
  SupervisionTask::Out out;
  rt::Tick tick;
  std::array<bool, 2> silent{};
  bool link_up = true;
  bool estop_sampled = true;
  bool peer_follows = true;

  explicit Story(Box box = Box::kOperator, const rt::ModeGate& gate = {},
                 const SupervisionConfig& config = {})
      : task(startup.token(), config, box, watches.data(), 2, gate) {
    tick.start = rt::time_from_ns(5'000'000'000);
    in.link_expected = true;
    in.estop_fitted = true;
    in.requests.engage = Engage::kNo;
    in.requests.clear = Clear::kNo;
    in.tasks[0].heard = in.tasks[1].heard = true;
  }
  Story& run(std::chrono::milliseconds time) {
    for (auto t = 0ms; t < time; t += 10ms) {
      tick.start += 10ms;
      ++tick.k;
      for (std::size_t i = 0; i < 2; ++i) {
        if (!silent[i]) in.tasks[i].heartbeat = tick.start - 1ms;
      }
      if (link_up) in.link_heard = true, in.link_last = tick.start - 20ms;
      if (estop_sampled) in.estop_sampled = tick.start;
      const Severity before = out.episode.severity;
      const Mode mode_before = out.mode.mode;
      rt_guard::reset();
      {
        rt::Section s;
        (void)task.step(tick, in, out);
      }
      EXPECT_EQ(rt_guard::counts().total(), 0U);
      EXPECT_EQ(out.mode.seq, tick.k);
      if (out.mode.mode == mode_before) {
        EXPECT_GE(out.episode.severity, before) << "severity only grows within an episode";
      }
      if (peer_follows) {
        in.peer_mode = out.mode.mode == Mode::kEngaged ? Mode::kEngaged : Mode::kHold;
        in.peer_mode_at = tick.start;
      }
    }
    return *this;
  }
  Story& engage() {
    in.requests.engage = Engage::kNo;
    run(10ms);
    in.requests.engage = Engage::kYes;
    return run(10ms);
  }
  Story& clear() {
    in.requests.clear = Clear::kNo;
    run(10ms);
    in.requests.clear = Clear::kYes;
    run(10ms);
    in.requests.clear = Clear::kNo;
    return *this;
  }
  Story& engaged() {
    run(20ms).engage();
    EXPECT_EQ(mode(), Mode::kEngaged);
    return run(50ms);
  }
  Mode mode() const { return out.mode.mode; }
};

TEST(Supervision, InitHoldEngageAndNothingByItself) {
  Story s;
  s.in.tasks[1].heard = false;
  s.run(500ms);
  EXPECT_EQ(s.mode(), Mode::kInit) << "one task has not been heard";
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kInit);
  EXPECT_TRUE(s.out.engage_refused);
  s.in.tasks[1].heard = true;
  s.run(2000ms);
  EXPECT_EQ(s.mode(), Mode::kHold) << "a switch that was on all the time starts nothing";
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kEngaged);
  s.run(60000ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged);
  EXPECT_EQ(s.out.episode.severity, Severity::kOk);
}

// The admission has closed the way into the engaged mode: every other mode is entered as ever.
TEST(Supervision, NoEngageWhereTheHostHasNoRoomForIt) {
  rt::ModeGate gate;
  gate.set(static_cast<std::size_t>(Mode::kHold), static_cast<std::size_t>(Mode::kEngaged), false);
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    Story s(box, gate);
    s.run(50ms).engage();
    EXPECT_EQ(s.mode(), Mode::kHold);
    EXPECT_TRUE(s.out.engage_refused);
    EXPECT_EQ(s.task.count(tasks::kFaultNoRoom), 1U);
    EXPECT_EQ(s.out.now.fault, tasks::kFaultNoRoom);
    s.run(100ms);
    EXPECT_EQ(s.task.count(tasks::kFaultNoRoom), 1U) << "one wish, counted once";
    s.in.requests.stop = true;
    s.run(20ms);
    EXPECT_EQ(s.mode(), Mode::kSafeStop);
    s.in.requests.stop = false;
    s.in.requests.engage = Engage::kNo;
    s.run(20ms).clear();
    EXPECT_EQ(s.mode(), Mode::kHold);
  }
}

TEST(Supervision, AnEngageMustBeSeenAsNoFirst) {
  Story s(Box::kRobot);
  s.in.requests.engage = Engage::kYes;
  s.run(1000ms);
  EXPECT_EQ(s.mode(), Mode::kHold);
  s.in.requests.engage = Engage::kAbsent;
  s.run(100ms);
  s.in.requests.engage = Engage::kYes;
  s.run(100ms);
  EXPECT_EQ(s.mode(), Mode::kHold) << "a goal that comes back is no act";
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kEngaged);
}

TEST(Supervision, NoEngageWithoutALink) {
  Story s;
  s.link_up = false;
  s.run(100ms);
  EXPECT_EQ(s.mode(), Mode::kHold) << "hold needs no link";
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kHold);
  EXPECT_TRUE(s.out.engage_refused);
}

TEST(Supervision, LinkSilentRampsDownAndItsReturnStartsNothing) {  // F-SUP-02
  SupervisionConfig none;
  none.resume_within_s = 0;
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    Story s(box, {}, none);
    s.engaged();
    s.link_up = false;
    s.run(150ms);
    EXPECT_EQ(s.mode(), Mode::kEngaged);
    s.run(30ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkSilent);
    s.run(170ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown);
    s.run(50ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkSilent) << "the cause stays on show";
    s.link_up = true;
    s.run(5000ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.engage();
    EXPECT_EQ(s.mode(), Mode::kEngaged);
    EXPECT_EQ(s.out.mode.cause, rt::kNoFault);
    EXPECT_EQ(s.task.count(tasks::kFaultLinkSilent), 1U);
  }
}

// ---- a silence that a held engage survives

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

// A ramp down for another cause is none of its business, also where the link falls silent afterwards.
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

// Only one direction is silent: the operator's box pauses, and the robot's, which hears it, goes out of
// the engaged mode with it and comes back with it.
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

// A pause is no act, whatever came before.
TEST(SupervisionResume, APauseEngagesNobody) {
  Story s(Box::kRobot);
  s.run(50ms);
  s.in.requests.engage = Engage::kPaused;
  s.run(100ms);
  EXPECT_EQ(s.mode(), Mode::kHold);
  s.in.requests.engage = Engage::kYes;
  s.run(1000ms);
  EXPECT_EQ(s.mode(), Mode::kHold) << "no release was seen right before";
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
    s.peer_follows = false;
    s.in.peer_mode = Mode::kRampDown;
    s.in.peer_pause = Pause::kSilent;
    s.run(10ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown) << "the hand goes limp with it";
    EXPECT_TRUE(s.out.mode.resumes);
    s.run(pause - 10ms);
    EXPECT_NE(s.mode(), Mode::kEngaged) << "not while it hears nothing";
    s.in.peer_mode = Mode::kHold;
    s.in.peer_pause = Pause::kHears;
    s.run(220ms);
    EXPECT_EQ(s.mode(), Mode::kEngaged) << pause.count();
    s.in.peer_pause = Pause::kNone;
    s.in.peer_mode = Mode::kEngaged;
    s.in.peer_mode_at = s.tick.start;
    s.run(50ms);
    EXPECT_EQ(s.mode(), Mode::kEngaged) << pause.count();
    s.in.peer_mode = Mode::kHold;
    s.run(20ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown) << "it left for another reason";
    EXPECT_FALSE(s.out.mode.resumes);
  }
}

// The news of a silence that is over already.
TEST(SupervisionResume, TheOperatorWaitsForARobotThatHearsAgain) {  // F-SUP-04
  Story s;
  s.engaged();
  s.run(100ms);
  s.peer_follows = false;
  s.in.peer_mode = Mode::kRampDown;
  s.in.peer_pause = Pause::kHears;
  s.run(300ms);
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
    s.peer_follows = false;
    s.in.peer_mode = Mode::kHold;
    s.in.peer_pause = Pause::kSilent;
    s.run(too_long ? 1250ms : 300ms);
    s.in.peer_pause = too_long ? Pause::kHears : Pause::kNone;
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

// The end of a connection is known at once: no liveness to wait for.
TEST(Supervision, LinkClosedRampsDownInTheSameTick) {  // F-SUP-02
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    Story s(box);
    s.engaged();
    s.in.link_closed = true;
    s.run(10ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkSilent);
    s.run(500ms);
    s.engage();
    EXPECT_EQ(s.mode(), Mode::kHold) << "no engage over a link that is gone";
    EXPECT_TRUE(s.out.engage_refused);
    s.in.link_closed = false;
    s.run(1000ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.engage();
    EXPECT_EQ(s.mode(), Mode::kEngaged);
  }
}

// A connection that ended and came back between two looks is still another one.
TEST(Supervision, AnotherConnectionEndsTheEngagement) {  // F-SUP-02
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    Story s(box);
    s.in.link_session = 1;
    s.engaged();
    s.in.link_session = 2;
    s.run(10ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkSilent);
    EXPECT_EQ(s.task.count(tasks::kFaultLinkSilent), 1U);
    s.run(5000ms);
    EXPECT_EQ(s.mode(), Mode::kHold) << "only an act engages again";
    s.engage();
    EXPECT_EQ(s.mode(), Mode::kEngaged);
    s.run(1000ms);
    EXPECT_EQ(s.mode(), Mode::kEngaged);
    EXPECT_EQ(s.task.count(tasks::kFaultLinkSilent), 1U);
  }
}

// The first one is no change, whatever its number is.
TEST(Supervision, TheFirstConnectionIsNoFault) {
  Story s(Box::kRobot);
  s.run(50ms);
  s.in.link_session = 7;
  s.engaged();
  EXPECT_EQ(s.task.count(tasks::kFaultLinkSilent), 0U);
}

TEST(Supervision, EmergencyStopNeedsReleaseClearAndEngage) {  // F-SUP-01
  for (int cause = 0; cause < 2; ++cause) {
    Story s;
    s.engaged();
    cause == 0 ? s.in.estop_closed = false : s.estop_sampled = false;
    s.run(70ms);
    EXPECT_EQ(s.mode(), Mode::kSafeStop);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultEstop);
    s.clear();
    EXPECT_EQ(s.mode(), Mode::kSafeStop) << "still pressed";
    s.in.estop_closed = s.estop_sampled = true;
    s.run(5000ms).engage();
    EXPECT_EQ(s.mode(), Mode::kSafeStop) << "not by itself, not by engage";
    s.clear();
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.run(100ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.engage();
    EXPECT_EQ(s.mode(), Mode::kEngaged);
  }
}

TEST(Supervision, AClearThatIsOnFromTheStartIsNoAct) {
  Story s;
  s.in.requests.clear = Clear::kYes;
  s.in.estop_closed = false;
  s.run(100ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop) << "also before hold was ever reached";
  s.in.estop_closed = true;
  s.run(1000ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  s.clear();
  EXPECT_EQ(s.mode(), Mode::kHold);
}

TEST(Supervision, LinkRefusedNeedsARestart) {  // F-SUP-03
  Story s;
  s.run(50ms);
  s.in.link_refused = true;
  s.run(50ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkRefused);
  s.in.link_refused = false;
  s.clear().clear();
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
}

TEST(Supervision, OperatorRampsDownWhenTheRobotDoesNotFollowOrLeaves) {  // F-SUP-04
  Story s;
  s.peer_follows = false;
  s.in.peer_mode = Mode::kHold;
  s.run(50ms).engage().run(950ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged) << "within the grace";
  s.run(100ms);
  EXPECT_EQ(s.mode(), Mode::kRampDown);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultPeerNotEngaged);
  Story left;
  left.engaged();
  left.peer_follows = false;
  left.in.peer_mode = Mode::kRampDown;
  left.run(20ms);
  EXPECT_EQ(left.mode(), Mode::kRampDown) << "no grace for one that has followed before";
}

TEST(Supervision, PeerStoppedStopsMotionButNotForEver) {  // F-SUP-05
  Story s;
  s.engaged();
  s.peer_follows = false;
  s.in.peer_mode = Mode::kSafeStop;
  s.run(20ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultPeerStopped);
  s.clear();
  EXPECT_EQ(s.mode(), Mode::kHold) << "one of the two must be able to go first";
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kHold);
  EXPECT_TRUE(s.out.engage_refused);
  s.in.peer_mode = Mode::kHold;
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kEngaged);
}

// A cause that only the clear itself takes away (a latch of a device) goes while it is pressed; a
// safe stop that begins meanwhile needs a press of its own.
TEST(Supervision, AClearCountsWhileItIsPressedForOneSafeStop) {
  for (const Box box : {Box::kOperator, Box::kRobot}) {
    Story s(box);
    s.engaged();
    const auto latched = rt::Health::of(Severity::kSafeStop, 506);
    s.in.tasks[0].health = latched;
    s.run(10ms);
    EXPECT_EQ(s.mode(), Mode::kSafeStop);
    EXPECT_FALSE(s.out.mode.clear);
    s.in.requests.engage = Engage::kNo;
    s.in.requests.clear = Clear::kYes;
    s.run(30ms);
    EXPECT_EQ(s.mode(), Mode::kSafeStop) << "the cause is still there";
    EXPECT_TRUE(s.out.mode.clear) << "the tasks are told";
    s.in.tasks[0].health = rt::Health::ok();
    s.run(10ms);
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.in.tasks[0].health = latched;
    s.run(20ms);
    s.in.tasks[0].health = rt::Health::ok();
    s.run(1000ms);
    EXPECT_EQ(s.mode(), Mode::kSafeStop) << "a button that is held down clears nothing new";
    s.clear();
    EXPECT_EQ(s.mode(), Mode::kHold);
    s.engage();
    EXPECT_EQ(s.mode(), Mode::kEngaged);
  }
}

// The robot's box knows the operator's button by the goal: over a silent link, or when the link is
// back with the button down, it is no act.
TEST(Supervision, TheRobotTakesAClearOverALiveLinkOnly) {
  Story s(Box::kRobot);
  s.engaged();
  s.in.requests.stop = true;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  s.in.requests.stop = false;
  s.link_up = false;
  s.run(500ms);
  s.in.requests.clear = Clear::kYes;
  s.run(200ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  s.link_up = true;
  s.run(500ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop) << "it has not been seen released";
  s.clear();
  EXPECT_EQ(s.mode(), Mode::kHold);
}

TEST(Supervision, RobotFollowsTheOperatorsEngage) {  // F-SUP-06
  for (const Engage e : {Engage::kNo, Engage::kAbsent}) {
    Story s(Box::kRobot);
    s.engaged();
    s.in.requests.engage = e;
    s.run(20ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultEngageWithdrawn);
  }
  Story op;
  op.engaged();
  op.in.requests.engage = Engage::kNo;
  op.run(500ms);
  EXPECT_EQ(op.mode(), Mode::kEngaged) << "on the operator's box it is a button, not a switch";
}

TEST(Supervision, RequestedRampDownTakesItsRampAndNoLonger) {  // F-SUP-07
  Story s;
  s.engaged();
  s.in.requests.ramp_down = true;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kRampDown);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultRampRequested);
  s.run(210ms);
  EXPECT_EQ(s.mode(), Mode::kHold);
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kHold) << "still requested";
  EXPECT_TRUE(s.out.engage_refused);
  s.in.requests.ramp_down = false;
  s.run(500ms);
  EXPECT_EQ(s.mode(), Mode::kHold) << "that engage is gone";
}

TEST(Supervision, RequestedStop) {  // F-SUP-08
  Story s;
  s.engaged();
  s.in.requests.stop = true;
  s.in.requests.ramp_down = true;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop) << "the worse of the two";
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultStopRequested);
}

TEST(Supervision, WatchdogNeedsARestart) {  // F-SUP-09
  Story s;
  s.engaged();
  s.in.watchdog_bit = true;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  s.in.watchdog_bit = false;
  s.clear();
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
}

TEST(Supervision, UnknownFaultIsAsSevereAsItSaysAtLeastDegraded) {  // F-SUP-10
  Story s;
  s.engaged();
  s.in.tasks[0].health = rt::Health::of(Severity::kCounted, 4242);
  s.run(20ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged);
  EXPECT_EQ(s.out.now, rt::Health::of(Severity::kDegraded, tasks::kFaultUnknown));
  s.in.tasks[0].health.severity = Severity::kSafeStop;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
}

TEST(Supervision, SilentTasks) {  // F-*-90
  Story s;
  s.engaged();
  s.silent[1] = true;
  s.run(290ms);
  EXPECT_EQ(s.mode(), Mode::kEngaged);
  s.run(30ms);
  EXPECT_EQ(s.mode(), Mode::kRampDown);
  EXPECT_EQ(s.out.mode.cause, 390);
  s.silent[0] = true;
  s.run(60ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop) << "worse within the same episode";
  EXPECT_EQ(s.out.mode.cause, 190);
  s.silent = {};
  s.clear();
  EXPECT_EQ(s.mode(), Mode::kHold);
}

// Every row of the table, reported by a task: the mode follows from severity and clear rule alone.
TEST(Supervision, EveryFaultOfTheTableActsAsItsRowSays) {
  for (const auto& row : kFaultTable) {
    SCOPED_TRACE(row.code);
    Story s;
    s.engaged();
    s.in.tasks[0].health = rt::Health::of(Severity::kCounted, row.id);
    s.run(10ms);
    const Mode expected = row.severity >= Severity::kSafeStop   ? Mode::kSafeStop
                          : row.severity >= Severity::kRampDown ? Mode::kRampDown
                                                                : Mode::kEngaged;
    EXPECT_EQ(s.mode(), expected);
    EXPECT_EQ(s.out.now.fault, row.id);
    EXPECT_EQ(s.out.now.severity, row.severity);
    EXPECT_EQ(s.task.count(row.id), 1U);
    s.run(300ms);
    EXPECT_EQ(s.task.count(row.id), 1U) << "one condition counts once";
    s.in.tasks[0].health = rt::Health::ok();
    s.run(300ms);
    if (expected == Mode::kEngaged) {
      EXPECT_EQ(s.mode(), Mode::kEngaged);
      continue;
    }
    EXPECT_NE(s.mode(), Mode::kEngaged);
    s.engage();
    const bool by_itself = expected == Mode::kRampDown && row.clear == ClearRule::kItself;
    EXPECT_EQ(s.mode() == Mode::kEngaged, by_itself);
    if (by_itself) continue;
    s.clear();
    s.engage();
    EXPECT_EQ(s.mode() == Mode::kEngaged, row.clear == ClearRule::kOperator);
  }
}

TEST(Supervision, SeverityNeverFallsAndMotionNeverStartsByItself) {
  const std::uint64_t seed = 99;
  rt::Random r(seed);
  int engagements = 0;
  for (int episode = 0; episode < 300; ++episode) {
    Story s(r.uniform() < 0.5 ? Box::kOperator : Box::kRobot);
    Mode last = Mode::kInit;
    Engage last_engage = Engage::kAbsent;
    for (int i = 0; i < 300; ++i) {
      if (r.uniform() < 0.1) s.in.requests.engage = static_cast<Engage>(r.integer(0, 2));
      if (r.uniform() < 0.05) s.in.requests.clear = static_cast<Clear>(r.integer(0, 2));
      if (r.uniform() < 0.02) s.in.link_closed = !s.in.link_closed;
      if (r.uniform() < 0.02) s.in.requests.ramp_down = !s.in.requests.ramp_down;
      if (r.uniform() < 0.02) s.link_up = !s.link_up;
      if (r.uniform() < 0.01) s.in.estop_closed = !s.in.estop_closed;
      if (r.uniform() < 0.02) {
        const auto row = static_cast<std::size_t>(
            r.integer(0, static_cast<std::int64_t>(tasks::kFaultCount) - 1));
        s.in.tasks[1].health = r.uniform() < 0.7
                                   ? rt::Health::ok()
                                   : rt::Health::of(Severity::kOk, kFaultTable[row].id);
        if (s.in.tasks[1].health.fault != 0) s.in.tasks[1].health.severity = Severity::kCounted;
      }
      const bool resumes = s.out.mode.resumes;  // an act that is held goes on: the one exception
      s.run(10ms);
      const Mode m = s.mode();
      if (m == Mode::kEngaged && last != Mode::kEngaged) {
        ++engagements;
        ASSERT_EQ(s.in.requests.engage, Engage::kYes);
        if (!resumes) {
          ASSERT_EQ(last, Mode::kHold) << "seed " << seed;
          ASSERT_EQ(last_engage, Engage::kNo);
        }
      }
      if (m == Mode::kEngaged) {
        ASSERT_LT(s.out.now.severity, Severity::kRampDown);
        ASSERT_TRUE(s.in.estop_closed);
      }
      if (last == Mode::kSafeStop) {
        ASSERT_TRUE(m == Mode::kSafeStop || m == Mode::kHold);
      }
      if (last == Mode::kRampDown) {
        ASSERT_NE(m, Mode::kEngaged);
      }
      last = m;
      last_engage = s.in.requests.engage;
    }
  }
  std::printf("seed %llu: %d engagements\n", static_cast<unsigned long long>(seed), engagements);
  EXPECT_GT(engagements, 100);
}

TEST(Supervision, RefusesAWrongWatchTable) {
  const tasks::Watch bad{4242, 10ms}, zero{190, 0ms};
  const SupervisionConfig config;
  EXPECT_THROW(SupervisionTask(startup.token(), config, Box::kRobot, &bad, 1), std::logic_error);
  EXPECT_THROW(SupervisionTask(startup.token(), config, Box::kRobot, &zero, 1), std::logic_error);
  EXPECT_THROW(SupervisionTask(startup.token(), config, Box::kRobot, &bad, 17), std::logic_error);
}

}  // namespace
