// What the haptic task refuses at start, and what it is made of.
#include <algorithm>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>

#include "tasks/haptic/haptic_task.hpp"

namespace tasks {

using perception::Vec3;

namespace {

[[noreturn]] void refuse(const std::ostringstream& text) { throw std::runtime_error(text.str()); }

Contact contact_of(const HapticConfig& config) {
  ProxyMethod method = ProxyMethod::kConstrained;
  if (!parse_proxy_method(config.method, method)) {
    throw std::runtime_error("haptic.method = '" + config.method + "': allowed are " +
                             std::string(kProxyMethods));
  }
  ProxyConfig proxy;
  proxy.tip_radius_m = config.tip_radius_m;
  proxy.shade = config.shade;
  if (config.iterations_max > 0) proxy.iterations_max = config.iterations_max;
  proxy.paper_friction = config.paper_friction;
  return Contact(proxy_step(method), proxy);
}

WorkspaceConfig workspace_of(const HapticConfig& config) {
  const auto& origin = config.workspace_W_m;
  return {config.scale, Vec3(origin[0], origin[1], origin[2]),
          config.workspace_yaw_deg * std::numbers::pi / 180.0, config.border_m,
          config.border_rate_per_s};
}

}  // namespace

HapticTask::HapticTask(rt::NonRealtime&, const HapticConfig& config,
                       const drivers::DeviceProperties& device, double period_s,
                       double window_half_extent_m)
    : config_(config),
      period_s_(period_s),
      force_limit_N_(std::min(config.force_limit_N, device.force_limit_N)),
      device_radius_m_(device.workspace_radius_m),
      workspace_(workspace_of(config)),
      blend_(config.blend_s),
      contact_(contact_of(config)),
      effects_(config, device.stiffness_limit(period_s), period_s),
      gain_(config.fade_in_s, config.ramp_s),
      books_(config, device, force_limit_N_, period_s),
      guard_(config, force_limit_N_, period_s),
      events_(config.mark_spacing_m, config.mark_rate_hz) {
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
}

}  // namespace tasks
