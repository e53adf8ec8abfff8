#include "tasks/haptic/effects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace tasks {

using perception::Material;
using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr int kStillTicks = 20;  // slip without motion for so long is at rest

// From p_c along t in steps of a quarter voxel, lifted out of the solid at each; p_c itself when
// the way is barred.
Vec3 swept(const Field& field, const Vec3& p_c, const Vec3& t, const Vec3& n,
           double radius) noexcept {
  const double length = t.norm(), step = 0.25 * field.voxel();
  const int steps = std::clamp(static_cast<int>(std::ceil(length / step)), 1, 8);
  Vec3 q = p_c;
  for (int i = 1; i <= steps; ++i) {
    q += t / steps;
    for (int k = 0; k < 4; ++k) {
      const FieldSample s = field.sample(q);
      const double slope = s.gradient.norm();
      if (!s.known || s.value >= radius || slope < 0.05) break;
      q += (std::min((radius - s.value) / slope, step) / slope) * s.gradient;
    }
  }
  // Lifted out of the spring's side: a wall stands in the way.
  return (q - p_c).dot(n) < -length ? p_c : q;
}

// J v, J = dp_c / dh on one smooth sheet: Z (Z' (I - lambda H) Z)^-1 Z', Z the tangent plane at p and
// lambda grad phi = p - h. A bulge that would carry the foot off faster than twice the hand is not believed.
Vec3 followed(const Field& field, const Vec3& p, const Vec3& h, const Vec3& n,
              const Vec3& v) noexcept {
  Vec3 flat = v - v.dot(n) * n;
  const Vec3 q = p / field.voxel();
  if (!(q.cwiseAbs().maxCoeff() < 1e9)) return flat;
  std::array<std::int32_t, 3> at{};
  Vec3 u;
  for (std::size_t a = 0; a < 3; ++a) {
    const auto i = static_cast<Eigen::Index>(a);
    at[a] = static_cast<std::int32_t>(std::floor(q[i]));
    u[i] = q[i] - at[a];
  }
  CellSample s;
  if (!field.sample_in(at, u, s)) return flat;
  const double slope2 = s.gradient.squaredNorm();
  if (slope2 < 1e-16) return flat;
  const double lambda = std::max(0.0, s.gradient.dot(q - h / field.voxel()) / slope2);
  const auto bent = [&](const Vec3& a, const Vec3& b) {
    const Vec3& e = s.bend;
    return a.dot(b) - lambda * (e.x() * (a.y() * b.z() + a.z() * b.y()) +
                                e.y() * (a.x() * b.z() + a.z() * b.x()) +
                                e.z() * (a.x() * b.y() + a.y() * b.x()));
  };
  const Vec3 t1 = n.unitOrthogonal(), t2 = n.cross(t1);
  double a = bent(t1, t1), c = bent(t2, t2);
  const double b = bent(t1, t2), least = 0.5 * (a + c) - std::hypot(0.5 * (a - c), b);
  if (least < 0.5) {
    a += 0.5 - least;
    c += 0.5 - least;
  }
  const double det = a * c - b * b, v1 = t1.dot(v), v2 = t2.dot(v);
  return ((c * v1 - b * v2) / det) * t1 + ((a * v2 - b * v1) / det) * t2;
}

}  // namespace

Vec3 with_friction(const Field& field, const Vec3& h, ProxyState& state, double mu_static,
                   double mu_dynamic, double radius) noexcept {
  Vec3 p_c = state.rendered_WP();
  const Vec3 out = p_c - h;
  const double d = out.norm();
  if (state.phase != ProxyState::Phase::kContact || d < 1e-6 || mu_static <= 0) {
    state.anchored = state.slipping = false;
    return p_c;
  }
  if (!state.anchored) {
    state.anchored = true;
    state.slipping = false;
    state.set_anchor(p_c);
  }
  const Vec3 n = out / d, away = state.anchor_W() - p_c;
  Vec3 t = away - away.dot(n) * n;
  const double length = t.norm(), slip = std::min(mu_dynamic, mu_static) * d;
  if (length > (state.slipping ? slip : mu_static * d)) {
    state.still = state.slipping && length < slip + 1e-6 ? state.still + 1 : 0;
    state.slipping = state.still < kStillTicks;
    t *= slip / length;
    state.set_anchor(p_c + t);
  } else if (state.slipping) {
    // At the rim the hand rests, inside it the motion has turned.
    const bool turned = length < slip - 1e-6;
    state.still = turned ? kStillTicks : state.still + 1;
    if (state.still >= kStillTicks) {
      state.slipping = false;
      state.still = 0;
    }
  }
  return t.squaredNorm() > 0 ? swept(field, p_c, t, n, radius) : p_c;
}

