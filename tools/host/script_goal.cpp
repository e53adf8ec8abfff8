#include "tools/host/script_goal.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tasks/robot_io/robot_io_task.hpp"
#include "tools/host/run_truth.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

namespace {

struct Script {
  double marked_s = -1;  // end of the last mark; below 0: it marks nothing
  double end_s = 0;
};

Script script_of(const drivers::HandScriptConfig& hand) {
  Script s;
  s.end_s = hand.start_after_s;
  for (const auto& segment : hand.segments) {
    if (segment.kind == "button_up") s.marked_s = s.end_s;
    s.end_s += segment.time_s;
  }
  return s;
}

// Half of the speed limit on the average, and a while to set off and to settle: who takes longer is
// late.
double time_for(const tasks::Path& path, double speed_m_per_s) {
  double way = 0;
  for (std::int32_t i = 1; i < path.size; ++i) {
    const auto& a = path.points[static_cast<std::size_t>(i - 1)];
    const auto& b = path.points[static_cast<std::size_t>(i)];
    way += std::hypot(b[0] - a[0], b[1] - a[1]);
  }
  return way / (0.5 * speed_m_per_s) + 3.0;
}

std::string metres(const char* format, double m) {
  char text[100];
  std::snprintf(text, sizeof text, format, m);
  return text;
}

// Of the true robot to the end of the newest path; below 0: not known.
double left_m(const OperatorHalf& op, const RobotHalf& robot) {
  if (op.view.paths.empty() || op.view.paths.back().size <= 0 || robot.view.truth.empty())
    return -1;
  const auto& path = op.view.paths.back();
  const auto& end = path.points[static_cast<std::size_t>(path.size - 1)];
  return std::hypot(robot.view.truth.back().x_m - end[0], robot.view.truth.back().y_m - end[1]);
}

// Farthest that the true robot was from a goal when it was said to have arrived there; below 0: not
// known.
double worst_arrival_m(const OperatorHalf& op, const RobotHalf& robot) {
  double worst = -1;
  for (const Arrival& a : op.view.arrived)
    if (const auto X_WB = true_base_at(robot, a.stamp))
      worst = std::max(worst, std::hypot(X_WB->x - a.goal_x_m, X_WB->y - a.goal_y_m));
  return worst;
}

// Goals were not engaged when the run ended, or the robot let them expire.
bool held_at_end(const OperatorView& view) {
  if (view.engages == 0) return false;
  return view.world.held != tasks::Held::kNo ||
         view.robot.fault == tasks::robot_io_fault::kGoalExpired;
}

// "; held for 3.2 s: robot state 612 ms old, limit 500 ms"; empty: it was not.
std::string why_held(const OperatorView& view) {
  if (view.held_s > 0)
    return metres("; held for %.1f s: ", view.held_s) +
           held_text(view.held, view.held_ms, view.held_limit_ms);
  if (view.world.held == tasks::Held::kPlaceUnsure)
    return metres("; held for %.1f s: ", view.unsure_s) +
           held_text(view.world.held, view.world.held_ms, view.world.held_limit_ms);
  return held_at_end(view) && view.robot.fault != rt::kNoFault ? "; " + fault_text(view.robot.fault)
                                                               : "";
}

std::string stopped(const OperatorView& view) {
  const tasks::ModeMsg& mode = view.mode;
  if (mode.seq == 0 || mode.mode == tasks::Mode::kEngaged) return {};
  std::string text = mode.mode == tasks::Mode::kSafeStop   ? "; at the end: safe stop"
                     : mode.mode == tasks::Mode::kRampDown ? "; at the end: ramp down"
                                                           : "; at the end: not engaged";
  if (mode.cause != rt::kNoFault) text += ", " + cause_text(mode.cause, view.robot);
  return text;
}

}  // namespace

GoalCheck check_goal(const Scene& scene, const DemoOptions& options, const OperatorHalf& op,
                     const RobotHalf& robot) {
  using Phase = tasks::TaskState::Phase;
  GoalCheck c;
  const Script script = script_of(scene.hand);
  const auto& task = op.view.task;
  c.asked = !options.stub_bodies && options.rgbd_dir.empty() && scene.choice.in_process() &&
            scene.camera_choice.in_process() && script.marked_s >= 0 &&
            script.marked_s < options.seconds &&
            scene.operator_script.engage_after_s < options.seconds;
  if (!c.asked) return c;
  c.judged = options.seconds >= script.end_s && options.fault_plan.empty() &&
             options.cut_link_at_s < 0 && !g_stop_requested.load() && op.complete && robot.complete;
  const double left = left_m(op, robot);
  const std::string off = left < 0 ? "" : metres("%.2f m off, ", left);
  if (task.marks == 0) {
    c.missed = "the hand drew no mark (the figures list its contacts)";
  } else if (op.view.paths.empty()) {
    c.missed = (task.failures > 0 ? "no path to the mark was found" : "no path was made") +
               why_held(op.view);
  } else if (task.phase == Phase::kArrived) {
    const double worst = std::max(left, worst_arrival_m(op, robot));
    if (worst > kGoalReached_m)
      c.missed =
          metres("arrived by its own odometry, but %.2f m off in the simulated world", worst) +
          (left > kGoalReached_m ? "" : ", at an earlier goal");
  } else if (task.phase == Phase::kShort) {
    c.missed = goal_text(task) + why_held(op.view);
  } else if (task.phase == Phase::kFailed) {
    c.missed = off + "no path to it was found after the drive began" + why_held(op.view);
  } else if (task.phase == Phase::kDriving) {
    const double due =
        1e-9 * static_cast<double>(rt::ns_of(op.view.paths.back().made) - op.epoch_ns) +
        time_for(op.view.paths.back(), scene.graph.robot_io.trajectory.speed_m_per_s);
    const bool held = held_at_end(op.view);
    c.missed = off + (held ? "the base stands" : "the base was on its way when the run ended") +
               why_held(op.view);
    // Who asks for less time than the way takes, gets less way; a base that is held gets nowhere in
    // any time.
    if (!held && options.seconds < kWholeDemo_s && due > options.seconds) c.judged = false;
  } else {
    c.missed =
        off + (task.phase == Phase::kPlanning ? "waiting for a path" : "the drive was broken off") +
        why_held(op.view);
  }
  if (!c.missed.empty()) c.missed = "goal not reached: " + c.missed + stopped(op.view);
  return c;
}

}  // namespace teletact
