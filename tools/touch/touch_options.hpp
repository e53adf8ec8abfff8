// Options of `teletact touch`.
#pragma once

#include <string>

#include "perception/geometry/pose.hpp"
#include "perception/patch/surface_patch.hpp"

namespace teletact::touch {

struct Options {
  std::string field, fields, path, out, debug, json, origin = "0,0,0", method = "constrained";
  std::string view, passivity = "on", guard = "on", blend = "on", record, replay;
  std::string labels, palette;
  bool bump_normal = false;
  double voxel_m = 0, stiffness = 1000, tip_radius_m = 0, force_limit_N = 12, rate_hz = 0;
  double truncation_m = 0.05;
  double friction_static = 0, friction_dynamic = 0, viscosity = 0, paper_friction = 0;
  double texture_m = 0, texture_period_m = 0.002;
  double scale = 1, border_m = 0, border_rate_per_s = 2;
  int window_nodes = perception::SurfacePatch::kMaxNodes;
};

// Parses and checks the options. With --replay only replay, method (empty: not given), out and json
// apply. False: help was asked for and printed. Throws std::runtime_error with one line.
[[nodiscard]] bool read_options(int argc, char** argv, Options& out);

// Throw std::runtime_error: `what`, or the option and what it may be.
void check(bool ok, const std::string& what);
[[nodiscard]] perception::Vec3 parse_origin(const std::string& text);
[[nodiscard]] bool on_off(const std::string& value, const std::string& option);

}  // namespace teletact::touch
