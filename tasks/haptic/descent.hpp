// One tick of the constrained proxy: how contact begins, is carried over a changed field, is held
// and ends; the descent itself is cell_flow.hpp. Written for tasks/haptic/proxy.cpp alone; method
// and equations: docs/haptic_rendering.md. Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "tasks/haptic/cell_flow.hpp"
#include "tasks/haptic/field.hpp"
#include "tasks/haptic/nearest_on_planes.hpp"
#include "tasks/haptic/proxy.hpp"
#include "tasks/haptic/touch_rules.hpp"

namespace tasks {

inline constexpr double kSweepStep_vox = 0.25;

using perception::Vec3;

// What the proxy has to keep >= 0, and its gradient.
struct Gap {
  double value = 0;
  Vec3 gradient = Vec3::Zero();
  bool known = false;
};

// One tick of the constrained method: the working set, on the stack.
class Descent {
 public:
  Descent(const Field& field, const Vec3& h, ProxyState& state, const ProxyConfig& cfg) noexcept
      : field_(field), h_(h), state_(state), cfg_(cfg), radius_(cfg.tip_radius_m) {
    if (radius_ > 0) radius_ = radius_at(state.p_WP());
    for (std::int32_t i = 0; i < state.frame_size; ++i) {
      const ProxyPlane& f = state.frame[static_cast<std::size_t>(i)];
      frame_[frame_size_++] = {Vec3(f.nx, f.ny, f.nz), f.d};
    }
  }

  [[nodiscard]] Gap gap(const Vec3& x) noexcept {
    const FieldSample s = field_.sample(x);
    if (!s.known) return held_gap(x);
    return {s.value - radius_, s.gradient, true};
  }

  void place() noexcept;
  void sweep() noexcept;
  void contact(Vec3 p) noexcept;
  void hold() noexcept;

 private:
  // Unknown space in contact: the surface goes on as the last contact planes.
  [[nodiscard]] Gap held_gap(const Vec3& x) noexcept {
    Gap g{1.0, state_.normal_W(), false};
    for (std::size_t i = 0; i < frame_size_; ++i) {
      const double d = frame_[i].distance(x);
      if (d < g.value) g = {d, frame_[i].n, false};
    }
    return g;
  }
  // A projective field overstates distance (|gradient| > 1) at grazing views; the tip's radius
  // is a true length. Below 1 the gradient is that of a rounded crease and must not shrink it.
  // Beside unknown space the last slope goes on, as the contact planes do: by what half the cells
  // say it would come and go with every tick.
  [[nodiscard]] double radius_at(const Vec3& p) noexcept {
    if (state_.phase != ProxyState::Phase::kContact || !meets_unknown(p)) {
      state_.slope = std::max(1.0, field_.smooth_gradient(p).norm());
    }
    return TouchRules::tip_radius_m(cfg_.tip_radius_m, state_.slope);
  }
  [[nodiscard]] bool meets_unknown(const Vec3& p) const noexcept;
  [[nodiscard]] Gap gap_at_proxy(const Vec3& p) noexcept;
  bool lift(Vec3& p, Gap& g) noexcept;
  bool carry(Vec3& p, Gap& g) noexcept;
  void finish(const Vec3& p, const std::array<Tangent, 3>& tangents, std::size_t count) noexcept;
  void leave(const Vec3& p, bool free) noexcept;
  [[nodiscard]] Vec3 crossing(Vec3 out, double value_out, Vec3 in, double value_in) const noexcept;

  const Field& field_;
  const Vec3 h_;
  ProxyState& state_;
  const ProxyConfig& cfg_;
  double radius_;
  std::array<HalfSpace, 3> frame_{};
  std::size_t frame_size_ = 0;
};

}  // namespace tasks
