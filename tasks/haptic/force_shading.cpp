#include "tasks/haptic/force_shading.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

using perception::Vec3;

namespace {

using Floats = float __attribute__((vector_size(32)));
using Ints = std::int32_t __attribute__((vector_size(32)));
constexpr std::size_t kWide = 8;

struct Best {
  Floats d;
  Ints at;
};

inline __attribute__((always_inline)) void take(Best& best, const float* x, const float* y,
                                                const float* z, std::size_t i, const Floats& gx,
                                                const Floats& gy, const Floats& gz) noexcept {
  Floats dx, dy, dz;
  __builtin_memcpy(&dx, x + i, sizeof dx);
  __builtin_memcpy(&dy, y + i, sizeof dy);
  __builtin_memcpy(&dz, z + i, sizeof dz);
  dx -= gx;
  dy -= gy;
  dz -= gz;
  const Floats d = dx * dx + dy * dy + dz * dz;
  const Ints nearer = d < best.d;
  best.d = nearer ? d : best.d;
  best.at = nearer ? Ints{} + static_cast<std::int32_t>(i) : best.at;
}

// Two rows of lanes; each keeps its first smallest, so the lowest index wins in the end.
inline __attribute__((always_inline)) std::size_t reduce(const SurfacePoints& s,
                                                         const Vec3& g) noexcept {
  const Floats gx = Floats{} + static_cast<float>(g.x()), gy = Floats{} + static_cast<float>(g.y()),
               gz = Floats{} + static_cast<float>(g.z());
  Best a{Floats{} + HUGE_VALF, Ints{}}, b = a;
  const float *x = s.x.data(), *y = s.y.data(), *z = s.z.data();
  for (std::size_t i = 0; i < s.x.size(); i += 2 * kWide) {
    take(a, x, y, z, i, gx, gy, gz);
    take(b, x, y, z, i + kWide, gx, gy, gz);
  }
  float least = HUGE_VALF;
  std::size_t at = 0;
  for (const Best& row : {a, b}) {
    for (std::size_t k = 0; k < kWide; ++k) {
      const std::size_t index = static_cast<std::size_t>(row.at[k]) + k;
      if (row.d[k] < least || (row.d[k] == least && index < at)) {
        least = row.d[k];
        at = index;
      }
    }
  }
  return at;
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) std::size_t reduce_avx2(const SurfacePoints& s,
                                                        const Vec3& g) noexcept {
  return reduce(s, g);
}
#endif
std::size_t reduce_base(const SurfacePoints& s, const Vec3& g) noexcept { return reduce(s, g); }

using Reduce = std::size_t (*)(const SurfacePoints&, const Vec3&) noexcept;
Reduce choose() noexcept {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return &reduce_avx2;
#endif
  return &reduce_base;
}
const Reduce kReduce = choose();

// False: no ray met anything, or what it met is no number.
bool stand_on(const SurfacePoints& s, const Vec3& goal, ProxyState& state) noexcept {
  const std::size_t i = nearest_index(s, goal);
  if (!(s.x[i] < SurfacePoints::kFar)) return false;
  state.set_p(s.point(i));
  state.set_normal(s.normal(i));
  return true;
}

// The tick after a first contact; false: the contact ends.
bool go_on(const SurfacePoints& s, const Vec3& h, ProxyState& state, double mu) noexcept {
  const Vec3 p = state.p_WP(), n = state.normal_W();
  const double depth = (h - p).dot(n);
  const Vec3 foot = h - depth * n;
  Vec3 goal = foot;
  if (mu > 0) {
    const double radius = mu * std::abs(depth);
    const Vec3 out = p - foot;  // p' lies on the tangent plane, as foot does
    const double away = out.norm();
    if (away <= radius) return depth < 0;  // p' stays
    goal = foot + (radius / away) * out;
  }
  return stand_on(s, goal, state) && (h - state.p_WP()).dot(state.normal_W()) < 0;
}

}  // namespace

std::size_t nearest_index(const SurfacePoints& s, const Vec3& g) noexcept { return kReduce(s, g); }

std::size_t nearest_index_scalar(const SurfacePoints& s, const Vec3& g) noexcept {
  const auto gx = static_cast<float>(g.x()), gy = static_cast<float>(g.y()),
             gz = static_cast<float>(g.z());
  float least = HUGE_VALF;
  std::size_t at = 0;
  for (std::size_t i = 0; i < s.count; ++i) {
    const float dx = s.x[i] - gx, dy = s.y[i] - gy, dz = s.z[i] - gz;
    const float d = dx * dx + dy * dy + dz * dz;
    if (d < least) {
      least = d;
      at = i;
    }
  }
  return at;
}

void step_force_shading(const Field& field, const Vec3& h, ProxyState& state,
                        const ProxyConfig& cfg) noexcept {
  using Phase = ProxyState::Phase;
  const FieldSample at_hand = field.sample(h);
  const bool was_outside = state.outside, was_contact = state.phase == Phase::kContact;
  state.outside = at_hand.known && at_hand.value > 0;
  state.held = state.started_inside = false;
  state.contacts = 0;
  const bool surface = cfg.surface != nullptr && cfg.surface->count > 0;
  if (surface && was_contact) {
    if (go_on(*cfg.surface, h, state, cfg.paper_friction)) {
      state.contacts = 1;
      return;
    }
    // It has ended; another one begins only when the hand comes from outside.
  } else if (surface && was_outside && at_hand.known && at_hand.value <= 0 &&
             stand_on(*cfg.surface, h, state)) {
    state.phase = Phase::kContact;
    state.contacts = 1;
    return;
  }
  state.phase = state.outside ? Phase::kFree : Phase::kUnknown;
  state.set_p(h);
  state.set_normal(Vec3::Zero());
}

}  // namespace tasks
