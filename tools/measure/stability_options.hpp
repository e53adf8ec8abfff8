// The command line of `teletact stability`, and the settings it asks for.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "tools/measure/stability/cases.hpp"

namespace teletact {

struct StabilityOptions {
  std::string json, svg, method = "constrained", layer = "on";
  std::set<int> cases;  // those to run
  bool quick = false, verbose = false, judged = true, fused = false, beside = false,
       allow_bound = false;
  double tip_radius_m = 0;
  double patch_smooth = perception::SmoothOptions{}.radius;      // of the fused fields, voxels
  std::vector<double> angles_deg, offsets_vox, speeds_mm_per_s;  // other placements than the usual

  // Nothing but what the limits are written for: then the fused fields belong to it.
  [[nodiscard]] bool usual() const {
    return angles_deg.empty() && offsets_vox.empty() && speeds_mm_per_s.empty() &&
           tip_radius_m == 0 && method != "force_shading";
  }
};

// False: help was asked for and printed. Throws std::runtime_error naming option, value and what is
// allowed.
[[nodiscard]] bool parse_stability(int argc, char** argv, StabilityOptions& out);

// A method with or without the stability layer.
struct Variant {
  std::string method;
  bool layer = true;
  [[nodiscard]] std::string name() const { return layer ? method : method + ", off"; }
};
// The first is the one that is judged. The others beside it: every method without the layer, then
// every one with it, as far as asked for.
[[nodiscard]] std::vector<Variant> variants(const StabilityOptions& o, bool fused);

// Every placement at every speed; quick: each placement at one speed, each speed at each rotation.
[[nodiscard]] std::vector<stability::Setting> settings(const StabilityOptions& o);
// Of the solids as the product fuses them: every view with a tip of 0 and 3 mm, each at another
// placement and speed.
[[nodiscard]] std::vector<stability::Setting> fused_settings(
    const StabilityOptions& o, const std::vector<stability::FusedView>& views);

}  // namespace teletact
