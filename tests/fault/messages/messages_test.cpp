// Message faults on the virtual clock: each kind on its edge has the reaction that docs/faults.md
// and the edge table (`beyond`) promise.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "config/fault_plan.hpp"
#include "tasks/edges/edge_faults.hpp"
#include "tests/fault/messages/faulty_run.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/whole.hpp"

namespace {

using messages::Line;
using messages::run;
using messages::startup;
using rt::FaultEntry;
using rt::FaultKind;
using rt::FaultPlan;
using tasks::TouchEvent;
using teletact::VirtualRun;
using namespace std::chrono_literals;

double since(const teletact::OperatorHalf& h, rt::Time t) {
  return 1e-9 * static_cast<double>(rt::ns_of(t) - h.epoch_ns);
}
double since(const teletact::RobotHalf& h, rt::Time t) {
  return 1e-9 * static_cast<double>(rt::ns_of(t) - h.epoch_ns);
}
double largest_force(const VirtualRun& r, double from, double to) {
  double f = 0;
  for (const auto& s : r.op.view.haptic) {
    const double t = since(r.op, s.stamp);
    if (t >= from && t < to) f = std::max(f, static_cast<double>(s.force_N));
  }
  return f;
}
double largest_speed(const VirtualRun& r, double from, double to) {
  double v = 0;
  for (const auto& s : r.robot.view.robot) {
    const double t = since(r.robot, s.stamp);
    if (t >= from && t < to) v = std::max(v, static_cast<double>(s.speed_m_per_s));
  }
  return v;
}
std::size_t jobs_with(const rt::RunLog& log, tasks::TaskId id, rt::FaultId fault, double from_s,
                      std::int64_t epoch) {
  std::size_t n = 0;
  for (const auto& t : log.tasks) {
    if (t.id != static_cast<std::uint16_t>(id)) continue;
    for (const auto& j : t.jobs) {
      n += j.fault == fault && static_cast<double>(j.start_ns - epoch) * 1e-9 >= from_s ? 1 : 0;
    }
  }
  return n;
}

// ---- plans

FaultPlan plan_of(FaultKind kind, const std::string& target) {
  FaultEntry e;
  e.kind = kind;
  e.target = target;
  e.magnitude = kind == FaultKind::kStale ? rt::Nanos{1000} : rt::Nanos{0};
  FaultPlan p;
  p.name = "p";
  p.entries = {e};
  return p;
}

TEST(MessagePlans, EveryShippedPlanNamesTasksAndEdgesThatExist) {
  int plans = 0;
  for (const auto& f : std::filesystem::directory_iterator(tests::in_tree("config/faults"))) {
    const auto plan = config::load_fault_plan(f.path());
    ASSERT_TRUE(plan) << plan.error();
    const auto good = tasks::check_faults(plan.value());
    EXPECT_TRUE(good) << f.path() << ": " << good.error();
    ++plans;
  }
  EXPECT_GE(plans, 10);
}

TEST(MessagePlans, AnUnknownTargetOrAKindThatMeansNothingIsOneError) {
  const auto unknown = tasks::check_faults(plan_of(FaultKind::kDrop, "force"));
  ASSERT_FALSE(unknown);
  EXPECT_NE(unknown.error().find("no such edge"), std::string::npos) << unknown.error();
  EXPECT_NE(unknown.error().find("robot_state"), std::string::npos) << "it lists what there is";
  for (const auto& [kind, edge] :
       std::vector<std::pair<FaultKind, std::string>>{{FaultKind::kRingFull, "patch"},
                                                      {FaultKind::kNan, "frame"},
                                                      {FaultKind::kNan, "mode"}}) {
    const auto refused = tasks::check_faults(plan_of(kind, edge));
    ASSERT_FALSE(refused) << edge;
    EXPECT_EQ(refused.error().find('\n'), std::string::npos);
    EXPECT_NE(refused.error().find(edge), std::string::npos) << refused.error();
  }
  for (const auto& row : tasks::kEdgeTable) {
    EXPECT_TRUE(tasks::check_faults(plan_of(FaultKind::kDrop, std::string(row.name)))) << row.name;
  }
}

// ---- the gate itself

TEST(EdgeGate, LatestKinds) {
  auto& nrt = startup().token();
  rt::Latest<drivers::RobotGoal> cell(nrt, {1});
  FaultPlan plan;
  const auto at = [&](FaultKind kind, std::uint64_t n, rt::Nanos magnitude = rt::Nanos{0}) {
    FaultEntry e;
    e.kind = kind;
    e.target = "goal";
    e.first = n;
    e.count = 1;
    e.magnitude = magnitude;
    plan.entries.push_back(e);
  };
  at(FaultKind::kDrop, 1);
  at(FaultKind::kDuplicate, 2);
  at(FaultKind::kStale, 3, 5ms);
  at(FaultKind::kNan, 4);
  tasks::EdgeGate gate(plan, "goal");
  const auto send = [&](std::uint64_t n) {
    auto& slot = cell.begin_write();
    slot = {};
    slot.seq = n;
    slot.made = rt::time_from_ns(100000000);
    slot.x_m = 1;
    (void)tasks::publish(gate, cell, slot, slot.made);
    const auto got = cell.acquire(0);
    return std::pair<std::uint64_t, drivers::RobotGoal>{got.seq, *got};
  };
  EXPECT_EQ(send(0).first, 1U);
  const auto dropped = send(1);
  EXPECT_EQ(dropped.first, 1U);
  EXPECT_EQ(dropped.second.seq, 0U) << "the reader keeps what it had";
  const auto twice = send(2);
  EXPECT_EQ(twice.first, 3U);
  EXPECT_EQ(twice.second.seq, 2U);
  EXPECT_EQ(rt::ns_of(send(3).second.made), 95000000);
  EXPECT_TRUE(std::isnan(send(4).second.x_m));
  EXPECT_EQ(send(5).second.x_m, 1);
}

TEST(EdgeGate, WhatARingRefusedIsFlaggedInTheNextEventThatFits) {
  rt::Ring<TouchEvent, 4> ring;
  tasks::EdgeGate none;
  bool gap = false;
  TouchEvent e;
  for (e.seq = 1; e.seq <= 6; ++e.seq) tasks::push(none, ring, e, gap);
  EXPECT_TRUE(gap) << "5 and 6 did not fit";
  EXPECT_EQ(ring.dropped(), 2U);
  TouchEvent out;
  for (std::uint64_t i = 1; i <= 4; ++i) {
    ASSERT_TRUE(ring.try_pop(out));
    EXPECT_EQ(out.seq, i);
    EXPECT_FALSE(out.gap);
  }
  tasks::push(none, ring, e, gap);
  ASSERT_TRUE(ring.try_pop(out));
  EXPECT_EQ(out.seq, 7U);
  EXPECT_TRUE(out.gap);
  tasks::push(none, ring, e, gap);
  ASSERT_TRUE(ring.try_pop(out));
  EXPECT_FALSE(out.gap) << "said once";
}

TEST(EdgeGate, AnEditThatDoesNotGoIsRefusedToItsWriter) {
  rt::Ring<tasks::SceneEdit, 2> ring;
  tasks::EdgeGate none;
  tasks::SceneEdit e;
  for (e.seq = 1; e.seq <= 3; ++e.seq) EXPECT_EQ(tasks::push(none, ring, e), e.seq <= 2);
  tasks::SceneEdit out;
  while (ring.try_pop(out)) {
  }
  FaultPlan plan;
  for (const auto& [kind, first] : {std::pair{FaultKind::kDrop, 0},
                                    {FaultKind::kRingFull, 1},
                                    {FaultKind::kNan, 2},
                                    {FaultKind::kDuplicate, 3}}) {
    FaultEntry f;
    f.kind = kind;
    f.target = "edit";
    f.first = static_cast<std::uint64_t>(first);
    f.count = 1;
    plan.entries.push_back(f);
  }
  tasks::EdgeGate gate(plan, "edit");
  EXPECT_FALSE(tasks::push(gate, ring, e));
  EXPECT_FALSE(tasks::push(gate, ring, e));
  EXPECT_FALSE(ring.try_pop(out));
  EXPECT_TRUE(tasks::push(gate, ring, e));
  ASSERT_TRUE(ring.try_pop(out));
  EXPECT_TRUE(std::isnan(out.centre_W[0]));
  EXPECT_TRUE(tasks::push(gate, ring, e));
  EXPECT_TRUE(ring.try_pop(out) && ring.try_pop(out)) << "twice";
}

// ---- the stack

TEST(MessageFaults, PatchesThatStopComingMakeTheHandLimp) {
  const auto r = run(4.4, {{"drop", "patch", 100, 1, 15}});  // 3.33 s to 3.83 s
  EXPECT_GT(largest_force(r, 3.0, 3.33), 1.0);
  EXPECT_LT(largest_force(r, 3.33 + 0.1 + 0.1 + 0.05, 3.82), 0.01);
  EXPECT_GT(largest_force(r, 4.0, 4.4), 1.0) << "back with the patch";
  EXPECT_GT(jobs_with(r.op.log, tasks::TaskId::kHaptic, 102, 3.3, r.op.epoch_ns), 100U);
}

TEST(MessageFaults, EventsThatTheRingRefusedDropTheOpenMark) {
  const auto r = run(5.2, {{"ring_full", "touch", 3, 2}});
  EXPECT_EQ(r.op.view.task.marks, 0U);
  EXPECT_EQ(r.op.view.paths.size(), 0U);
  EXPECT_GT(jobs_with(r.op.log, tasks::TaskId::kPlanning, 404, 0, r.op.epoch_ns), 0U);
}

TEST(MessageFaults, GoalsThatAreNotFiniteOrOldHaltTheRobot) {
  const auto logs = std::filesystem::temp_directory_path() /
                    ("teletact-messages-logs-" + std::to_string(::getpid()));
  const auto r = run(9, {{"nan", "goal", 108, 1, 28}, {"stale", "goal", 147, 1, 28, 500000}}, logs);
  // What the tasks said, in words.
  const auto text = [&](const char* file) {
    std::stringstream s;
    s << std::ifstream(logs / file).rdbuf();
    return s.str();
  };
  const std::string op = text("operator.log"), robot = text("robot.log");
  for (const char* line : {"supervision: mode 1 -> 2", "haptic: contact begins at",
                           "planning: mark 1 taken", "planning: path 1 made"}) {
    EXPECT_NE(op.find(line), std::string::npos) << line << " is not in\n" << op;
  }
  for (const char* line : {"robot_supervision: mode 1 -> 2", "robot_io: goal refused, not finite",
                           "robot_io: goal expired"}) {
    EXPECT_NE(robot.find(line), std::string::npos) << line << " is not in\n" << robot;
  }
  EXPECT_EQ(r.op.view.log_dropped + r.robot.view.log_dropped, 0U);
  std::filesystem::remove_all(logs);
  EXPECT_GT(largest_speed(r, 5.0, 5.5), 0.1);
  EXPECT_LT(largest_speed(r, 5.5 + 0.4 + 0.1, 6.75), 0.01) << "not finite: refused, then expired";
  EXPECT_GT(largest_speed(r, 7.0, 7.5), 0.1) << "goes on by itself";
  EXPECT_LT(largest_speed(r, 7.5 + 0.4 + 0.1, 8.6), 0.01) << "old";
  EXPECT_GT(jobs_with(r.robot.log, tasks::TaskId::kRobotIo, 504, 5.4, r.robot.epoch_ns), 0U);
  EXPECT_GT(jobs_with(r.robot.log, tasks::TaskId::kRobotIo, 503, 5.4, r.robot.epoch_ns), 0U);
  for (const auto& s : r.robot.view.truth) ASSERT_TRUE(std::isfinite(s.x_m + s.y_m + s.yaw_rad));
}

TEST(MessageFaults, WithoutFramesTheMapStaysWithoutStatesTheBoxesRampDown) {
  const auto r = run(6.6, {{"drop", "frame", 90, 1, 30}, {"drop", "robot_state", 500}});
  // Frames 90 to 119 of 30 a second: nothing is consumed, the map stays, the hand still feels it.
  std::size_t consumed = 0;
  std::uint32_t first = 0, last = 0;
  double frames_from = 1e9, frames_to = 0;
  rt::Time before{};
  for (const auto& s : r.op.view.fusion) {
    if (!s.consumed) continue;
    if (before != rt::Time{} && rt::seconds(s.stamp - before) > 0.5) {
      frames_from = since(r.op, before);
      frames_to = since(r.op, s.stamp);
    }
    before = s.stamp;
  }
  ASSERT_LT(frames_from, frames_to) << "a gap of a second";
  EXPECT_NEAR(frames_to - frames_from, 1.03, 0.1);
  for (const auto& s : r.op.view.fusion) {
    const double t = since(r.op, s.stamp);
    if (t <= frames_from || t >= frames_to) continue;
    consumed += s.consumed ? 1 : 0;
    if (first == 0) first = s.blocks;
    last = s.blocks;
  }
  EXPECT_EQ(consumed, 0U);
  EXPECT_EQ(first, last);
  EXPECT_GT(largest_force(r, frames_from + 0.5, frames_to), 1.0);
  // States from the 500th on: 200 ms later both boxes leave the engaged mode, and stay out.
  double left = 0;
  for (const auto& s : r.robot.view.robot) {
    const double t = since(r.robot, s.stamp);
    if (s.mode == static_cast<std::uint8_t>(tasks::Mode::kEngaged)) left = t;
  }
  EXPECT_GT(left, 4.8);
  EXPECT_LT(left, 5.6);
  EXPECT_GT(largest_speed(r, left - 0.3, left), 0.05);
  EXPECT_LT(largest_speed(r, left + 0.6, 7), 0.01);
  EXPECT_NE(r.op.view.mode.mode, tasks::Mode::kEngaged);
  EXPECT_EQ(r.op.view.mode.cause, tasks::kFaultLinkSilent);
  EXPECT_LT(largest_force(r, left + 0.3, 7), 0.01) << "limp until the next engage";
}

// Supervision publishes a hundred times a second; 25 of its modes do not come, later 80.
TEST(MessageFaults, ASilentModeMakesTheHandLimpAndHaltsTheRobot) {
  const auto r = run(7.4, {{"drop", "mode", 340, 1, 25}, {"drop", "mode", 560, 1, 80}});
  EXPECT_GT(largest_force(r, 3.0, 3.4), 1.0);
  EXPECT_LT(largest_force(r, 3.4 + 0.06 + 0.1 + 0.01, 3.63), 0.01) << "limp";
  EXPECT_GT(largest_force(r, 3.8, 4.2), 1.0) << "back with the mode";
  const double before = largest_speed(r, 5.3, 5.6);
  EXPECT_GT(before, 0.1);
  // Seen within a period of prediction, sent, and then no faster down than the base may.
  EXPECT_LT(largest_speed(r, 6.3, 6.4), 0.5 * before);
  EXPECT_GT(largest_speed(r, 7.1, 7.4), 0.1) << "goes on by itself";
}

// An old map makes no path; one that is under way is driven to its end.
TEST(MessageFaults, AnOldCostMapMakesNoPathAndLeavesTheOneUnderWay) {
  for (const char* kind : tests::whole_or<const char*>({"drop", "stale"}, {0})) {
    const double by_us = std::string_view(kind) == "stale" ? 5e6 : 0;
    const auto before = run(6.4, {{kind, "cost_map", 10, 1, 0, by_us}});
    EXPECT_EQ(before.op.view.task.marks, 1U) << kind;
    EXPECT_EQ(before.op.view.paths.size(), 0U) << kind;
    EXPECT_LT(largest_speed(before, 0, 7), 0.01) << kind;
    const auto after = run(12, {{kind, "cost_map", 55, 1, 0, by_us}});
    EXPECT_EQ(after.op.view.paths.size(), 1U) << kind;
    EXPECT_EQ(after.op.view.arrivals, 1U) << kind;
    EXPECT_EQ(after.robot.view.truth.back().collisions, 0U);
  }
}

// A path that nothing has confirmed for longer than its age ends where the robot then is.
TEST(MessageFaults, AnOldPathHaltsTheRobot) {
  const auto r = run(6.8, {{"stale", "path", 55, 1, 0, 1.1e7}});
  EXPECT_GT(largest_speed(r, 5.0, 5.5), 0.1);
  EXPECT_LT(largest_speed(r, 6.4, 6.8), 0.01);
  EXPECT_EQ(r.op.view.mode.mode, tasks::Mode::kEngaged);
  EXPECT_EQ(r.op.view.beyond, std::vector<std::string_view>{"path"});
}

// The published method's ray cast, whole every 400 ms from the first claimed image on: five that do
// not come, one that is no number, and old ones. The hand rests on the floor until 4.6 s.
TEST(MessageFaults, ARayCastThatDoesNotComeOrIsNoNumberGivesNoForce) {
  const std::vector<std::string> method{"haptic.method=\"force_shading\""};
  const auto count = [](const VirtualRun& r, rt::FaultId fault) {
    return jobs_with(r.op.log, tasks::TaskId::kHaptic, fault, 0, r.op.epoch_ns);
  };
  // The last that came was published at 3.4 s or a little before.
  const auto silent = run(6.5, {{"drop", "surface", 8, 1, 5}}, {}, method);
  EXPECT_GT(largest_force(silent, 3.2, 4.2), 1.0) << "touched on for a second";
  EXPECT_GT(count(silent, tasks::kFaultHapticSurfaceStale), 900U);
  EXPECT_LT(count(silent, tasks::kFaultHapticSurfaceStale), 1800U);
  EXPECT_LT(largest_force(silent, 4.56, 5.6), 0.01) << "ramped to zero";
  EXPECT_EQ(jobs_with(silent.op.log, tasks::TaskId::kHaptic, tasks::kFaultHapticSurfaceStale, 6.0,
                      silent.op.epoch_ns),
            0U)
      << "back with the next one";
  const auto nan = run(5, {{"nan", "surface", 8, 1, 1}}, {}, method);
  EXPECT_GT(count(nan, tasks::kFaultHapticBadPatch), 350U);
  EXPECT_LT(count(nan, tasks::kFaultHapticBadPatch), 450U);
  EXPECT_EQ(count(nan, tasks::kFaultHapticSurfaceStale), 0U);
  for (const auto& s : nan.op.view.haptic) ASSERT_TRUE(s.finite);
  // Old ones, on time: told, and touched on.
  const auto old = run(5, {{"stale", "surface", 8, 1, 5, 2e6}}, {}, method);
  EXPECT_EQ(count(old, tasks::kFaultHapticSurfaceStale), 0U);
  EXPECT_GT(largest_force(old, 3.9, 4.4), 1.0);
}

// Every kind on every edge that takes it, at random: nothing that is no number gets out, nothing is
// hit.
TEST(MessageFaults, AStormOfAllKindsLeavesTheOutputsSane) {
  std::vector<Line> storm;
  for (const auto& row : tasks::kEdgeTable) {
    for (int k = static_cast<int>(FaultKind::kRingFull); k < rt::kFaultKinds; ++k) {
      const auto kind = static_cast<FaultKind>(k);
      if (!tasks::edge_takes(row.id, kind)) continue;
      storm.push_back({std::string(rt::name_of(kind)), std::string(row.name), 20, 1, 0,
                       kind == FaultKind::kStale ? 30000.0 : 0.0, 0.03});
    }
  }
  EXPECT_GT(storm.size(), 40U);
  const auto r = run(7, storm);
  for (const auto& s : r.op.view.haptic) {
    ASSERT_TRUE(s.finite);
    ASSERT_TRUE(std::isfinite(s.force_N));
    ASSERT_LE(s.force_N, 12.0F);
  }
  for (const auto& s : r.robot.view.truth) {
    ASSERT_TRUE(std::isfinite(s.x_m + s.y_m + s.yaw_rad));
    ASSERT_EQ(s.collisions, 0U);
  }
  EXPECT_GT(largest_force(r, 2, 7), 0.5) << "it still works";
}

}  // namespace
