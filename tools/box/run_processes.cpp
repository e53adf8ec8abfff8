#include "tools/box/run_processes.hpp"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "config/fault_plan.hpp"
#include "drivers/world/world.hpp"
#include "tasks/edges/edge_faults.hpp"
#include "tools/box/box_main.hpp"
#include "tools/host/run_folder.hpp"
#include "tools/record/box_recorder.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/scene/page_hook.hpp"

namespace teletact {

namespace {

struct Child {
  const char* name;
  pid_t pid = 0;
  bool running = true;
};

// What a child's end means for the run; empty for an orderly end.
std::string verdict(const Child& c, int status) {
  if (WIFSIGNALED(status)) {
    return std::string("the ") + c.name + " process was killed by signal " +
           std::to_string(WTERMSIG(status));
  }
  const int code = WEXITSTATUS(status);
  if (code == 0) return {};
  return std::string("the ") + c.name + " process ended with code " + std::to_string(code) +
         (code == 3              ? " (could not start: its own message says why)"
          : code == kTaskHung    ? " (a task hung and its device was made safe)"
          : code == kFileRefused ? " (the disk refused a file of it: its own message says which)"
                                 : "");
}

// Throws CouldNotStart where the host has no room for the tasks, and std::runtime_error where the
// fault plan is wrong. Nothing of an earlier run is touched before.
BoxPlan box_plan_of(Scene& scene, const DemoOptions& options,
                    const tasks::Calibration& calibration) {
  BoxPlan plan;
  plan.calibration = as_asked(calibration, scene);
  plan.host = admit_host(scene, calibration, rt::affinity_cpus(),
                         declared_shares(scene, calibration, options.page != nullptr));
  if (!plan.host.refusal.empty()) throw CouldNotStart("admission: " + plan.host.refusal);
  scene.graph.fusion.tsdf.voxel_size_m = plan.host.voxel_m;
  try {
    check_room(plan);
  } catch (const std::runtime_error& e) {
    throw CouldNotStart(e.what());
  }
  if (!options.quiet) std::printf("%s\n", admission_text(plan.host).c_str());
  if (!options.fault_plan.empty()) {
    auto loaded = config::load_fault_plan(options.fault_plan);
    if (!loaded) throw std::runtime_error(loaded.error());
    if (auto good = tasks::check_faults(loaded.value()); !good)
      throw std::runtime_error(options.fault_plan + ": " + good.error());
    plan.faults = std::move(loaded).value();
    plan.planned = true;
  }
  plan.folder = options.report + "/raw";
  return plan;
}

// The operator's box and the robot's.
using Children = std::array<Child, 2>;

Children fork_boxes(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
                    const BoxPlan& plan) {
  Children children{{{"operator"}, {"robot"}}};
  for (Child& c : children) {
    c.pid = ::fork();
    if (c.pid < 0) throw std::runtime_error(std::string("fork: ") + std::strerror(errno));
    if (c.pid == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGTERM);  // without a parent there is no report: ramp down
      const bool op = &c == &children[0];
      const int code = op ? run_operator_process(nrt, scene, options, plan)
                          : run_robot_process(nrt, scene, options, plan);
      std::fflush(stdout);
      ::_exit(code);
    }
  }
  std::ofstream pids(plan.folder + "/pids");
  pids << children[0].pid << ' ' << children[1].pid << '\n';
  return children;
}

// Until both have ended; returns what went wrong.
std::vector<std::string> wait_for(Children& children) {
  std::vector<std::string> problems;
  bool forwarded = false;
  std::int64_t end_by = 0;  // once one child is gone the other gets a second to be safe, then ends
  while (children[0].running || children[1].running) {
    for (Child& c : children) {
      int status = 0;
      if (!c.running || ::waitpid(c.pid, &status, WNOHANG) != c.pid) continue;
      c.running = false;
      const std::string what = verdict(c, status);
      if (what.empty()) continue;
      problems.push_back(what);
      std::fprintf(stderr, "teletact: %s\n", what.c_str());
      end_by = rt::monotonic_ns() + 1000000000;
    }
    if ((g_stop_requested.load() || (end_by != 0 && rt::monotonic_ns() > end_by)) && !forwarded) {
      forwarded = true;
      for (const Child& c : children) {
        if (c.running) ::kill(c.pid, SIGTERM);
      }
    }
    ::usleep(5000);
  }
  return problems;
}

// What both boxes left in the run's folder.
void load_run(const std::string& folder, RealRun& run) {
  load_half(folder, run.op);
  run.effects = load_effects(folder);
  load_half(folder, run.robot);
  std::ifstream missing(folder + "/not_realtime");
  for (std::string line; std::getline(missing, line);) run.op.log.not_realtime.push_back(line);
  std::ifstream notes(folder + "/notes");
  for (std::string line; std::getline(notes, line);) {
    if (run.notes.empty()) run.notes.push_back(line);  // both boxes say the same
  }
}

}  // namespace

RealRun run_processes(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& options,
                      const tasks::Calibration& calibration) {
  RealRun run;
  BoxPlan plan = box_plan_of(scene, options, calibration);
  run.admission = plan.host.admission;
  run.modes = plan.host.modes;
  run.best_effort = plan.host.request.best_effort;
  clear_run_folder(plan.folder);
  if (options.record) save_setup(plan.folder, scene, options.fault_plan);
  // Time to build both boxes and shake hands; a recording is decoded whole before that.
  const std::int64_t lead = scene.rgbd_dir.empty() ? 3000000000 : 12000000000;
  plan.epoch_host_ns = rt::monotonic_ns() + lead;
  catch_signals();
  std::fflush(stdout);
  Children children = fork_boxes(nrt, scene, options, plan);
  run.problems = wait_for(children);
  say_black_boxes(plan.folder);
  load_run(plan.folder, run);
  return run;
}

}  // namespace teletact
