#include "tools/measure/haptic/map_path.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rt/random.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kHover_m = 0.02;      // over the surface, between two strokes
constexpr double kFree_m_per_s = 0.2;  // through the free

// Writes the hand tick by tick, never faster than 200 mm/s.
class Pen {
 public:
  Pen(MapProbe& probe, rt::Random& random, const MapPathOptions& o, MapPath& out)
      : probe_(probe), random_(random), options_(o), out_(out) {}

  static Vec3 on_plane(const Place& place, const Vec3& p) {
    return p - (p - place.p_W).dot(place.n_W) * place.n_W;
  }
  void start(const Vec3& p) { at_ = p; }
  [[nodiscard]] double now() const {
    return options_.period_s * static_cast<double>(out_.hand_W.size());
  }
  [[nodiscard]] bool full() const { return now() >= options_.seconds; }
  void of_place(int place) { place_ = place; }
  // A stroke ends then, wherever it is.
  void until(double t) { until_ = t; }
  [[nodiscard]] bool due() const { return now() >= until_ || full(); }

  void go(const Vec3& to, double speed) {
    const double length = (to - at_).norm();
    const Vec3 from = at_;
    const int n = std::max(1, static_cast<int>(std::ceil(length / (speed * options_.period_s))));
    for (int i = 1; i <= n && !full(); ++i) put(from + (static_cast<double>(i) / n) * (to - from));
  }
  // From where the hand is to the point (x, y) of the place's plane, `depth` under the surface
  // there. The height comes from the map; beyond an edge the last one holds, also where the map
  // rounds the edge off.
  void slide(const Place& place, const Vec3& to, double depth, double speed) {
    const Vec3 from = on_plane(place, at_);
    const double length = (to - from).norm(), depth_from = depth_;
    const int n = std::max(1, static_cast<int>(std::ceil(length / (speed * options_.period_s))));
    for (int i = 1; i <= n && !due(); ++i) {
      const double s = static_cast<double>(i) / n;
      const Vec3 foot = from + s * (to - from);
      const double h =
          beyond_edge(place, foot) ? std::nan("") : probe_.height(foot, place.n_W, 0.02, 0.02);
      if (!std::isnan(h)) height_ = h;
      put(foot + (height_ - (depth_from + s * (depth - depth_from))) * place.n_W);
    }
    depth_ = depth;
  }
  void press(const Place& place, const Vec3& at, double depth) {
    const double h = probe_.height(at, place.n_W, 0.02, 0.02);
    height_ = std::isnan(h) ? 0 : h;
    depth_ = depth;
    go(at + (height_ - depth) * place.n_W, 0.15);
  }
  // All the way down to the surface there the map is known: what comes out of the unknown is not
  // felt.
  [[nodiscard]] bool known_over(const Place& place, const Vec3& at) {
    for (double z = kHover_m; z >= -0.01; z -= 0.005) {
      const Vec3 p = at + z * place.n_W;
      if (std::isnan(probe_.value(p)) && !probe_.free(p, 0)) return false;
    }
    return true;
  }
  // How much the map's surface is inclined to the place's plane there; large where it is not known.
  [[nodiscard]] double incline(const Place& place, const Vec3& at) {
    const Axes axes(place.n_W);
    const auto rise = [&](const Vec3& d) {
      const double ahead = probe_.height(at + 0.01 * d, place.n_W, 0.02, 0.02),
                   behind = probe_.height(at - 0.01 * d, place.n_W, 0.02, 0.02);
      return std::isnan(ahead + behind) ? 10.0 : (ahead - behind) / 0.02;
    };
    return std::hypot(rise(axes.a), rise(axes.b));
  }
  [[nodiscard]] double depth() { return random_.uniform(0.003, 0.008); }
  [[nodiscard]] double speed() { return random_.uniform(0.02, 0.2); }
  [[nodiscard]] const Vec3& at() const { return at_; }

 private:
  static bool beyond_edge(const Place& place, const Vec3& foot) {
    const Vec3 r = foot - place.p_W;
    return !place.flat() && (r.dot(place.out_W[0]) > place.edge_m[0] - 0.005 ||
                             (place.kind == Place::Kind::kCorner &&
                              r.dot(place.out_W[1]) > place.edge_m[1] - 0.005));
  }
  void put(const Vec3& p) {
    const double most = 0.2 * options_.period_s, way = (p - at_).norm();
    at_ = way > most ? Vec3(at_ + (most / way) * (p - at_)) : p;
    out_.hand_W.push_back(at_);
    if (place_ >= 0 && probe_.value(at_) < 0) out_.planned_s += options_.period_s;
    out_.place.push_back(place_);
  }
  MapProbe& probe_;
  rt::Random& random_;
  const MapPathOptions& options_;
  MapPath& out_;
  Vec3 at_ = Vec3::Zero();
  double height_ = 0, depth_ = 0, until_ = 0;
  int place_ = -1;
};

