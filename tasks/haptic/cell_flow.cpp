#include "tasks/haptic/cell_flow.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

using perception::Vec3;

namespace {

// Exactly zero counts as solid: a plate of one voxel may hold nothing else. The clearance is tiny:
// where a crease lies on nodes the gradient fades to zero, and a clearance f moves the proxy off by
// sqrt(f).
constexpr double kClear_m = 1e-10;
constexpr double kOn = 1e-9;      // nearer than this the point is on the surface
constexpr double kExact = 1e-11;  // a Newton step onto the surface ends here
constexpr double kGain = 1e-10;   // of |q - h|^2: less is rounding
constexpr double kStride = 0.25;
// chosen on: not recorded; judged on: stability 1 to 20 (docs/haptic_rendering.md)
constexpr double kBendMin = 0.05;  // least curvature that a Newton step believes

// Where a rest vanishes the distance to h is flat or falls ever faster: as far as a step may go.
Vec3 long_step(const Vec3& s) noexcept {
  const double size = s.norm();
  return size > 0 && size < kStride ? Vec3(s * (kStride / size)) : s;
}

}  // namespace

CellFlow::CellFlow(const Field& field, const ProxyConfig& cfg, double radius_m, const Vec3& p_WH,
                   const std::array<HalfSpace, 3>& held, std::size_t held_size) noexcept
    : field_(field),
      cfg_(cfg),
      h_(p_WH / field.voxel()),
      radius_(0),
      step_min_(cfg.step_min_m / field.voxel()),
      held_(held),
      held_size_(held_size) {
  set_radius(radius_m);
  for (std::size_t i = 0; i < held_size_; ++i) held_[i].d /= field.voxel();
}

void CellFlow::set_radius(double radius_m) noexcept {
  radius_ = (radius_m + kClear_m) / field_.voxel();
}

auto CellFlow::local(const Index& at, const Vec3& q) const noexcept -> Local {
  --left_;
  Local l;
  CellSample s;
  if (!field_.sample_in(at, q - Vec3(at[0], at[1], at[2]), s)) {
    l.f = 1;
    for (std::size_t i = 0; i < held_size_; ++i) {
      const double d = held_[i].distance(q);
      if (d < l.f) {
        l.f = d;
        l.g = held_[i].n;
      }
    }
    return l;
  }
  l.f = s.value - radius_;
  l.g = s.gradient;
  l.bend = s.bend;
  l.known = true;
  return l;
}

// The cells that meet at q: one inside a cell, two on a face, four on an edge, eight on a node.
std::size_t CellFlow::around(const Vec3& q, std::array<Side, 8>& out) const noexcept {
  Side first;
  std::array<int, 3> walls{};
  std::size_t wall_count = 0;
  for (std::size_t a = 0; a < 3; ++a) {
    const double low = std::floor(q[static_cast<Eigen::Index>(a)]);
    first.at[a] = static_cast<std::int32_t>(low);
    if (q[static_cast<Eigen::Index>(a)] == low) {
      first.sign[a] = 1;
      walls[wall_count++] = static_cast<int>(a);
    }
  }
  const std::size_t count = std::size_t{1} << wall_count;
  for (std::size_t k = 0; k < count; ++k) {
    out[k] = first;
    for (std::size_t w = 0; w < wall_count; ++w) {
      if (((k >> w) & 1U) == 0) continue;
      const auto a = static_cast<std::size_t>(walls[w]);
      out[k].at[a] -= 1;
      out[k].sign[a] = -1;
    }
  }
  return count;
}

// Projection of r onto the cone of the ways that are open in this cell: exact, by trying which
// walls bar it.
auto CellFlow::pull(const Local& l, const Side& side, const Vec3& r) noexcept -> Pull {
  unsigned walls = 0;
  for (std::size_t a = 0; a < 3; ++a) walls |= side.sign[a] != 0 ? 1U << a : 0U;
  for (unsigned fixed = 0; fixed < 8; ++fixed) {
    if ((fixed & ~walls) != 0) continue;
    Pull p;
    p.fixed = fixed;
    p.d = without(r, fixed);
    if (l.f <= kOn) {
      const Vec3 g = without(l.g, fixed);
      const double slope2 = g.squaredNorm(), into = g.dot(p.d);
      if (into < 0 && slope2 > kFlat2) {
        p.lambda = -into / slope2;
        p.d += p.lambda * g;
        p.barred = true;
      }
    }
    bool open = true;
    for (std::size_t a = 0; a < 3; ++a) {
      if (side.sign[a] == 0) continue;
      const auto i = static_cast<Eigen::Index>(a);
      const bool bars = (fixed & (1U << a)) != 0;
      const double way = side.sign[a] * (bars ? r[i] + p.lambda * l.g[i] : p.d[i]);
      open = open && (bars ? way <= 1e-12 : way >= -1e-12);
    }
    if (open) return p;
  }
  return {};
}

