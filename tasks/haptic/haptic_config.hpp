// The keys of the haptic task: section [haptic] of the configuration.
// Forces, stiffness and damping are those at the device; lengths say whether they are scene metres.
// SI.
#pragma once

#include <array>
#include <string>

#include "config/schema.hpp"
#include "tasks/contract/table.hpp"

namespace tasks {

struct HapticConfig {
  std::string method = "constrained";
  double stiffness_N_per_m = 1000.0;                   // at the device
  double scale = 1.0;                                  // scene metres per hand metre
  std::array<double, 3> workspace_W_m{0.0, 0.0, 0.0};  // origin of D in W
  double workspace_yaw_deg = 0.0;                      // of D about z of W
  double border_m = 0.0;           // rate control beyond this radius at the device; 0: none
  double border_rate_per_s = 2.0;  // hand metres a second per metre beyond it
  double tip_radius_m = 0.0;       // scene metres
  int iterations_max = 0;          // of the proxy in a tick; 0: the method's own
  bool shade = true;               // go over the small bends of the samples without a step
  double force_limit_N = 12.0;
  double slew_N_per_s = 300.0;
  double slew_calm_N_per_s = 98.0;  // hand still and less than 1 N behind
  double fade_in_s = 0.05;          // after start inside, re-enable, reconnect
  double blend_s = 1.0 / 30.0;      // old patch -> new patch: one fusion period
  double patch_liveness_s = limit_of(EdgeId::kPatch, TaskId::kHaptic).liveness_ms / 1000.0;
  double ramp_s = 0.1;              // to zero when a patch is stale or on ramp-down
  double device_liveness_s = 0.01;  // last force held this long without a sample
  double mark_spacing_m = 0.02;
  double mark_rate_hz = 10.0;
  bool guard = true;  // slew guard
  // Effects (effects.hpp), off by default.
  double friction_static = 0, friction_dynamic = 0;
  double texture_amplitude_m = 0, texture_period_m = 0.002;
  bool bump_normal = false;  // the published perturbed normal instead of a height: to compare
  // Largest stiffness of a bump along the surface; 0: 3/4 of what the device renders stably.
  double texture_stiffness_N_per_m = 0;
  double viscosity_N_s_per_m = 0;
  bool materials = false;  // parameters from the patch's palette instead of the keys above

  [[nodiscard]] bool effects() const noexcept {
    return friction_static > 0 || texture_amplitude_m > 0 || viscosity_N_s_per_m > 0 || materials;
  }
  bool passivity_controller = true;
  // Damping of the device of which 4/5 is credited to the observer; -1: b where the device knows
  // it, else none.
  double credit_N_s_per_m = -1;
  double paper_friction = 0;  // method force_shading only: mu of the published friction circle

  // The published method stands on a ray cast of the map; no other method reads one.
  [[nodiscard]] bool asks_for_ray_cast() const noexcept { return method == "force_shading"; }

  void describe(config::Section& s);
};

}  // namespace tasks
