#include "tools/haptic/map_path.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <queue>
#include <stdexcept>

#include <Eigen/Dense>

#include "perception/raycast/raycast.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

// Farther off the sensor's noise makes edges and corners of its own.
constexpr double kFine_m = 1.8;
constexpr double kLift_m = 0.05;  // over a place, before and after it is touched

struct Axes {
  Vec3 a, b;
  explicit Axes(const Vec3& n) : a(n.unitOrthogonal()), b(n.cross(a)) {}
  [[nodiscard]] Vec3 at(double angle) const { return std::cos(angle) * a + std::sin(angle) * b; }
};

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

bool clear(MapProbe& probe, const Vec3& from, const Vec3& to) {
  const double length = (to - from).norm();
  for (double s = 0; s < length; s += 0.01) {
    if (!probe.free(from + (s / length) * (to - from), 0.01)) return false;
  }
  return true;
}

// Ways through what was seen free: A* over cells of 40 mm, then corners cut while the straight is clear.
class Ways {
 public:
  explicit Ways(MapProbe& probe) : probe_(probe) {}
  // From, corners, to; empty: there is none.
  [[nodiscard]] std::vector<Vec3> find(const Vec3& from, const Vec3& to) {
    if (clear(probe_, from, to)) return {from, to};
    struct Open {
      double total, way;
      Cell at, before;
      bool operator<(const Open& o) const { return total > o.total; }
    };
    std::priority_queue<Open> open;
    std::map<Cell, Cell> came;
    for (int c = 0; c < 8; ++c) {
      const Cell at = cell_of(from + 0.5 * kCell_m * Vec3(c & 1, (c >> 1) & 1, c >> 2) -
                              0.25 * kCell_m * Vec3::Ones());
      if (!clear(probe_, from, centre(at))) continue;
      const double way = (centre(at) - from).norm();
      open.push({way + (to - centre(at)).norm(), way, at, at});
    }
    while (!open.empty() && came.size() < 100000) {
      const Open now = open.top();
      open.pop();
      if (!came.emplace(now.at, now.before).second) continue;
      const Vec3 here = centre(now.at);
      if ((to - here).norm() < 2 * kCell_m && clear(probe_, here, to)) {
        return cut(traced(came, now.at, from, to));
      }
      for (int side = 0; side < 6; ++side) {
        Cell next = now.at;
        next[static_cast<std::size_t>(side / 2)] += side % 2 == 0 ? 1 : -1;
        if (came.contains(next) || !clear(probe_, here, centre(next))) continue;
        const double way = now.way + kCell_m;
        open.push({way + (to - centre(next)).norm(), way, next, now.at});
      }
    }
    return {};
  }

 private:
  using Cell = std::array<int, 3>;
  static constexpr double kCell_m = 0.04;
  static Cell cell_of(const Vec3& p) {
    Cell c{};
    for (int a = 0; a < 3; ++a) {
      c[static_cast<std::size_t>(a)] = static_cast<int>(std::floor(p[a] / kCell_m));
    }
    return c;
  }
  static Vec3 centre(const Cell& c) { return kCell_m * Vec3(c[0] + 0.5, c[1] + 0.5, c[2] + 0.5); }
  static std::vector<Vec3> traced(const std::map<Cell, Cell>& came, Cell at, const Vec3& from,
                                  const Vec3& to) {
    std::vector<Vec3> way{to, centre(at)};
    for (Cell before = came.at(at); before != at; before = came.at(at)) {
      at = before;
      way.push_back(centre(at));
    }
    way.push_back(from);
    std::reverse(way.begin(), way.end());
    return way;
  }
  [[nodiscard]] std::vector<Vec3> cut(const std::vector<Vec3>& way) {
    std::vector<Vec3> out{way.front()};
    for (std::size_t i = 0; i + 1 < way.size();) {
      std::size_t j = way.size() - 1;
      while (j > i + 1 && !clear(probe_, way[i], way[j])) --j;
      out.push_back(way[j]);
      i = j;
    }
    return out;
  }
  MapProbe& probe_;
};