// From the pull to a step: on the sheet the distance to h has the curvature I - lambda H.
Vec3 CellFlow::newton(const Local& l, const Pull& p, const Vec3& r) noexcept {
  if (!p.barred) return p.d;
  const auto bent = [&](const Vec3& a, const Vec3& b) {
    const Vec3& e = l.bend;
    const double h = e.x() * (a.y() * b.z() + a.z() * b.y()) +
                     e.y() * (a.x() * b.z() + a.z() * b.x()) +
                     e.z() * (a.x() * b.y() + a.y() * b.x());
    return a.dot(b) - p.lambda * h;
  };
  if (p.fixed != 0) {  // along a curve on the wall
    const double size = p.d.norm();
    const Vec3 t = p.d / size;
    const double curve = bent(t, t);
    return curve < kBendMin ? long_step(p.d) : Vec3((size / curve) * t);
  }
  const Vec3 n = l.g.normalized(), t1 = n.unitOrthogonal(), t2 = n.cross(t1);
  double a = bent(t1, t1), c = bent(t2, t2);
  const double b = bent(t1, t2);
  const double least = 0.5 * (a + c) - std::hypot(0.5 * (a - c), b);
  if (least < kBendMin) {
    a += kBendMin - least;
    c += kBendMin - least;
  }
  const double det = a * c - b * b, r1 = t1.dot(r), r2 = t2.dot(r);
  const Vec3 s = ((c * r1 - b * r2) / det) * t1 + ((a * r2 - b * r1) / det) * t2;
  return least < kBendMin ? long_step(s) : s;
}

// Newton onto the surface within the cell and off the fixed axes. False: not reached, and in the
// solid.
bool CellFlow::settle(const Index& at, Vec3& x, unsigned fixed) const noexcept {
  Local l = local(at, x);
  for (int i = 0; i < 12 && std::abs(l.f) > kExact; ++i) {
    const Vec3 g = without(l.g, fixed);
    const double slope2 = g.squaredNorm();
    if (slope2 < kFlat2) break;
    const Vec3 step = (-l.f / slope2) * g;
    if (step.squaredNorm() > kStride * kStride) return false;
    x += step;
    for (int a = 0; a < 3; ++a) {
      const double low = at[static_cast<std::size_t>(a)];
      if (x[a] >= low && x[a] <= low + 1) continue;
      x[a] = x[a] < low ? low : low + 1;
      fixed |= 1U << a;
    }
    l = local(at, x);
  }
  return l.f >= -kOn;
}

// Where the way from q to x, both within the cell, meets the surface first.
bool CellFlow::meet(const Index& at, Vec3& x) const noexcept {
  Vec3 out = q_, in = x;
  double f_out = local(at, out).f, f_in = local(at, in).f;
  for (int i = 0; i < 40 && f_out > kOn; ++i) {
    const double t = (i % 3) == 2 ? 0.5 : std::clamp(f_out / (f_out - f_in), 1e-3, 1 - 1e-3);
    const Vec3 middle = out + t * (in - out);
    const double f = local(at, middle).f;
    if (f >= 0) {
      out = middle;
      f_out = f;
    } else {
      in = middle;
      f_in = f;
    }
  }
  x = out;
  return true;
}

// Along s, as far as the cell reaches; shorter until it ends nearer to h.
bool CellFlow::search(const Side& side, const Local& l, const Pull& p, Vec3 s) noexcept {
  for (int a = 0; a < 3; ++a) {  // never back over the wall, not even by rounding
    if (side.sign[static_cast<std::size_t>(a)] * s[a] < 0) s[a] = 0;
  }
  const double length = s.norm();
  if (!(length > 0)) return false;
  double share = std::min(1.0, kStride / length);
  unsigned hit = 0;
  for (int a = 0; a < 3; ++a) {
    if (s[a] == 0) continue;
    const double wall = side.at[static_cast<std::size_t>(a)] + (s[a] > 0 ? 1 : 0);
    const double room = std::max((wall - q_[a]) / s[a], 0.0);
    if (room > share) continue;
    hit = room < share ? 1U << a : hit | (1U << a);
    share = room;
  }
  const double before = (q_ - h_).squaredNorm();
  for (int i = 0; i < 8 && left_ > 0; ++i) {
    Vec3 x = q_ + share * s;
    for (int a = 0; a < 3; ++a) {
      const double low = side.at[static_cast<std::size_t>(a)];
      x[a] = (hit & (1U << a)) != 0 ? low + (s[a] > 0 ? 1 : 0) : std::clamp(x[a], low, low + 1);
    }
    bool good = true;
    if (p.barred) {
      good = settle(side.at, x, p.fixed | hit);
    } else if (local(side.at, x).f < 0) {
      good = l.f > kOn ? meet(side.at, x) : settle(side.at, x, p.fixed | hit);
    }
    // A way to the wall may be too short to count.
    const double gain = hit != 0 && share * length < 1e-5 ? -kGain : kGain;
    good = good && (x - h_).squaredNorm() < before - gain;
    if (good && share * length > 0.5 * kStride) {
      good = local(side.at, 0.5 * (q_ + x)).f > -0.05;
    }
    if (good) {
      q_ = x;
      return true;
    }
    hit = 0;
    share *= 0.35;
  }
  return false;
}

