// teletact calibrate: what each task variant costs on this machine.
#include <CLI/CLI.hpp>

#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

// A row of the table, and its figures.
void tell(const tasks::CalibrationRow& r, Metrics& metrics) {
  std::string name = "calibrate." + r.name + ".";
  for (const char ch : r.choice) {
    if (ch != ' ') name += ch;  // "20mm"
  }
  name += (r.choice.empty() ? "" : ".") + std::to_string(r.level);
  metrics.add(name + ".p50_us", r.p50_us, "us");
  metrics.add(name + ".p99_us", r.p99_us, "us");
  metrics.add(name + ".p999_us", r.p999_us, "us");
  metrics.add(name + ".budget_us", static_cast<double>(r.budget().count()) * 1e-3, "us");
  std::printf("%-18s %-7s %5d %10.1f %10.1f %10.1f %10.1f", r.name.c_str(), r.choice.c_str(),
              r.level, r.p50_us, r.p99_us, r.p999_us,
              static_cast<double>(r.budget().count()) * 1e-3);
  if (r.moving_p999_us >= 0) {
    metrics.add(name + ".still_p999_us", r.still_p999_us, "us");
    metrics.add(name + ".moving_p999_us", r.moving_p999_us, "us");
    std::printf("  still %.0f / %.0f, moving %.0f / %.0f;", r.still_p50_us, r.still_p999_us,
                r.moving_p50_us, r.moving_p999_us);
  }
  if (r.claimed_share >= 0) {
    metrics.add(name + ".claimed_share", r.claimed_share, "1");
    metrics.add(name + ".tracked_share", r.tracked_share, "1");
    std::printf("  tracks %.1f %%, claims %.1f %%", 100 * r.tracked_share, 100 * r.claimed_share);
  }
  if (r.off_mm >= 0) {
    metrics.add(name + ".off_mm", r.off_mm, "mm");
    std::printf(", at most %.1f mm off", r.off_mm);
  }
  std::printf("\n");
}

}  // namespace

int cmd_calibrate(int argc, char** argv) {
  CLI::App app{
      "Runs each task variant on the same stored input of a scene and writes p50 / p99 / p99.9 of "
      "its CPU with the host's id."};
  std::string scene_name = "default_room", out, rgbd, json;
  std::vector<std::string> overrides;
  double seconds = 10;
  bool quiet = false;
  app.add_option("--scene", scene_name, "scene that the variants run on")->capture_default_str();
  app.add_option("--set", overrides, "override a key of the scene: section.key=value");
  app.add_option("--rgbd", rgbd, "a recording as the camera");
  app.add_option("--seconds", seconds, "simulated time that is stored")
      ->check(in_range(2, 600))
      ->capture_default_str();
  app.add_option("--out", out, "file to write")->required();
  app.add_option("--json", json, "write the figures to this file");
  app.add_flag("--quiet", quiet, "no progress");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--out", out}, {"--json", json}}, {});
  catch_signals();
  rt::Startup startup;
  if (!rgbd.empty() && app.count("--scene") == 0) scene_name = "recording";
  auto scene = load_scene(find_config("scenes", scene_name), overrides);
  scene->rgbd_dir = rgbd;
  CalibrationInput input;
  const auto c = calibrate(startup.token(), *scene, seconds, quiet, &input);
  std::printf(
      "host: %s\ninput: %.0f s, the same in %llu passes: %016llx (operator), %016llx (robot)\n",
      c.host.c_str(), seconds, static_cast<unsigned long long>(input.passes),
      static_cast<unsigned long long>(input.operator_hash),
      static_cast<unsigned long long>(input.robot_hash));
  std::printf("%-18s %-7s %5s %10s %10s %10s %10s\n", "task", "choice", "level", "p50 us", "p99 us",
              "p99.9 us", "budget us");
  Metrics metrics("calibrate");
  for (const auto& row : c.rows) tell(row, metrics);
  std::printf(
      "still, moving: p50 / p99.9 of images before somebody walks into the view, and from then on "
      "(%zu images, up to %.0f %% of one found to move)\n",
      input.moving_images, 100 * input.moving_share);
  std::printf("planning: the budget is the declared one, which its abort enforces\n");
  write_outputs({{out, [&](const auto& path) { tasks::save_calibration(path, c); }},
                 {json, [&](const auto& path) { metrics.write(path); }}});
  return 0;
}

}  // namespace teletact
