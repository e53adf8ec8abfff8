#include "tools/measure/accuracy/moving_ghosts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <unordered_map>

#include "perception/tsdf/patch/patch_copy.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kGrown_m = 0.05, kGhost_m = 0.03, kCell_m = 0.01, kBehind_m = 0.05;
constexpr int kSeenFree = 10;  // frames
constexpr double kColumnFrom_m = 0.05, kColumnTo_m = 1.05, kColumnStep_m = 0.1, kBeside_m = 0.1;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::uint64_t key_of(const Vec3& p, double edge) {
  constexpr std::int64_t kShift = 1 << 20;
  const auto at = [edge](double x) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(x / edge)) + kShift);
  };
  return at(p.x()) << 42U | at(p.y()) << 21U | at(p.z());
}

}  // namespace

MovingGhosts::MovingGhosts(rt::NonRealtime& nrt, const MovingSample& sample, const MovingFilm& film)
    : film_(film), world_(nrt, sample.world, MovingSample::kBegin) {
  for (std::size_t i = 0; i < world_.shapes().size(); ++i) {
    if (world_.shapes()[i].mover >= 0) movers_.push_back(static_cast<int>(i));
  }
  for (int f = 0; f < sample.frames; ++f) {
    claimed_.push_back(1);
    X_CW_.push_back(film.with.truth(f)->inverse(Eigen::Isometry));
    for (const int m : movers_) {
      const Vec3 c = world_.X_WS_at(m, MovingSample::time_of(f)).translation();
      const double r = world_.shapes()[static_cast<std::size_t>(m)].bound_radius_m + kGrown_m;
      centres_.push_back(c);
      swept_.extend(Vec3(c - Vec3::Constant(r)));
      swept_.extend(Vec3(c + Vec3::Constant(r)));
    }
  }
}

bool MovingGhosts::mover_at(const Vec3& p_W, int frame, double grown_m) const {
  for (std::size_t i = 0; i < movers_.size(); ++i) {
    const Vec3& c = centres_[static_cast<std::size_t>(frame) * movers_.size() + i];
    const int m = movers_[i];
    const double r = world_.shapes()[static_cast<std::size_t>(m)].bound_radius_m + grown_m;
    if ((p_W - c).squaredNorm() > r * r) continue;
    if (world_.signed_distance(p_W, m, MovingSample::time_of(frame)) <= grown_m) return true;
  }
  return false;
}

bool MovingGhosts::seen_free(const Vec3& p_W, int frame) const {
  if (claimed_[static_cast<std::size_t>(frame)] == 0) return false;
  const auto& k = film_.with.intrinsics;
  const Vec3 p = X_CW_[static_cast<std::size_t>(frame)] * p_W;
  if (p.z() < 0.1) return false;
  const Eigen::Vector2d px = k.project(p);
  const auto u = static_cast<int>(std::lround(px.x())), v = static_cast<int>(std::lround(px.y()));
  if (u < 0 || v < 0 || u >= k.width || v >= k.height) return false;
  return 1e-3 * film_.with.depth_mm(frame, u, v) > p.z() + kBehind_m;
}

MovingGhosts::Place MovingGhosts::place(const Vec3& p_W, int frame, double grown_m) const {
  if (!swept_.contains(p_W)) return Place::kNeverThere;
  int seen = 0;
  for (int f = frame; f >= 0; --f) {
    if (mover_at(p_W, f, grown_m)) return seen >= kSeenFree ? Place::kSeenFree : Place::kUnseen;
    seen += seen_free(p_W, f) ? 1 : 0;
  }
  return Place::kNeverThere;
}

double MovingGhosts::volume_cm3(const perception::Mesh& mesh, const Pose& X_WT, int frame) const {
  const rt::Time t = MovingSample::time_of(frame);
  std::set<std::uint64_t> ghosts, looked_at;
  for (const auto& v : mesh.vertices_W) {
    const Vec3 p = X_WT * v.cast<double>();
    if (!swept_.contains(p)) continue;
    const std::uint64_t key = key_of(p, kCell_m);
    if (ghosts.count(key) > 0) continue;
    if (std::abs(world_.signed_distance(p, t)) <= kGhost_m) continue;
    if (!looked_at.insert(key).second) continue;
    if (place(p, frame, kGrown_m) == Place::kSeenFree) ghosts.insert(key);
  }
  return static_cast<double>(ghosts.size());
}

int MovingGhosts::cost_cells(const perception::CostMap& map, const Pose& X_WT, int frame) const {
  if (!map.ground_found) return 0;
  const rt::Time t = MovingSample::time_of(frame);
  int ghosts = 0;
  for (int iy = 0; iy < map.height; ++iy) {
    for (int ix = 0; ix < map.width; ++ix) {
      if (map.cost[map.index(ix, iy)] != perception::CostMap::kOccupied) continue;
      const Vec3 foot_M((ix + 0.5) * map.resolution, (iy + 0.5) * map.resolution, 0);
      bool was = false, free = true, real = false;
      for (double z = kColumnFrom_m; z <= kColumnTo_m && free && !real; z += kColumnStep_m / 2) {
        const Vec3 p = X_WT * (map.X_WM * (foot_M + Vec3(0, 0, z)));
        for (std::size_t i = 0; i < world_.shapes().size() && !real; ++i) {
          if (world_.shapes()[i].ground) continue;
          real = world_.signed_distance(p, static_cast<int>(i), t) < kBeside_m;
        }
        const Place there = real ? Place::kNeverThere : place(p, frame, 0.5 * map.resolution);
        was |= there == Place::kSeenFree;
        free &= there != Place::kUnseen;
      }
      ghosts += was && free && !real ? 1 : 0;
    }
  }
  return ghosts;
}

