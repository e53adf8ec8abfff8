// One tick of the constrained proxy: the descent from the last proxy to the point of the free side nearest to
// the hand, over at most three tangent planes at a time. Written for tasks/haptic/proxy.cpp alone; method and
// equations: docs/haptic_rendering.md. Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "tasks/haptic/field.hpp"
#include "tasks/haptic/nearest_on_planes.hpp"
#include "tasks/haptic/proxy.hpp"

namespace tasks {

inline constexpr double kSweepStep_vox = 0.25;

using perception::Vec3;

// What the proxy has to keep >= 0, and its gradient.
struct Gap {
  double value = 0;
  Vec3 gradient = Vec3::Zero();
  bool known = false;
};

struct Plane {
  HalfSpace half;
  Vec3 at = Vec3::Zero();  // where it was sampled
  bool fresh = false;      // found from the current proxy, not carried from an earlier one
  bool known = false;
};

// One tick of the constrained method: the working set, on the stack.
template <bool kTextured>
class Descent {
 public:
  Descent(const Field& field, const Vec3& h, ProxyState& state, const ProxyConfig& cfg) noexcept
      : field_(field), h_(h), state_(state), cfg_(cfg), radius_(cfg.tip_radius_m) {
    if (radius_ > 0) {
      // A projective field overstates distance (|gradient| > 1) at grazing views; the tip's radius
      // is a true length. Below 1 the gradient is that of a rounded crease and must not shrink it.
      radius_ *= std::max(1.0, field.smooth_gradient(state.p_WP()).norm());
    }
    stride_max_ = kSweepStep_vox * field.voxel();
    if constexpr (kTextured) {
      stride_max_ = std::min(stride_max_, 0.125 * cfg.texture_period_m);
      wave_ = 2 * std::numbers::pi / cfg.texture_period_m;
    }
    for (std::int32_t i = 0; i < state.frame_size; ++i) {
      const ProxyPlane& f = state.frame[static_cast<std::size_t>(i)];
      frame_[frame_size_++] = {Vec3(f.nx, f.ny, f.nz), f.d};
    }
  }

  [[nodiscard]] Gap gap(const Vec3& x) noexcept {
    const FieldSample s = field_.sample(x);
    if (!s.known) return held_gap(x);
    Gap g{s.value - radius_, s.gradient, true};
    if constexpr (kTextured) {
      for (int a = 0; a < 3; ++a) {
        g.value -= cfg_.texture_amplitude_m * std::sin(wave_ * x[a]);
        g.gradient[a] -= cfg_.texture_amplitude_m * wave_ * std::cos(wave_ * x[a]);
      }
    }
    return g;
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
  [[nodiscard]] Plane plane(const Vec3& x, const Gap& g, bool fresh) const noexcept;
  void probe(const Vec3& p) noexcept;
  bool lift(Vec3& p, Gap& g) noexcept;
  bool carry(Vec3& p, Gap& g) noexcept;
  void accept(const Vec3& p, const Gap& g) noexcept;
  void add(const Plane& plane) noexcept;
  bool drop_stale(unsigned active) noexcept;
  bool resample(const Vec3& p, unsigned active, double& trust) noexcept;
  bool hop(Vec3& p, Gap& g, double& trust) noexcept;
  [[nodiscard]] PlanesResult solve() const noexcept;
  [[nodiscard]] bool step(Vec3& p, Gap& g, double& trust) noexcept;
  void finish(const Vec3& p, const Gap& g) noexcept;
  void leave(const Vec3& p, bool free) noexcept;

  const Field& field_;
  const Vec3 h_;
  ProxyState& state_;
  const ProxyConfig& cfg_;
  double radius_;
  double stride_max_ = 0;  // of one descent step
  double wave_ = 0;        // 2 pi / period of the texture
  std::array<HalfSpace, 3> frame_{};
  std::size_t frame_size_ = 0;
  std::array<Plane, 3> planes_{};  // [0] is the tangent at the proxy
  std::size_t size_ = 0;
  unsigned active_ = 0;
};

extern template class Descent<false>;
extern template class Descent<true>;

}  // namespace tasks
