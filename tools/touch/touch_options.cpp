#include "tools/touch/touch_options.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <sstream>
#include <stdexcept>

#include "tasks/haptic/haptic_task.hpp"
#include "tools/cli/options.hpp"

namespace teletact::touch {

using perception::Vec3;

namespace {

void add_options(CLI::App& app, Options& o) {
  app.add_option("--field", o.field,
                 "NPY, float32 or float64, signed distance in m, positive outside, NaN = "
                 "unobserved, C order x,y,z");
  app.add_option("--fields", o.fields, "CSV t_s,file: fields that replace each other");
  app.add_option("--voxel", o.voxel_m, "node distance, m");
  app.add_option("--origin", o.origin, "x,y,z of node (0,0,0), m")->capture_default_str();
  app.add_option("--path", o.path,
                 "CSV t_s,x,y,z of the hand, m; a column clutch of 0 and 1 may follow");
  app.add_option("--method", o.method, std::string(tasks::kProxyMethods))->capture_default_str();
  app.add_option("--view", o.view,
                 "eye,look: six numbers x,y,z,x,y,z in m; the camera that force_shading casts from "
                 "(default: 1 m off the first contact)");
  app.add_option("--out", o.out, "trace CSV to write")->required();
  app.add_option("--debug", o.debug, "CSV with raw force, guards, constraints per tick");
  app.add_option("--json", o.json, "write the figures to this file");
  app.add_option("--stiffness", o.stiffness, "N/m")->capture_default_str();
  app.add_option("--tip-radius", o.tip_radius_m, "m")->capture_default_str();
  app.add_option("--force-limit", o.force_limit_N, "N")->capture_default_str();
  app.add_option("--rate", o.rate_hz, "ticks a second; default: one tick a row");
  app.add_option("--truncation", o.truncation_m, "m")->capture_default_str();
  app.add_option("--window", o.window_nodes, "nodes along an edge of the window")
      ->capture_default_str();
  app.add_option("--passivity", o.passivity, "on or off")->capture_default_str();
  app.add_option("--guard", o.guard, "slew guard, on or off")->capture_default_str();
  app.add_option("--blend", o.blend, "blend of windows, on or off")->capture_default_str();
  app.add_option("--friction", o.friction_static, "mu of rest; 0: none")->capture_default_str();
  app.add_option("--friction-dynamic", o.friction_dynamic,
                 "mu of slip; default: 0.8 of --friction");
  app.add_option("--paper-friction", o.paper_friction, "mu of the circle of force_shading");
  app.add_option("--texture", o.texture_m, "height of the bumps, m; 0: smooth");
  app.add_option("--texture-period", o.texture_period_m, "m")->capture_default_str();
  app.add_flag("--bump-normal", o.bump_normal,
               "bumps as a perturbed normal, as published, instead of a height");
  app.add_option("--palette", o.palette,
                 "CSV label,stiffness,friction,friction_dynamic,texture_m,texture_period_m: the "
                 "surface of each label, 0 to 15; stiffness is a share of --stiffness");
  app.add_option("--labels", o.labels, "NPY, uint8, the field's shape: the label of each node");
  app.add_option("--viscosity", o.viscosity, "drag of the hand, N s/m");
  app.add_option("--scale", o.scale, "scene metres per metre of the path")->capture_default_str();
  app.add_option("--border", o.border_m,
                 "rate control beyond this distance from the path's origin, m");
  app.add_option("--border-rate", o.border_rate_per_s, "m/s per m beyond the border")
      ->capture_default_str();
  app.add_option("--record", o.record, "haptic run to write: windows, hand, forces");
  app.add_option(
      "--replay", o.replay,
      "haptic run to touch again instead of --field and --path: as it was, to the last bit, "
      "or with another --method");
}

void check_replay(const CLI::App& app, Options& o) {
  // What the run was recorded with stays; an option that would be passed over in silence is
  // refused.
  for (const CLI::Option* option : app.get_options()) {
    const std::string name = option->get_name();
    const bool counts = name == "--replay" || name == "--method" || name == "--out" ||
                        name == "--json" || name == "--help";
    check(counts || option->count() == 0, name + " has no meaning with --replay");
  }
  check(!o.out.empty(), "--out is empty: the trace needs a file");
  if (app.count("--method") == 0) o.method.clear();
  check_outputs({{"--out", o.out}, {"--json", o.json}}, {o.replay});
}

void within(double v, double lo, double hi, const char* option) {
  std::ostringstream text;
  text << option << " " << v << ": allowed are " << lo << " to " << hi;
  check(v >= lo && v <= hi, text.str());
}

// Sets what follows from others.
void check_options(const CLI::App& app, Options& o) {
  check(!o.out.empty(), "--out is empty: the trace needs a file");
  check(!o.path.empty(), "--path is required");
  check(app.count("--voxel") > 0, "--voxel is required");
  check(o.field.empty() != o.fields.empty(), "one of --field and --fields is needed");
  within(o.voxel_m, 1e-4, 1, "--voxel");
  within(o.stiffness, 1, 1e5, "--stiffness");
  within(o.truncation_m, 1e-3, 1, "--truncation");
  within(o.tip_radius_m, 0, 0.8 * o.truncation_m, "--tip-radius");
  within(o.force_limit_N, 0.01, 1000, "--force-limit");
  if (app.count("--friction-dynamic") == 0) o.friction_dynamic = 0.8 * o.friction_static;
  within(o.friction_static, 0, 2, "--friction");
  within(o.friction_dynamic, 0, std::max(o.friction_static, 1e-9), "--friction-dynamic");
  within(o.paper_friction, 0, 2, "--paper-friction");
  check(app.count("--paper-friction") == 0 || o.method == "force_shading",
        "--paper-friction has no meaning with --method " + o.method + ": it is force_shading's");
  within(o.texture_m, 0, 0.002, "--texture");
  within(o.texture_period_m, 0.0004, 0.1, "--texture-period");
  within(o.viscosity, 0, 5, "--viscosity");
  within(o.window_nodes, 8, perception::SurfacePatch::kMaxNodes, "--window");
  within(o.scale, 0.01, 100, "--scale");
  within(o.border_m, 0, 1, "--border");
  within(o.border_rate_per_s, 0, 20, "--border-rate");
  if (app.count("--rate") > 0) within(o.rate_hz, 10, 1e5, "--rate");
  check(o.labels.empty() || !o.palette.empty(), "--labels needs --palette");
  if (!o.palette.empty()) {
    for (const char* other :
         {"--friction", "--friction-dynamic", "--texture", "--texture-period"}) {
      check(app.count(other) == 0,
            std::string(other) + " has no meaning with --palette: the surface is the label's");
    }
  }
  check(app.count("--border-rate") == 0 || o.border_m > 0, "--border-rate needs --border");
  check(app.count("--texture-period") == 0 || o.texture_m > 0, "--texture-period needs --texture");
  check(!o.bump_normal || o.texture_m > 0 || !o.palette.empty(),
        "--bump-normal needs --texture or --palette");
  check(o.window_nodes % 4 == 0, "--window must be a multiple of 4");
  check_outputs(
      {{"--out", o.out}, {"--debug", o.debug}, {"--json", o.json}, {"--record", o.record}},
      {o.field, o.fields, o.path, o.labels, o.palette});
}

}  // namespace

bool read_options(int argc, char** argv, Options& out) {
  CLI::App app("teletact touch: renders a distance field along a hand path", "teletact touch");
  add_options(app, out);
  if (!parse_options(app, argc, argv)) return false;
  if (out.replay.empty())
    check_options(app, out);
  else
    check_replay(app, out);
  return true;
}

void check(bool ok, const std::string& what) {
  if (!ok) throw std::runtime_error(what);
}

Vec3 parse_origin(const std::string& text) {
  Vec3 out;
  int used = 0;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf%n", &out.x(), &out.y(), &out.z(), &used) != 3 ||
      static_cast<std::size_t>(used) != text.size() || !out.allFinite() || out.norm() > 1e6) {
    throw std::runtime_error("--origin '" + text + "': three finite numbers x,y,z in metres");
  }
  return out;
}

bool on_off(const std::string& value, const std::string& option) {
  check(value == "on" || value == "off", option + " '" + value + "': allowed are on, off");
  return value == "on";
}

}  // namespace teletact::touch
