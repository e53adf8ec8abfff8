// teletact identify: mass, damping and dry friction of the haptic device by ring-down, nobody
// holding it. Prints what the configuration assumes beside it, and writes the keys to take over.
// `identify robot`: cmd_identify_robot.cpp.
#include <time.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <string>
#include <thread>

#include "rt/clock/box_time.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/scene/haptic_choice.hpp"
#include "tools/scene/scene.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/touch/identify_report.hpp"
#include "tools/touch/ring_down.hpp"

namespace teletact {
namespace {

struct Asked {
  std::string scene_name = "default_room", json, out, kind;
  std::vector<std::string> overrides;
  IdentifyOptions options;
};

// False: help was asked for, and printed.
bool parse_identify(Asked& o, int argc, char** argv) {
  double residual_um = 1e6 * kResidualMost_m;
  CLI::App app(
      "Measures mass, damping and dry friction of the haptic device by ring-down. It moves by "
      "itself, by "
      "a few centimetres: nobody may hold it.",
      "teletact identify");
  app.footer("teletact identify robot: wheels and camera mount of the robot; --help tells more.");
  app.add_option("--scene", o.scene_name, "scene whose section [device] is used")
      ->capture_default_str();
  app.add_option("--set", o.overrides, "override a key: device.kind=\"omega\"");
  app.add_option("--kind", o.kind, "twin, omega or falcon: short for --set device.kind");
  app.add_option("--seconds", o.options.seconds, "of each swing")
      ->check(in_range(0.3, 20))
      ->capture_default_str();
  app.add_option("--rate", o.options.rate_hz, "ticks a second")
      ->check(in_range(200, 4000))
      ->capture_default_str();
  app.add_option("--throw", o.options.throw_m, "how far the swing's middle lies aside, m")
      ->check(in_range(0.002, 0.03))
      ->capture_default_str();
  app.add_option("--residual", residual_um, "largest that is believed, um")
      ->check(in_range(1, 10000))
      ->capture_default_str();
  app.add_flag("--fit-delay", o.options.fit_delay, "find the delay too, instead of the stated one");
  app.add_option("--out", o.out, "TOML with the keys to take over");
  app.add_option("--json", o.json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return false;
  check_outputs({{"--json", o.json}, {"--out", o.out}}, {});
  o.options.residual_most_m = 1e-6 * residual_um;
  if (!o.kind.empty()) o.overrides.push_back("device.kind=\"" + o.kind + "\"");
  return true;
}

Identified swing_device(const Scene& scene, const IdentifyOptions& options) {
  Identified out;
  rt::Startup startup;
  drivers::HandScript nobody(startup.token(), {}, scene.workspace());
  const bool real = !scene.choice.in_process();
  const auto opened = open_haptic_device(startup.token(), scene, nobody,
                                         rt::time_from_ns(rt::monotonic_ns()), true);
  out.stated = opened->device().properties();
  std::printf("device     %s\n", opened->description().c_str());
  opened->device().request_enable();
  // Opening may have taken long: ticks that are late would follow each other without a wait.
  const rt::Time begin = rt::time_from_ns(rt::monotonic_ns());
  out.result = identify_device(opened->device(), options, begin, [&](rt::Time due) {
    if (!real) return;  // the twin's time is the caller's
    const rt::Nanos wait = due - rt::time_from_ns(rt::monotonic_ns());
    if (wait.count() > 0) std::this_thread::sleep_for(wait);
    ++out.ticks;
    const double behind_s = rt::seconds(rt::time_from_ns(rt::monotonic_ns()) - due);
    out.late += behind_s * options.rate_hz > 0.5 ? 1 : 0;
  });
  opened->device().make_safe();
  return out;
}

}  // namespace

int cmd_identify(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "robot") == 0) return cmd_identify_robot(argc - 1, argv + 1);
  Asked o;
  if (!parse_identify(o, argc, argv)) return 0;
  const auto scene = load_scene(find_config("scenes", o.scene_name), o.overrides);
  const Identified found = swing_device(*scene, o.options);
  print_identified(found, o.options.fit_delay);
  if (const std::string why = poor_fit(found.result); !why.empty()) throw std::runtime_error(why);
  const Metrics metrics = identified_metrics(found);
  write_outputs({{o.out,
                  [&](const auto& path) {
                    write_whole_file(path, identified_keys(scene->choice.kind, found.result));
                  }},
                 {o.json, [&](const auto& path) { metrics.write(path); }}});
  return 0;
}

}  // namespace teletact
