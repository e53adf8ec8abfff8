#include "tools/measure/stability_options.hpp"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "tasks/haptic/proxy.hpp"
#include "tools/cli/options.hpp"

namespace teletact {

using stability::Setting;

namespace {

constexpr double kSpeeds_m_per_s[3] = {0.02, 0.1, 0.2};

std::set<int> parse_cases(const std::string& list) {
  std::set<int> out;
  std::stringstream in(list);
  for (std::string item; std::getline(in, item, ',');) {
    int id = 0, used = 0;
    if (std::sscanf(item.c_str(), "%d%n", &id, &used) != 1 ||
        static_cast<std::size_t>(used) != item.size() || id < 1 || id > 20) {
      throw std::runtime_error("--cases '" + list +
                               "': allowed are numbers 1 to 20, comma between");
    }
    out.insert(id);
  }
  if (out.empty()) {
    throw std::runtime_error("--cases '" + list + "': allowed are numbers 1 to 20, comma between");
  }
  return out;
}

// The cases that are left: what was asked for and what the other options allow.
void choose_cases(StabilityOptions& o, const std::string& list) {
  const bool asked = !list.empty();
  if (asked) o.cases = parse_cases(list);
  for (const stability::Case& c : stability::cases()) {
    if (!asked) o.cases.insert(c.id);
    if (o.tip_radius_m > 0 && !stability::takes_tip(c.id)) {
      if (asked && o.cases.contains(c.id)) {
        throw std::runtime_error("--tip-radius: case " + std::to_string(c.id) +
                                 " is about a point; allowed are cases 1 to 19");
      }
      o.cases.erase(c.id);
    }
    if (o.fused && !stability::on_fused_fields(c.id)) {
      if (asked && o.cases.contains(c.id)) {
        throw std::runtime_error("--fused: case " + std::to_string(c.id) +
                                 " is not fused; allowed are cases 1, 2, 5, 6, 7, 10 and 13");
      }
      o.cases.erase(c.id);
    }
  }
}

void check_together(const StabilityOptions& o) {
  tasks::ProxyMethod method{};
  if (!tasks::parse_proxy_method(o.method, method)) {
    throw std::runtime_error("--method '" + o.method + "': allowed are " +
                             std::string(tasks::kProxyMethods));
  }
  if (o.layer != "on" && o.layer != "off" && o.layer != "both") {
    throw std::runtime_error("--layer '" + o.layer + "': allowed are on, off, both");
  }
  if (o.patch_smooth > 0 && o.patch_smooth < 2) {
    throw std::runtime_error("--patch-smooth " + std::to_string(o.patch_smooth) +
                             ": allowed are 0 (none) and 2 to 8 voxels");
  }
  if (!o.fused) return;
  if (o.tip_radius_m > 0) {
    throw std::runtime_error("--tip-radius: fused fields are touched by tips of 0 and 3 mm");
  }
  if (o.method == "force_shading") {
    throw std::runtime_error(
        "--method 'force_shading': with --fused allowed are constrained, "
        "nearest, nearest10");
  }
  if (!o.angles_deg.empty() || !o.offsets_vox.empty() || !o.speeds_mm_per_s.empty()) {
    throw std::runtime_error(
        "--fused: has placements and speeds of its own; --angles, --offsets and --speeds are for "
        "samples");
  }
}

// Those asked for, else the usual ones. An offset of u voxels puts the grid off by u, 2u, 3u along
// its axes.
std::vector<rig::Placement> placements(const StabilityOptions& o) {
  if (o.angles_deg.empty() && o.offsets_vox.empty()) return rig::placements();
  constexpr double kVoxel_m = 0.01;
  const auto or_else = [](const std::vector<double>& asked, const std::vector<double>& usual) {
    return asked.empty() ? usual : asked;
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

}  // namespace

bool parse_stability(int argc, char** argv, StabilityOptions& o) {
  CLI::App app("teletact stability: the hard cases of touch, judged by the field optimum",
               "teletact stability");
  std::string cases;
  double tip_radius_mm = 0;
  app.add_option("--cases", cases, "numbers, comma between; default: all");
  app.add_option("--method", o.method, std::string(tasks::kProxyMethods))->capture_default_str();
  app.add_option("--layer", o.layer,
                 "stability layer (slew guard, fade-in, passivity controller): on, off, or both "
                 "beside each other")
      ->capture_default_str();
  app.add_flag("--beside", o.beside,
               "measure nearest, nearest10 and force_shading in the same runs, as rows and curves "
               "beside");
  app.add_option("--tip-radius", tip_radius_mm,
                 "of the tip on samples, mm, alone; 0: both a point and a tip of 3 mm")
      ->check(in_range(0, 1e3 * stability::kTipMost_m))
      ->capture_default_str();
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
  app.add_option(
         "--patch-smooth", o.patch_smooth,
         "of fused fields: voxels that they are smoothed over, as fusion.patch_smooth; 0: none")
      ->check(in_range(0, 8));
  app.add_flag("!--no-optimum", o.judged, "leave the field optimum out (fast)");
  app.add_option("--json", o.json, "metrics and every check of every run, to write");
  app.add_option("--svg", o.svg, "folder for one figure a case");
  app.add_flag(
      "--allow-bound", o.allow_bound,
      "exit status 0 although limits are missed, where the optimum misses each of them too");
  if (!parse_options(app, argc, argv)) return false;
  o.tip_radius_m = 1e-3 * tip_radius_mm;
  check_outputs({{"--json", o.json}}, {});
  check_together(o);
  if (app.count("--cases") > 0 && cases.empty()) (void)parse_cases(cases);
  choose_cases(o, cases);
  return true;
}

std::vector<Variant> variants(const StabilityOptions& o, bool fused) {
  std::vector<std::string> methods{o.method};
  if (o.beside) {
    for (const std::string m : {"nearest", "nearest10", "force_shading"}) {
      if (m != o.method && !(fused && m == "force_shading")) methods.push_back(m);
    }
  }
  std::vector<Variant> out;
  for (const std::string& m : methods) out.push_back({m, o.layer != "off"});
  if (o.layer != "both") return out;
  for (const std::string& m : methods) out.push_back({m, false});
  return out;
}

std::vector<Setting> settings(const StabilityOptions& o) {
  std::vector<double> speeds(std::begin(kSpeeds_m_per_s), std::end(kSpeeds_m_per_s));
  if (!o.speeds_mm_per_s.empty()) {
    speeds.clear();
    for (const double mm : o.speeds_mm_per_s) speeds.push_back(1e-3 * mm);
  }
  std::vector<Setting> out;
  const auto places = placements(o);
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (std::size_t k = 0; k < speeds.size(); ++k) {
      if (o.quick && k != (i / 3 + i) % speeds.size()) continue;
      Setting s{places[i], speeds[k], o.method, o.judged};
      s.tip_radius_m = o.tip_radius_m;
      out.push_back(std::move(s));
    }
  }
  return out;
}

std::vector<Setting> fused_settings(const StabilityOptions& o,
                                    const std::vector<stability::FusedView>& views) {
  std::vector<Setting> out;
  const auto places = rig::placements();
  for (const stability::FusedView& view : views) {
    for (const double radius : {0.0, 0.003}) {
      const std::size_t i = out.size();
      Setting s{places[(4 * i) % places.size()], kSpeeds_m_per_s[(i + i / 3) % 3], o.method,
                o.judged};
      s.fused = &view;
      s.tip_radius_m = radius;
      out.push_back(std::move(s));
    }
  }
  return out;
}

}  // namespace teletact
