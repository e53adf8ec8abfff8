#include "tools/haptic/map_places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>

#include <Eigen/Dense>

#include "perception/raycast/raycast.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

// Farther off the sensor's noise makes edges and corners of its own.
constexpr double kFine_m = 1.8;

bool level(MapProbe& probe, const Vec3& p, const Vec3& n, double within) {
  const double h = probe.height(p, n, 0.02, 0.02);
  return std::abs(h) < within;  // false for NaN
}

// Most of the surface around p lies within `within` of the plane. A tenth may not: a hole, or a step of the sensor.
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

// The plane through the surface within `radius` of p, by least squares: a single normal of a cast is the noise of
// its pixels. False: hardly anything there.
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

// A place about p, if there is one; most particular kind first.
std::optional<Place> place_at(MapProbe& probe, Vec3 p, Vec3 n, const Vec3& up) {
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

// Casts of the map, from which points are drawn.
class Surface {
 public:
  Surface(const perception::TsdfMap& map, const perception::Intrinsics& camera,
          const std::vector<Pose>& views) {
    perception::RaycastOptions options;
    options.pixel_step = 2;
    options.min_weight = 2;
    for (const Pose& X_WC : views) {
      auto maps = std::make_unique<perception::RaycastMaps>(startup_.token(), camera.width / 2,
                                                            camera.height / 2);
      if (perception::raycast(map, camera, X_WC, options, *maps).hits > 0) {
        casts_.push_back(std::move(maps));
      }
    }
    if (casts_.empty()) throw std::runtime_error("haptic path: the views see nothing of the map");
  }
  // False: that ray met nothing, or meets it at a grazing angle.
  bool draw(rt::Random& random, Vec3& p_W, Vec3& n_W, double& range_m) const {
    const auto& cast =
        *casts_[static_cast<std::size_t>(random.integer(0, static_cast<int>(casts_.size()) - 1))];
    const int u = static_cast<int>(random.integer(10, cast.width() - 11)),
              v = static_cast<int>(random.integer(10, cast.height() - 11));
    if (!cast.hit(u, v)) return false;
    const Vec3 p_C = cast.vertex_C(u, v).cast<double>(), n_C = cast.normal_C(u, v).cast<double>();
    if (!(n_C.norm() > 0.5) || -n_C.dot(p_C.normalized()) < 0.35 || p_C.z() > 3.0) return false;
    p_W = cast.X_WC * p_C;
    range_m = p_C.z();
    n_W = (cast.X_WC.linear() * n_C).normalized();
    return true;
  }

 private:
  rt::Startup startup_;
  std::vector<std::unique_ptr<perception::RaycastMaps>> casts_;
};

// Another surface than those: not on the plane of one of them near by.
bool apart(const std::vector<Place>& places, const Place& from) {
  return std::none_of(places.begin(), places.end(), [&](const Place& p) {
    const Vec3 way = from.p_W - p.p_W;
    const bool same_plane = std::abs(way.dot(p.n_W)) < 0.03 && p.n_W.dot(from.n_W) > 0.95;
    return way.norm() < (same_plane ? 0.6 : 0.2);
  });
}

// What is built stands along gravity or across it: the direction near `rough` to which most normals are parallel or
// perpendicular, then refined on those (Gupta, Arbelaez, Malik 2013).
Vec3 refined_up(const Surface& surface, const Vec3& rough, rt::Random& random) {
  std::vector<Vec3> normals;
  for (int i = 0; i < 20000 && normals.size() < 2000; ++i) {
    Vec3 p, n;
    double range = 0;
    if (surface.draw(random, p, n, range)) normals.push_back(n);
  }
  const auto across = [](double c) { return std::abs(c) < 0.12; };
  const auto along = [](double c) { return std::abs(c) > 0.99; };
  Vec3 best = rough;
  int most = -1;
  for (std::size_t i = 0; i < normals.size(); i += 4) {
    const Vec3& up = normals[i];
    if (up.dot(rough) < 0.6) continue;
    int votes = 0;
    for (const Vec3& n : normals) {
      const double c = n.dot(up);
      votes += across(c) || along(c) ? 1 : 0;
    }
    if (votes > most) {
      most = votes;
      best = up;
    }
  }
  for (int round = 0; round < 5; ++round) {
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
    for (const Vec3& n : normals) {
      const double c = n.dot(best);
      if (across(c)) H += n * n.transpose();
      if (along(c)) H -= n * n.transpose();
    }
    const Vec3 up = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(H).eigenvectors().col(0);
    best = up.dot(best) < 0 ? Vec3(-up) : up;
  }
  return best;
}

// The way around all of them and back, through the free; negative: one can not be reached.
double tour(Ways& ways, const std::vector<Place>& places) {
  double sum = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const auto way = ways.find(over(places[i]), over(places[(i + 1) % places.size()]));
    if (way.empty()) return -1;
    for (std::size_t k = 1; k < way.size(); ++k) sum += (way[k] - way[k - 1]).norm();
  }
  return sum;
}

