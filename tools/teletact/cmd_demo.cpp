// teletact demo: both boxes on this machine, and a report at the end.
#include <CLI/CLI.hpp>
#include <stdexcept>

#include "rt/fault/injector.hpp"
#include "tools/box/run_demo.hpp"
#include "tools/cli/options.hpp"
#include "tools/record/recording_truth.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/console_words.hpp"
#include "tools/teletact/store_option.hpp"

namespace teletact {

namespace {

struct DemoCommand {
  DemoOptions demo;
  DemoWords words;
  ConsoleWords console;
  std::string bodies = "real", scene_name = "default_room", simd = "auto";
  double seconds = -1;
};

void check_bodies(const DemoOptions& o, const std::string& clock) {
  if (!o.stub_bodies) return;
  if (clock != "virtual")
    throw std::runtime_error("--bodies stub needs --clock virtual: give both");
  if (o.record) throw std::runtime_error("--record needs --bodies real");
  if (!o.save_map.empty()) throw std::runtime_error("--save-map needs --bodies real");
}

void add_run_options(CLI::App& app, DemoCommand& c) {
  app.add_option("--scene", c.scene_name, "scene: a name from config/scenes or a file")
      ->capture_default_str();
  app.add_option("--set", c.demo.overrides, "override a key of the scene: section.key=value");
  app.add_option("--rgbd", c.demo.rgbd_dir, "drive fusion with a recording (TUM RGB-D layout)");
  app.add_option("--seconds", c.seconds,
                 "length of the run; default 20, with --rgbd the recording plus 15 s held")
      ->check(in_range(0.1, 864000));
  app.add_option(
         "--clock", c.words.clock,
         "auto: real where this user and machine may, else paced; real: threads on this machine; "
         "paced: simulated time, not ahead of the real one; virtual: simulated time, as fast as it "
         "goes")
      ->check(CLI::IsMember({"auto", "real", "paced", "virtual"}))
      ->capture_default_str();
  app.add_option("--bodies", c.bodies, "virtual clock: real task bodies, or the schedule alone")
      ->check(CLI::IsMember({"real", "stub"}))
      ->capture_default_str();
  app.add_option("--simd", c.simd,
                 "auto: this processor's; scalar: the same bytes on every processor")
      ->check(CLI::IsMember({"auto", "scalar"}));
}

void add_file_options(CLI::App& app, DemoCommand& c) {
  app.add_option("--report", c.demo.report, "folder for the report")->capture_default_str();
  app.add_option("--json", c.words.json, "write the figures to this file");
  app.add_option("--faults", c.demo.fault_plan, "fault plan: a name from config/faults or a file");
  app.add_option("--calibration", c.demo.calibration,
                 "calibration file; default: this host's, measured if there is none");
  app.add_option("--cost-seed", c.demo.cost_seed, "simulated time: seed of the job costs");
  app.add_option("--cut-link", c.demo.cut_link_at_s, "cut the cable at this second")
      ->check(in_range(0, 864000));
  app.add_option("--cores", c.demo.cores, "simulated time: cores of the simulated host; paced: 2")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--black-box", c.demo.black_box_s,
                 "seconds before a stop that REPORT/raw/*.blackbox holds; 0: none")
      ->check(in_range(0, 60))
      ->capture_default_str();
  add_store_cap(app, c.demo.store);
  app.add_flag("--record", c.demo.record,
               "record the inputs of both boxes, for teletact replay REPORT/raw");
  app.add_option("--save-map", c.demo.save_map,
                 "write fusion's map at the end, for the key fusion.map or teletact fuse --map");
  app.add_flag("--quiet", c.demo.quiet, "no status lines");
}

std::unique_ptr<Scene> scene_of(DemoCommand& c, bool scene_given) {
  DemoOptions& o = c.demo;
  if (!o.fault_plan.empty() && !rt::kFaultsBuilt)
    throw std::runtime_error("--faults: this build runs no fault plans (TELETACT_FAULTS=OFF)");
  if (!o.fault_plan.empty()) o.fault_plan = find_config("faults", o.fault_plan);
  if (!o.rgbd_dir.empty() && !scene_given) c.scene_name = "any_recording";
  o.scene_path = find_config("scenes", c.scene_name);
  auto scene = load_scene(o.scene_path, o.overrides);
  scene->rgbd_dir = o.rgbd_dir;
  const std::string& clock = c.words.clock;
  if ((clock == "virtual" || clock == "paced") && !scene->choice.in_process()) {
    throw std::runtime_error("device.kind = \"" + scene->choice.kind +
                             "\": a device lives in real time; --clock " + clock +
                             " has the twin only");
  }
  check_haptic_device(*scene);
  return scene;
}

}  // namespace

int cmd_demo(int argc, char** argv) {
  CLI::App app{
      "Runs the operator's box and the robot's box on this machine, every device a twin, and "
      "writes a report."};
  DemoCommand c;
  add_run_options(app, c);
  add_file_options(app, c);
  add_console_options(app, c.console);
  if (!parse_options(app, argc, argv)) return 0;
  DemoOptions& o = c.demo;
  check_outputs({{"--json", c.words.json}, {"--save-map", o.save_map}}, {});
  if (c.simd == "scalar") start_again_scalar(argv);
  o.stub_bodies = c.bodies == "stub";
  check_bodies(o, c.words.clock);
  c.words.cores_given = app.count("--cores") > 0;
  for (int i = 0; i < argc; ++i) o.command += (i == 0 ? "teletact " : " ") + std::string(argv[i]);
  const bool scene_given = app.count("--scene") > 0;
  prepare_console(c.console, scene_given, c.scene_name, o);
  if (c.console.console && o.stub_bodies) throw std::runtime_error("--console needs --bodies real");
  const auto scene = scene_of(c, scene_given || !c.console.session.empty());
  // A recording that can not be read is said before anything starts.
  const double whole =
      o.rgbd_dir.empty() ? kWholeDemo_s : recording_seconds(o.rgbd_dir) + scene->hold_s + 0.5;
  // Of a person at a page: until it is stopped.
  constexpr double kUntilStopped_s = 864000;
  o.seconds = c.seconds > 0 ? c.seconds : c.console.console ? kUntilStopped_s : whole;
  const auto page = console_of(c.console, *scene, o);
  o.page = page.get();
  return run_demo(*scene, o, c.words);
}

}  // namespace teletact
