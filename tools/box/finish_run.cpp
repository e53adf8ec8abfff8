#include "tools/box/finish_run.hpp"

#include <algorithm>
#include <cstdio>

#include "tools/host/run_folder.hpp"
#include "tools/host/run_truth.hpp"
#include "tools/host/script_goal.hpp"
#include "tools/record/recording_truth.hpp"
#include "tools/scene/host_info.hpp"

namespace teletact {

namespace {

void print_metrics(const Metrics& metrics) {
  for (const auto& r : metrics.rows()) {
    if (r.is_text)
      std::printf("  %-36s %s\n", r.name.c_str(), r.text.c_str());
    else
      std::printf("  %-36s %.6g %s\n", r.name.c_str(), r.value,
                  r.unit == "1" ? "" : r.unit.c_str());
  }
}

// A task whose thread ended was made safe, but such a run is no orderly one.
void note_dead_tasks(const rt::RunLog& log, const std::vector<BoxTotals>& totals,
                     std::vector<std::string>& problems) {
  for (const auto& task : log.tasks) {
    for (const auto& t : totals) {
      if (t.task != task.id || t.totals.lost == 0) continue;
      problems.push_back("the thread of task " + task.spec.name +
                         " ended: " + std::to_string(t.totals.lost) + " of its releases were lost");
    }
  }
}

// A hand that chose its places: which, and whether they were enough.
void check_touches(const DemoOptions& options, const Scene& scene, RunInfo& info,
                   const OperatorHalf& op) {
  const auto asked =
      std::count_if(scene.hand.segments.begin(), scene.hand.segments.end(),
                    [](const auto& s) { return s.source == "chosen" && s.kind == "press"; });
  if (asked == 0 || info.stub_bodies || !op.complete) return;
  const TouchedPlaces touched = touched_of(op);
  const std::string what = touched.text();
  info.notes.push_back("touched: " + (what.empty() ? "nothing" : what));
  const bool judged =
      info.stopped_early.empty() && options.fault_plan.empty() && options.cut_link_at_s < 0;
  const std::string few = too_few_touches(touched, static_cast<int>(asked));
  if (!few.empty()) (judged ? info.problems : info.notes).push_back(few);
}

}  // namespace

int finish_run(const DemoOptions& options, const Scene& scene, RunInfo& info,
               const OperatorHalf& op, const RobotHalf& robot, const std::string& json_path) {
  if (!scene.rgbd_dir.empty()) info.recorded = recording_figures(scene.rgbd_dir, op.view.fusion);
  if (!info.stub_bodies) {
    info.ate_first_pose_mm = rendered_figures(scene, op, robot).ate_first_pose_mm;
    if (!op.complete)
      info.problems.push_back(
          "the operator's box did not finish the run: its own message says why");
    if (!robot.complete)
      info.problems.push_back("the robot's box did not finish the run: its own message says why");
  }
  if (!scene.rgbd_dir.empty() && !info.stub_bodies && op.complete && info.stopped_early.empty() &&
      op.force_check.samples == 0)
    info.problems.push_back(
        "no press of the hand met a plane of the recording, so no force was judged: run longer, or "
        "choose another recording");
  check_touches(options, scene, info, op);
  const GoalCheck goal = check_goal(scene, options, op, robot);
  if (!goal.missed.empty() && goal.judged) info.problems.push_back(goal.missed);
  if (!goal.missed.empty() && !goal.judged)
    info.notes.push_back(goal.missed +
                         " (not judged: the run was too short, or had injected faults)");
  note_dead_tasks(op.log, op.totals, info.problems);
  note_dead_tasks(robot.log, robot.totals, info.problems);
  if (const std::string over = beyond_admission(info, op, robot); !over.empty())
    info.problems.push_back(over);
  info.touch_method = scene.graph.haptic.method;
  info.touch_N_per_m = scene.graph.haptic.stiffness_N_per_m / scene.graph.haptic.scale;
  Metrics metrics("demo");
  add_metrics(info, op, robot, metrics);
  info.config_toml = config::effective(scene.schema);
  if (!info.stub_bodies) {
    write_trace(options.report + "/trace.json", {&op.log, &robot.log});
    info.files.push_back("trace.json");
    write_report(options.report, make_report(info, op, robot, metrics));
  }
  if (!json_path.empty()) metrics.write(json_path);
  print_metrics(metrics);
  if (info.paced)
    std::printf("%s\n", info.not_real_time.c_str());
  else if (const std::string why = not_measured(info, op, robot, metrics); !why.empty())
    std::printf("timing not measured in this run: %s\n", why.c_str());
  if (const auto lost = op.dropped_records + robot.dropped_records; lost > 0) {
    std::printf("AUDIT INCOMPLETE: %llu records lost, a ring was full\n",
                static_cast<unsigned long long>(lost));
  }
  if (!info.stopped_early.empty()) std::printf("%s\n", info.stopped_early.c_str());
  for (const auto& n : info.notes) std::printf("%s\n", n.c_str());
  if (!info.give_rights.empty()) std::printf("to be real-time: %s\n", info.give_rights.c_str());
  for (const auto& p : info.problems) std::fprintf(stderr, "teletact demo: %s\n", p.c_str());
  if (!info.stub_bodies) std::printf("report: %s/report.html\n", options.report.c_str());
  return info.problems.empty() ? 0 : 1;
}

}  // namespace teletact
