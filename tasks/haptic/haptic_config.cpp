#include "tasks/haptic/haptic_config.hpp"

namespace tasks {

void HapticConfig::describe(config::Section& s) {
  s.text("method", method, {"constrained", "nearest", "nearest10", "force_shading"},
         "how the proxy is found");
  s.number("stiffness_N_per_m", stiffness_N_per_m, 1, 14500, "spring at the device");
  s.number("scale", scale, 0.01, 100, "scene metres per hand metre");
  s.numbers("workspace_W_m", workspace_W_m, -1000, 1000, "centre of the device workspace in W");
  s.number("workspace_yaw_deg", workspace_yaw_deg, -360, 360, "device base about z of W");
  s.number("border_m", border_m, 0, 1, "rate control beyond this radius of the device; 0: none");
  s.number("border_rate_per_s", border_rate_per_s, 0, 20, "hand m/s per m beyond the border");
  s.number("tip_radius_m", tip_radius_m, 0, 0.04, "radius of the proxy, in the scene");
  s.integer("iterations_max", iterations_max, 0, 10000,
            "steps of the proxy in a tick; 0: the method's own");
  s.flag("shade", shade, "go over the small bends of the samples without a step");
  s.number("force_limit_N", force_limit_N, 0.1, 12, "largest force on the hand");
  s.number("slew_N_per_s", slew_N_per_s, 10, 10000, "fastest change of force at a still hand");
  s.number("slew_calm_N_per_s", slew_calm_N_per_s, 10, 10000,
           "the same while the force is less than 1 N behind");
  s.number("fade_in_s", fade_in_s, 0, 1, "after start inside, re-enable, reconnect");
  s.number("blend_s", blend_s, 0, 1, "old patch to new patch");
  s.number("patch_liveness_s", patch_liveness_s, 0.01, 10, "oldest publication still touched");
  s.number("ramp_s", ramp_s, 0.001, 1, "to zero when a patch is stale or on ramp-down");
  s.number("device_liveness_s", device_liveness_s, 0, 0.1, "last force held without a sample");
  s.number("mark_spacing_m", mark_spacing_m, 0.001, 1, "distance between points of a mark");
  s.number("mark_rate_hz", mark_rate_hz, 0.1, 1000, "points of a mark a second, at least");
  s.number("paper_friction", paper_friction, 0, 2, "mu of method force_shading's circle");
  s.number("friction_static", friction_static, 0, 2, "mu of rest; 0: no friction");
  s.number("friction_dynamic", friction_dynamic, 0, 2, "mu of slip, at most friction_static");
  s.number("texture_amplitude_m", texture_amplitude_m, 0, 0.002, "height of the bumps; 0: smooth");
  s.number("texture_period_m", texture_period_m, 0.0004, 0.1, "from bump to bump");
  s.flag("bump_normal", bump_normal, "bumps as a perturbed normal instead of a height: to compare");
  s.number(
      "texture_stiffness_N_per_m", texture_stiffness_N_per_m, 0, 1e9,
      "largest stiffness of a bump along the surface; 0: 3/4 of what the device renders stably; "
      "the slew guard's at most");
  s.number("viscosity_N_s_per_m", viscosity_N_s_per_m, 0, 5, "drag of the hand");
  s.flag("materials", materials, "surface parameters from the palette of the map's labels");
  s.flag("guard", guard, "slew guard");
  s.flag("passivity_controller", passivity_controller,
         "take away what neither hand nor device paid for");
  s.number("credit_N_s_per_m", credit_N_s_per_m, -1, 100,
           "damping of the device of which 4/5 is credited; -1: its own where it is known");
}

}  // namespace tasks
