// What each effect of the catalogue costs: thread CPU of the one that pays for it, of a run in which it is asked for less
// that of the same run without it.
//
// The runs are of the default scene on the simulated clock, where the same keys give the same jobs to the last bit: of
// each job the least of several rounds counts, so what else the machine did is left out. The floor below which a cost is
// not told from none is what the same payer's cost differs by in runs that change what others pay for.
#pragma once

#include <deque>
#include <ostream>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"
#include "tools/bench/bench_metric.hpp"

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

// `only`: an effect's name; empty: all. Says on `progress` what it does. Throws std::runtime_error with one line.
[[nodiscard]] EffectCosts measure_effects(rt::NonRealtime&, std::ostream& progress, double seconds,
                                          int rounds, const std::string& only = {});

}  // namespace teletact
