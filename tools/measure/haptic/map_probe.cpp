#include "tools/measure/haptic/map_probe.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <queue>

namespace teletact {

using perception::Vec3;

namespace {

using Cell = std::array<int, 3>;
constexpr double kCell_m = 0.04;

Cell cell_of(const Vec3& p) {
  Cell c{};
  for (int a = 0; a < 3; ++a) {
    c[static_cast<std::size_t>(a)] = static_cast<int>(std::floor(p[a] / kCell_m));
  }
  return c;
}

Vec3 centre(const Cell& c) { return kCell_m * Vec3(c[0] + 0.5, c[1] + 0.5, c[2] + 0.5); }

std::vector<Vec3> traced(const std::map<Cell, Cell>& came, Cell at, const Vec3& from,
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

bool clear(MapProbe& probe, const Vec3& from, const Vec3& to) {
  const double length = (to - from).norm();
  for (double s = 0; s < length; s += 0.01) {
    if (!probe.free(from + (s / length) * (to - from), 0.01)) return false;
  }
  return true;
}

}  // namespace

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

std::vector<Vec3> Ways::find(const Vec3& from, const Vec3& to) {
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

std::vector<Vec3> Ways::cut(const std::vector<Vec3>& way) {
  std::vector<Vec3> out{way.front()};
  for (std::size_t i = 0; i + 1 < way.size();) {
    std::size_t j = way.size() - 1;
    while (j > i + 1 && !clear(probe_, way[i], way[j])) --j;
    out.push_back(way[j]);
    i = j;
  }
  return out;
}

}  // namespace teletact
