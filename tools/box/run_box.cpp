#include "tools/box/run_box.hpp"

#include <cstdio>
#include <fstream>
#include <stdexcept>

#include "drivers/link/road_link.hpp"
#include "drivers/link/tcp_link.hpp"
#include "tasks/graph/frame_phase.hpp"
#include "tools/box/box_main.hpp"
#include "tools/box/run_processes.hpp"
#include "tools/files/user_folder.hpp"
#include "tools/host/run_folder.hpp"
#include "tools/record/box_recorder.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/scene/box_devices.hpp"
#include "tools/scene/host_info.hpp"
#include "tools/scene/page_hook.hpp"

namespace teletact {

namespace {

rt::Result<std::unique_ptr<drivers::LinkTransport>> open_plain(const BoxCommand& command) {
  const std::string host = command.road.host == "localhost" ? "127.0.0.1" : command.road.host;
  auto opened = command.listens ? drivers::TcpLink::listen_lasting(host, command.road.port)
                                : drivers::TcpLink::dial_lasting(host, command.road.port);
  if (!opened) return rt::Error{opened.error()};
  if (command.listens)
    std::printf("link: waits at %s:%d\n", host.c_str(), opened.value()->port());
  else
    std::printf("link: dials %s:%d\n", host.c_str(), command.road.port);
  std::fflush(stdout);
  return std::unique_ptr<drivers::LinkTransport>(std::move(opened).value());
}

drivers::RoadOptions road_of(const BoxCommand& command) {
  drivers::RoadOptions road;
  road.role = command.box;
  road.listen = command.listens;
  road.address = command.road.host;
  road.port = command.road.port;
  road.keys = command.keys;
  road.state = user_state_folder();
  road.expected_peer = command.peer;
  road.rate_Mbit_per_s = command.rate_Mbit_per_s;
  return road;
}

rt::Result<std::unique_ptr<drivers::LinkTransport>> open_keyed(const BoxCommand& command) {
  auto opened = drivers::open_road(road_of(command));
  if (!opened) return opened;
  std::printf("link: %s %s:%d, TLS, keys in %s\n", command.listens ? "waits at" : "dials",
              command.road.host.c_str(), command.road.port, command.keys.c_str());
  std::fflush(stdout);
  return opened;
}

// The other box's half stays empty.
int write_box_report(const DemoOptions& options, const BoxCommand& command, RunInfo& info,
                     const OperatorHalf& op, const RobotHalf& robot) {
  const bool is_robot = command.box == rt::Box::kRobot;
  const auto& totals = is_robot ? robot.totals : op.totals;
  const auto& log = is_robot ? robot.log : op.log;
  if (!(is_robot ? robot.complete : op.complete))
    info.problems.push_back("the box did not finish the run: its own message says why");
  for (const BoxTotals& t : totals) {
    if (t.totals.lost == 0) continue;
    info.problems.push_back("the thread of task " + std::to_string(t.task) + " ended: " +
                            std::to_string(t.totals.lost) + " of its releases were lost");
  }
  info.notes.push_back(std::string("of the ") + command.name() +
                       "'s box alone: the other box has a report of its own");
  Metrics metrics(command.name());
  add_metrics(info, op, robot, metrics);
  for (const auto& n : info.notes) std::printf("%s\n", n.c_str());
  for (const auto& p : info.problems)
    std::fprintf(stderr, "teletact %s: %s\n", command.name(), p.c_str());
  // Behind the words: where the disk is full, they are all that is left.
  if (!command.json.empty()) metrics.write(command.json);
  write_trace(options.report + "/trace.json", {&log});
  info.files.push_back("trace.json");
  write_report(options.report, make_report(info, op, robot, metrics));
  std::printf("report: %s/report.html\n", options.report.c_str());
  return info.problems.empty() ? 0 : 1;
}

// From the files that the box has left.
int report_box(const DemoOptions& options, const BoxCommand& command, const BoxPlan& plan,
               RunInfo& info) {
  OperatorHalf op;
  RobotHalf robot;
  auto& not_realtime = command.box == rt::Box::kRobot ? robot.log : op.log;
  if (command.box == rt::Box::kRobot)
    load_half(plan.folder, robot);
  else
    load_half(plan.folder, op);
  std::ifstream missing(plan.folder + "/not_realtime");
  for (std::string line; std::getline(missing, line);) not_realtime.not_realtime.push_back(line);
  info.effects = load_effects(plan.folder);
  info.admission = plan.host.admission;
  info.modes = plan.host.modes;
  info.best_effort = plan.host.request.best_effort;
  return write_box_report(options, command, info, op, robot);
}

HostPlan admit_for(const Scene& scene, const BoxCommand& command,
                   const tasks::Calibration& calibration, bool page) {
  const tasks::BestEffortShares shares = declared_shares(scene, calibration, page);
  const auto cpus = rt::affinity_cpus();
  return both_on_this_host(command) ? admit_host(scene, calibration, cpus, shares)
                                    : admit_box(scene, calibration, cpus, shares, command.box);
}

// Where capture begins; then it follows the camera (release_phase.hpp). Admission holds at any
// phase (frame_phase.hpp).
void place_capture(const Scene& scene, HostPlan& host) {
  if (!counts_from_epoch(scene)) return;
  const rt::Nanos exposure = rt::nanos_from_seconds(1e-3 * scene.camera.exposure_ms);
  for (std::size_t i = 0; i < host.specs.size(); ++i) {
    if (host.ids[i] != tasks::index_of(tasks::TaskId::kCapture)) continue;
    host.specs[i].offset = tasks::capture_offset(exposure, host.specs[i].period());
  }
}

// The shape is the demo's road in place of a real one. With keys there is a real one.
void choose_shape(const BoxCommand& command, Scene& scene) {
  if (command.plain || command.shape || !scene.link.shape.any()) return;
  scene.link.shape = {};
  std::printf(
      "link: the scene's link.shape is for the demo, and is not applied to a road with keys "
      "(--shape applies it)\n");
}

// Before the box has an epoch: a person may take as long as it takes.
void wait_for_robot(rt::NonRealtime& nrt, const Scene& scene) {
  try {
    await_motor_bus(nrt, scene, [] { return g_stop_requested.load(); });
  } catch (const std::runtime_error& e) {
    if (g_stop_requested.load()) throw Stopped(std::string("stopped: ") + e.what());
    throw CouldNotStart(e.what());
  }
}

}  // namespace

bool both_on_this_host(const BoxCommand& command) {
  return command.one_host || is_loopback(command.road.host);
}

void check_link(const BoxCommand& command) {
  if (command.plain) return;
  const auto good = drivers::RoadLink::check(road_of(command));
  if (!good) throw CouldNotStart(good.error());
}

int run_box(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& options,
            const BoxCommand& command, const tasks::Calibration& calibration, RunInfo& info) {
  BoxPlan plan;
  plan.calibration = as_asked(calibration, scene);
  choose_shape(command, scene);
  plan.clock[0] = plan.clock[1] = {};  // each box has a clock of its own: this machine's
  plan.host = admit_for(scene, command, calibration, options.page != nullptr);
  if (!plan.host.refusal.empty()) throw CouldNotStart("admission: " + plan.host.refusal);
  place_capture(scene, plan.host);
  if (plan.host.voxel_m > 0) scene.graph.fusion.tsdf.voxel_size_m = plan.host.voxel_m;
  try {
    check_room(plan, command.box);
  } catch (const std::runtime_error& e) {
    throw CouldNotStart(e.what());
  }
  if (!options.quiet) std::printf("%s\n", admission_text(plan.host).c_str());
  plan.folder = options.report + "/raw";
  clear_run_folder(plan.folder);
  if (options.record) save_setup(plan.folder, scene, "");
  plan.open_link = [&command] { return command.plain ? open_plain(command) : open_keyed(command); };
  if (command.box == rt::Box::kRobot) wait_for_robot(nrt, scene);
  // Time to build the box; a recording is decoded whole before that.
  const std::int64_t lead = scene.rgbd_dir.empty() ? 3000000000 : 12000000000;
  plan.epoch_host_ns = rt::monotonic_ns() + lead;
  const int code = command.box == rt::Box::kRobot ? run_robot_process(nrt, scene, options, plan)
                                                  : run_operator_process(nrt, scene, options, plan);
  if (code == 3) return code;
  say_black_boxes(plan.folder);
  int reported = 1;
  try {
    reported = report_box(options, command, plan, info);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "teletact %s: %s\n", command.name(), e.what());
  }
  return code != 0 ? code : reported;
}

}  // namespace teletact
