#include "tasks/haptic/effects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "tasks/haptic/cell_flow.hpp"
#include "tasks/haptic/touch_rules.hpp"

namespace tasks {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr int kStillTicks = 20;  // slip without motion for so long is at rest

// From p_c along t in steps of a quarter voxel, lifted out of the solid along the gradient at each.
// False: nothing stood in the way. `up`: the last gradient's direction.
bool lifted(const Field& field, const Vec3& t, double radius, Vec3& q, Vec3& up) noexcept {
  const double step = 0.25 * field.voxel();
  const int steps = std::clamp(static_cast<int>(std::ceil(t.norm() / step)), 1, 8);
  bool in = false;
  for (int i = 1; i <= steps; ++i) {
    q += t / steps;
    for (int k = 0; k < 4; ++k) {
      const FieldSample s = field.sample(q);
      const double slope = s.gradient.norm();
      if (!s.known || s.value >= radius || slope < 0.05) break;
      up = s.gradient / slope;
      q += std::min((radius - s.value) / slope, step) * up;
      in = true;
    }
  }
  return in;
}

// From q, or from p_c where q is in the solid, down to the free place that is nearest to `end`.
Vec3 nearest_free(const Field& field, const ProxyState& state, const Vec3& p_c, const Vec3& q,
                  const Vec3& end, double radius) noexcept {
  ProxyConfig cfg;
  cfg.iterations_max = 24;
  std::array<HalfSpace, 3> held{};
  std::size_t size = 0;
  for (std::int32_t i = 0; i < state.frame_size; ++i) {
    const ProxyPlane& f = state.frame[static_cast<std::size_t>(i)];
    held[size++] = {Vec3(f.nx, f.ny, f.nz), f.d};
  }
  const FieldSample s = field.sample(q);
  const bool free = !s.known || s.value >= radius - 10 * cfg.tolerance_m;
  return CellFlow(field, cfg, radius, end, held, size).run(free ? q : p_c);
}

// Where t from p_c ends, or the free place nearest to that; p_c itself when the way is barred. A
// lift along the gradient is that place on a face; where faces meet, the descent of the proxy finds
// it.
Vec3 swept(const Field& field, const ProxyState& state, const Vec3& p_c, const Vec3& t,
           const Vec3& n, double radius) noexcept {
  constexpr double kAside_m = 2e-5;
  Vec3 q = p_c, up = n;
  if (lifted(field, t, radius, q, up)) {
    const Vec3 off = p_c + t - q;
    if ((off - off.dot(up) * up).squaredNorm() > kAside_m * kAside_m) {
      q = nearest_free(field, state, p_c, q, p_c + t, radius);
    }
  }
  // Lifted out of the spring's side: a wall stands in the way.
  return (q - p_c).dot(n) < -t.norm() ? p_c : q;
}

// J v, J = dp_c / dh on one smooth sheet: Z (Z' (I - lambda H) Z)^-1 Z', Z the tangent plane at p
// and lambda grad phi = p - h. A bulge that would carry the foot off faster than twice the hand is
// not believed.
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

constexpr double kShortestPeriod_m = 0.0004;  // two samples a tick at 200 mm/s
constexpr double kHighestBump_m = 0.005;

double wave_of(const Bumps& b) noexcept { return 2 * std::numbers::pi / b.period_m; }

struct Relief {
  double height = 0;
  Vec3 slope = Vec3::Zero();
};
Relief relief_at(const Surface& surface, const Vec3& foot) noexcept {
  Relief out;
  for (std::size_t i = 0; i < surface.patterns; ++i) {
    const Bumps& b = surface.bumps[i];
    const double wave = wave_of(b);
    for (int a = 0; a < 3; ++a) {
      out.height += b.amplitude_m * std::sin(wave * foot[a]);
      out.slope[a] += b.amplitude_m * wave * std::cos(wave * foot[a]);
    }
  }
  out.height = TouchRules::bump_height_m(out.height);
  return out;
}

}  // namespace

