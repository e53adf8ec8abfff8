// What a person is told about a safe stop: a clear is offered only where one helps.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tasks/supervision/fault_ids.hpp"
#include "tools/desk/intents/safe_stop.hpp"
#include "tools/record/box_recorder.hpp"

namespace {

using tasks::Mode;
using teletact::clear_refusal;
using teletact::safe_stop_refusal;
using teletact::still_stopped;
using teletact::wants_restart;
using testing::EndsWith;
using testing::HasSubstr;
using testing::StartsWith;

tasks::ModeMsg here(Mode mode, rt::FaultId cause = rt::kNoFault) {
  tasks::ModeMsg msg{};
  msg.mode = mode;
  msg.cause = cause;
  return msg;
}

drivers::RobotState there(Mode mode, rt::FaultId cause = rt::kNoFault) {
  drivers::RobotState robot{};
  robot.mode = static_cast<std::uint8_t>(mode);
  robot.mode_cause = cause;
  return robot;
}

TEST(SafeStop, WithoutOneNothingIsRefusedForItAndThereIsNothingToClear) {
  for (const Mode mode : {Mode::kInit, Mode::kHold, Mode::kEngaged, Mode::kRampDown}) {
    // A cause that wants a restart is not one of a safe stop that has ended.
    EXPECT_EQ(safe_stop_refusal(here(mode, tasks::kFaultWatchdog), there(Mode::kHold)), "");
    EXPECT_EQ(wants_restart(here(mode, tasks::kFaultWatchdog), there(mode, tasks::kFaultWatchdog)),
              rt::kNoFault);
    EXPECT_EQ(clear_refusal(here(mode), there(Mode::kHold)), "there is no safe stop to clear");
  }
}

// Every row of the table, on either side: the text of an engage and the answer to a clear agree.
TEST(SafeStop, OfEveryFaultTheClearIsTriedWhereTheEngageAsksForIt) {
  int restarts = 0;
  for (const tasks::FaultRow& row : tasks::kFaultTable) {
    const bool restart = row.clear == tasks::ClearRule::kRestart;
    restarts += restart;
    const auto mine = here(Mode::kSafeStop, row.id);
    const auto its = there(Mode::kSafeStop, row.id);
    for (const auto& [mode, robot] : {std::pair{mine, there(Mode::kHold)},
                                      std::pair{here(Mode::kHold), its}, std::pair{mine, its}}) {
      EXPECT_EQ(wants_restart(mode, robot), restart ? row.id : rt::kNoFault) << row.code;
      const std::string engage = safe_stop_refusal(mode, robot);
      const std::string clear = clear_refusal(mode, robot);
      EXPECT_THAT(engage, HasSubstr(row.code));
      if (restart) {
        EXPECT_THAT(engage, EndsWith(teletact::fault_advice(row.id)));
        EXPECT_THAT(clear, StartsWith("no clear helps: " + std::string(row.code)));
        EXPECT_THAT(clear, EndsWith(teletact::fault_advice(row.id)));
      } else {
        EXPECT_THAT(engage, EndsWith(": clear it first")) << row.code;
        EXPECT_EQ(clear, "") << row.code;
      }
    }
  }
  EXPECT_GE(restarts, 3);
}

// A clear that changed nothing says which box is still stopped, by what, and what to do.
TEST(SafeStop, AClearThatChangedNothingIsTold) {
  const auto estop = tasks::kFaultEstop;
  EXPECT_EQ(still_stopped(here(Mode::kHold), there(Mode::kHold)), "");
  EXPECT_EQ(still_stopped(here(Mode::kHold), there(Mode::kSafeStop, estop)),
            "the robot's box is still in a safe stop, " + teletact::fault_text(estop) +
                teletact::fault_advice(estop));
  EXPECT_EQ(still_stopped(here(Mode::kSafeStop, estop), there(Mode::kHold)),
            "still in a safe stop, " + teletact::fault_text(estop) + teletact::fault_advice(estop));
}

// Two causes of their own: the one that no clear ends is named, and its advice is the one given.
TEST(SafeStop, ARestartThatTheOtherBoxWantsIsNamed) {
  const auto mode = here(Mode::kSafeStop, tasks::kFaultEstop);
  const auto robot = there(Mode::kSafeStop, tasks::kFaultWatchdog);
  const std::string text = safe_stop_refusal(mode, robot);
  EXPECT_THAT(text, StartsWith("a safe stop, F-SUP-01"));
  EXPECT_THAT(text, EndsWith(", and at the robot " + teletact::fault_text(tasks::kFaultWatchdog) +
                             teletact::fault_advice(tasks::kFaultWatchdog)));
}

// The operator's box followed the robot's, whose own cause is what wants the restart.
TEST(SafeStop, TheOtherBoxesCauseIsTheOneThatDecides) {
  const auto mode = here(Mode::kSafeStop, tasks::kFaultPeerStopped);
  const auto robot = there(Mode::kSafeStop, tasks::kFaultWatchdog);
  EXPECT_EQ(wants_restart(mode, robot), tasks::kFaultWatchdog);
  EXPECT_THAT(safe_stop_refusal(mode, robot), StartsWith("a safe stop, F-SUP-05"));
  EXPECT_THAT(safe_stop_refusal(mode, robot), HasSubstr("(there: F-SUP-09"));
  EXPECT_THAT(safe_stop_refusal(mode, robot),
              EndsWith(teletact::fault_advice(tasks::kFaultWatchdog)));
  EXPECT_THAT(clear_refusal(mode, robot), StartsWith("no clear helps: F-SUP-09"));
}

}  // namespace