Vec3 over(const Place& place) { return place.p_W + kLift_m * place.n_W; }

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

std::vector<Place> find_places(MapProbe& probe, const Surface& surface, const Vec3& rough_up,
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

// Writes the hand tick by tick, never faster than 200 mm/s.
class Pen {
 public:
  Pen(MapProbe& probe, rt::Random& random, const MapPathOptions& o, MapPath& out)
      : probe_(probe), random_(random), options_(o), out_(out) {}

  void start(const Vec3& p) { at_ = p; }
  [[nodiscard]] double now() const {
    return options_.period_s * static_cast<double>(out_.hand_W.size());
  }
  [[nodiscard]] bool full() const { return now() >= options_.seconds; }
  void of_place(int place) { place_ = place; }

  void go(const Vec3& to, double speed) {
    const double length = (to - at_).norm();
    const Vec3 from = at_;
    const int n = std::max(1, static_cast<int>(std::ceil(length / (speed * options_.period_s))));
    for (int i = 1; i <= n && !full(); ++i) put(from + (static_cast<double>(i) / n) * (to - from));
  }
  // From where the hand is to the point (x, y) of the place's plane, `depth` under the surface there. The height
  // comes from the map; beyond an edge the last one holds.
  void slide(const Place& place, const Vec3& to, double depth, double speed) {
    const Vec3 from = on_plane(place, at_);
    const double length = (to - from).norm(), depth_from = depth_;
    const int n = std::max(1, static_cast<int>(std::ceil(length / (speed * options_.period_s))));
    for (int i = 1; i <= n && !full(); ++i) {
      const double s = static_cast<double>(i) / n;
      const Vec3 foot = from + s * (to - from);
      const double h = probe_.height(foot, place.n_W, 0.02, 0.02);
      if (!std::isnan(h)) height_ = h;
      put(foot + (height_ - (depth_from + s * (depth - depth_from))) * place.n_W);
    }
    depth_ = depth;
  }
  void press(const Place& place, const Vec3& at, double depth) {
    const double h = probe_.height(at, place.n_W, 0.02, 0.02);
    height_ = std::isnan(h) ? 0 : h;
    depth_ = depth;
    go(at + (height_ - depth) * place.n_W, 0.1);
  }
  [[nodiscard]] double depth() { return random_.uniform(0.003, 0.008); }
  [[nodiscard]] double speed() { return random_.uniform(0.02, 0.2); }
  [[nodiscard]] const Vec3& at() const { return at_; }

 private:
  static Vec3 on_plane(const Place& place, const Vec3& p) {
    return p - (p - place.p_W).dot(place.n_W) * place.n_W;
  }
  void put(const Vec3& p) {
    const double most = 0.2 * options_.period_s, way = (p - at_).norm();
    at_ = way > most ? Vec3(at_ + (most / way) * (p - at_)) : p;
    out_.hand_W.push_back(at_);
    out_.place.push_back(place_);
  }
  MapProbe& probe_;
  rt::Random& random_;
  const MapPathOptions& options_;
  MapPath& out_;
  Vec3 at_ = Vec3::Zero();
  double height_ = 0, depth_ = 0;
  int place_ = -1;
};

// Strokes of four seconds each: what comes in before the map holds the surface there feels nothing until it was out.
void wander(Pen& pen, const Place& place, rt::Random& random, double until) {
  const Axes axes(place.n_W);
  const auto draw = [&] {
    const double r = 0.045 * std::sqrt(random.uniform());
    return Vec3(place.p_W + r * axes.at(random.uniform(0, 2 * std::numbers::pi)));
  };
  while (pen.now() < until && !pen.full()) {
    const Vec3 at = draw();
    pen.go(at + 0.02 * place.n_W, 0.15);
    pen.press(place, at, pen.depth());
    const double lift = std::min(until, pen.now() + 4);
    while (pen.now() < lift && !pen.full()) {
      pen.slide(place, draw(), pen.depth(), pen.speed());
    }
    pen.go(pen.at() + 0.02 * place.n_W, 0.15);
  }
  pen.go(pen.at() + kLift_m * place.n_W, 0.15);
}

// Along the edge and over it, again and again; comes back through the air.
void cross_edges(Pen& pen, const Place& place, rt::Random& random, double until) {
  const bool corner = place.kind == Place::Kind::kCorner;
  const Vec3 between = (place.out_W[0] + place.out_W[1]).normalized();
  const Vec3 back = corner ? Vec3(-between) : Vec3(-place.out_W[0]);
  const Vec3 along = place.n_W.cross(place.out_W[0]);
  for (int round = 0; pen.now() < until && !pen.full(); ++round) {
    const double side = random.uniform(-0.02, 0.02);
    const Vec3 inner =
        place.p_W + 0.035 * back + (corner ? Vec3(Vec3::Zero()) : Vec3(side * along));
    pen.go(inner + 0.02 * place.n_W, 0.2);
    pen.press(place, inner, pen.depth());
    pen.slide(place, place.p_W + (corner ? 0.01 : -0.005) * back + (corner ? 0.0 : -side) * along,
              pen.depth(), pen.speed());
    pen.slide(place, inner, pen.depth(), pen.speed());
    Vec3 out = place.out_W[0];
    double reach = place.edge_m[0];
    if (corner && round % 3 == 1) out = place.out_W[1], reach = place.edge_m[1];
    if (corner && round % 3 == 2) {
      out = between;
      reach = 1.3 * std::max(place.edge_m[0], place.edge_m[1]);
    }
    pen.slide(place, place.p_W + (reach + 0.03) * out, pen.depth(), pen.speed());
    pen.go(pen.at() + 0.035 * place.n_W, 0.2);
  }
  pen.go(pen.at() + kLift_m * place.n_W, 0.15);
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

double MapProbe::value(const Vec3& p_W) {
  const Vec3 q = p_W / map_.voxel_size();
  const auto cell = reader_.cell(q.x(), q.y(), q.z());
  if (!cell.valid) return std::nan("");
  return static_cast<double>(cell.value()) * static_cast<double>(map_.metres_per_unit());
}

bool MapProbe::free(const Vec3& p_W, double margin) {
  const double v = value(p_W);
  if (!std::isnan(v)) return v > margin;
  const Vec3 q = p_W / map_.voxel_size();
  return map_.free_at(static_cast<int>(std::lround(q.x())), static_cast<int>(std::lround(q.y())),
                      static_cast<int>(std::lround(q.z())));
}

double MapProbe::height(const Vec3& p_W, const Vec3& n_W, double above, double below) {
  constexpr double kStep_m = 0.002;
  double before = std::nan("");
  for (double z = above; z >= -below; z -= kStep_m) {
    const double v = value(p_W + z * n_W);
    if (before > 0 && v <= 0) return z + kStep_m * v / (v - before);
    before = v;
  }
  return std::nan("");
}

MapPath make_map_path(const perception::TsdfMap& map, const perception::Intrinsics& camera,
                      const std::vector<Pose>& views, const Vec3& up_W, const MapPathOptions& o) {
  MapProbe probe(map);
  rt::Random random(o.seed);
  const Surface surface(map, camera, views);
  MapPath path;
  path.places = find_places(probe, surface, up_W, random);
  begin_where_seen(path.places, camera, views);
  Pen pen(probe, random, o, path);
  Ways ways(probe);
  pen.start(over(path.places.front()));
  for (std::size_t i = 0; !pen.full(); i = (i + 1) % path.places.size()) {
    const Place& place = path.places[i];
    pen.of_place(-1);
    for (const Vec3& p : ways.find(pen.at(), over(place))) pen.go(p, 0.2);
    pen.of_place(static_cast<int>(i));
    const double until = pen.now() + o.stroke_s;
    if (place.kind == Place::Kind::kEdge || place.kind == Place::Kind::kCorner) {
      cross_edges(pen, place, random, until);
    } else {
      wander(pen, place, random, until);
    }
  }
  return path;
}

}  // namespace teletact
