#include "tools/measure/haptic/map_places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Dense>

namespace teletact {

using perception::Vec3;

namespace {

bool level(MapProbe& probe, const Vec3& p, const Vec3& n, double within) {
  const double h = probe.height(p, n, 0.02, 0.02);
  return std::abs(h) < within;  // false for NaN
}

// Most of the surface around p lies within `within` of the plane. A tenth may not: a hole, or a
// step of the sensor.
bool flat(MapProbe& probe, const Vec3& p, const Vec3& n, double within,
          std::initializer_list<double> radii) {
  const Axes axes(n);
  int asked = 0, found = 0;
  for (const double r : radii) {
    for (int k = 0; k < 12; ++k) {
      ++asked;
      found += level(probe, p + r * axes.at(k * std::numbers::pi / 6), n, within) ? 1 : 0;
    }
  }
  return 10 * found >= 9 * asked;
}

// The plane through the surface within `radius` of p, by least squares: a single normal of a cast
// is the noise of its pixels. False: hardly anything there.
bool fit_plane(MapProbe& probe, double radius, Vec3& p, Vec3& n) {
  for (int round = 0; round < 2; ++round) {
    const Axes axes(n);
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
    Vec3 g = Vec3::Zero();
    int found = 0;
    for (const double r : {0.0, 0.5 * radius, radius}) {
      for (int k = 0; k < (r > 0 ? 12 : 1); ++k) {
        const Vec3 at = r * axes.at(k * std::numbers::pi / 6);
        const double h = probe.height(p + at, n, 0.03, 0.03);
        if (std::isnan(h)) continue;
        const Vec3 row(1, at.dot(axes.a), at.dot(axes.b));
        H += row * row.transpose();
        g += h * row;
        ++found;
      }
    }
    if (found < 18) return false;
    const Vec3 fit = H.ldlt().solve(g);
    if (!(std::hypot(fit.y(), fit.z()) < 0.6)) return false;
    p += fit.x() * n;
    n = (n - fit.y() * axes.a - fit.z() * axes.b).normalized();
  }
  return true;
}

// Upright and flat for 100 mm around, on a plane fitted to all of that.
bool is_wall(MapProbe& probe, const Vec3& up, Vec3& p, Vec3& n) {
  Vec3 at = p, normal = n;
  if (std::abs(n.dot(up)) > 0.4 || !fit_plane(probe, 0.1, at, normal)) return false;
  if (std::abs(normal.dot(up)) > 0.25) return false;
  if (!flat(probe, at, normal, 0.01, {0.025, 0.05, 0.075, 0.1})) return false;
  p = at;
  n = normal;
  return true;
}

// Where the surface ends in direction d: distance from p, or NaN.
double edge_along(MapProbe& probe, const Vec3& p, const Vec3& n, const Vec3& d) {
  double s = 0.01;
  while (s <= 0.07 && level(probe, p + s * d, n, 0.006)) s += 0.005;
  if (s > 0.07 || s < 0.02) return std::nan("");
  for (const double beyond : {0.02, 0.035}) {
    for (double z = 0.02; z >= -0.05; z -= 0.01) {
      if (!probe.free(p + (s + beyond) * d + z * n, 0.004)) return std::nan("");
    }
  }
  // The side of something solid goes down; one that recedes is the shadow of what was not seen.
  const Vec3 along = n.cross(d);
  for (const double aside : {0.0, -0.01, 0.01}) {
    const auto side = [&](double depth) {
      return probe.height(p + s * d + aside * along - depth * n, d, 0.03, 0.02);
    };
    const double shallow = side(0.003), deep = side(0.01);
    if (deep < shallow || (aside == 0 && !(deep >= shallow))) return std::nan("");  // or unseen
  }
  return s;
}

struct EdgeFound {
  Vec3 out;
  double at;
};

// Directions in which the surface ends, every 15 degrees.
std::vector<EdgeFound> edges_of(MapProbe& probe, const Vec3& p, const Vec3& n) {
  const Axes axes(n);
  std::vector<EdgeFound> found;
  for (int k = 0; k < 24; ++k) {
    const Vec3 d = axes.at(k * std::numbers::pi / 12);
    const double s = edge_along(probe, p, n, d);
    if (!std::isnan(s)) found.push_back({d, s});
  }
  return found;
}

// Nothing else in the way of a hand that comes and goes; a tenth may be unknown.
bool room_over(MapProbe& probe, const Vec3& p, const Vec3& n) {
  const Axes axes(n);
  int asked = 0, unknown = 0;
  for (const double up : {0.02, 0.035, kLift_m}) {
    for (const double r : {0.0, 0.025, 0.05}) {
      for (int k = 0; k < (r > 0 ? 12 : 1); ++k) {
        const Vec3 at = p + up * n + r * axes.at(k * std::numbers::pi / 6);
        const double v = probe.value(at);
        ++asked;
        if (v < 0.005) return false;
        if (std::isnan(v) && !probe.free(at, 0)) ++unknown;
      }
    }
  }
  return 10 * unknown <= asked;
}

bool room_at(MapProbe& probe, const Place& place) {
  if (!room_over(probe, place.p_W, place.n_W)) return false;
  if (place.flat()) return true;
  const std::size_t edges = place.kind == Place::Kind::kCorner ? 2 : 1;
  for (std::size_t i = 0; i < edges; ++i) {
    const Vec3 beyond = place.p_W + (place.edge_m[i] + 0.03) * place.out_W[i];
    if (!room_over(probe, beyond, place.n_W)) return false;
  }
  return true;
}

// Whatever is in the way; most particular kind first.
std::optional<Place> place_of(MapProbe& probe, Vec3 p, Vec3 n, const Vec3& up) {
  Place place;
  place.p_W = p;
  place.n_W = n;
  if (is_wall(probe, up, place.p_W, place.n_W)) {
    place.kind = Place::Kind::kWall;
    return place;
  }
  if (!fit_plane(probe, 0.025, p, n) || !level(probe, p, n, 0.003)) return std::nullopt;
  place.p_W = p;
  place.n_W = n;
  const double rise = n.dot(up);
  if (flat(probe, p, n, 0.004, {0.025, 0.05})) {
    if (rise > 0.9) return place;
    return std::nullopt;
  }
  const auto edges = edges_of(probe, p, n);
  const auto inner = [&](const Vec3& d) {
    return level(probe, p - 0.025 * d, n, 0.004) && level(probe, p - 0.05 * d, n, 0.006);
  };
  for (const EdgeFound& one : edges) {
    for (const EdgeFound& two : edges) {
      const double c = one.out.dot(two.out);
      if (std::abs(c) > 0.5 || one.out.cross(two.out).dot(n) < 0) continue;
      const Vec3 between = (one.out + two.out).normalized();
      if (!inner(between) || std::isnan(edge_along(probe, p, n, between))) continue;
      // Straight on, each of the two edges is the nearest way out.
      place.kind = Place::Kind::kCorner;
      place.out_W[0] = one.out, place.out_W[1] = two.out;
      place.edge_m[0] = one.at, place.edge_m[1] = two.at;
      return place;
    }
  }
  if (rise < 0.9 || edges.empty()) return std::nullopt;
  const EdgeFound& nearest = *std::min_element(
      edges.begin(), edges.end(), [](const auto& a, const auto& b) { return a.at < b.at; });
  const Vec3 along = n.cross(nearest.out);
  if (!inner(nearest.out) || !level(probe, p + 0.04 * along, n, 0.005) ||
      !level(probe, p - 0.04 * along, n, 0.005)) {
    return std::nullopt;
  }
  place.kind = Place::Kind::kEdge;
  place.out_W[0] = nearest.out;
  place.edge_m[0] = nearest.at;
  return place;
}

}  // namespace

std::optional<Place> place_at(MapProbe& probe, const Vec3& p_W, const Vec3& n_W, const Vec3& up_W) {
  std::optional<Place> place = place_of(probe, p_W, n_W, up_W);
  if (place && !room_at(probe, *place)) place.reset();
  return place;
}

const char* name_of(Place::Kind kind) {
  switch (kind) {
    case Place::Kind::kWall:
      return "wall";
    case Place::Kind::kTop:
      return "top";
    case Place::Kind::kEdge:
      return "edge";
    case Place::Kind::kCorner:
      return "corner";
  }
  return "?";
}

}  // namespace teletact
