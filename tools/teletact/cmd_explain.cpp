// teletact explain SCENE: the effects that a scene asks for, each with the key that asks and who
// pays for it, and those that it does not ask for: they are not built.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>

#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/host/effect_costs.hpp"
#include "tools/scene/effect_catalogue.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

int cmd_explain(int argc, char** argv) {
  CLI::App app{
      "What a scene simulates and what not: each effect with the key that asks for it and who "
      "pays.",
      "teletact explain"};
  std::string name = "default_room", json;
  std::vector<std::string> overrides;
  app.add_option("SCENE", name, "a name from config/scenes or a file")->capture_default_str();
  app.add_option("--set", overrides, "override a key of the scene: section.key=value");
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  const auto scene = load_scene(find_config("scenes", name), overrides);
  rt::Startup startup;
  const Explained e = explain_effects(startup.token(), *scene);
  const auto costs = load_effect_costs(find_config("limits", "effect_costs"));
  if (!costs) throw std::runtime_error(costs.error());
  std::printf("%s asks for %zu effects:\n", name.c_str(), e.asked.size());
  for (const ExplainedEffect& effect : e.asked) {
    const std::string set = effect.value.empty() ? "" : " = " + effect.value;
    std::printf("  %-34s %s%s\n  %-34s paid by: %s, %s\n", effect.row->name, effect.row->key,
                set.c_str(), "", effect.row->paid_by,
                cost_text(costs.value().of(effect.row->name)).c_str());
    std::printf("  %-34s %s\n", "", effect.row->what);
  }
  std::printf("\nnot asked for, not built (%zu):\n", e.not_asked.size());
  for (const EffectRow* row : e.not_asked)
    std::printf("  %-34s %-42s %s\n", row->name, row->key, row->paid_by);
  const auto& rows = costs.value().rows;
  const auto told = std::count_if(rows.begin(), rows.end(), [](const auto& c) { return c.told(); });
  std::printf(
      "\nCosts: CPU time of the task that pays, in %s, by `teletact bench effects` on\n%s.\n",
      costs.value().scene.c_str(), costs.value().host.c_str());
  std::printf("below: the cost was within the noise of that machine; above it: %td of %zu rows.\n",
              told, rows.size());
  Metrics metrics("explain");
  metrics.add("explain.asked", static_cast<double>(e.asked.size()), "1");
  metrics.add("explain.not_asked", static_cast<double>(e.not_asked.size()), "1");
  if (!json.empty()) metrics.write(json);
  return 0;
}

}  // namespace teletact