int MovingGhosts::window_nodes(const perception::TsdfMap& map, const Pose& X_WT, int frame) const {
  constexpr int kEvery = 10, kNodes = 32;
  const Pose X_TW = X_WT.inverse(Eigen::Isometry);
  const rt::Time t = MovingSample::time_of(frame);
  const auto window = std::make_unique<perception::SurfacePatch>();
  std::set<std::array<int, 3>> looked_at;
  int ghosts = 0;
  for (int f = 0; f <= frame; f += kEvery) {
    for (std::size_t m = 0; m < movers_.size(); ++m) {
      const Vec3& c_W = centres_[static_cast<std::size_t>(f) * movers_.size() + m];
      if (!perception::copy_patch(map, X_TW * c_W, kNodes, *window)) continue;
      for (int n = 0; n < kNodes * kNodes * kNodes; ++n) {
        const int x = n / (kNodes * kNodes), y = n / kNodes % kNodes, z = n % kNodes;
        const std::size_t i = window->index(x, y, z);
        if (window->material[i] == 0 || window->distance[i] > 0) continue;
        const auto& first = window->origin_node;
        if (!looked_at.insert({first[0] + x, first[1] + y, first[2] + z}).second) continue;
        const Vec3 p = X_WT * window->node_W(x, y, z);
        if (!swept_.contains(p) || world_.signed_distance(p, t) <= kGhost_m) continue;
        ghosts += place(p, frame, kGrown_m) == Place::kSeenFree ? 1 : 0;
      }
    }
  }
  return ghosts;
}

std::vector<Vec3> MovingGhosts::seen_mover(int frame) const {
  constexpr int kStep = 4;
  const auto& k = film_.with.intrinsics;
  const Pose& X_WC = *film_.with.truth(frame);
  const auto& truth = film_.truth[static_cast<std::size_t>(frame)];
  std::vector<Vec3> points;
  for (int v = 0; v < k.height; v += kStep) {
    for (int u = 0; u < k.width; u += kStep) {
      if ((truth[static_cast<std::size_t>(v * k.width + u)] & kMoverBit) == 0) continue;
      const Vec3 ray = k.unproject(u, v, 1.0);
      const auto hit =
          world_.ray_cast(X_WC.translation(), X_WC.linear() * ray, MovingSample::time_of(frame));
      if (!hit || world_.shapes()[static_cast<std::size_t>(hit.shape)].mover < 0) continue;
      points.emplace_back(X_WC * (hit.t * ray));
    }
  }
  return points;
}

double MovingGhosts::mover_in_mesh(const perception::Mesh& mesh, const Pose& X_WT, int frame,
                                   double reach_m) const {
  const auto points = seen_mover(frame);
  if (points.size() < 40) return kNaN;
  std::unordered_multimap<std::uint64_t, Vec3> cells;
  for (const auto& v : mesh.vertices_W) {
    const Vec3 p = X_WT * v.cast<double>();
    if (swept_.contains(p)) cells.emplace(key_of(p, reach_m), p);
  }
  const auto covered = [&](const Vec3& p) {
    for (int n = 0; n < 27; ++n) {
      const int a = n / 9 - 1, b = n / 3 % 3 - 1, c = n % 3 - 1;
      const Vec3 by(a, b, c);
      const auto [from, to] = cells.equal_range(key_of(p + reach_m * by, reach_m));
      for (auto it = from; it != to; ++it) {
        if ((it->second - p).norm() <= reach_m) return true;
      }
    }
    return false;
  };
  return static_cast<double>(std::count_if(points.begin(), points.end(), covered)) /
         static_cast<double>(points.size());
}

double MovingGhosts::mover_in_cost(const perception::CostMap& map, const Pose& X_WT,
                                   int frame) const {
  if (!map.ground_found) return kNaN;
  const Pose X_MW = (X_WT * map.X_WM).inverse(Eigen::Isometry);
  int points = 0, held = 0;
  for (const Vec3& p_W : seen_mover(frame)) {
    const Vec3 p = X_MW * p_W;
    if (p.z() < 0.15 || p.z() > 1.0) continue;
    ++points;
    const auto ix = static_cast<int>(std::floor(p.x() / map.resolution));
    const auto iy = static_cast<int>(std::floor(p.y() / map.resolution));
    bool any = false;
    for (int n = 0; n < 9; ++n) {
      const int x = ix + n % 3 - 1, y = iy + n / 3 - 1;
      any |= map.contains(x, y) && map.cost[map.index(x, y)] == perception::CostMap::kOccupied;
    }
    held += any ? 1 : 0;
  }
  return points >= 100 ? static_cast<double>(held) / points : kNaN;
}

}  // namespace teletact
