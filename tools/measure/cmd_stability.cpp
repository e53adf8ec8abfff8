// teletact stability: the hard cases of touch, judged by the field optimum; a table with the peers'
// figures beside, JSON metrics and one SVG a case.
#include <unistd.h>
#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/measure_commands.hpp"
#include "tools/measure/stability/gates.hpp"
#include "tools/measure/stability_drawing.hpp"
#include "tools/measure/stability_json.hpp"
#include "tools/measure/stability_options.hpp"
#include "tools/measure/stability_table.hpp"

namespace teletact {

namespace {

using stability::Gated;
using stability::Run;
using stability::Setting;

bool all_met(const Run& run) {
  for (const stability::Check& c : run.checks) {
    if (!c.met()) return false;
  }
  return true;
}

// One case: its settings on samples and on fused fields, by each of the methods.
class CaseOfTable {
 public:
  CaseOfTable(const StabilityOptions& o, const stability::Case& c, StabilityRecord& record)
      : options_(o), case_(c), record_(record) {}

  void run(const std::vector<Setting>& settings, bool fused) {
    const std::vector<Variant> all = variants(options_, fused);
    std::vector<StabilityTally> tallies(all.size());
    for (std::size_t i = 0; i < settings.size(); ++i) {
      if (isatty(2) != 0) {
        std::fprintf(stderr, "\rcase %d%s: setting %zu of %zu ", case_.id, fused ? ", fused" : "",
                     i + 1, settings.size());
      }
      setting(settings[i], all, tallies);
    }
    if (isatty(2) != 0) std::fprintf(stderr, "\r%40s\r", "");
    for (std::size_t i = 0; i < all.size(); ++i) {
      print_row(case_, all[i].name(), tallies[i], fused, i == 0);
      if (i > 0) beside(all[i], tallies[i]);
    }
    if (!fused) print_published(case_);
    std::fflush(stdout);
    total_.take(tallies.front());
  }

  [[nodiscard]] const StabilityTally& total() const { return total_; }
  [[nodiscard]] const StabilityDrawing& drawing() const { return drawing_; }
  void add_to(Metrics& metrics) const {
    add_metrics(metrics, case_.id, total_);
    for (const auto& [v, t] : beside_) add_beside(metrics, case_.id, v.method, v.layer, t);
  }

 private:
  void setting(const Setting& asked, const std::vector<Variant>& all,
               std::vector<StabilityTally>& tallies) {
    std::size_t drawn = 0;  // of the runs of this setting; none: it is not drawn
    bool draws = false;
    for (std::size_t i = 0; i < all.size(); ++i) {
      Setting s = asked;
      s.method = all[i].method;
      s.layer = all[i].layer;
      const Gated gated = stability::run_gated(case_, s);
      record_.take(case_, s, gated);
      tallies[i].take(gated, options_.verbose && i == 0);
      if (i == 0) {
        draws = draw(all[i].name(), gated, drawn);
      } else if (draws && all[i].layer == all[0].layer && drawn < gated.runs.size()) {
        drawing_.beside(all[i].name(), gated.runs[drawn]);
      }
    }
  }

  // The first run that is over a limit, else the first of all.
  bool draw(const std::string& method, const Gated& gated, std::size_t& drawn) {
    if (options_.svg.empty()) return false;
    bool begun = false;
    for (std::size_t i = 0; i < gated.runs.size(); ++i) {
      const bool failed = !all_met(gated.runs[i]);
      if (!drawing_.traces.empty() && (!failed || drawn_failed_)) continue;
      drawing_.begin(case_, method, gated.runs[i]);
      drawn_failed_ = failed;
      drawn = i;
      begun = true;
    }
    return begun;
  }

  void beside(const Variant& v, const StabilityTally& t) {
    for (auto& [there, sum] : beside_) {
      if (there.name() != v.name()) continue;
      sum.take(t);
      return;
    }
    beside_.emplace_back(v, t);
  }

  const StabilityOptions& options_;
  const stability::Case& case_;
  StabilityRecord& record_;
  StabilityTally total_;
  std::vector<std::pair<Variant, StabilityTally>> beside_;
  StabilityDrawing drawing_;
  bool drawn_failed_ = false;
};

}  // namespace

int cmd_stability(int argc, char** argv) {
  StabilityOptions o;
  if (!parse_stability(argc, argv, o)) return 0;
  if (!o.svg.empty()) make_output_folder("--svg", o.svg);
  std::vector<Output> outputs;
  Metrics metrics("stability");
  StabilityRecord record;
  std::vector<stability::FusedView> views = stability::fused_views();
  for (stability::FusedView& view : views) view.smooth = o.patch_smooth;
  int cases = 0, passed = 0, bound = 0;
  bool counted = false;
  double energy_min_mJ = 0;
  print_table_head();
  for (const stability::Case& c : stability::cases()) {
    if (!o.cases.contains(c.id)) continue;
    CaseOfTable table(o, c, record);
    if (!o.fused) table.run(settings(o), false);
    if (stability::on_fused_fields(c.id) && (o.fused || (o.usual() && !o.quick))) {
      table.run(fused_settings(o, views), true);
    }
    table.add_to(metrics);
    if (!o.svg.empty()) {
      outputs.push_back({o.svg + "/case" + std::to_string(c.id) + ".svg",
                         [text = table.drawing().svg()](const std::string& path) {
                           write_whole_file(path, text);
                         }});
    }
    const StabilityTally& t = table.total();
    ++cases;
    passed += t.within == t.settings ? 1 : 0;
    bound += t.failed() > 0 && t.failed_alone() == 0 ? 1 : 0;
    counted = t.counted;
    energy_min_mJ = std::min(energy_min_mJ, t.energy_min_mJ);
  }
  metrics.add("haptic.energy_min_mJ", energy_min_mJ, "mJ");
  std::printf("%d of %d cases pass, %d fail: %d of them only where the optimum fails too\n", passed,
              cases, cases - passed, bound);
  std::printf(
      "least E + booked + credit under the passivity controller %.3f mJ (limit -1); cases 1 to 18: "
      "the same answers without it, or a failed gate\n",
      energy_min_mJ);
  std::printf(
      "gates of every run: step p99 25 us, same trace twice, all finite, 12 N, no allocation, no "
      "lock%s\n",
      counted ? "" : " (these two are counted by the tests' guard, not in this program)");
  outputs.push_back(
      {o.json, [&](const std::string& path) { write_whole_file(path, record.json(metrics)); }});
  write_outputs(outputs);
  return passed + (o.allow_bound ? bound : 0) < cases ? 1 : 0;
}

}  // namespace teletact
