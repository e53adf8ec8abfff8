// Running the whole stack, on either clock.
#pragma once

#include <atomic>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "rt/fault/plan.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/task.hpp"
#include "rt/sched/virtual_executor.hpp"
#include "rt/store/run_store.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/host/host_admission.hpp"
#include "tools/host/run_results.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

inline constexpr double kWholeDemo_s = 20;  // of a scene without a recording

class PageHook;

struct DemoOptions {
  std::string scene_path;
  std::vector<std::string> overrides;
  std::string rgbd_dir;  // empty: the synthetic place
  double seconds = kWholeDemo_s;
  bool virtual_clock = false, stub_bodies = false;
  bool paced = false;      // virtual clock: not ahead of the real one
  std::string log_folder;  // virtual clock: where the tasks' logs go; empty: nowhere
  // Virtual clock: folder of the job records of both boxes; empty: in memory, the newest whole.
  std::string store_folder;
  rt::StoreOptions store;
  std::string report = "report";  // folder
  std::string calibration;        // file; empty: the built-in reference (virtual) or the host's
  std::string fault_plan;         // file; empty: the plain executor
  std::string force_choice;       // calibration: this static choice ("20 mm")
  bool quiet = false;
  std::string command;  // as typed, for the report
  std::uint64_t cost_seed = 1;
  int cores = 4;              // of the virtual clock's host; the declared budgets are for four
  double cut_link_at_s = -1;  // the cable is cut then
  double black_box_s = 5;     // seconds that a black box holds; 0: none
  double passer_from_s = -1;  // virtual clock: somebody walks before the camera from then on
  PageHook* page = nullptr;   // somebody sits at a page; null: nobody (page_hook.hpp)
  bool record = false;        // inputs of both boxes to <report>/raw, for a replay
  std::string save_map;       // file for fusion's map at the end; empty: none
  // Virtual clock, for tests: called once, between two jobs, at this instant of the run.
  double meddle_at_s = -1;
  std::function<void(std::int64_t ns)> each_minute;  // of the run; since its start
  std::function<void(OperatorBox&)> meddle;
  // Virtual clock, for tests: before and after the robot's box is built.
  std::function<void(BoxOptions&)> robot_options;
  std::function<void(RobotBox&)> robot_built;
  // Virtual clock, for benches: replacements of a task's body and of the link; empty: the real
  // ones.
  std::function<rt::TaskBody*(tasks::TaskId, rt::TaskBody&)> wrap_body;
  std::function<rt::Actor*(rt::Actor&)> wrap_link;
};

// Set by the signal handler: ramp down, then stop. The instant of the request (host clock, 0: none
// yet), and the request to the box's supervision, which the handler sets itself so that no loop has
// to notice it first.
extern std::atomic<bool> g_stop_requested;
extern std::atomic<std::int64_t> g_stop_asked_ns;
extern std::atomic<std::atomic<bool>*> g_ramp_down;
// What a black box then says.
inline constexpr const char* kAskedToEnd = "asked to end (SIGINT, SIGTERM or SIGHUP)";
// From here on SIGINT, SIGTERM and a terminal that is gone (SIGHUP, but under nohup) set them
// instead of ending the process, and what only ends writing (SIGPIPE, SIGXFSZ) does nothing.
void catch_signals();
// Asked to end before there was anything to report. Exit code 1.
struct Stopped : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The robot's clock of the demo: 1000 s ahead and 50 ppm fast.
inline constexpr rt::BoxTime kOperatorClock{0, 0};
inline constexpr rt::BoxTime kRobotClock{1000000000000LL, 50};

struct VirtualRun {
  OperatorHalf op;
  RobotHalf robot;
  std::uint64_t sched_hash = 0, log_hash = 0;
  Effects effects;
  rt::Admission admission;
  rt::ModeTable modes;
  std::int64_t link_cpu_ns = 0;  // of both ends
  double seconds = 0;            // of simulated time that ran
  double wall_s = 0, lag_s = 0;  // paced: real time that it took, and what it was behind for good
  bool stopped_early = false;
};
// One process, simulated time; ends between two jobs when g_stop_requested is set. `log` in the
// halves holds each box's tasks. Sets the scene's voxel size to the admitted one.
[[nodiscard]] VirtualRun run_virtual(rt::NonRealtime&, Scene&, const DemoOptions&,
                                     const tasks::Calibration&);

}  // namespace teletact
