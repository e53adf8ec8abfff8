// teletact accuracy prediction: error of the base's predicted motion against CPU.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>

#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/measure/measure_commands.hpp"
#include "tools/measure/prediction/prediction_study.hpp"

namespace teletact {

int cmd_prediction_study(int argc, char** argv) {
  CLI::App app{
      "Error of the base's predicted motion against thread CPU: every method at its default, and "
      "the linear model over\nits order, ridge and rows, at horizons of 100, 200 and 400 ms, on a "
      "driven trace and on a recorded log.",
      "teletact accuracy prediction"};
  PredictionStudyOptions o;
  std::string json, plots;
  o.folder = "../shared/data/odometry";
  auto* logs = app.add_option("--logs", o.folder,
                              "folder that holds tuc_lecture_hall.csv; the default may be absent")
                   ->capture_default_str();
  app.add_option("--trace-seconds", o.length_s, "of the driven trace")
      ->check(CLI::Range(10, 3600))
      ->capture_default_str();
  app.add_option("--seed", o.seed, "of the driven trace")->capture_default_str();
  app.add_option("--plots", plots, "folder for the SVG plots");
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  if (!plots.empty()) make_output_folder("--plots", plots);
  if (logs->count() == 0 && !std::filesystem::exists(o.folder)) {
    std::cerr << o.folder << " is not there: only the driven trace\n";
    o.folder.clear();
  }
  const Study study = study_prediction(std::cerr, o);
  study.print(std::cout);
  Metrics metrics("accuracy prediction");
  for (const BenchMetric& m : study.metrics()) metrics.add(m.name, m.value, m.unit);
  if (!plots.empty()) {
    for (const std::string& file : study.write_plots(plots)) std::cout << file << "\n";
  }
  if (!json.empty()) metrics.write(json);
  return 0;
}

}  // namespace teletact
