// teletact stability: the hard cases of touch, judged by the field optimum; a table with the peers'
// figures beside, JSON metrics and one SVG a case.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "tools/plot/svg.hpp"
#include "tools/stability/cases.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/metrics_json.hpp"
#include "tools/teletact/options.hpp"
#include "tools/teletact/whole_file.hpp"

namespace teletact {

namespace {

using stability::Check;
using stability::Run;
using stability::Setting;

struct StabilityOptions {
  std::string cases, json, svg, method = "constrained";
  bool quick = false, verbose = false, judged = true, fused = false;
  std::vector<double> angles_deg, offsets_vox, speeds_mm_per_s;  // other placements than the usual
};

// What is left of a case over all its runs.
struct Summary {
  int runs = 0, failed = 0, field_bound = 0;
  double margin = 1;
  double j = 0, j_raw = 0, guard = 0, cpu_p99 = 0;
  std::map<std::string, Check> worst;  // of each check, over its limit the most
  Run shown;                           // the one drawn
};

std::set<int> parse_cases(const std::string& list) {
  std::set<int> out;
  if (list.empty()) return out;
  std::stringstream in(list);
  for (std::string item; std::getline(in, item, ',');) {
    int id = 0, used = 0;
    if (std::sscanf(item.c_str(), "%d%n", &id, &used) != 1 ||
        static_cast<std::size_t>(used) != item.size() || id < 1 || id > 20) {
      throw std::runtime_error("--cases '" + list + "': numbers 1 to 20, comma between");
    }
    out.insert(id);
  }
  return out;
}

// Those asked for, else the usual ones. An offset of u voxels puts the grid off by u, 2u, 3u along its axes.
std::vector<rig::Placement> placements(const StabilityOptions& o) {
  if (o.angles_deg.empty() && o.offsets_vox.empty()) return rig::placements();
  constexpr double kVoxel_m = 0.01;
  const auto or_else = [](const std::vector<double>& asked, std::vector<double> usual) {
    return asked.empty() ? std::move(usual) : asked;
  };
  std::vector<rig::Placement> out;
  for (const double angle : or_else(o.angles_deg, {0, 17, 45})) {
    for (const double offset : or_else(o.offsets_vox, {0})) {
      char name[64];
      std::snprintf(name, sizeof name, "%gdeg/%g", angle, offset);
      const auto part = [&](int times) { return kVoxel_m * std::fmod(times * offset, 1.0); };
      out.push_back(rig::placement(name, angle, {part(1), part(2), part(3)}));
    }
  }
  return out;
}

// Every placement at every speed; quick: each placement at one speed, each speed at each rotation.
std::vector<Setting> settings(const StabilityOptions& o) {
  std::vector<double> speeds{0.02, 0.1, 0.2};
  if (!o.speeds_mm_per_s.empty()) {
    speeds.clear();
    for (const double mm : o.speeds_mm_per_s) speeds.push_back(1e-3 * mm);
  }
  std::vector<Setting> out;
  const auto places = placements(o);
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (std::size_t k = 0; k < speeds.size(); ++k) {
      if (o.quick && k != (i / 3 + i) % speeds.size()) continue;
      out.push_back({places[i], speeds[k], o.method, o.judged});
    }
  }
  return out;
}

// Of the solids as the product fuses them: every view with a tip of 0 and 3 mm, each at another
// placement and speed.
std::vector<Setting> fused_settings(const StabilityOptions& o,
                                    const std::vector<stability::FusedView>& views) {
  constexpr double kSpeeds[3] = {0.02, 0.1, 0.2};
  std::vector<Setting> out;
  const auto places = rig::placements();
  for (const stability::FusedView& view : views) {
    for (const double radius : {0.0, 0.003}) {
      const std::size_t i = out.size();
      out.push_back({places[(4 * i) % places.size()], kSpeeds[(i + i / 3) % 3], o.method, o.judged,
                     &view, radius});
    }
  }
  return out;
}

void take(Summary& sum, Run run, bool verbose) {
  ++sum.runs;
  bool failed = false, bound = true;
  for (const Check& c : run.checks) {
    sum.margin = std::min(sum.margin, c.margin());
    const auto [it, fresh] = sum.worst.try_emplace(c.name, c);
    if (!fresh && c.margin() < it->second.margin()) it->second = c;
    if (c.met()) continue;
    failed = true;
    bound = bound && c.field_bound();
    if (verbose) {
      std::printf(
          "      %s: %s %.4g, limit %.4g%s\n", run.name.c_str(), c.name.c_str(), c.value, c.limit,
          std::isnan(c.optimum) ? "" : (", field optimum " + std::to_string(c.optimum)).c_str());
    }
  }
  if (verbose && !run.note.empty()) {
    std::printf("      %s: %s\n", run.name.c_str(), run.note.c_str());
  }
  sum.failed += failed ? 1 : 0;
  sum.field_bound += failed && bound ? 1 : 0;
  sum.j = std::max(sum.j, run.figures.j);
  sum.j_raw = std::max(sum.j_raw, run.figures.j_raw);
  sum.guard = std::max(sum.guard, run.figures.guard_share);
  sum.cpu_p99 = std::max(sum.cpu_p99, run.figures.cpu_p99);
  if (sum.shown.rows.empty() || (failed && sum.failed == 1)) sum.shown = std::move(run);
}

std::string drawing(const stability::Case& c, const Run& run) {
  plot::Figure f;
  f.title = "Case " + std::to_string(c.id) + ": " + c.name + ", " + run.name;
  f.x_label = "time, s";
  f.y_label = "N (force), mm (proxy height)";
  plot::Series size{"|F|", {}, {}, "", false, false}, raw = size, height = size, best = size;
  raw.name = "|F| before the guard";
  height.name = "proxy z";
  best.name = "field optimum |F|";
  for (const auto& row : run.rows) {
    size.x.push_back(row.t);
    size.y.push_back(row.f.norm());
    raw.x.push_back(row.t);
    raw.y.push_back(row.f_raw.norm());
    height.x.push_back(row.t);
    height.y.push_back(1e3 * row.p.z());
  }
  for (const auto& o : run.optimum) {
    best.x.push_back(run.rows[o.row].t);
    best.y.push_back(o.f.norm());
  }
  f.series = {raw, size, height};
  if (!run.optimum.empty()) f.series.push_back(best);
  return plot::line_plot(f);
}

void print(const stability::Case& c, const Summary& s, bool fused) {
  const bool pass = s.failed == 0;
  std::printf("%2d %-26s %-5s %3d/%-3d  J %.3f (raw %.2f) N, guard %.1f %%, step p99 %.1f us\n",
              c.id, fused ? (std::string(c.name) + ", fused").c_str() : c.name,
              pass ? "pass" : "FAIL", s.runs - s.failed, s.runs, s.j, s.j_raw, 100 * s.guard,
              s.cpu_p99);
  if (!fused) {
    std::printf("     must      %s\n     baseline  %s\n     CHAI3D    %s\n", c.must, c.baseline,
                c.chai3d);
  }
  for (const auto& [name, check] : s.worst) {
    if (check.met()) continue;
    std::printf("     not met   %s %.3g, limit %.3g%s\n", name.c_str(), check.value, check.limit,
                std::isnan(check.optimum)
                    ? ""
                    : (", field optimum itself " + std::to_string(check.optimum)).c_str());
  }
  if (s.failed > 0) {
    std::printf("     %d of the %d failed runs only where the field optimum fails too\n",
                s.field_bound, s.failed);
  }
}

}  // namespace