Bumped with_texture(const Field& field, const Vec3& h, const ProxyState& state, double amplitude_m,
                    double period_m, double tip_radius_m) noexcept {
  using Phase = ProxyState::Phase;
  Bumped out;
  Vec3 foot = state.rendered_WP(), n = state.normal_W();
  double d = (foot - h).norm();
  if (state.phase == Phase::kContact) {
    if (d > 1e-5) n = (foot - h) / d;
  } else {
    if (state.phase != Phase::kFree || field.empty()) return out;
    const FieldSample s = field.sample(h);
    const double rise = s.gradient.norm();
    if (!s.known || rise < 0.3) return out;
    n = s.gradient / rise;
    d = tip_radius_m * std::max(1.0, 1 / rise) - s.value / rise;
    if (d < -3 * amplitude_m) return out;  // above the highest bump
    foot = h + d * n;
  }
  const double wave = 2 * std::numbers::pi / period_m;
  double height = 0;
  Vec3 slope;
  for (int a = 0; a < 3; ++a) {
    height += amplitude_m * std::sin(wave * foot[a]);
    slope[a] = amplitude_m * wave * std::cos(wave * foot[a]);
  }
  out.stretch_m = d + height;
  if (out.stretch_m <= 0) {  // over a trough
    out.stretch_m = 0;
    return out;
  }
  out.contact = true;
  out.lift_W = foot + height * n - state.rendered_WP();
  // The ways on which the foot follows the hand.
  Vec3 along = slope - slope.dot(n) * n;
  if (state.phase == Phase::kContact && state.contacts == 1) {
    along = followed(field, foot, h, n, slope);
  } else if (state.phase == Phase::kContact && state.contacts > 1) {
    const ProxyPlane &a = state.frame[0], &b = state.frame[1];
    const Vec3 edge = Vec3(a.nx, a.ny, a.nz).cross(Vec3(b.nx, b.ny, b.nz));
    const double size2 = edge.squaredNorm();
    const bool one_way = state.contacts == 2 && state.frame_size >= 2 && size2 > 1e-12;
    along = one_way ? Vec3((slope.dot(edge) / size2) * edge) : Vec3::Zero();
  }
  // 1 / (A wave^2) is the bumps' own radius of curvature.
  out.elastic_W =
      out.stretch_m * n - std::min(out.stretch_m, 1 / (amplitude_m * wave * wave)) * along;
  return out;
}

bool material_at(const SurfacePatch& patch, const Vec3& p_W, Material& out) noexcept {
  const Vec3 q = p_W / patch.voxel_size;
  if (!(q.cwiseAbs().maxCoeff() < 1e9)) return false;
  const Eigen::Array3i cell = q.array().floor().cast<int>();
  const Vec3 u = q - cell.cast<double>().matrix();
  double sum = 0, stiffness = 0, mu_s = 0, mu_d = 0, amplitude = 0, period = 0;
  for (int c = 0; c < 8; ++c) {
    const Eigen::Array3i bit(c >> 2, (c >> 1) & 1, c & 1);
    const Eigen::Array3i i =
        cell + bit -
        Eigen::Array3i(patch.origin_node[0], patch.origin_node[1], patch.origin_node[2]);
    if ((i < 0).any() || (i >= patch.nodes).any()) continue;
    const std::uint8_t slot = patch.material[patch.index(i.x(), i.y(), i.z())];
    if (slot == 0 || slot > SurfacePatch::kMaxMaterials) continue;
    double w = 1;
    for (int a = 0; a < 3; ++a) w *= bit[a] != 0 ? u[a] : 1 - u[a];
    const Material& m = patch.palette[slot - 1U];
    sum += w;
    stiffness += w * static_cast<double>(m.stiffness_scale);
    mu_s += w * static_cast<double>(m.friction_static);
    mu_d += w * static_cast<double>(m.friction_dynamic);
    amplitude += w * static_cast<double>(m.texture_amplitude_m);
    period += w * static_cast<double>(m.texture_period_m);
  }
  if (sum < 1e-9) return false;
  out.stiffness_scale = static_cast<float>(std::clamp(stiffness / sum, 0.0, 1.0));
  out.friction_static = static_cast<float>(std::clamp(mu_s / sum, 0.0, 2.0));
  out.friction_dynamic = static_cast<float>(std::clamp(mu_d / sum, 0.0, 2.0));
  out.texture_amplitude_m = static_cast<float>(amplitude / sum);
  out.texture_period_m = static_cast<float>(period / sum);
  return true;
}

void follow(Material& now, const Material& goal, double stiffness, double stretch,
            double force_step) noexcept {
  const double force = std::max(stiffness * stretch, 1e-3);  // of the whole spring
  const auto towards = [](float& value, float to, double most) {
    const auto step = static_cast<float>(most);
    value += std::clamp(to - value, -step, step);
  };
  towards(now.stiffness_scale, goal.stiffness_scale, force_step / force);
  towards(now.friction_static, goal.friction_static, force_step / force);
  towards(now.friction_dynamic, goal.friction_dynamic, force_step / force);
  towards(now.texture_amplitude_m, goal.texture_amplitude_m, force_step / stiffness);
  now.texture_period_m = goal.texture_period_m;
}

}  // namespace tasks
