// Exact point and segment checks on the cost map.
#include <cmath>
#include <limits>

#include "tasks/planning/planner.hpp"

namespace tasks {

namespace {

using perception::CostMap;

// A segment on a border belongs to both sides: it is walked twice, moved this much to either side.
constexpr double kBorderCells = 1e-6;

// Visits the cells of a segment given in cells (Amanatides, Woo: A fast voxel traversal algorithm,
// 1987), until `blocked(ix, iy)` says so.
template <class Blocked>
bool walk_clear(double ax, double ay, double bx, double by, Blocked&& blocked) noexcept {
  int ix = static_cast<int>(std::floor(ax)), iy = static_cast<int>(std::floor(ay));
  const int ex = static_cast<int>(std::floor(bx)), ey = static_cast<int>(std::floor(by));
  const double dx = bx - ax, dy = by - ay;
  const int sx = ex > ix ? 1 : -1, sy = ey > iy ? 1 : -1;
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const double step_x = dx != 0 ? std::abs(1.0 / dx) : kNever;
  const double step_y = dy != 0 ? std::abs(1.0 / dy) : kNever;
  double next_x = dx != 0 ? ((sx > 0 ? ix + 1 : ix) - ax) / dx : kNever;
  double next_y = dy != 0 ? ((sy > 0 ? iy + 1 : iy) - ay) / dy : kNever;
  // The number of border crossings is known, so rounding can not make the walk miss its end.
  int left_x = std::abs(ex - ix), left_y = std::abs(ey - iy);
  if (blocked(ix, iy)) return false;
  while (left_x > 0 || left_y > 0) {
    if (left_y == 0 || (left_x > 0 && next_x <= next_y)) {
      ix += sx, next_x += step_x, --left_x;
    } else {
      iy += sy, next_y += step_y, --left_y;
    }
    if (blocked(ix, iy)) return false;
  }
  return true;
}

template <class Blocked>
bool both_sides_clear(const CostMap& map, Point2 a, Point2 b, Blocked&& blocked) noexcept {
  const double limit = 4.0 * CostMap::kMaxCells * map.resolution;
  const auto sane = [&](double v) { return std::abs(v) < limit; };  // false for NaN
  if (!(map.resolution > 0) || !sane(a.x) || !sane(a.y) || !sane(b.x) || !sane(b.y)) return false;
  const double s = 1.0 / map.resolution;
  const double ax = a.x * s, ay = a.y * s, bx = b.x * s, by = b.y * s;
  const double length = std::hypot(bx - ax, by - ay);
  // Sideways and lengthways: the ends belong to both sides as well.
  const double ux = length > 0 ? (bx - ax) / length * kBorderCells : kBorderCells;
  const double uy = length > 0 ? (by - ay) / length * kBorderCells : 0.0;
  return walk_clear(ax - uy - ux, ay + ux - uy, bx - uy + ux, by + ux + uy, blocked) &&
         walk_clear(ax + uy - ux, ay - ux - uy, bx + uy + ux, by - ux + uy, blocked);
}

}  // namespace

bool edge_clear(const CostMap& map, Point2 a, Point2 b, std::uint8_t limit) noexcept {
  return both_sides_clear(map, a, b, [&](int ix, int iy) {
    return !map.contains(ix, iy) || map.cost[map.index(ix, iy)] > limit;
  });
}

bool edge_clear_or_unknown(const CostMap& map, Point2 a, Point2 b, std::uint8_t limit) noexcept {
  return both_sides_clear(map, a, b, [&](int ix, int iy) {
    if (!map.contains(ix, iy)) return true;
    const std::uint8_t c = map.cost[map.index(ix, iy)];
    return c > limit && c != CostMap::kUnknown;
  });
}

bool point_clear(const CostMap& map, Point2 p, std::uint8_t limit) noexcept {
  return edge_clear(map, p, p, limit);
}

}  // namespace tasks