int cmd_stability(int argc, char** argv) {
  StabilityOptions o;
  CLI::App app("teletact stability: the hard cases of touch, judged by the field optimum",
               "teletact stability");
  app.add_option("--cases", o.cases, "numbers, comma between; default: all");
  app.add_option("--method", o.method, "constrained, nearest or nearest10")->capture_default_str();
  app.add_flag("--quick", o.quick, "one of the speeds at each placement");
  app.add_option("--angles", o.angles_deg, "degrees about the skew axis; default: 0,17,45")
      ->check(in_range(-360, 360))
      ->delimiter(',');
  app.add_option("--offsets", o.offsets_vox, "of the grid, voxels; default: three usual ones")
      ->check(in_range(0, 1))
      ->delimiter(',');
  app.add_option("--speeds", o.speeds_mm_per_s, "of the hand, mm/s; default: 20,100,200")
      ->check(in_range(1, 1000))
      ->delimiter(',');
  app.add_flag("--verbose", o.verbose, "every figure over its limit, and the closed forms");
  app.add_flag("--fused", o.fused, "only the cases on fields fused from synthetic depth");
  app.add_flag("!--no-optimum", o.judged, "leave the field optimum out (fast)");
  app.add_option("--json", o.json, "metrics to write");
  app.add_option("--svg", o.svg, "folder for one figure a case");
  bool strict = false;
  app.add_flag("--strict", strict, "exit status 1 when a case is over one of its limits");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", o.json}}, {});
  tasks::ProxyMethod method{};
  if (!tasks::parse_proxy_method(o.method, method) || method == tasks::ProxyMethod::kForceShading) {
    throw std::runtime_error("--method '" + o.method +
                             "': allowed are constrained, nearest, nearest10");
  }
  const std::set<int> wanted = parse_cases(o.cases);
  if (!o.svg.empty()) make_output_folder("--svg", o.svg);
  std::vector<Output> outputs;
  Metrics metrics("stability");
  const std::vector<stability::FusedView> views = stability::fused_views();
  int failed = 0, run_count = 0;
  for (const stability::Case& c : stability::cases()) {
    if (!wanted.empty() && !wanted.contains(c.id)) continue;
    if (o.fused && !stability::on_fused_fields(c.id)) continue;
    Summary sum;
    const auto run_all = [&](const std::vector<Setting>& all, bool fused) {
      Summary part;
      for (const Setting& setting : all) {
        for (Run& run : c.run(setting)) take(part, std::move(run), o.verbose);
      }
      print(c, part, fused);
      std::fflush(stdout);
      const int failed_before = sum.failed;
      const double margin = std::min(sum.margin, part.margin);
      if (sum.runs == 0) {
        sum = std::move(part);
      } else {
        sum.failed = failed_before + part.failed;
      }
      sum.margin = margin;
    };
    if (!o.fused) run_all(settings(o), false);
    const bool usual = o.angles_deg.empty() && o.offsets_vox.empty() && o.speeds_mm_per_s.empty();
    if (stability::on_fused_fields(c.id) && (o.fused || (usual && !o.quick))) {
      run_all(fused_settings(o, views), true);
    }
    const std::string name = "stability.case" + std::to_string(c.id);
    metrics.add(name + ".pass", sum.failed == 0 ? 1 : 0, "1");
    metrics.add(name + ".margin", sum.margin, "1");
    if (!o.svg.empty()) {
      outputs.push_back({o.svg + "/case" + std::to_string(c.id) + ".svg",
                         [text = drawing(c, sum.shown)](const std::string& path) {
                           write_whole_file(path, text);
                         }});
    }
    failed += sum.failed > 0 ? 1 : 0;
    ++run_count;
  }
  std::printf("%d of %d cases within all limits\n", run_count - failed, run_count);
  outputs.push_back({o.json, [&](const std::string& path) { metrics.write(path); }});
  write_outputs(outputs);
  return strict && failed > 0 ? 1 : 0;
}

}  // namespace teletact
