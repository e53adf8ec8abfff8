// What the desk tells of a run: each change once, and nothing while nothing changes.
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tasks/supervision/fault_ids.hpp"
#include "tools/desk/desk_events.hpp"

namespace {

using teletact::OperatorView;

TEST(DeskEvents, EachChangeIsToldOnce) {
  teletact::DeskEvents events(rt::time_from_ns(0), "");
  OperatorView seen;
  std::int64_t now_s = 0;
  const auto watch = [&] { events.watch(seen, rt::time_from_ns(++now_s * 1'000'000'000)); };
  watch(), watch();
  EXPECT_EQ(events.all(), 0U);
  const std::vector<std::pair<std::string, std::function<void()>>> changes{
      {"mode", [&] { seen.mode.seq = 1, seen.mode.mode = tasks::Mode::kHold; }},
      {"mode", [&] { seen.mode.cause = tasks::kFaultEstop; }},
      {"robot", [&] { seen.robot.fault = tasks::kFaultEstop; }},
      {"task", [&] { seen.task.phase = tasks::TaskState::Phase::kDriving; }},
      {"tracking", [&] { seen.camera.tracking = tasks::CameraPose::Tracking::kTracking; }},
      {"object", [&] { seen.objects_named = 3; }},
      {"task", [&] { seen.task.phase = tasks::TaskState::Phase::kIdle; }},
  };
  for (std::size_t n = 0; n < changes.size(); ++n) {
    changes[n].second();
    watch(), watch();
    ASSERT_EQ(events.all(), n + 1) << changes[n].first;
    EXPECT_EQ(events.newest().back().kind, changes[n].first);
    EXPECT_DOUBLE_EQ(events.newest().back().t_s, static_cast<double>(now_s - 1));
    EXPECT_NE(events.newest().back().text, "");
  }
  // A fault that has gone is no event; the time since when nothing is wrong is kept.
  seen.robot.fault = rt::kNoFault;
  watch(), watch();
  EXPECT_EQ(events.all(), changes.size());
  EXPECT_DOUBLE_EQ(events.robot_fault_since_s(), static_cast<double>(now_s - 1));
}

}  // namespace
