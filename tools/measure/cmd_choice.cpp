// teletact accuracy choice: settings of segmentation chosen on one half of the images, judged on
// the other.
#include <CLI/CLI.hpp>
#include <iostream>

#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/accuracy/choice_study.hpp"
#include "tools/measure/measure_commands.hpp"

namespace teletact {

int cmd_choice(int argc, char** argv) {
  CLI::App app{
      "Is segmentation fitted to the images that judge it? Settings drawn about the default are "
      "chosen on every\nsecond image and judged on the others. Ends with 1 where such a choice is "
      "better than the default by more\nthan .01.",
      "teletact accuracy choice"};
  ChoiceOptions o;
  std::string json;
  app.add_option("--data", o.data,
                 "folder of images with people's or true masks, as of bench table2 and bench "
                 "segmentation")
      ->required();
  app.add_option("--settings", o.settings, "drawn")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  app.add_option("--seed", o.seed, "of the settings and of the touches")->capture_default_str();
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  const Choice choice = study_choice(std::cerr, o);
  choice.print(std::cout);
  Metrics metrics("accuracy choice");
  for (const BenchMetric& m : choice.metrics()) metrics.add(m.name, m.value, m.unit);
  if (!json.empty()) metrics.write(json);
  return missed(choice.limits()) > 0 ? 1 : 0;
}

}  // namespace teletact
