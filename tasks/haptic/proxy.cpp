#include "tasks/haptic/proxy.hpp"

#include <algorithm>

#include "tasks/haptic/descent.hpp"
#include "tasks/haptic/force_shading.hpp"

namespace tasks {

namespace {

void nearest(const Field& field, const Vec3& h, ProxyState& state, const ProxyConfig& cfg,
             int steps) noexcept {
  state.held = state.started_inside = false;
  state.contacts = 0;
  state.frame_size = 0;
  state.set_p(h);
  state.set_normal(Vec3::Zero());
  const FieldSample at_hand = field.sample(h);
  state.phase = at_hand.known ? ProxyState::Phase::kFree : ProxyState::Phase::kUnknown;
  if (!at_hand.known || at_hand.value > cfg.tip_radius_m) return;
  Vec3 p = h;
  double value = at_hand.value;
  for (int i = 0; i < steps; ++i) {
    const Vec3 g = field.smooth_gradient(p, 0.5);
    const double slope2 = g.squaredNorm();
    if (slope2 < 1e-6) break;
    p -= ((value - cfg.tip_radius_m) / slope2) * g;
    const FieldSample s = field.sample(p);
    if (!s.known) break;
    value = s.value;
  }
  const Vec3 out = p - h;
  const double length = out.norm();
  state.phase = ProxyState::Phase::kContact;
  state.contacts = 1;
  state.set_p(p);
  if (length > 0) state.set_normal(out / length);
}

}  // namespace

void step_constrained(const Field& field, const Vec3& p_WH, ProxyState& state,
                      const ProxyConfig& cfg) noexcept {
  using Phase = ProxyState::Phase;
  state.held = state.started_inside = false;
  state.contacts = 0;
  state.set_shift(Vec3::Zero());
  if (field.empty()) {
    state.set_p(p_WH);
    state.set_normal(Vec3::Zero());
    state.frame_size = 0;
    if (state.phase != Phase::kStart) state.phase = Phase::kUnknown;
    return;
  }
  Descent descent(field, p_WH, state, cfg);
  switch (state.phase) {
    case Phase::kStart:
      descent.place();
      break;
    case Phase::kContact:
      if (state.frame_size > 0 && (field.near_edge(p_WH) || field.near_edge(state.p_WP()))) {
        descent.hold();
      } else {
        descent.contact(state.p_WP());
      }
      break;
    case Phase::kUnknown:
    case Phase::kFree:
      descent.sweep();
      break;
  }
}

void step_nearest(const Field& field, const Vec3& p_WH, ProxyState& state,
                  const ProxyConfig& cfg) noexcept {
  nearest(field, p_WH, state, cfg, 1);
}

void step_nearest10(const Field& field, const Vec3& p_WH, ProxyState& state,
                    const ProxyConfig& cfg) noexcept {
  nearest(field, p_WH, state, cfg, 10);
}

double gone_back(const Field& field, const Vec3& p_W, double tip_radius_m) noexcept {
  constexpr double kSlopeLeast = 0.3;  // flatter is a rounded crease or the edge of the band
  const FieldSample s = field.sample(p_W);
  if (!s.known) return field.truncation();
  const double slope = std::max(s.gradient.norm(), kSlopeLeast);
  return std::max(s.value - tip_radius_m * std::max(1.0, slope), 0.0) / slope;
}

ProxyStep proxy_step(ProxyMethod method) noexcept {
  switch (method) {
    case ProxyMethod::kNearest:
      return &step_nearest;
    case ProxyMethod::kNearest10:
      return &step_nearest10;
    case ProxyMethod::kForceShading:
      return &step_force_shading;
    case ProxyMethod::kConstrained:
      break;
  }
  return &step_constrained;
}

bool parse_proxy_method(std::string_view name, ProxyMethod& out) noexcept {
  if (name == "nearest") {
    out = ProxyMethod::kNearest;
  } else if (name == "nearest10") {
    out = ProxyMethod::kNearest10;
  } else if (name == "force_shading") {
    out = ProxyMethod::kForceShading;
  } else if (name == "constrained") {
    out = ProxyMethod::kConstrained;
  } else {
    return false;
  }
  return true;
}

}  // namespace tasks
