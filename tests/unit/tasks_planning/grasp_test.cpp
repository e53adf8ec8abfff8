// Grasps of boxes and cylinders in closed form, the arm against its own forward kinematics, and
// what every grasp must keep over random boxes.
#include "tasks/planning/grasp.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "rt/random.hpp"
#include "tests/unit/tasks_planning/story.hpp"

namespace tasks {
namespace {

constexpr double kPi = std::numbers::pi;
const Vec3 kUp = Vec3::UnitZ(), kFloor = Vec3::Zero(), kRobot(-1, 0, 0);

// Standing on something at `z`, turned by yaw; edges along O's axes.
ObjectBox standing(const Vec3& at, const Vec3& extent, double yaw = 0) {
  ObjectBox b;
  b.X_WO.linear() = Eigen::AngleAxisd(yaw, Vec3::UnitZ()).toRotationMatrix();
  b.X_WO.translation() = at + Vec3(0, 0, extent.z() / 2);
  b.extent_m = extent;
  return b;
}

Grasp grasp(const ObjectBox& b, const GraspConfig& c = {}) {
  return find_grasp(b, kUp, kFloor, kRobot, c);
}

// Tips by the joints, in the arm's upright plane: x ahead of the base's centre, z above the floor.
std::array<double, 2> tips(const Grasp& g, const GraspConfig& c) {
  double x = c.shoulder_x_m, z = c.shoulder_z_m, pitch = 0;
  const double lengths[3] = {c.upper_m, c.fore_m, c.hand_m};
  for (std::size_t i = 0; i < 3; ++i) {
    pitch += g.joint_rad[i];
    x += lengths[i] * std::sin(pitch);
    z += lengths[i] * std::cos(pitch);
  }
  return {x, z};
}

void expect_reached(const Grasp& g, const GraspConfig& c) {
  const auto [x, z] = tips(g, c);
  EXPECT_NEAR(x, g.base_m, 1e-9);
  EXPECT_NEAR(z, g.X_WG.translation().z(), 1e-9);
  const double pitch = g.joint_rad[0] + g.joint_rad[1] + g.joint_rad[2];
  EXPECT_NEAR(pitch, g.kind == Grasp::Kind::kTop ? kPi : kPi / 2, 1e-9);
}

TEST(Grasp, ABoxIsTakenFromAboveAcrossItsNarrowSide) {
  const GraspConfig c;
  for (const double yaw : {0.0, 0.4, -1.3, 2.9}) {
    const Grasp g = grasp(standing(Vec3(0.5, 0.2, 0), Vec3(0.14, 0.055, 0.10), yaw));
    ASSERT_EQ(g.refused, Grasp::Refused::kNo) << text_of(g.refused);
    EXPECT_EQ(g.kind, Grasp::Kind::kTop);
    EXPECT_NEAR(g.width_m, 0.055, 1e-12);
    EXPECT_NEAR(g.opening_m, 0.059, 1e-12);
    const Vec3 narrow(-std::sin(yaw), std::cos(yaw), 0);
    EXPECT_NEAR(std::abs(g.X_WG.linear().col(0).dot(narrow)), 1, 1e-12);
    EXPECT_NEAR((g.X_WG.linear().col(2) + kUp).norm(), 0, 1e-12);
    // Over the middle, 40 mm below the top.
    EXPECT_NEAR((g.X_WG.translation() - Vec3(0.5, 0.2, 0.06)).norm(), 0, 1e-12);
    EXPECT_NEAR((g.before_W - Vec3(0.5, 0.2, 0.14)).norm(), 0, 1e-12);
    expect_reached(g, c);
  }
}

TEST(Grasp, TheJointsStayWithinTheirRangesAtBothEnds) {
  constexpr std::uint64_t kSeed = 71;
  rt::Random random(kSeed);
  std::printf("  seed %llu\n", static_cast<unsigned long long>(kSeed));
  int taken = 0, refused = 0;
  for (int n = 0; n < 400; ++n) {
    GraspConfig c;
    const std::array<std::array<double, 2>*, 3> ranges{&c.range2_deg, &c.range3_deg, &c.range4_deg};
    for (auto* range : ranges) *range = {random.uniform(-120, 70), random.uniform(30, 150)};
    const Grasp g =
        grasp(standing(Vec3(0.5, 0, 0), Vec3(0.12, 0.06, random.uniform(0.04, 0.3))), c);
    if (g.refused != Grasp::Refused::kNo) {
      EXPECT_EQ(g.refused, Grasp::Refused::kOutOfReach);
      ++refused;
      continue;
    }
    ++taken;
    expect_reached(g, c);
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      EXPECT_GE(g.joint_rad[i], (*ranges[i])[0] * kPi / 180 - 1e-12) << n << ", joint " << i + 2;
      EXPECT_LE(g.joint_rad[i], (*ranges[i])[1] * kPi / 180 + 1e-12) << n << ", joint " << i + 2;
    }
  }
  std::printf("  %d taken, %d out of reach\n", taken, refused);
  EXPECT_GE(taken, 40);
  EXPECT_GE(refused, 40);
}

TEST(Grasp, AFlatBoxIsTakenNoDeeperThanItsMiddleAndTheFloorAllows) {
  const Grasp g = grasp(standing(Vec3(0.5, 0, 0), Vec3(0.12, 0.06, 0.04)));
  ASSERT_EQ(g.kind, Grasp::Kind::kTop);
  EXPECT_NEAR(g.X_WG.translation().z(), 0.02, 1e-12) << "its middle";
  const Grasp flat = grasp(standing(Vec3(0.5, 0, 0), Vec3(0.12, 0.06, 0.014)));
  ASSERT_EQ(flat.kind, Grasp::Kind::kTop);
  EXPECT_NEAR(flat.X_WG.translation().z(), 0.01, 1e-12) << "above the floor";
}

// Too high to be come at from above: a cylinder on a board, of which every level direction is a
// diameter.
TEST(Grasp, ACylinderOnABoardIsTakenFromTheSide) {
  const GraspConfig c;
  const double d = 0.06, h = 0.20;
  for (const double yaw : {0.0, 0.8}) {
    const ObjectBox can = standing(Vec3(0.4, 0, 0.38), Vec3(d, d, h), yaw);
    const Grasp g = grasp(can);
    ASSERT_EQ(g.refused, Grasp::Refused::kNo) << text_of(g.refused);
    EXPECT_EQ(g.kind, Grasp::Kind::kSide);
    EXPECT_NEAR(g.width_m, d, 1e-12);
    const Vec3 approach = g.X_WG.linear().col(2);
    EXPECT_NEAR(approach.z(), 0, 1e-12);
    EXPECT_GT(approach.x(), 0.5) << "away from the robot";
    // To the middle: the fingers are longer than the radius.
    EXPECT_NEAR((g.X_WG.translation() - Vec3(0.4, 0, 0.48)).norm(), 0, 1e-12);
    EXPECT_NEAR((g.before_W - (Vec3(0.4, 0, 0.48) - 0.08 * approach)).norm(), 0, 1e-12);
    expect_reached(g, c);
  }
}

TEST(Grasp, OneReasonWhereThereIsNone) {
  const auto reason = [](const ObjectBox& b) {
    const Grasp g = grasp(b);
    EXPECT_EQ(g.kind, Grasp::Kind::kNone);
    EXPECT_FALSE(text_of(g.refused).empty());
    return g.refused;
  };
  using R = Grasp::Refused;
  EXPECT_EQ(reason(standing(Vec3(0.5, 0, 0), Vec3(0.08, 0.09, 0.1))), R::kTooWide);
  EXPECT_EQ(reason(standing(Vec3(0.5, 0, 0), Vec3(0.03, 0.02, 0.1))), R::kTooThin);
  EXPECT_EQ(reason(standing(Vec3(0.5, 0, 0), Vec3(0.03, 0.09, 0.1))), R::kTooWide)
      << "one side too thin, the other too wide";
  EXPECT_EQ(reason(standing(Vec3(0.5, 0, 1.2), Vec3(0.06, 0.06, 0.1))), R::kOutOfReach);
  ObjectBox bad = standing(Vec3(0.5, 0, 0), Vec3(0.06, 0.06, 0.1));
  bad.extent_m.y() = 0;
  EXPECT_EQ(reason(bad), R::kBadInput);
  bad.extent_m.y() = std::nan("");
  EXPECT_EQ(reason(bad), R::kBadInput);
  // The limits themselves: 70 mm less the clearance, and 70 less 20.
  EXPECT_EQ(grasp(standing(Vec3(0.5, 0, 0), Vec3(0.0659, 0.2, 0.1))).refused, R::kNo);
  EXPECT_EQ(grasp(standing(Vec3(0.5, 0, 0), Vec3(0.0661, 0.2, 0.1))).refused, R::kTooWide);
  EXPECT_EQ(grasp(standing(Vec3(0.5, 0, 0), Vec3(0.0501, 0.2, 0.1))).refused, R::kNo);
  EXPECT_NE(grasp(standing(Vec3(0.5, 0, 0), Vec3(0.0499, 0.2, 0.1))).refused, R::kNo);
}

TEST(Grasp, JointsAreThoseOfTheForwardWay) {
  const GraspConfig c;
  rt::Random random(7);
  int reached = 0;
  for (int n = 0; n < 20000; ++n) {
    const double q[3] = {random.uniform(-1.1, 1.5), random.uniform(-2.5, 2.5),
                         random.uniform(-1.7, 1.7)};
    const double x = c.upper_m * std::sin(q[0]) + c.fore_m * std::sin(q[0] + q[1]);
    const double z = c.upper_m * std::cos(q[0]) + c.fore_m * std::cos(q[0] + q[1]);
    const double pitch = q[0] + q[1] + q[2];
    std::array<double, 3> joints{};
    ASSERT_TRUE(arm_joints(x, z, pitch, c, joints))
        << n << ": there is at least the one it came from";
    ++reached;
    EXPECT_NEAR(c.upper_m * std::sin(joints[0]) + c.fore_m * std::sin(joints[0] + joints[1]), x,
                1e-9);
    EXPECT_NEAR(c.upper_m * std::cos(joints[0]) + c.fore_m * std::cos(joints[0] + joints[1]), z,
                1e-9);
    EXPECT_NEAR(joints[0] + joints[1] + joints[2], pitch, 1e-12);
  }
  EXPECT_EQ(reached, 20000);
  std::array<double, 3> joints{};
  EXPECT_FALSE(arm_joints(0.3, 0, 0, c, joints)) << "farther than the arm is long";
}

TEST(Grasp, WhatEveryGraspKeeps) {
  constexpr std::uint64_t kSeed = 20240611;
  std::printf("  seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  const GraspConfig c;
  int found = 0, sides = 0, refused[5] = {};
  for (int n = 0; n < 4000; ++n) {
    ObjectBox b;
    b.X_WO.linear() =
        Eigen::AngleAxisd(random.uniform(0, 3),
                          Vec3(random.normal(), random.normal(), random.normal()).normalized())
            .toRotationMatrix();
    b.X_WO.translation() =
        Vec3(random.uniform(0, 1), random.uniform(-1, 1), random.uniform(0.03, 0.7));
    b.extent_m =
        Vec3(random.uniform(0.02, 0.12), random.uniform(0.02, 0.12), random.uniform(0.02, 0.2));
    b.centre_m = Vec3(random.uniform(-0.02, 0.02), 0, random.uniform(-0.02, 0.02));
    const Grasp g = grasp(b, c);
    ++refused[static_cast<std::size_t>(g.refused)];
    if (g.refused != Grasp::Refused::kNo) {
      EXPECT_EQ(g.kind, Grasp::Kind::kNone);
      continue;
    }
    ++found;
    sides += g.kind == Grasp::Kind::kSide ? 1 : 0;
    const auto& R = g.X_WG.linear();
    EXPECT_NEAR((R.transpose() * R - perception::Mat3::Identity()).norm(), 0, 1e-9);
    EXPECT_NEAR(R.determinant(), 1, 1e-9);
    EXPECT_NEAR(R(2, 0), 0, 1e-9) << "closes level";
    // Width and what the tips go into, by the corners.
    double lo[2] = {1e9, 1e9}, hi[2] = {-1e9, -1e9};
    for (int k = 0; k < 8; ++k) {
      const Vec3 s((k & 1) != 0 ? 0.5 : -0.5, (k & 2) != 0 ? 0.5 : -0.5, (k & 4) != 0 ? 0.5 : -0.5);
      const Vec3 p = b.X_WO * (b.centre_m + s.cwiseProduct(b.extent_m));
      for (int a = 0; a < 2; ++a) {
        const double along = R.col(2 * a).dot(p - g.X_WG.translation());
        lo[a] = std::min(lo[a], along), hi[a] = std::max(hi[a], along);
      }
    }
    EXPECT_NEAR(hi[0] - lo[0], g.width_m, 1e-9);
    EXPECT_NEAR(hi[0] + lo[0], 0, 1e-9) << "in the middle between the fingers";
    EXPECT_LE(g.opening_m, c.opening_most_m + 1e-12);
    EXPECT_GE(g.width_m, c.opening_most_m - c.stroke_m - 1e-12);
    EXPECT_GT(-lo[1], 0) << "within it";
    EXPECT_LE(-lo[1], c.finger_m + 1e-9) << "no deeper than the fingers are long";
    expect_reached(g, c);
    EXPECT_GE(g.base_m, c.front_m + c.front_clear_m);
  }
  std::printf(
      "  %d of 4000 can be taken, %d from the side; %d too wide, %d too thin, %d out of reach\n",
      found, sides, refused[2], refused[3], refused[4]);
  EXPECT_GT(found, 100);
  EXPECT_GT(sides, 10);
  EXPECT_EQ(refused[1], 0);
}

// ---------------------------------------------------------------- as a goal

struct Wanted {
  tests::Story s;
  PlanningTask task{tests::startup.token(), config(), 42};
  ObjectList list;

  static PlanningConfig config() {
    PlanningConfig c;
    c.object_goal = "grasp";
    return c;
  }
  // A box on the floor, or on a board, at (1, 1); about it the base's centre can not be.
  explicit Wanted(const Vec3& extent, double z = 0) {
    s.box(0.6, 0.6, 1.4, 1.4, perception::CostMap::kInscribed);
    s.box(0.95, 0.95, 1.05, 1.05);
    s.mark({1, 1, z + extent.z()});
    job();
    list.seq = 1;
    list.size = 1;
    list.mark_seq = s.event_seq - 2;
    list.touched = 3;
    auto& e = list.entries[0];
    e.id = 3;
    e.serial = 8;
    e.seen = e.summarised = true;
    const ObjectBox b = standing(Vec3(1, 1, z), extent, 0.3);
    e.X_WO = b.X_WO;
    e.extent_m = extent;
    s.in.objects = &list;
  }
  void job() {
    ++s.tick.k;
    s.tick.start += std::chrono::milliseconds(100);
    s.health = task.step(s.tick, s.in, s.out);
    s.in.event_count = 0;
  }
};

TEST(GraspGoal, TheBaseGoesWhereTheArmReaches) {
  for (const bool aside : {false, true}) {
    Wanted w(aside ? Vec3(0.06, 0.06, 0.20) : Vec3(0.14, 0.055, 0.10), aside ? 0.38 : 0.0);
    EXPECT_EQ(w.s.out.grasp.kind, Grasp::Kind::kNone) << "not before it is known what was marked";
    w.job();
    ASSERT_NE(w.s.out.flags & PlanningTask::kGrasp, 0U);
    const Grasp g = w.s.out.grasp;
    ASSERT_EQ(g.refused, Grasp::Refused::kNo) << text_of(g.refused);
    EXPECT_EQ(g.kind, aside ? Grasp::Kind::kSide : Grasp::Kind::kTop);
    ASSERT_NE(w.s.out.flags & PlanningTask::kNewPath, 0U);
    w.s.expect_path_sound();
    const auto& end = w.s.last();
    const double away = std::hypot(end[0] - 1, end[1] - 1);
    constexpr double kCell = 0.05;
    std::printf("  base %.3f m from it; reached from %.3f to %.3f m\n", away, g.base_least_m,
                g.base_most_m);
    EXPECT_GE(away, g.base_least_m - kCell);
    EXPECT_LE(away, g.base_most_m + kCell);
    EXPECT_NEAR(std::remainder(end[2] - std::atan2(1 - end[1], 1 - end[0]), 2 * kPi), 0, 0.05)
        << "and looks at it";
    if (aside) {
      // Where the hand comes straight from, to a cell.
      const Vec3 approach = g.X_WG.linear().col(2);
      EXPECT_LE(std::abs((end[0] - 1) * approach.y() - (end[1] - 1) * approach.x()), kCell + 1e-9);
      EXPECT_LT((end[0] - 1) * approach.x() + (end[1] - 1) * approach.y(), 0);
    }
    // The same object again asks for nothing new; pushed away, the grasp goes along.
    w.job();
    EXPECT_EQ(w.s.out.flags & (PlanningTask::kGrasp | PlanningTask::kNewPath), 0U);
    w.list.entries[0].X_WO.translation() += Vec3(-0.9, 0.3, 0);
    w.s.box(0.6 - 0.9, 0.6 + 0.3, 1.4 - 0.9, 1.4 + 0.3, perception::CostMap::kInscribed);
    w.job();
    EXPECT_NE(w.s.out.flags & PlanningTask::kGrasp, 0U);
    const auto& then = w.s.last();
    EXPECT_LE(std::hypot(then[0] - 0.1, then[1] - 1.3), w.s.out.grasp.base_most_m + kCell);
  }
}

TEST(GraspGoal, IsGivenUpWithAReasonWhereThereIsNone) {
  Wanted w(Vec3(0.3, 0.09, 0.10));
  w.job();
  EXPECT_EQ(w.s.out.grasp.refused, Grasp::Refused::kTooWide);
  EXPECT_EQ(w.s.health.fault, kFaultPlanningNoGrasp);
  EXPECT_EQ(w.s.out.state.phase, TaskState::Phase::kFailed);
  EXPECT_EQ(w.s.out.path.seq, 0U) << "the way to the mark is withdrawn";
  w.job();
  EXPECT_EQ(w.s.out.flags, 0U) << "said once";
}

TEST(GraspGoal, AMarkOnNoObjectIsApproachedAsEver) {
  Wanted w(Vec3(0.14, 0.055, 0.10));
  w.list.touched = 0;
  w.job();
  EXPECT_EQ(w.s.out.flags & PlanningTask::kGrasp, 0U);
  EXPECT_NE(w.s.out.path.seq, 0U);
}

}  // namespace
}  // namespace tasks