// Around a corner, whatever is nearest to one already chosen: five places. Empty: a kind is missing.
std::vector<Place> chosen_around(const Place& corner, const std::vector<Place>& pool) {
  using Kind = Place::Kind;
  std::vector<Place> chosen{corner};
  for (const Kind kind : {Kind::kEdge, Kind::kWall, Kind::kTop, Kind::kTop, Kind::kWall}) {
    if (chosen.size() == 5) break;
    const Place* best = nullptr;
    double best_way = std::numeric_limits<double>::infinity();
    for (const Place& p : pool) {
      if (p.kind != kind || !apart(chosen, p)) continue;
      for (const Place& c : chosen) {
        const double way = (c.p_W - p.p_W).norm();
        if (way >= best_way) continue;
        best_way = way;
        best = &p;
      }
    }
    if (best != nullptr) {
      chosen.push_back(*best);
    } else if (chosen.size() < 3) {
      return {};  // no edge, no wall
    }
  }
  return chosen;
}

// From the first on, each time to the nearest. Returns the way.
double put_in_order(std::vector<Place>& places) {
  double way = 0;
  for (std::size_t i = 1; i < places.size(); ++i) {
    const auto from = [&](const Place& p) { return (p.p_W - places[i - 1].p_W).norm(); };
    const auto next =
        std::min_element(places.begin() + static_cast<std::ptrdiff_t>(i), places.end(),
                         [&](const Place& a, const Place& b) { return from(a) < from(b); });
    std::iter_swap(places.begin() + static_cast<std::ptrdiff_t>(i), next);
    way += from(places[i]);
  }
  return way;
}

std::vector<Place> places_on(MapProbe& probe, const Surface& surface, const Vec3& rough_up,
                             rt::Random& random) {
  const Vec3 up = refined_up(surface, rough_up, random);
  std::vector<Place> pool;
  int of[4] = {};
  for (int i = 0; i < 60000; ++i) {
    Vec3 p, n;
    double range = 0;
    if (!surface.draw(random, p, n, range)) continue;
    const auto place = place_at(probe, p, n, up);
    if (!place) continue;
    const bool fine = place->kind == Place::Kind::kCorner || place->kind == Place::Kind::kEdge;
    if (fine && range > kFine_m) continue;
    if (++of[static_cast<int>(place->kind)] > 60) continue;  // enough of these
    pool.push_back(*place);
    if (std::all_of(std::begin(of), std::end(of), [](int k) { return k >= 10; })) break;
  }
  // The corner from which it is the shortest way, time in the air is no touch, and everything can be reached.
  std::vector<std::pair<double, std::vector<Place>>> rounds;
  for (const Place& corner : pool) {
    if (corner.kind != Place::Kind::kCorner) continue;
    std::vector<Place> chosen = chosen_around(corner, pool);
    if (chosen.empty()) continue;
    const double way = put_in_order(chosen) - 100.0 * static_cast<double>(chosen.size());
    rounds.emplace_back(way, std::move(chosen));
  }
  std::sort(rounds.begin(), rounds.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  Ways ways(probe);
  std::vector<Place> best;
  double shortest = std::numeric_limits<double>::infinity();
  std::size_t most = 0;
  for (auto& [way, chosen] : rounds) {
    if (chosen.size() < most || (most > 0 && way + 100.0 * static_cast<double>(most) > shortest)) {
      break;  // no shorter even in a straight line
    }
    const double around = tour(ways, chosen);
    if (around < 0 || around >= shortest) continue;
    shortest = around;
    most = chosen.size();
    best = std::move(chosen);
  }
  if (best.empty()) {
    throw std::runtime_error(
        "haptic path: the map holds no wall, edge and corner with a free way between (walls, tops, "
        "edges, corners: " +
        std::to_string(of[0]) + ", " + std::to_string(of[1]) + ", " + std::to_string(of[2]) + ", " +
        std::to_string(of[3]) + ")");
  }
  return best;
}

// The first of the views with the place in it, from its front.
std::size_t first_seen(const Place& place, const perception::Intrinsics& camera,
                       const std::vector<Pose>& views) {
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Vec3 p_C = views[i].inverse() * place.p_W;
    if (p_C.z() < 0.3 || (views[i].linear().transpose() * place.n_W).dot(p_C) > 0) continue;
    const double u = camera.fx * p_C.x() / p_C.z() + camera.cx,
                 v = camera.fy * p_C.y() / p_C.z() + camera.cy;
    if (u > 0 && u < camera.width && v > 0 && v < camera.height) return i;
  }
  return views.size();
}

// A map that is still growing holds what its first views saw: begins there, on something flat if there is, and goes on
// to the nearest each time.
void begin_where_seen(std::vector<Place>& places, const perception::Intrinsics& camera,
                      const std::vector<Pose>& views) {
  const auto rank = [&](const Place& p) {
    return std::pair(first_seen(p, camera, views), static_cast<int>(p.kind));
  };
  const auto first =
      std::min_element(places.begin(), places.end(),
                       [&](const Place& a, const Place& b) { return rank(a) < rank(b); });
  std::iter_swap(places.begin(), first);
  (void)put_in_order(places);
}

}  // namespace

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

std::vector<Place> find_places(const perception::TsdfMap& map, MapProbe& probe,
                               const perception::Intrinsics& camera, const std::vector<Pose>& views,
                               const Vec3& up_W, rt::Random& random) {
  const Surface surface(map, camera, views);
  auto places = places_on(probe, surface, up_W, random);
  begin_where_seen(places, camera, views);
  return places;
}

}  // namespace teletact
