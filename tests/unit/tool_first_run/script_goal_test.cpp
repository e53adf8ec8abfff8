// A script that marks a goal and does not get there is no success; a run that was cut short on
// purpose is not judged.
#include "tools/host/script_goal.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace {

using teletact::DemoOptions;
using teletact::OperatorHalf;
using teletact::RobotHalf;
using testing::HasSubstr;
using Phase = tasks::TaskState::Phase;

rt::Time at_s(double s) { return rt::time_from_ns(static_cast<std::int64_t>(1e9 * s)); }

// A run of the default room that went well: 2 m of path, made at 4.6 s.
struct Drive {
  std::unique_ptr<teletact::Scene> scene;
  DemoOptions options;
  OperatorHalf op;
  RobotHalf robot;
  explicit Drive(const std::vector<std::string>& set = {})
      : scene(teletact::load_scene(teletact::find_config("scenes", "default_room"), set)) {
    op.complete = robot.complete = true;
    op.view.task.marks = op.view.task.paths = 1;
    op.view.task.phase = Phase::kArrived;
    op.view.mode.seq = 1;
    op.view.mode.mode = tasks::Mode::kEngaged;
    auto& path = op.view.paths.emplace_back();
    path.seq = 1;
    path.made = at_s(4.6);
    path.size = 2;
    path.points[1] = {2, 0, 0};
    stand(2.0);
  }
  void stand(double x_m) { robot.view.truth.assign(1, {at_s(19), x_m, 0, 0, x_m, 0}); }
  teletact::GoalCheck check() const { return check_goal(*scene, options, op, robot); }
};

TEST(ScriptGoal, Reached) {
  const auto c = Drive().check();
  EXPECT_TRUE(c.asked);
  EXPECT_TRUE(c.judged);
  EXPECT_EQ(c.missed, "");
}

TEST(ScriptGoal, NoMark) {
  Drive r;
  r.op.view.task = {};
  r.op.view.paths.clear();
  EXPECT_TRUE(r.check().judged);
  EXPECT_THAT(r.check().missed, HasSubstr("goal not reached: the hand drew no mark"));
}

TEST(ScriptGoal, NoPath) {
  Drive r;
  r.op.view.paths.clear();
  r.op.view.task.phase = Phase::kFailed;
  r.op.view.task.failures = 1;
  EXPECT_TRUE(r.check().judged);
  EXPECT_THAT(r.check().missed, HasSubstr("no path to the mark was found"));
}

TEST(ScriptGoal, NeverArrived) {
  Drive r;
  r.op.view.task.phase = Phase::kDriving;
  r.stand(0.06);
  EXPECT_TRUE(r.check().judged);
  EXPECT_THAT(r.check().missed, HasSubstr("1.94 m off"));
}

TEST(ScriptGoal, BrokenOffSaysWhatStopped) {
  Drive r;
  r.op.view.task.phase = Phase::kIdle;
  r.op.view.mode.mode = tasks::Mode::kSafeStop;
  r.op.view.mode.cause = rt::FaultId{190};
  r.stand(1);
  EXPECT_THAT(r.check().missed, HasSubstr("1.00 m off"));
  EXPECT_THAT(r.check().missed, HasSubstr("safe stop, F-HAP-90"));
}

TEST(ScriptGoal, ArrivedByOdometryAlone) {
  Drive r;
  r.stand(1.7);
  EXPECT_TRUE(r.check().judged);
  EXPECT_THAT(r.check().missed, HasSubstr("0.30 m off"));
  r.stand(1.95);
  EXPECT_EQ(r.check().missed, "");
}

TEST(ScriptGoal, AnEarlierGoalThatWasMissed) {
  Drive r;
  r.robot.view.truth = {{at_s(8), 1.0, 0, 0, 1.0, 0}, {at_s(19), 2.0, 0, 0, 2.0, 0}};
  auto& first = r.op.view.arrived.emplace_back();
  first.stamp = teletact::kOperatorClock.from_host(teletact::kRobotClock.to_host(at_s(8)));
  first.goal_x_m = 1.05;
  EXPECT_EQ(r.check().missed, "");
  first.goal_x_m = 1.25;
  EXPECT_THAT(r.check().missed, HasSubstr("0.25 m off"));
  EXPECT_THAT(r.check().missed, HasSubstr("earlier goal"));
}

TEST(ScriptGoal, AShorterRunIsNotJudgedUntilItsScriptIsOver) {
  Drive r;
  r.op.view.task = {};
  r.op.view.paths.clear();
  r.options.seconds = 4;  // the mark ends later
  EXPECT_FALSE(r.check().asked);
  EXPECT_EQ(r.check().missed, "");
  r.options.seconds = 8;
  EXPECT_TRUE(r.check().asked);
  EXPECT_FALSE(r.check().judged);
  EXPECT_NE(r.check().missed, "");
  r.options.seconds = 18;
  EXPECT_TRUE(r.check().judged);
}

// 2 m at half of .5 m/s and 3 s: by 15.6 s.
TEST(ScriptGoal, OnTheWayIsJudgedWhenItIsLate) {
  Drive r;
  r.op.view.task.phase = Phase::kDriving;
  r.stand(1);
  r.options.seconds = 18;
  EXPECT_TRUE(r.check().judged);
  r.op.view.paths.back().made = at_s(10);
  EXPECT_FALSE(r.check().judged);
  r.options.seconds = 20;
  EXPECT_TRUE(r.check().judged) << "the whole demo has to get there";
}

TEST(ScriptGoal, WhatIsBrokenOnPurposeIsNotJudged) {
  const auto judged = [](const auto& change) {
    Drive r;
    r.op.view.task.phase = Phase::kDriving;
    change(r);
    return r.check().judged;
  };
  EXPECT_TRUE(judged([](Drive&) {}));
  EXPECT_FALSE(judged([](Drive& r) { r.options.fault_plan = "extra_cpu"; }));
  EXPECT_FALSE(judged([](Drive& r) { r.options.cut_link_at_s = 5; }));
  EXPECT_FALSE(judged([](Drive& r) { r.options.stub_bodies = true; }));
  EXPECT_FALSE(judged([](Drive& r) { r.options.rgbd_dir = "recording"; }));
  EXPECT_FALSE(judged([](Drive& r) { r.op.complete = false; }));
}

TEST(ScriptGoal, AScriptThatAsksForNoneHasNone) {
  Drive never({"operator.engage_after_s=3600"});
  never.op.view.task.phase = Phase::kIdle;
  EXPECT_FALSE(never.check().asked);
  Drive no_script;
  no_script.scene->hand.segments.clear();
  no_script.op.view.task = {};
  EXPECT_FALSE(no_script.check().asked);
  EXPECT_EQ(no_script.check().missed, "");
}

}  // namespace
