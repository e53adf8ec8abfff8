// The keys of [haptic], and what the task refuses at start.
#include <algorithm>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>

#include "rt/effect_count.hpp"
#include "tasks/haptic/haptic_task.hpp"

namespace tasks {

using perception::Vec3;

namespace {

[[noreturn]] void refuse(const std::ostringstream& text) { throw std::runtime_error(text.str()); }

}  // namespace

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

HapticTask::HapticTask(rt::NonRealtime&, const HapticConfig& config,
                       const drivers::DeviceProperties& device, double period_s,
                       double window_half_extent_m)
    : config_(config), period_s_(period_s) {
  ProxyMethod method = ProxyMethod::kConstrained;
  if (!parse_proxy_method(config.method, method)) {
    throw std::runtime_error("haptic.method = '" + config.method + "': allowed are " +
                             std::string(kProxyMethods));
  }
  effects_ = config.effects();
  using rt::Effect;
  if (config.friction_static > 0) rt::effect_built(Effect::kFriction);
  if (config.texture_amplitude_m > 0) rt::effect_built(Effect::kTexture);
  if (config.viscosity_N_s_per_m > 0) rt::effect_built(Effect::kViscosity);
  if (config.materials) rt::effect_built(Effect::kMaterials);
  proxy_step_ = proxy_step(method);
  stiffness_ = config.stiffness_N_per_m;
  constexpr double kOfDamping = 0.8;
  credit_N_s_per_m_ = kOfDamping * (config.credit_N_s_per_m >= 0 ? config.credit_N_s_per_m
                                    : device.damping_known       ? device.damping_N_s_per_m
                                                                 : 0.0);
  passivity_ = PassivityController(device.mass_kg, device.quantum_m, period_s);
  surface_.friction_static = config.friction_static;
  surface_.friction_dynamic = config.friction_dynamic;
  surface_.add(config.texture_amplitude_m, config.texture_period_m);
  side_ = TouchRules::Side(config, device.stiffness_limit(period_s));
  const double k_max = device.stiffness_limit(period_s);
  if (!(config.stiffness_N_per_m > 0) || config.stiffness_N_per_m > k_max) {
    std::ostringstream text;
    text << "haptic.stiffness_N_per_m = " << config.stiffness_N_per_m
         << " is above what the device renders stably: 0.8 b / (T/2 + t_d) = " << k_max
         << " N/m (b = " << device.damping_N_s_per_m << " N s/m, T = " << period_s
         << " s, t_d = " << device.delay_s << " s)";
    refuse(text);
  }
  const double half_min = device.speed_limit_m_per_s * config.scale * 0.1 + 0.05;
  if (window_half_extent_m > 0 && window_half_extent_m < half_min - 1e-9) {
    std::ostringstream text;
    text << "haptic: the patch window reaches " << window_half_extent_m
         << " m to each side, below the needed " << half_min << " m (speed limit "
         << device.speed_limit_m_per_s << " m/s x scale " << config.scale
         << " x 100 ms + 50 mm): use more nodes, a larger voxel or a smaller scale";
    refuse(text);
  }
  proxy_config_.tip_radius_m = config.tip_radius_m;
  proxy_config_.shade = config.shade;
  if (config.iterations_max > 0) proxy_config_.iterations_max = config.iterations_max;
  proxy_config_.paper_friction = config.paper_friction;
  force_limit_N_ = std::min(config.force_limit_N, device.force_limit_N);
  device_radius_m_ = device.workspace_radius_m;
  const auto& origin = config.workspace_W_m;
  workspace_ = Workspace({config.scale, Vec3(origin[0], origin[1], origin[2]),
                          config.workspace_yaw_deg * std::numbers::pi / 180.0, config.border_m,
                          config.border_rate_per_s});
}

}  // namespace tasks