bool CellFlow::advance(const Side& side, const Local& l, const Pull& p, const Vec3& r) noexcept {
  const Vec3 s = newton(l, p, r);
  bool within = true;  // a Newton step may turn back over the wall
  for (std::size_t a = 0; a < 3; ++a) {
    within = within && side.sign[a] * s[static_cast<Eigen::Index>(a)] >= -1e-12;
  }
  if (within && search(side, l, p, s)) return true;
  return p.barred && search(side, l, p, p.d);
}

bool CellFlow::move() noexcept {
  if (left_ <= 0) return false;
  const Vec3 r = h_ - q_;
  std::array<Side, 8> sides;
  const std::size_t count = around(q_, sides);
  if (count == 1) {
    const Local l = local(sides[0].at, q_);
    const Pull p = pull(l, sides[0], r);
    return p.d.squaredNorm() >= step_min_ * step_min_ && advance(sides[0], l, p, r);
  }
  std::array<Local, 8> locals;
  std::array<Pull, 8> pulls;
  for (std::size_t k = 0; k < count; ++k) {
    locals[k] = local(sides[k].at, q_);
    pulls[k] = pull(locals[k], sides[k], r);
  }
  for (std::size_t tried = 0; tried < count && left_ > 0; ++tried) {
    std::size_t best = 0;
    double most = -1;
    for (std::size_t k = 0; k < count; ++k) {
      const double size = pulls[k].d.squaredNorm();
      if (size > most) {
        most = size;
        best = k;
      }
    }
    if (most < step_min_ * step_min_) return false;
    if (advance(sides[best], locals[best], pulls[best], r)) return true;
    pulls[best].d = Vec3::Zero();
  }
  return false;
}

// Out of the solid by the rounding of the last tick, so that the next step is not spent on it.
void CellFlow::raise() noexcept {
  std::array<Side, 8> sides;
  (void)around(q_, sides);
  if (local(sides[0].at, q_).f >= 0) return;
  Vec3 x = q_;
  if (settle(sides[0].at, x, 0)) q_ = x;
}

Vec3 CellFlow::run(const Vec3& p_W) noexcept {
  q_ = p_W / field_.voxel();
  for (int a = 0; a < 3; ++a) {
    const double node = std::round(q_[a]);
    if (std::abs(q_[a] - node) < 1e-9) q_[a] = node;
  }
  for (std::size_t i = 0; i < held_size_; ++i) {  // the held surface goes on from here
    held_[i].d = std::min(held_[i].d, held_[i].n.dot(q_));
  }
  raise();
  descend();
  const Vec3 rest = q_;
  if (onto_wall()) {
    descend();
    if ((q_ - h_).squaredNorm() >= (rest - h_).squaredNorm()) q_ = rest;
  }
  return field_.voxel() * q_;
}

void CellFlow::descend() noexcept {
  for (int i = 0; i < cfg_.iterations_max && move(); ++i) {
  }
}

// At rest a hair from a wall: onto it, so that the cells beyond are asked too. Where the hand is
// over the very edge of a solid, the step to it is shorter than any that counts.
bool CellFlow::onto_wall() noexcept {
  constexpr double kHair = 3e-3;
  for (int a = 0; a < 3; ++a) {
    const double node = std::round(q_[a]), off = std::abs(q_[a] - node);
    if (off == 0 || off > kHair) continue;
    std::array<Side, 8> sides;
    (void)around(q_, sides);
    Vec3 x = q_;
    x[a] = node;
    if (!settle(sides[0].at, x, 1U << a)) continue;
    q_ = x;
    return true;
  }
  return false;
}

}  // namespace tasks
