#include "tools/box/run_demo.hpp"

#include <sys/auxv.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

#include "tools/box/finish_run.hpp"
#include "tools/box/run_processes.hpp"
#include "tools/cli/options.hpp"
#include "tools/doctor/rights.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_folder.hpp"
#include "tools/record/recording_setup.hpp"
#include "tools/scene/host_info.hpp"

namespace teletact {

namespace {

std::string iso_now() {
  const std::time_t t = std::time(nullptr);
  char text[32];
  std::strftime(text, sizeof text, "%FT%TZ", std::gmtime(&t));
  return text;
}

// With auto: the real clock where the machine gives what it needs, else the simulated one, paced. A
// device or a camera that is no twin lives in real time, whatever the machine gives.
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

// What the report says of the command, before anything has run.
void describe(const Scene& scene, const DemoOptions& o, RunInfo& info) {
  info.command = o.command;
  info.started = iso_now();
  info.folder = o.report;
  info.virtual_clock = o.virtual_clock;
  info.stub_bodies = o.stub_bodies;
  info.recording = !o.rgbd_dir.empty();
  info.seconds = o.seconds;
  info.host = host_rows();
  info.seeds = {{"tasks", std::to_string(scene.graph.seed)},
                {"camera noise", std::to_string(scene.camera.seed)},
                {"job costs", std::to_string(o.cost_seed)}};
}

// Simulated time costs jobs by a fixed reference, so that a run is the same on every machine.
tasks::Calibration calibration_for(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& o,
                                   RunInfo& info) {
  if (!o.virtual_clock || !o.calibration.empty())
    return host_calibration(nrt, scene, o, info.calibration_text);
  const tasks::Calibration calibration = reference_calibration();
  info.calibration_text = "reference: " + calibration.host;
  return calibration;
}

int run_simulated(rt::NonRealtime& nrt, Scene& scene, DemoOptions& o,
                  const tasks::Calibration& calibration, RunInfo& info, const std::string& json) {
  o.log_folder = o.report + "/raw";
  if (!o.stub_bodies) o.store_folder = o.log_folder;
  // The default run's folder: nothing of an earlier run on the real clock stays.
  if (o.paced) clear_run_folder(o.log_folder);
  const VirtualRun run = run_virtual(nrt, scene, o, calibration);
  info.admission = run.admission;
  info.modes = run.modes;
  info.effects = run.effects;
  info.wall_s = run.wall_s;
  info.lag_s = run.lag_s;
  info.sched_hash = run.sched_hash;
  info.log_hash = run.log_hash;
  if (run.stopped_early) info.stopped_early = stopped_early(o, run.seconds);
  return finish_run(o, scene, info, run.op, run.robot, json);
}

int run_as_processes(rt::NonRealtime& nrt, Scene& scene, DemoOptions& o,
                     const tasks::Calibration& calibration, RunInfo& info,
                     const std::string& json) {
  const RealRun run = run_processes(nrt, scene, o, calibration);
  info.admission = run.admission;
  info.modes = run.modes;
  info.best_effort = run.best_effort;
  info.problems = run.problems;
  info.notes = run.notes;
  info.effects = run.effects;
  if (g_stop_requested.load()) info.stopped_early = stopped_early(o, -1);
  return finish_run(o, scene, info, run.op, run.robot, json);
}

}  // namespace

// One instruction set for a run that is to repeat on another machine. Our own vector kernels give
// the same bytes as their scalar form; what differs between processors is libm, which chooses FMA
// variants by itself. They are chosen when the program is loaded, so the program starts again with
// them switched off.
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

int run_demo(Scene& scene, DemoOptions& o, const DemoWords& words) {
  catch_signals();
  make_output_folder("--report", o.report);
  if (!o.stub_bodies) make_run_folder(o.report);
  rt::Startup startup;
  rt::NonRealtime& nrt = startup.token();
  RunInfo info;
  if (!o.rgbd_dir.empty() && !o.stub_bodies) {
    const RecordingSetup setup = set_up_recording(nrt, scene, o.seconds);
    if (setup.placed || setup.scripted) {
      info.notes.push_back(setup.text());
      if (!o.quiet) std::printf("%s\n", setup.text().c_str());
    }
  }
  choose_clock(words.clock, scene, words.cores_given, o, info);
  describe(scene, o, info);
  const tasks::Calibration calibration = calibration_for(nrt, scene, o, info);
  return (o.virtual_clock ? run_simulated : run_as_processes)(nrt, scene, o, calibration, info,
                                                              words.json);
}

}  // namespace teletact