Vec3 with_friction(const Field& field, const Vec3& h, ProxyState& state, const FrictionCone& cone,
                   double radius) noexcept {
  Vec3 p_c = state.rendered_WP();
  const Vec3 out = p_c - h;
  const double d = out.norm();
  if (state.phase != ProxyState::Phase::kContact || d < 1e-6 || cone.mu_static <= 0) {
    state.anchored = state.slipping = false;
    return p_c;
  }
  if (!state.anchored) {
    state.anchored = true;
    state.slipping = false;
    state.set_anchor(p_c);
  }
  state.set_anchor(TouchRules::anchor_W(state.anchor_W(), p_c));
  const Vec3 n = out / d, away = state.anchor_W() - p_c;
  Vec3 t = away - away.dot(n) * n;
  const double rest = TouchRules::mu_of_rest(cone.mu_static, cone.mu_dynamic) * d;
  const double length = t.norm(), slip = std::min(cone.mu_dynamic, cone.mu_static) * d;
  if (length > (state.slipping ? slip : rest)) {
    // A cone that has closed over a proxy at rest takes it along at its rim: that is no slip.
    const bool closed = !state.slipping && length <= cone.mu_static_before * d;
    if (!closed) {
      state.still = state.slipping && length < slip + 1e-6 ? state.still + 1 : 0;
      state.slipping = state.still < kStillTicks;
    }
    t *= (closed ? rest : slip) / length;
    state.set_anchor(p_c + t);
  } else if (state.slipping) {
    // At the rim the hand rests, inside it the motion has turned. From the rim of a cone that opens
    // the proxy comes to be inside too, and goes on.
    const double rim = cone.moves ? std::min(slip, state.rubbed) : slip;
    const bool turned = length < rim - 1e-6;
    const bool onwards = cone.moves && length > state.rubbed + 1e-9;
    state.still = turned ? kStillTicks : onwards ? 0 : state.still + 1;
    if (state.still >= kStillTicks) {
      state.slipping = false;
      state.still = 0;
    }
  }
  state.rubbed = t.norm();
  return t.squaredNorm() > 0 ? swept(field, state, p_c, t, n, radius) : p_c;
}

void Surface::add(double amplitude_m, double period_m) noexcept {
  if (!(amplitude_m > 0)) return;
  const double period = std::max(period_m, kShortestPeriod_m);
  for (std::size_t i = 0; i < patterns; ++i) {
    if (bumps[i].period_m == period) {
      bumps[i].amplitude_m += amplitude_m;
      return;
    }
  }
  if (patterns < kMostPatterns) bumps[patterns++] = {amplitude_m, period};
}

double Surface::height_m() const noexcept {
  double sum = 0;
  for (std::size_t i = 0; i < patterns; ++i) sum += bumps[i].amplitude_m;
  return sum;
}

double Surface::curvature_per_m() const noexcept {
  double sum = 0;
  for (std::size_t i = 0; i < patterns; ++i) {
    sum += bumps[i].amplitude_m * wave_of(bumps[i]) * wave_of(bumps[i]);
  }
  return sum;
}

double Surface::steepness() const noexcept {
  double sum = 0;
  for (std::size_t i = 0; i < patterns; ++i) sum += bumps[i].amplitude_m * wave_of(bumps[i]);
  return std::sqrt(3.0) * sum;
}

Bumped with_texture(const Field& field, const Vec3& h, const ProxyState& state,
                    const Surface& surface, double reach_m, double tip_radius_m) noexcept {
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
    if (d < -3 * surface.height_m()) return out;  // above the highest bump
    foot = h + d * n;
  }
  const Relief relief = relief_at(surface, foot);
  const BumpForce bump = TouchRules::bump_force(d + relief.height, std::max(d, 0.0), reach_m);
  out.stretch_m = bump.stretch_m;
  if (out.stretch_m <= 0) return out;  // over a trough
  out.contact = true;
  out.lift_W = foot + (bump.pull_m - d) * n - state.rendered_WP();
  out.elastic_W = bump.pull_m * n;
  if (bump.along_m <= 0) return out;
  // The ways on which the foot follows the hand.
  const Vec3& slope = relief.slope;
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
  out.elastic_W -= bump.along_m * along;
  return out;
}

Vec3 with_bump_normal(const Vec3& h, const ProxyState& state, const Surface& surface) noexcept {
  const Vec3 foot = state.rendered_WP();
  Vec3 out = foot - h;
  const double d = out.norm();
  if (d < 1e-9) return out;
  const Vec3 slope = relief_at(surface, foot).slope, n = out / d;
  return d * (n - (slope - slope.dot(n) * n)).normalized();
}

