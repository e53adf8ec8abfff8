// What is asked of the place where the descent came to rest: whether the other side of a bend is a
// rest too, and which tangents bear the pull.
#include <algorithm>
#include <cmath>

#include "tasks/haptic/cell_flow.hpp"

namespace tasks {

using perception::Vec3;

namespace {

// In voxels, where nothing else is said.
// chosen on: not recorded; judged on: stability 1 to 20 (docs/haptic_rendering.md)
constexpr double kReach = 0.2;  // from a wall: what is beyond it is looked at
constexpr double kBendSmooth = 0.15,
                 kBendSharp = 0.22;  // rad: bends that are gone over, that are kept

// Rests so far apart are gone over, are not.
// chosen on: stability 10 fused; judged on: stability 1 to 20 (docs/haptic_rendering.md)
constexpr double kApartFull = 0.1, kApartMost = 0.12;

// Over what two planes would have between them: where a sheet bulges itself, its rest runs ahead of
// the hand, and the bend is the surface's.
// chosen on: stability 9, 10 and fused fields; judged on: stability 1 to 20 (docs/haptic_rendering.md)
constexpr double kBulgeFull = 1.015, kBulgeMost = 1.035;

// A ridge nearer than this does not hold the proxy.
// chosen on: stability 9, 11; judged on: stability 1 to 20 (docs/haptic_rendering.md)
constexpr double kNarrow = 0.01;

}  // namespace

// No cell that meets at q has a pull left.
bool CellFlow::resting(const Vec3& q) const noexcept {
  // voxels^2; chosen on: not recorded; judged on: stability 1 to 20 (docs/haptic_rendering.md)
  constexpr double kLeft2 = 1.6e-3;

  std::array<Side, 8> sides;
  const std::size_t count = around(q, sides);
  for (std::size_t k = 0; k < count; ++k) {
    const Local l = local(sides[k].at, q);
    if (pull(l, sides[k], h_ - q).d.squaredNorm() > kLeft2) return false;
  }
  return true;
}

// To rest within one closed cell.
void CellFlow::rest_in(const Index& at) noexcept {
  for (int i = 0; i < 12 && left_ > 0; ++i) {
    Side side{at, {}};
    for (std::size_t a = 0; a < 3; ++a) {
      const double u = q_[static_cast<Eigen::Index>(a)] - at[a];
      side.sign[a] = u <= 0 ? 1 : u >= 1 ? -1 : 0;
    }
    const Vec3 r = h_ - q_;
    const Local l = local(at, q_);
    const Pull p = pull(l, side, r);
    if (p.d.squaredNorm() < step_min_ * step_min_ || !advance(side, l, p, r)) return;
  }
}

// To rest on the curve in which the surface meets a wall of the cell.
void CellFlow::pass_on(const Index& at, unsigned wall) noexcept {
  for (int i = 0; i < 4; ++i) {
    Local l = local(at, q_);
    const Vec3 r = without(h_ - q_, wall);
    l.g = without(l.g, wall);
    Side side{at, {}};
    Pull p = pull(l, side, r);
    p.fixed = wall;
    const Vec3 last = q_;
    if (!p.barred || p.d.squaredNorm() < 1e-8 || !advance(side, l, p, r)) return;
    if ((q_ - last).squaredNorm() < 1e-20) return;  // at another wall
  }
}

// The rest beyond the wall of cell `at` across `axis`, by the pass between it and q.
bool CellFlow::beyond(const Index& at, int axis, bool up, Beyond& out) noexcept {
  const Vec3 own = q_;
  const unsigned wall = 1U << axis;
  Index next = at;
  next[static_cast<std::size_t>(axis)] += up ? 1 : -1;
  Vec3 x = own;
  x[axis] = at[static_cast<std::size_t>(axis)] + (up ? 1 : 0);
  if (!settle(at, x, wall) || (x - own).squaredNorm() > 4 * kReach * kReach) return false;
  q_ = x;
  pass_on(at, wall);
  const double pass = (q_ - h_).squaredNorm();
  rest_in(next);
  out.q = q_;
  q_ = own;
  const double here = (own - h_).squaredNorm(), there = (out.q - h_).squaredNorm();
  const double low = 1e-12, from_here = pass - here, from_there = pass - there;
  out.nearer = from_here < kNarrow * kNarrow && there < here - 1e-9;
  // Else the cell after next leads on: no bend of two planes.
  if (!resting(out.q)) return out.nearer;
  if (from_here < low || from_there < low || out.q[axis] == x[axis]) return out.nearer;
  out.share = from_there / (from_here + from_there) * smoothed(from_here, from_there, here, out.q);
  return out.share > 0 || out.nearer;
}

// How much of a bend is gone over: all of the samples' work, nothing of the surface's own.
double CellFlow::smoothed(double from_here, double from_there, double here,
                          const Vec3& other) const noexcept {
  const auto within = [](double value, double full, double most) {
    return std::clamp((most - value) / (most - full), 0.0, 1.0);
  };
  // For two planes that meet at angle b, the roots of the barriers add up to |p - h| b, whatever the
  // place of the hand; and to the distance of the rests.
  const double roots = std::sqrt(from_here) + std::sqrt(from_there);
  const double apart = (other - q_).norm();
  return std::min(within(roots / std::sqrt(here), kBendSmooth, kBendSharp),
                  within(apart, kApartFull, kApartMost)) *
         within(apart / roots, kBulgeFull, kBulgeMost);
}

Vec3 CellFlow::shade() noexcept {
  for (int round = 0; round < 3 && left_ > kSamples / 2; ++round) {
    std::array<Side, 8> sides;
    (void)around(q_, sides);
    const Index at = sides[0].at;
    Vec3 shift = Vec3::Zero();
    double shares = 0;
    bool moved = false;
    for (int a = 0; a < 3 && !moved; ++a) {
      const double u = q_[a] - at[static_cast<std::size_t>(a)];
      for (const bool up : {false, true}) {
        const double room = up ? 1 - u : u;
        Beyond b;
        if (u == 0 || room > kReach || !beyond(at, a, up, b)) continue;
        if (b.nearer && round < 2) {
          q_ = b.q;
          descend();
          moved = true;
          break;
        }
        shift += b.share * (b.q - q_);
        shares += b.share;
      }
    }
    if (!moved) return field_.voxel() * (shares > 1 ? Vec3(shift / shares) : shift);
  }
  return Vec3::Zero();
}

std::size_t CellFlow::tangents(std::array<Tangent, 3>& out) const noexcept {
  const Vec3 r = h_ - q_;
  const double size = r.norm();
  std::array<Side, 8> sides;
  const std::size_t count = around(q_, sides);
  std::array<Tangent, 8> all;
  std::size_t found = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const Local l = local(sides[k].at, q_);
    const double slope = l.g.norm();
    if (l.f > 1e-6 || slope * slope < kFlat2 || l.g.dot(r) >= -1e-9 * size * slope) continue;
    all[found].half.n = l.g / slope;
    all[found].half.d = 0;  // through q, for the moment
    all[found++].known = l.known;
  }
  // One after another, the one that the pull left by those before enters deepest.
  std::array<HalfSpace, 3> chosen{};
  std::array<std::size_t, 3> which{};
  std::size_t n = 0;
  unsigned active = 0;
  Vec3 left = r;
  while (n < 3) {
    std::size_t best = found;
    double deepest = -1e-6 * size;
    for (std::size_t k = 0; k < found; ++k) {
      const double depth = all[k].half.n.dot(left);
      if (depth < deepest) {
        deepest = depth;
        best = k;
      }
    }
    if (best == found) break;
    chosen[n] = all[best].half;
    which[n++] = best;
    const PlanesResult solved = nearest_on_planes(chosen, n, r);
    if (!solved.solved) break;
    active = solved.active;
    left = solved.x;
  }
  std::size_t used = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if ((active & (1U << i)) == 0 && n > 1) continue;
    Tangent t = all[which[i]];
    t.half.d = field_.voxel() * t.half.n.dot(q_);
    out[used++] = t;
  }
  return used;
}

}  // namespace tasks
