// teletact demo: both boxes on this machine, and a report at the end.
#include <sys/auxv.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <thread>

#include "rt/fault/injector.hpp"
#include "tools/box/run_real.hpp"
#include "tools/cli/options.hpp"
#include "tools/doctor/rights.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/rendered_truth.hpp"
#include "tools/host/run_folder.hpp"
#include "tools/host/script_goal.hpp"
#include "tools/record/recording_setup.hpp"
#include "tools/record/recording_truth.hpp"
#include "tools/scene/host_info.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

std::string iso_now() {
  const std::time_t t = std::time(nullptr);
  char text[32];
  std::strftime(text, sizeof text, "%FT%TZ", std::gmtime(&t));
  return text;
}

// One instruction set for a run that is to repeat on another machine. Our own vector kernels give the same
// bytes as their scalar form; what differs between processors is libm, which chooses FMA variants by
// itself. They are chosen when the program is loaded, so the program starts again with them switched off.
void start_again_scalar(char** argv) {
  constexpr const char* kTunables = "GLIBC_TUNABLES";
  constexpr const char* kScalar = "glibc.cpu.hwcaps=-AVX,-AVX2,-AVX512F,-FMA,-FMA4";
  if (::getauxval(AT_SECURE) != 0) {
    throw std::runtime_error(
        "--simd scalar: the loader takes no settings for a program whose file has capabilities; "
        "tools/run --no-rights takes them away");
  }
  const char* now = std::getenv(kTunables);
  if (now != nullptr && std::string(now) == kScalar) return;
  ::setenv(kTunables, kScalar, 1);
  // argv[0] is the subcommand; the word before it is the program's name.
  ::execv("/proc/self/exe", argv - 1);
  throw std::runtime_error(std::string("--simd scalar: the program can not start itself again: ") +
                           std::strerror(errno));
}

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

void check_bodies(const DemoOptions& o, const std::string& clock) {
  if (!o.stub_bodies) return;
  if (clock != "virtual")
    throw std::runtime_error("--bodies stub needs --clock virtual: give both");
  if (o.record) throw std::runtime_error("--record needs --bodies real");
  if (!o.save_map.empty()) throw std::runtime_error("--save-map needs --bodies real");
}

void add_store_cap(CLI::App& app, rt::StoreOptions& store) {
  app.add_option_function<std::uint64_t>(
         "--store-cap", [&store](std::uint64_t MiB) { store.cap_bytes = MiB << 20U; },
         "MiB on the disk for the job records of each box, default 256; the older ones become "
         "counts "
         "and histograms")
      ->check(CLI::Range(rt::StoreOptions::kLeastCap >> 20U, std::uint64_t{1} << 24U));
}

// With auto: the real clock where the machine gives what it needs, else the simulated one, paced. A device or a camera
// that is no twin lives in real time, whatever the machine gives.
void choose_clock(const std::string& clock, const Scene& scene, bool cores_given, DemoOptions& o,
                  RunInfo& info) {
  const bool twins = scene.choice.in_process() && scene.camera_choice.in_process();
  o.virtual_clock = clock == "virtual";
  if (o.virtual_clock) return;
  const Rights rights = find_rights();
  o.paced = clock == "paced" || (clock == "auto" && !rights.enough() && twins);
  if (o.paced) {
    o.virtual_clock = true;
    if (!cores_given) o.cores = 2;  // one thread does the work of them all: the variants of two
    info.paced = true;
    const bool wanted = clock == "paced";
    info.not_real_time =
        "not real-time, timing not measured: " + (wanted ? "--clock paced" : rights.why()) +
        "; the tasks run on the simulated clock, paced by the real one" +
        (wanted ? "" : "; to change it: " + rights.command);
    std::printf("%s\n", info.not_real_time.c_str());
  } else if (!rights.enough()) {
    info.give_rights = rights.command;
  }
}

