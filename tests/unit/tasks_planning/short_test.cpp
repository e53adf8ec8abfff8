// A way that ends elsewhere than where the base was asked to go is no arrival.
#include "tests/unit/tasks_planning/story.hpp"

namespace tests {
namespace {

Story& go_to(Story& s, double x, double y) {
  tasks::OperatorAct act;
  act.seq = ++s.event_seq;
  act.kind = tasks::OperatorAct::Kind::kGoTo;
  act.p_W = Vec3(x, y, 0);
  s.in.act = act;
  s.job();
  s.in.act.reset();
  return s;
}
void stand_at_the_end(Story& s) {
  s.robot.x_m = s.last()[0];
  s.robot.y_m = s.last()[1];
}
// From the robot to a place of W: what the task says of it comes from the map's cells.
double from_robot(const Story& s, double x, double y) {
  return std::hypot(s.robot.x_m - x, s.robot.y_m - y);
}

TEST(PlanningShort, APlaceOnTheFloorThatIsTakenIsNotReached) {
  Story s;
  s.box(0.6, -0.9, 2.4, 0.9);
  go_to(s, 1.5, 0);
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_TRUE(s.out.state.is_short) << "said on the way already";
  const double off = s.out.state.off_m;
  stand_at_the_end(s);
  EXPECT_NEAR(off, from_robot(s, 1.5, 0), 1e-9);
  EXPECT_GT(off, 0.9);
  for (int i = 0; i < PlanningConfig{}.look_jobs + 1; ++i) {
    EXPECT_NE(s.out.state.phase, Phase::kShort) << i;
    s.job();
    EXPECT_NE(s.out.state.phase, Phase::kArrived);
  }
  EXPECT_EQ(s.out.state.phase, Phase::kShort);
  EXPECT_EQ(s.out.state.paths, 1U) << "no nearer place: no other way";
  EXPECT_NEAR(s.out.state.off_m, off, 1e-12);
  for (int i = 0; i < 50; ++i) s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kShort);
  EXPECT_EQ(s.out.state.failures, 0U);
}

// The wall hides the floor behind it from where the base was; at the end of the way it is seen.
TEST(PlanningShort, GoesOnWhenItSeesANearerPlace) {
  Story s;
  s.box(0.5, -3, 2.99, 2.99, CostMap::kUnknown);
  go_to(s, 1.2, 0);
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  ASSERT_TRUE(s.out.state.is_short);
  const double first = s.out.state.off_m;
  stand_at_the_end(s);
  s.job().job();
  s.box(0.5, -3, 0.9, 2.99, CostMap::kFree);
  for (int i = 0; i < 10 && s.out.state.paths == 1; ++i) s.job();
  ASSERT_EQ(s.out.state.paths, 2U);
  EXPECT_TRUE(s.out.flags & PlanningTask::kGoesOn);
  EXPECT_LT(s.out.state.off_m, first - 0.15);
  EXPECT_TRUE(s.out.state.is_short);
  stand_at_the_end(s);
  s.job();
  s.box(0.5, -3, 2.99, 2.99, CostMap::kFree);
  for (int i = 0; i < 10 && s.out.state.paths == 2; ++i) s.job();
  EXPECT_FALSE(s.out.state.is_short);
  EXPECT_EQ(s.out.state.off_m, 0);
  stand_at_the_end(s);
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kArrived);
  EXPECT_NEAR(from_robot(s, 1.2, 0), 0, 1e-12);
}

TEST(PlanningShort, AMarkOnAnObjectIsReachedBesideIt) {
  Story s;
  s.box(1.2, -0.3, 1.8, 0.3);
  s.mark({1.5, 0, 0.4}, {-1, 0, 0}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_FALSE(s.out.state.is_short);
  EXPECT_GT(s.out.state.off_m, 0.25);
  stand_at_the_end(s);
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kArrived);
}

// As seen: a mark on what is so large that the base ends more than a metre off.
TEST(PlanningShort, ButNotWhereTheBaseEndsFarFromIt) {
  Story s;
  s.box(0.4, -1.2, 2.6, 1.2);
  s.mark({1.5, 0, 0.4}, {-1, 0, 0}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_TRUE(s.out.state.is_short);
  stand_at_the_end(s);
  EXPECT_GT(from_robot(s, 1.5, 0), 1.05);
  for (int i = 0; i < PlanningConfig{}.look_jobs + 1; ++i) s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kShort);
}

TEST(PlanningShort, WithoutAMapItStillSaysThatItIsNotThere) {
  Story s;
  s.box(0.6, -0.9, 2.4, 0.9);
  go_to(s, 1.5, 0);
  stand_at_the_end(s);
  s.in.may_plan = false;
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kShort);
}

TEST(PlanningShort, ANewGoalForgetsIt) {
  Story s;
  s.box(0.6, -0.9, 2.4, 0.9);
  go_to(s, 1.5, 0);
  ASSERT_TRUE(s.out.state.is_short);
  go_to(s, -1, -1);
  EXPECT_FALSE(s.out.state.is_short);
  EXPECT_EQ(s.out.state.off_m, 0);
  go_to(s, 1e6, 0);
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
  EXPECT_EQ(s.out.state.off_m, -1);
}

}  // namespace
}  // namespace tests
