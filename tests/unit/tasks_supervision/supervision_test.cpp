// What the boxes do when something happens. One story for every fault of the table.
#include "rt/random.hpp"
#include "tests/unit/tasks_supervision/story.hpp"

namespace tests {
namespace {

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
    if (box == Box::kRobot) s.in.requests.engage = Engage::kAbsent;  // the old goal is void
    s.run(10ms);
    EXPECT_EQ(s.mode(), Mode::kRampDown);
    EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkSilent);
    EXPECT_EQ(s.task.count(tasks::kFaultLinkSilent), 1U);
    s.in.requests.engage = Engage::kYes;
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
    const Box box = r.uniform() < 0.5 ? Box::kOperator : Box::kRobot;
    Story s(box);
    Mode last = Mode::kInit;
    int no_ago = 1000;  // ticks since the last "no", with nothing but silence behind it
    for (int i = 0; i < 300; ++i) {
      if (r.uniform() < 0.1)
        s.in.requests.engage = static_cast<Engage>(r.integer(0, box == Box::kRobot ? 3 : 2));
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
          ASSERT_LE(no_ago, box == Box::kRobot ? 100 : 0) << "seed " << seed;
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
      const Engage seen = s.in.requests.engage;
      const bool other = s.in.link_closed || m != Mode::kHold;  // than a silence
      if (box == Box::kRobot && (seen == Engage::kYes || (seen != Engage::kNo && other)))
        no_ago = 1000;
      else
        no_ago = seen == Engage::kNo && !(box == Box::kRobot && s.in.link_closed) ? 0 : no_ago + 1;
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

// A person's engage is held: let go, the mode ends, and only a new press brings it back.
TEST(Supervision, LettingGoEndsTheEngagement) {
  Story s;
  s.engaged();
  s.in.requests.engage = Engage::kNo;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kRampDown);
  EXPECT_EQ(s.out.mode.cause, 706);
  EXPECT_FALSE(s.out.mode.resumes);
  s.in.requests.engage = Engage::kYes;
  s.run(3000ms);
  EXPECT_EQ(s.mode(), Mode::kHold) << "pressed while it ramps down is no press";
  s.engage();
  EXPECT_EQ(s.mode(), Mode::kEngaged);
}

}  // namespace
}  // namespace tests
