// What put the robot's box into a safe stop, as the operator reads it.
#include <gtest/gtest.h>

#include "tasks/supervision/fault_ids.hpp"
#include "tools/desk/desk_events.hpp"
#include "tools/record/box_recorder.hpp"

namespace {

using teletact::cause_text;

drivers::RobotState stopped_by(rt::FaultId cause) {
  drivers::RobotState robot;
  robot.mode = static_cast<std::uint8_t>(tasks::Mode::kSafeStop);
  robot.mode_cause = cause;
  return robot;
}

TEST(RobotCause, IsNamedWhereTheOperatorsBoxFollowedIt) {
  const auto robot = stopped_by(tasks::kFaultEstop);
  const std::string there = " (there: " + teletact::fault_text(tasks::kFaultEstop) + ")";
  EXPECT_EQ(cause_text(tasks::kFaultPeerStopped, robot),
            teletact::fault_text(tasks::kFaultPeerStopped) + there);
  EXPECT_EQ(cause_text(tasks::kFaultPeerNotEngaged, robot),
            teletact::fault_text(tasks::kFaultPeerNotEngaged) + there);
  EXPECT_EQ(cause_text(tasks::kFaultEstop, robot), teletact::fault_text(tasks::kFaultEstop));
  EXPECT_EQ(cause_text(tasks::kFaultPeerStopped, {}),
            teletact::fault_text(tasks::kFaultPeerStopped));
  EXPECT_EQ(cause_text(rt::kNoFault, robot), "no fault");
}

TEST(RobotCause, ASafeStopThereIsAnEventOnce) {
  teletact::DeskEvents events(rt::time_from_ns(0), "");
  teletact::OperatorView seen;
  const auto told = [&] {
    int n = 0;
    for (const auto& e : events.newest()) n += e.text.find("F-SUP-01") != std::string::npos;
    return n;
  };
  events.watch(seen, rt::time_from_ns(1'000'000'000));
  seen.robot = stopped_by(tasks::kFaultEstop);
  for (int i = 2; i < 5; ++i) events.watch(seen, rt::time_from_ns(i * 1'000'000'000LL));
  EXPECT_EQ(told(), 1);
  EXPECT_EQ(events.robot_mode_since_s(), 2);
  seen.robot = {};
  events.watch(seen, rt::time_from_ns(5'000'000'000));
  EXPECT_EQ(told(), 1);
  seen.robot = stopped_by(tasks::kFaultEstop);
  events.watch(seen, rt::time_from_ns(6'000'000'000));
  EXPECT_EQ(told(), 2);
}

}  // namespace
