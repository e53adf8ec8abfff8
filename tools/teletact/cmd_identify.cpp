// teletact identify: mass, damping and dry friction of the haptic device by ring-down, nobody holding it. Prints
// what the configuration assumes beside it, and writes the keys to take over. `identify robot`: cmd_identify_robot.cpp.
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
#include "tools/files/today.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/scene/haptic_choice.hpp"
#include "tools/scene/scene.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/touch/ring_down.hpp"

namespace teletact {
namespace {

std::string keys_of(const std::string& kind, const IdentifyResult& r) {
  const std::string section = kind == "twin" ? "device" : "device." + kind;
  char text[400];
  std::snprintf(text, sizeof text,
                "# Measured by ring-down (teletact identify); residual %.1f um.\n[%s]\n"
                "mass_kg = %.4g\ndamping_N_s_per_m = %.4g\ncoulomb_N = %.4g\ndelay_s = %.4g\n"
                "measured = \"%s\"\n",
                1e6 * r.mean.residual_m, section.c_str(), r.mean.mass_kg, r.mean.damping_N_s_per_m,
                r.mean.coulomb_N, r.delay_s, today().c_str());
  return text;
}

}  // namespace

int cmd_identify(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "robot") == 0) return cmd_identify_robot(argc - 1, argv + 1);
  std::string scene_name = "default_room", json, out, kind;
  std::vector<std::string> overrides;
  IdentifyOptions options;
  double residual_um = 1e6 * kResidualMost_m;
  CLI::App app(
      "Measures mass, damping and dry friction of the haptic device by ring-down. It moves by "
      "itself, by "
      "a few centimetres: nobody may hold it.",
      "teletact identify");
  app.footer("teletact identify robot: wheels and camera mount of the robot; --help tells more.");
  app.add_option("--scene", scene_name, "scene whose section [device] is used")
      ->capture_default_str();
  app.add_option("--set", overrides, "override a key: device.kind=\"omega\"");
  app.add_option("--kind", kind, "twin, omega or falcon: short for --set device.kind");
  app.add_option("--seconds", options.seconds, "of each swing")
      ->check(in_range(0.3, 20))
      ->capture_default_str();
  app.add_option("--rate", options.rate_hz, "ticks a second")
      ->check(in_range(200, 4000))
      ->capture_default_str();
  app.add_option("--throw", options.throw_m, "how far the swing's middle lies aside, m")
      ->check(in_range(0.002, 0.03))
      ->capture_default_str();
  app.add_option("--residual", residual_um, "largest that is believed, um")
      ->check(in_range(1, 10000))
      ->capture_default_str();
  app.add_flag("--fit-delay", options.fit_delay, "find the delay too, instead of the stated one");
  app.add_option("--out", out, "TOML with the keys to take over");
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}, {"--out", out}}, {});
  options.residual_most_m = 1e-6 * residual_um;
  if (!kind.empty()) overrides.push_back("device.kind=\"" + kind + "\"");
  const auto scene = load_scene(find_config("scenes", scene_name), overrides);

  rt::Startup startup;
  drivers::HandScript nobody(startup.token(), {}, scene->workspace());
  const bool real = !scene->choice.in_process();
  const auto opened = open_haptic_device(startup.token(), *scene, nobody,
                                         rt::time_from_ns(rt::monotonic_ns()), true);
  const auto stated = opened->device().properties();
  std::printf("device     %s\n", opened->description().c_str());
  opened->device().request_enable();
  // Opening may have taken long: ticks that are late would follow each other without a wait.
  const rt::Time begin = rt::time_from_ns(rt::monotonic_ns());
  std::uint64_t ticks = 0, late = 0;
  const auto result = identify_device(opened->device(), options, begin, [&](rt::Time due) {
    if (!real) return;  // the twin's time is the caller's
    const rt::Nanos wait = due - rt::time_from_ns(rt::monotonic_ns());
    if (wait.count() > 0) std::this_thread::sleep_for(wait);
    ++ticks;
    const double behind_s = rt::seconds(rt::time_from_ns(rt::monotonic_ns()) - due);
    late += behind_s * options.rate_hz > 0.5 ? 1 : 0;
  });
  opened->device().make_safe();
  Metrics metrics("identify");
  std::printf("           mass kg  damping N s/m  friction N  bias N   residual um\n");
  const char* const names[3] = {"x", "y", "z"};
  for (std::size_t a = 0; a < 3; ++a) {
    const DeviceFit& f = result.axes[a];
    std::printf("%-10s %.4f   %.3f          %.4f      %+.4f  %.1f\n", names[a], f.mass_kg,
                f.damping_N_s_per_m, f.coulomb_N, f.bias_N, 1e6 * f.residual_m);
    const std::string name = std::string("identify.") + names[a];
    metrics.add(name + ".mass_kg", f.mass_kg, "kg");
    metrics.add(name + ".damping_N_s_per_m", f.damping_N_s_per_m, "N s/m");
    metrics.add(name + ".coulomb_N", f.coulomb_N, "N");
    metrics.add(name + ".residual_um", 1e6 * f.residual_m, "um");
  }
  std::printf("mean       %.4f   %.3f          %.4f\n", result.mean.mass_kg,
              result.mean.damping_N_s_per_m, result.mean.coulomb_N);
  std::printf("%-10s %.4f   %.3f          %.4f      (delay %.3f ms%s)\n",
              stated.measured ? "measured" : "assumed", stated.mass_kg, stated.damping_N_s_per_m,
              stated.coulomb_N, 1e3 * result.delay_s,
              options.fit_delay ? ", fitted" : ", as stated");
  if (late > 0) {
    std::printf(
        "late       %llu of %llu ticks by more than half a period: the fit takes them as on time; "
        "measure again where less else runs\n",
        static_cast<unsigned long long>(late), static_cast<unsigned long long>(ticks));
  }
  if (const std::string why = poor_fit(result); !why.empty()) throw std::runtime_error(why);
  metrics.add("identify.late_ticks", static_cast<double>(late), "1");
  metrics.add("identify.delay_ms", 1e3 * result.delay_s, "ms");
  write_outputs(
      {{out,
        [&](const auto& path) { write_whole_file(path, keys_of(scene->choice.kind, result)); }},
       {json, [&](const auto& path) { metrics.write(path); }}});
  return 0;
}

}  // namespace teletact
