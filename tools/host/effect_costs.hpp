// What each effect of the catalogue costs, as a table on disk: measured by `teletact bench effects`
// (tools/measure/effect_bench.hpp), printed by `teletact explain`.
#pragma once

#include <deque>
#include <ostream>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"
#include "tools/files/bench_metric.hpp"

namespace teletact {

struct EffectCost {
  std::string name;  // of effect_catalogue()
  std::string job;   // of what: "a job of haptic", ...
  double us = 0;     // more with it than without; may be below 0: it saves its payer work
  double floor_us = 0;
  [[nodiscard]] bool told() const noexcept { return us > floor_us || us < -floor_us; }
};

// config/limits/effect_costs.toml.
struct EffectCosts {
  std::string host;
  std::string scene = "default_room";
  double seconds = 0;
  int rounds = 0;
  std::deque<EffectCost> rows;
  std::deque<std::string> not_measured;  // "name: why"

  void describe(config::Section& s);
  [[nodiscard]] const EffectCost* of(const std::string& name) const noexcept;
  void print(std::ostream& out) const;
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  // Rows that the catalogue has and that are neither here nor said not to be measured: none.
  [[nodiscard]] int missed() const;
};
[[nodiscard]] rt::Result<EffectCosts> load_effect_costs(const std::string& path);
[[nodiscard]] std::string effect_costs_toml(const EffectCosts& costs);
// "0.12 us a job of haptic", "below 0.03 us a job of haptic"; of null: "cost not measured".
[[nodiscard]] std::string cost_text(const EffectCost* cost);

}  // namespace teletact