// ran_s below 0: not known.
std::string stopped_early(const DemoOptions& o, double ran_s) {
  char text[96];
  if (ran_s < 0)
    std::snprintf(text, sizeof text, "stopped early: asked to end before its %.3g s were over",
                  o.seconds);
  else
    std::snprintf(text, sizeof text, "stopped early: %.3f s of %.6g s ran", ran_s, o.seconds);
  return text;
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

int cmd_demo(int argc, char** argv) {
  CLI::App app{
      "Runs the operator's box and the robot's box on this machine, every device a twin, and "
      "writes a report."};
  DemoOptions o;
  std::string clock = "auto", bodies = "real", json, scene_name = "default_room", simd = "auto";
  double seconds = -1;
  app.add_option("--scene", scene_name, "scene: a name from config/scenes or a file")
      ->capture_default_str();
  app.add_option("--set", o.overrides, "override a key of the scene: section.key=value");
  app.add_option("--rgbd", o.rgbd_dir, "drive fusion with a recording (TUM RGB-D layout)");
  app.add_option("--seconds", seconds,
                 "length of the run; default 20, with --rgbd the recording plus 15 s held")
      ->check(in_range(0.1, 864000));
  app.add_option(
         "--clock", clock,
         "auto: real where this user and machine may, else paced; real: threads on this machine; "
         "paced: simulated time, not ahead of the real one; virtual: simulated time, as fast as it "
         "goes")
      ->check(CLI::IsMember({"auto", "real", "paced", "virtual"}))
      ->capture_default_str();
  app.add_option("--bodies", bodies, "virtual clock: real task bodies, or the schedule alone")
      ->check(CLI::IsMember({"real", "stub"}))
      ->capture_default_str();
  app.add_option("--simd", simd,
                 "auto: this processor's; scalar: the same bytes on every processor")
      ->check(CLI::IsMember({"auto", "scalar"}));
  app.add_option("--report", o.report, "folder for the report")->capture_default_str();
  app.add_option("--json", json, "write the figures to this file");
  app.add_option("--faults", o.fault_plan, "fault plan: a name from config/faults or a file");
  app.add_option("--calibration", o.calibration,
                 "calibration file; default: this host's, measured if there is none");
  app.add_option("--cost-seed", o.cost_seed, "simulated time: seed of the job costs");
  app.add_option("--cut-link", o.cut_link_at_s, "cut the cable at this second")
      ->check(in_range(0, 864000));
  app.add_option("--cores", o.cores, "simulated time: cores of the simulated host; paced: 2")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--black-box", o.black_box_s,
                 "seconds before a stop that REPORT/raw/*.blackbox holds; 0: none")
      ->check(in_range(0, 60))
      ->capture_default_str();
  add_store_cap(app, o.store);
  app.add_flag("--record", o.record,
               "record the inputs of both boxes, for teletact replay REPORT/raw");
  app.add_option("--save-map", o.save_map,
                 "write fusion's map at the end, for the key fusion.map or teletact fuse --map");
  app.add_flag("--quiet", o.quiet, "no status lines");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}, {"--save-map", o.save_map}}, {});
  if (simd == "scalar") start_again_scalar(argv);
  o.stub_bodies = bodies == "stub";
  check_bodies(o, clock);
  if (!o.fault_plan.empty() && !rt::kFaultsBuilt)
    throw std::runtime_error("--faults: this build runs no fault plans (TELETACT_FAULTS=OFF)");
  if (!o.fault_plan.empty()) o.fault_plan = find_config("faults", o.fault_plan);
  if (!o.rgbd_dir.empty() && app.count("--scene") == 0) scene_name = "any_recording";
  o.scene_path = find_config("scenes", scene_name);
  for (int i = 0; i < argc; ++i) o.command += (i == 0 ? "teletact " : " ") + std::string(argv[i]);

  auto scene = load_scene(o.scene_path, o.overrides);
  scene->rgbd_dir = o.rgbd_dir;
  if ((clock == "virtual" || clock == "paced") && !scene->choice.in_process()) {
    throw std::runtime_error("device.kind = \"" + scene->choice.kind +
                             "\": a device lives in real time; --clock " + clock +
                             " has the twin only");
  }
  check_haptic_device(*scene);
  // A recording that can not be read is said before anything starts.
  const double whole =
      o.rgbd_dir.empty() ? kWholeDemo_s : recording_seconds(o.rgbd_dir) + scene->hold_s + 0.5;
  o.seconds = seconds > 0 ? seconds : whole;

  catch_signals();
  make_output_folder("--report", o.report);
  if (!o.stub_bodies) make_run_folder(o.report);

  rt::Startup startup;
  rt::NonRealtime& nrt = startup.token();
  RunInfo info;
  if (!o.rgbd_dir.empty() && !o.stub_bodies) {
    const RecordingSetup setup = set_up_recording(nrt, *scene, o.seconds);
    if (setup.placed || setup.scripted) {
      info.notes.push_back(setup.text());
      if (!o.quiet) std::printf("%s\n", setup.text().c_str());
    }
  }
  choose_clock(clock, *scene, app.count("--cores") > 0, o, info);
  info.command = o.command;
  info.started = iso_now();
  info.folder = o.report;
  info.virtual_clock = o.virtual_clock;
  info.stub_bodies = o.stub_bodies;
  info.recording = !o.rgbd_dir.empty();
  info.seconds = o.seconds;
  info.host = host_rows();
  info.seeds = {{"tasks", std::to_string(scene->graph.seed)},
                {"camera noise", std::to_string(scene->camera.seed)},
                {"job costs", std::to_string(o.cost_seed)}};
  // The virtual clock costs jobs by a fixed reference, so that a run is the same on every machine.
  const tasks::Calibration calibration =
      o.virtual_clock && o.calibration.empty()
          ? reference_calibration()
          : host_calibration(nrt, *scene, o, info.calibration_text);
  if (o.virtual_clock && o.calibration.empty())
    info.calibration_text = "reference: " + calibration.host;
  if (o.virtual_clock) {
    o.log_folder = o.report + "/raw";
    if (!o.stub_bodies) o.store_folder = o.log_folder;
    // The default run's folder: nothing of an earlier run on the real clock stays.
    if (o.paced) clear_run_folder(o.log_folder);
    VirtualRun run = run_virtual(nrt, *scene, o, calibration);
    info.admission = run.admission;
    info.modes = run.modes;
    info.effects = run.effects;
    info.wall_s = run.wall_s;
    info.lag_s = run.lag_s;
    info.sched_hash = run.sched_hash;
    info.log_hash = run.log_hash;
    if (run.stopped_early) info.stopped_early = stopped_early(o, run.seconds);
    return finish_run(o, *scene, info, run.op, run.robot, json);
  }
  RealRun run = run_real(nrt, *scene, o, calibration);
  info.admission = run.admission;
  info.modes = run.modes;
  info.best_effort = run.best_effort;
  info.problems = run.problems;
  info.notes = run.notes;
  info.effects = run.effects;
  if (g_stop_requested.load()) info.stopped_early = stopped_early(o, -1);
  return finish_run(o, *scene, info, run.op, run.robot, json);
}

}  // namespace teletact