// What comes in before the map holds the surface there feels nothing until it was out: up again now
// and then, and more often while the map is new.
void wander(Pen& pen, const Place& place, rt::Random& random, double seen, double until) {
  const Axes axes(place.n_W);
  const auto draw = [&] {
    const double r = 0.045 * std::sqrt(random.uniform());
    return Vec3(place.p_W + r * axes.at(random.uniform(0, 2 * std::numbers::pi)));
  };
  while (pen.now() < until && !pen.full()) {
    Vec3 at = Pen::on_plane(place, pen.at());
    for (int i = 0; i < 20 && !pen.known_over(place, at); ++i) at = draw();
    pen.go(at + kHover_m * place.n_W, kFree_m_per_s);
    pen.press(place, at, pen.depth());
    pen.until(std::min(until, pen.now() + (pen.now() < seen ? 1.5 : 7.0)));
    while (!pen.due()) pen.slide(place, draw(), pen.depth(), pen.speed());
    pen.go(pen.at() + kHover_m * place.n_W, kFree_m_per_s);
  }
}

// To the edge and back, twice, and over it; comes back through the air. At a corner over the one
// edge, over the other, and between them.
void cross_edges(Pen& pen, const Place& place, rt::Random& random, double until) {
  const bool corner = place.kind == Place::Kind::kCorner;
  const Vec3 between = (place.out_W[0] + place.out_W[1]).normalized();
  const Vec3 back = corner ? Vec3(-between) : Vec3(-place.out_W[0]);
  const Vec3 along = place.n_W.cross(place.out_W[0]);
  const auto aside = [&] {
    return corner ? Vec3(Vec3::Zero()) : Vec3(random.uniform(-0.02, 0.02) * along);
  };
  // Comes in where the surface is as the plane says: which way is out for the contact, its first
  // tick tells.
  const auto entry = [&] {
    Vec3 best = place.p_W + 0.035 * back;
    double least = pen.incline(place, best);
    for (int i = 0; i < 8; ++i) {
      const double angle = random.uniform(0, 2 * std::numbers::pi);
      const Vec3 at = place.p_W + 0.035 * back + 0.015 * Axes(place.n_W).at(angle);
      const double incline = pen.incline(place, at);
      if (incline >= least) continue;
      least = incline;
      best = at;
    }
    return best;
  };
  for (int round = 0; pen.now() < until && !pen.full(); ++round) {
    const Vec3 inner = entry();
    pen.go(inner + kHover_m * place.n_W, kFree_m_per_s);
    pen.press(place, inner, pen.depth());
    pen.until(until);
    for (int stroke = 0; stroke < 2 && !pen.due(); ++stroke) {
      pen.slide(place, place.p_W + (corner ? 0.01 : -0.005) * back + aside(), pen.depth(),
                pen.speed());
      pen.slide(place, place.p_W + 0.035 * back + aside(), pen.depth(), pen.speed());
    }
    Vec3 out = place.out_W[0];
    double reach = place.edge_m[0];
    if (corner && round % 3 == 1) out = place.out_W[1], reach = place.edge_m[1];
    if (corner && round % 3 == 2) {
      out = between;
      reach = 1.3 * std::max(place.edge_m[0], place.edge_m[1]);
    }
    pen.slide(place, place.p_W + (reach + 0.015) * out, pen.depth(), pen.speed());
    if (!pen.due()) pen.go(pen.at() + 0.015 * out, kFree_m_per_s);
    pen.go(pen.at() + 0.035 * place.n_W, kFree_m_per_s);
  }
}

// Time at each place: of what the ways leave, an edge so much of something flat, since a third of
// it is air.
std::vector<double> shares(const std::vector<Place>& places, double way_m, double edge,
                           const MapPathOptions& o) {
  std::vector<double> s;
  double sum = 0;
  for (const Place& p : places) s.push_back(p.flat() ? 1.0 : edge);
  for (const double part : s) sum += part;
  // Down from the way and back to it.
  const double left = o.seconds - way_m / kFree_m_per_s - 0.5 * static_cast<double>(places.size());
  for (double& part : s) part = std::max(o.least_s, left * part / sum);
  return s;
}

// The hand on its round, with so much of its time at edges.
MapPath drawn(MapProbe& probe, const Round& round, double edge, rt::Random random,
              const MapPathOptions& o) {
  MapPath path;
  path.places = round.places;
  path.way_m = round.way_m;
  path.chosen_from = round.chosen_from;
  const std::vector<double> time_s = shares(path.places, round.way_m, edge, o);
  Pen pen(probe, random, o, path);
  pen.start(over(path.places.front()));
  for (std::size_t i = 0; !pen.full(); i = (i + 1) % path.places.size()) {
    const Place& place = path.places[i];
    pen.of_place(static_cast<int>(i));
    double until = pen.now() + time_s[i];
    if (i + 1 == path.places.size()) until = std::max(until, o.seconds);  // what is left over
    if (place.flat()) {
      wander(pen, place, random, o.seen_s, until);
    } else {
      cross_edges(pen, place, random, until);
    }
    pen.of_place(-1);
    pen.go(over(place), kFree_m_per_s);
    for (const Vec3& p : round.ways[i]) pen.go(p, kFree_m_per_s);
  }
  return path;
}

}  // namespace

MapPath make_map_path(const perception::TsdfMap& map, const perception::Intrinsics& camera,
                      const std::vector<Pose>& views, const Vec3& up_W, const MapPathOptions& o) {
  MapProbe probe(map);
  rt::Random random(o.seed);
  const Round round = find_places(map, probe, camera, views, up_W, o.first, o.pool, random);
  // As much of its time at edges as leaves the contact that is asked for.
  MapPath path;
  for (const double edge : {0.6, 0.5, 0.4, 0.3}) {
    path = drawn(probe, round, edge, random, o);
    if (path.planned_s >= o.contact * o.seconds) break;
  }
  return path;
}

}  // namespace teletact
