// teletact robot, teletact operator: one box each, on one machine or on two. Either may start
// first, either may dial; a box that is alone says so and holds still.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <ctime>
#include <optional>
#include <stdexcept>

#include "tools/box/run_box.hpp"
#include "tools/cli/options.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_folder.hpp"
#include "tools/scene/box_devices.hpp"
#include "tools/scene/host_info.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/console_words.hpp"
#include "tools/teletact/store_option.hpp"

namespace teletact {

namespace {

struct BoxWords {
  std::string listen, dial, dial_option, scene = "default_room";
};

RoadAddress where(const BoxWords& words, bool listens) {
  auto a = listens ? parse_road_address("--listen", words.listen, true)
                   : parse_road_address(words.dial_option, words.dial, false);
  if (!a) throw std::runtime_error(a.error());
  return a.value();
}

// What the road may be. Without TLS: nothing but loopback, and only when it is asked for.
void check_road(const BoxCommand& c) {
  if (!c.plain && c.keys.empty())
    throw std::runtime_error(
        "--keys is missing: the folder of this box's keys, as `teletact keys` makes it; or, with "
        "both boxes on this machine, --plain");
  if (c.plain && !is_loopback(c.road.host))
    throw std::runtime_error("--plain " + c.road.host +
                             ": a road without keys is allowed on loopback only (127.0.0.0/8)");
}

void add_options(CLI::App& app, bool robot, DemoOptions& o, BoxCommand& c, BoxWords& w) {
  app.add_option("--robot,--scene", w.scene,
                 "what the robot is and where: a scene, the same for both boxes; a name from "
                 "config/scenes or a file")
      ->capture_default_str();
  app.add_option("--set", o.overrides, "override a key of the scene: section.key=value");
  w.dial_option = robot ? "--operator-address" : "--robot-address";
  auto* dial =
      app.add_option(w.dial_option, w.dial, "HOST:PORT where the other box waits; it is dialled");
  app.add_option("--listen", w.listen,
                 "ADDR:PORT where this box waits for the other one; port 0: the kernel chooses")
      ->excludes(dial);
  auto* keys = app.add_option("--keys", c.keys,
                              "folder of this box's keys, as `teletact keys issue` writes it");
  app.add_flag("--plain", c.plain, "no keys and no encryption; on loopback only")->excludes(keys);
  app.add_option("--peer", c.peer,
                 "who must answer: a box name of the certificate, or sha256:HEX of its public key; "
                 "default: any box of the other role that the lab's CA vouches for")
      ->needs(keys);
  app.add_option("--rate", c.rate_Mbit_per_s,
                 "what the slowest part of the road carries, Mbit/s; 0: images are not paced")
      ->check(in_range(0, 10000))
      ->needs(keys);
  app.add_flag("--one-host", c.one_host,
               "the other box is on this machine too, in another network namespace: both are "
               "admitted together, as on loopback");
  app.add_option("--seconds", o.seconds, "length of the run; default: until it is stopped")
      ->check(in_range(0.1, 864000));
  app.add_flag("--record", o.record, "record this box's inputs, for teletact replay REPORT/raw");
  app.add_option("--report", o.report, "folder for the report")->capture_default_str();
  app.add_option("--json", c.json, "write the figures to this file");
  app.add_option("--calibration", o.calibration,
                 "calibration file; default: this host's, measured if there is none");
  app.add_option("--black-box", o.black_box_s,
                 "seconds before a stop that REPORT/raw/*.blackbox holds; 0: none")
      ->check(in_range(0, 60))
      ->capture_default_str();
  add_store_cap(app, o.store);
  app.add_flag("--shape", c.shape,
               "with --keys: apply the scene's [link.shape], the demo's road, to this road too")
      ->needs(keys);
  app.add_flag("--quiet", o.quiet,
               "no line a second and no table of admission; what happens to the link is told all "
               "the same");
}

int run_command(int argc, char** argv, rt::Box box) {
  const bool robot = box == rt::Box::kRobot;
  CLI::App app{robot ? "Runs the robot's box: camera, base, and its end of the link."
                     : "Runs the operator's box: the haptic device, the map, planning, and its end "
                       "of the link."};
  DemoOptions o;
  BoxCommand c;
  BoxWords w;
  c.box = box;
  o.seconds = 0;
  o.report = robot ? "robot_report" : "operator_report";
  add_options(app, robot, o, c, w);
  ConsoleWords console;
  if (!robot) add_console_options(app, console);
  if (!parse_options(app, argc, argv)) return 0;
  if (w.listen.empty() && w.dial.empty()) w.listen = "127.0.0.1:" + std::to_string(kRoadPort);
  c.listens = w.dial.empty();
  c.road = where(w, c.listens);
  check_road(c);
  check_link(c);
  check_outputs({{"--json", c.json}}, {});
  prepare_console(console, app.count("--robot") > 0, w.scene, o);
  o.scene_path = find_config("scenes", w.scene);
  auto scene = load_scene(o.scene_path, o.overrides);
  if (!robot) check_haptic_device(*scene);
  rt::Startup startup;
  if (robot) check_motor_bus(startup.token(), *scene);
  const auto page = console_of(console, *scene, o);
  o.page = page.get();

  if (o.record && o.seconds <= 0)
    std::printf(
        "--record without --seconds: the recording holds every input, images included, and grows "
        "until this box is stopped\n");
  catch_signals();
  make_output_folder("--report", o.report);
  make_run_folder(o.report);
  RunInfo info;
  for (int i = 0; i < argc; ++i)
    info.command += (i == 0 ? "teletact " : " ") + std::string(argv[i]);
  const std::time_t t = std::time(nullptr);
  char text[32];
  std::strftime(text, sizeof text, "%FT%TZ", std::gmtime(&t));
  info.started = text;
  info.folder = o.report;
  info.seconds = o.seconds;
  info.host = host_rows();
  info.config_toml = config::effective(scene->schema);
  // Both on this host are admitted together, and so measured together.
  std::optional<rt::Box> only;
  if (!both_on_this_host(c)) only = box;
  const tasks::Calibration calibration =
      host_calibration(startup.token(), *scene, o, info.calibration_text, only);
  return run_box(startup.token(), *scene, o, c, calibration, info);
}

}  // namespace

int cmd_robot(int argc, char** argv) { return run_command(argc, argv, rt::Box::kRobot); }
int cmd_operator(int argc, char** argv) { return run_command(argc, argv, rt::Box::kOperator); }

}  // namespace teletact
