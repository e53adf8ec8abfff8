// teletact accuracy moving: what a thing that moves in view does to pose, mask and map, against the
// truth.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <map>
#include <string>

#include "tasks/fusion/fusion_task.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/accuracy/moving_study.hpp"
#include "tools/measure/measure_commands.hpp"

namespace teletact {

namespace {

int print_static(const std::vector<StaticMask>& masks, double voxel_mm,
                 std::map<std::string, double>& worst) {
  int missed = 0;
  std::printf("\nstill pixels masked where nothing moves, %g mm (limit %.3f)\n", voxel_mm,
              kMostStaticMasked);
  for (const StaticMask& m : masks) {
    const bool met = m.masked <= kMostStaticMasked;
    missed += met ? 0 : 1;
    std::printf("  %-8s %.5f  claimed %.3f  ate %.2f mm  %s\n", m.scene.c_str(), m.masked,
                m.claimed, m.ate_mm, met ? "met" : "MISSED");
    double& most = worst["moving.static." + m.scene + ".masked"];
    most = std::max(most, m.masked);
  }
  std::fflush(stdout);
  return missed;
}

struct MovingCommand {
  MovingOptions o;
  std::string json, plots;
  bool still = false, no_odometry = false, no_surfaces = false, list = false;
  int still_frames = 200;

  void add_to(CLI::App& app);
  void say_samples() const;
  // Limits that were missed.
  int samples(Metrics& metrics) const;
  int static_scenes(Metrics& metrics) const;
};

void MovingCommand::add_to(CLI::App& app) {
  app.add_option("--samples", o.samples, "how many")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  app.add_option("--seed", o.seed, "of the samples")->capture_default_str();
  app.add_option("--only", o.only, "this sample alone")->check(CLI::Range(0, 100000));
  app.add_option("--voxels", o.voxels_mm, "edges of a voxel, mm")
      ->check(in_range(4, 100))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--levels", o.levels, "of fusion")
      ->check(CLI::Range(0, tasks::FusionConfig::kMaxLevels - 1))
      ->delimiter(',')
      ->capture_default_str();
  app.add_flag("--spread", o.spread,
               "each sample at one voxel and level, in turn by twelve, in place of all of them");
  app.add_option("--jobs", o.jobs, "samples at a time")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_flag("--colour", o.colour, "images in colour, for the map's sake");
  app.add_option("--incidence", o.incidence,
                 "factor on the noise that grows with the angle of incidence")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app.add_flag("--debug", o.debug, "a line for each frame");
  app.add_flag("--peer", o.peers, "Open3D and OpenCV on the same frames, where installed");
  app.add_flag("--list", list, "say what is drawn, and run nothing");
  app.add_flag("--no-odometry", no_odometry, "only the runs without it");
  app.add_flag("--no-surfaces", no_surfaces, "do not look at the map");
  app.add_flag("--no-watch{false}", o.watch, "without the watch for what moves: what it saves");
  app.add_flag(
      "--static", still,
      "the mask in the five scenes where nothing moves, too, at each of --voxels, level 0");
  app.add_option("--static-frames", still_frames, "of each of them")
      ->check(CLI::Range(5, 2000))
      ->capture_default_str();
  app.add_option("--plots", plots, "folder for the SVG plots");
  app.add_option("--json", json, "write the figures to this file");
}

void MovingCommand::say_samples() const {
  rt::Startup startup;
  for (int i = std::max(0, o.only); i < (o.only >= 0 ? o.only + 1 : o.samples); ++i)
    std::cout << draw_moving_sample(startup.token(), o.seed, i).text() << std::endl;
}

int MovingCommand::samples(Metrics& metrics) const {
  const MovingStudy study = study_moving(std::cerr, o);
  study.print(std::cout);
  for (const BenchMetric& m : study.metrics()) metrics.add(m.name, m.value, m.unit);
  if (!plots.empty()) {
    for (const std::string& file : study.write_plots(plots)) std::cout << file << "\n";
  }
  std::cout << std::flush;
  return study.missed();
}

int MovingCommand::static_scenes(Metrics& metrics) const {
  int missed = 0;
  std::map<std::string, double> worst;
  for (const double voxel_mm : o.voxels_mm)
    missed += print_static(study_static_masks(std::cerr, voxel_mm, still_frames), voxel_mm, worst);
  for (const auto& [name, share] : worst) metrics.add(name, share, "1");
  return missed;
}

}  // namespace

int cmd_moving(int argc, char** argv) {
  CLI::App app{"A thing moves in view: pose, mask and map against the truth. Seeded samples.",
               "teletact accuracy moving"};
  MovingCommand c;
  c.add_to(app);
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", c.json}}, {});
  if (!c.plots.empty()) make_output_folder("--plots", c.plots);
  c.o.odometry = !c.no_odometry, c.o.surfaces = !c.no_surfaces;
  if (c.list) {
    c.say_samples();
    return 0;
  }
  Metrics metrics("accuracy moving");
  int missed = 0;
  if (c.o.samples > 0) missed += c.samples(metrics);
  if (c.still) missed += c.static_scenes(metrics);
  if (!c.json.empty()) metrics.write(c.json);
  return missed > 0 ? 1 : 0;
}

}  // namespace teletact