bool material_at(const SurfacePatch& patch, const Vec3& p_W, Surface& out) noexcept {
  const Vec3 q = p_W / patch.voxel_size;
  if (!(q.cwiseAbs().maxCoeff() < 1e9)) return false;
  const Eigen::Array3i cell = q.array().floor().cast<int>();
  const Vec3 u = q - cell.cast<double>().matrix();
  std::array<double, SurfacePatch::kMaxMaterials> share{};
  double sum = 0;
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
    share[slot - 1U] += w;
    sum += w;
  }
  if (sum < 1e-9) return false;
  out = Surface{};
  out.stiffness_scale = 0;
  for (std::size_t slot = 0; slot < share.size(); ++slot) {
    if (share[slot] <= 0) continue;
    const perception::Material& m = patch.palette[slot];
    const double w = share[slot] / sum;
    out.stiffness_scale += w * static_cast<double>(m.stiffness_scale);
    out.friction_static += w * static_cast<double>(m.friction_static);
    out.friction_dynamic += w * static_cast<double>(m.friction_dynamic);
    out.add(w * std::min(static_cast<double>(m.texture_amplitude_m), kHighestBump_m),
            static_cast<double>(m.texture_period_m));
  }
  out.stiffness_scale = std::clamp(out.stiffness_scale, 0.0, 1.0);
  out.friction_static = std::clamp(out.friction_static, 0.0, 2.0);
  out.friction_dynamic = std::clamp(out.friction_dynamic, 0.0, 2.0);
  return true;
}

void follow(Surface& now, const Surface& goal, double stiffness, double stretch, double reach,
            double force_step) noexcept {
  // What each pattern goes to, those of the goal that are new from nothing.
  for (std::size_t i = 0; i < goal.patterns; ++i) {
    const Bumps& b = goal.bumps[i];
    bool known = false;
    for (std::size_t k = 0; k < now.patterns; ++k)
      known = known || now.bumps[k].period_m == b.period_m;
    if (!known && now.patterns < Surface::kMostPatterns)
      now.bumps[now.patterns++] = {0, b.period_m};
  }
  std::array<double, Surface::kMostPatterns> change{};
  // The largest force that all changes together can make: of the whole spring for stiffness, of its
  // part along the surface for friction, of height and slope for bumps. Where f is not its argument
  // any more the reach changes with C: f at most by 5/4 r of its share, and less between crest and
  // foot.
  const double highest = 3 * now.height_m(), axes = std::sqrt(3.0);
  const double depth = std::min(stretch + highest, kPlateau * reach);
  const double slope = now.steepness(), curvature = now.curvature_per_m();
  double moved = 0, steeper = 0, more = 0;
  for (std::size_t k = 0; k < now.patterns; ++k) {
    const Bumps& b = now.bumps[k];
    double to = 0;
    for (std::size_t i = 0; i < goal.patterns; ++i) {
      if (goal.bumps[i].period_m == b.period_m) to = goal.bumps[i].amplitude_m;
    }
    change[k] = to - b.amplitude_m;
    const double wave = wave_of(b), by = std::abs(change[k]);
    moved += 3 * by;
    steeper += axes * wave * by;
    more += wave * wave * by;
  }
  double turned = depth * steeper + moved * slope;
  if (stretch + highest > reach && curvature > 0) {
    const double shift = kPlateau * reach * more / curvature;
    turned += shift * slope;
    if (stretch - highest < 1.5 * reach) {
      moved += std::min(shift, 3 * highest * more / curvature);
    }
  }
  const double scale = std::abs(goal.stiffness_scale - now.stiffness_scale);
  const double rubbed = std::max(std::abs(goal.friction_static - now.friction_static),
                                 std::abs(goal.friction_dynamic - now.friction_dynamic));
  const double whole = stretch * (1 + std::max(now.friction_static, now.friction_dynamic)) +
                       3 * highest + depth * slope;
  const double most = stiffness * (scale * whole + stretch * rubbed + moved + turned);
  const double share = most > force_step ? force_step / most : 1;
  now.stiffness_scale += share * (goal.stiffness_scale - now.stiffness_scale);
  now.friction_static += share * (goal.friction_static - now.friction_static);
  now.friction_dynamic += share * (goal.friction_dynamic - now.friction_dynamic);
  std::size_t kept = 0;
  for (std::size_t k = 0; k < now.patterns; ++k) {
    Bumps b = now.bumps[k];
    b.amplitude_m = std::max(0.0, b.amplitude_m + share * change[k]);
    const bool gone = change[k] <= 0 && b.amplitude_m < 1e-12;
    if (!gone) now.bumps[kept++] = b;
  }
  now.patterns = kept;
}

}  // namespace tasks
