#include "tools/measure/haptic/map_round.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <tuple>

#include <Eigen/Dense>

#include "perception/raycast/raycast.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

// Farther off the sensor's noise makes edges and corners of its own.
constexpr double kFine_m = 1.8;

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

// What is built stands along gravity or across it: the direction near `rough` to which most normals
// are parallel or perpendicular, then refined on those (Gupta, Arbelaez, Malik 2013).
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

// The ways around all of them through the free; no places: one can not be reached.
Round tour(Ways& ways, std::vector<Place> places) {
  Round r;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const bool back = i + 1 == places.size();
    r.ways.push_back(ways.find(over(places[i]), over(places[back ? 0 : i + 1])));
    const auto& way = r.ways.back();
    if (way.empty()) return {};
    for (std::size_t k = 1; k < way.size() && !back; ++k) r.way_m += (way[k] - way[k - 1]).norm();
  }
  r.places = std::move(places);
  return r;
}

// Around a corner, whatever is nearest to one already chosen: five places. Empty: a kind is
// missing.
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

// Up to `most` of each kind: the more there are, the nearer each to another.
std::vector<Place> pool_of(MapProbe& probe, const Surface& surface, const Vec3& up, int most,
                           rt::Random& random, std::array<int, 4>& of) {
  std::vector<Place> pool;
  of = {};
  for (int i = 0; i < 60000; ++i) {
    Vec3 p, n;
    double range = 0;
    if (!surface.draw(random, p, n, range)) continue;
    const auto place = place_at(probe, p, n, up);
    if (!place || (!place->flat() && range > kFine_m)) continue;
    if (++of[static_cast<std::size_t>(place->kind)] > most) continue;  // enough of these
    pool.push_back(*place);
    if (std::all_of(of.begin(), of.end(), [](int k) { return k >= 10; })) break;
  }
  return pool;
}

// Does something of the map lie between?
bool hidden(MapProbe& probe, const Vec3& eye_W, const Vec3& p_W) {
  constexpr double kFrom_m = 0.3, kStep_m = 0.02, kClose_m = 0.06;
  const double range = (p_W - eye_W).norm();
  for (double t = kFrom_m; t < range - kClose_m; t += kStep_m)
    if (probe.value(eye_W + t / range * (p_W - eye_W)) <= 0) return true;
  return false;
}

// The first of the views with the place in it, from its front.
std::size_t first_seen(MapProbe& probe, const Place& place, const perception::Intrinsics& camera,
                       const std::vector<Pose>& views) {
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Vec3 p_C = views[i].inverse() * place.p_W;
    if (p_C.z() < 0.3 || (views[i].linear().transpose() * place.n_W).dot(p_C) > 0) continue;
    const double u = camera.fx * p_C.x() / p_C.z() + camera.cx,
                 v = camera.fy * p_C.y() / p_C.z() + camera.cy;
    if (u > 0 && u < camera.width && v > 0 && v < camera.height &&
        !hidden(probe, views[i].translation(), place.p_W))
      return i;
  }
  return views.size();
}

// A map that is still growing holds what its first views saw: begins there, on something flat if
// there is, the nearer the less noisy, or at the kind that was asked for; goes on to the nearest
// each time.
double begin_where_seen(MapProbe& probe, std::vector<Place>& places,
                        const perception::Intrinsics& camera, const std::vector<Pose>& views,
                        std::optional<Place::Kind> kind) {
  const auto rank = [&](const Place& p) {
    const std::size_t view = first_seen(probe, p, camera, views);
    const Vec3 eye = view < views.size() ? views[view].translation() : Vec3(Vec3::Zero());
    return std::tuple(kind && p.kind != *kind, view, !p.flat(), (p.p_W - eye).norm());
  };
  const auto first =
      std::min_element(places.begin(), places.end(),
                       [&](const Place& a, const Place& b) { return rank(a) < rank(b); });
  std::iter_swap(places.begin(), first);
  return put_in_order(places);
}

}  // namespace

Round find_places(const perception::TsdfMap& map, MapProbe& probe,
                  const perception::Intrinsics& camera, const std::vector<Pose>& views,
                  const Vec3& up_W, std::optional<Place::Kind> first, int pool_most,
                  rt::Random& random) {
  const Surface surface(map, camera, views);
  const Vec3 up = refined_up(surface, up_W, random);
  std::array<int, 4> of{};
  const std::vector<Place> pool = pool_of(probe, surface, up, pool_most, random, of);
  // The corner from which it is the shortest way, time in the air is no touch, and everything can
  // be reached.
  std::vector<std::pair<double, std::vector<Place>>> rounds;
  for (const Place& corner : pool) {
    if (corner.kind != Place::Kind::kCorner) continue;
    std::vector<Place> chosen = chosen_around(corner, pool);
    if (chosen.empty()) continue;
    const double way = begin_where_seen(probe, chosen, camera, views, first);
    // The hand is there with the first image.
    if (first && first_seen(probe, chosen.front(), camera, views) > 0) continue;
    rounds.emplace_back(way - 100.0 * static_cast<double>(chosen.size()), std::move(chosen));
  }
  std::sort(rounds.begin(), rounds.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  Ways ways(probe);
  Round best;
  for (auto& [way, chosen] : rounds) {
    const std::size_t most = best.places.size();
    if (chosen.size() < most) break;
    if (most > 0 && way + 100.0 * static_cast<double>(most) > best.way_m) {
      break;  // no shorter even in a straight line
    }
    Round round = tour(ways, std::move(chosen));
    if (round.places.empty() || (most > 0 && round.way_m >= best.way_m)) continue;
    best = std::move(round);
  }
  if (best.places.empty()) {
    throw std::runtime_error(
        "haptic path: the map holds no wall, edge and corner with a free way between (walls, tops, "
        "edges, corners: " +
        std::to_string(of[0]) + ", " + std::to_string(of[1]) + ", " + std::to_string(of[2]) + ", " +
        std::to_string(of[3]) + ")");
  }
  best.chosen_from = of;
  return best;
}

}  // namespace teletact
