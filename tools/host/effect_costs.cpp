#include "tools/host/effect_costs.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <utility>

#include "rt/clock/box_time.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/scene/effect_catalogue.hpp"

namespace teletact {

namespace {

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text)
    out += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
  return out + "\"";
}

}  // namespace

void EffectCosts::describe(config::Section& s) {
  s.text("host", host, {}, "machine that it was measured on");
  s.text("scene", scene, {}, "scene that it was measured in");
  s.number("seconds", seconds, 0, 864000, "simulated time of a run");
  s.integer("rounds", rounds, 0, 10000, "of which the least of each job counts");
  s.list(
      "effect",
      [this](config::Section& row) {
        EffectCost& e = rows.emplace_back();
        row.text("name", e.name, {}, "of the catalogue");
        row.text("job", e.job, {}, "of what");
        row.number("us", e.us, -1e9, 1e9, "thread CPU more than without it");
        row.number("floor_us", e.floor_us, 0, 1e9, "below it is not told from none");
      },
      "a row an effect");
}

const EffectCost* EffectCosts::of(const std::string& name) const noexcept {
  const auto row =
      std::find_if(rows.begin(), rows.end(), [&](const EffectCost& e) { return e.name == name; });
  return row == rows.end() ? nullptr : &*row;
}

std::string cost_text(const EffectCost* cost) {
  if (cost == nullptr) return "cost not measured";
  const double us = cost->told() ? std::abs(cost->us) : cost->floor_us;
  char text[120];
  std::snprintf(text, sizeof text, us >= 100 ? "%s%.0f us%s %s" : "%s%.2f us%s %s",
                cost->told() ? "" : "below ", us, cost->told() && cost->us < 0 ? " less" : "",
                cost->job.c_str());
  return text;
}

void EffectCosts::print(std::ostream& out) const {
  out << "thread CPU more with the effect than without, in " << scene << ", least of " << rounds
      << " rounds of each job, runs of " << seconds << " s\n";
  for (const EffectCost& e : rows) {
    char line[200];
    std::snprintf(line, sizeof line, "  %-34s %10.3f us (floor %.3f) %s\n", e.name.c_str(), e.us,
                  e.floor_us, e.job.c_str());
    out << line;
  }
  for (const std::string& n : not_measured) out << "  not measured: " << n << "\n";
}

std::vector<BenchMetric> EffectCosts::metrics() const {
  std::vector<BenchMetric> all;
  for (const EffectCost& e : rows) all.push_back({"effect." + e.name + ".us", e.us, "us"});
  return all;
}

int EffectCosts::missed() const {
  int none = 0;
  for (const EffectRow& row : effect_catalogue()) {
    const std::string name = row.name;
    none += of(name) == nullptr &&
                    std::none_of(not_measured.begin(), not_measured.end(),
                                 [&](const std::string& n) { return n.rfind(name, 0) == 0; })
                ? 1
                : 0;
  }
  return none;
}

rt::Result<EffectCosts> load_effect_costs(const std::string& path) {
  EffectCosts c;
  config::Section root;
  c.describe(root);
  if (auto ok = config::load_file(path, root); !ok) return rt::Error{ok.error()};
  for (const EffectCost& e : c.rows) {
    if (effect_named(e.name) == nullptr)
      return rt::Error{path + ": effect.name = \"" + e.name + "\" is not in the catalogue"};
  }
  return c;
}

std::string effect_costs_toml(const EffectCosts& c) {
  std::string out =
      "# What each effect costs the one that pays for it: thread CPU with the effect less that "
      "without, of the same run "
      "of the\n# default scene, measured by `teletact bench effects --write FILE`. `teletact "
      "explain` prints it.\n"
      "host = " +
      quoted(c.host) + "\nscene = " + quoted(c.scene) + "\n";
  char line[160];
  std::snprintf(line, sizeof line, "seconds = %g\nrounds = %d\n", c.seconds, c.rounds);
  out += line;
  for (const std::string& n : c.not_measured) out += "# not measured: " + n + "\n";
  for (const EffectCost& e : c.rows) {
    std::snprintf(line, sizeof line, "us = %.4f\nfloor_us = %.4f\n", e.us, e.floor_us);
    out += "\n[[effect]]\nname = " + quoted(e.name) + "\njob = " + quoted(e.job) + "\n" + line;
  }
  return out;
}

}  // namespace teletact
