// Test oracle, sharing no code with the planner: textbook Dijkstra on cells, dense sampling of
// paths, random maps.
#pragma once

#include <cmath>
#include <limits>
#include <memory>
#include <queue>
#include <vector>

#include "perception/ground/cost_map.hpp"
#include "rt/random.hpp"
#include "tasks/planning/planner.hpp"

namespace oracle {

using perception::CostMap;
using tasks::Point2;

inline constexpr std::uint8_t kDrive = 176;  // what a path may touch: PlannerConfig's own limit

inline bool open(const CostMap& m, int x, int y) {
  return x >= 0 && y >= 0 && x < m.width && y < m.height &&
         m.cost[static_cast<std::size_t>(y * m.width + x)] <= kDrive;
}

// Length in m over 8 neighbours without cutting corners; infinity if there is no way.
inline double dijkstra(const CostMap& m, int sx, int sy, int gx, int gy) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  std::vector<double> d(static_cast<std::size_t>(m.width * m.height), kInf);
  using Item = std::pair<double, int>;
  std::priority_queue<Item, std::vector<Item>, std::greater<>> q;
  if (!open(m, sx, sy) || !open(m, gx, gy)) return kInf;
  d[static_cast<std::size_t>(sy * m.width + sx)] = 0;
  q.push({0, sy * m.width + sx});
  while (!q.empty()) {
    const auto [dist, c] = q.top();
    q.pop();
    if (dist > d[static_cast<std::size_t>(c)]) continue;
    const int x = c % m.width, y = c / m.width;
    if (x == gx && y == gy) return dist * m.resolution;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        if ((dx == 0 && dy == 0) || !open(m, x + dx, y + dy)) continue;
        if (dx != 0 && dy != 0 && (!open(m, x + dx, y) || !open(m, x, y + dy))) continue;
        const double next = dist + std::hypot(dx, dy);
        auto& old = d[static_cast<std::size_t>((y + dy) * m.width + x + dx)];
        if (next < old) old = next, q.push({next, (y + dy) * m.width + x + dx});
      }
    }
  }
  return kInf;
}

inline bool open_at(const CostMap& m, double x, double y) {
  return open(m, static_cast<int>(std::floor(x / m.resolution)),
              static_cast<int>(std::floor(y / m.resolution)));
}

// Every `step` metres along the segment, ends included.
inline bool free_segment(const CostMap& m, Point2 a, Point2 b, double step = 0.0005) {
  const double length = std::hypot(b.x - a.x, b.y - a.y);
  const int n = std::max(1, static_cast<int>(std::ceil(length / step)));
  for (int i = 0; i <= n; ++i) {
    const double t = static_cast<double>(i) / n;
    if (!open_at(m, a.x + t * (b.x - a.x), a.y + t * (b.y - a.y))) return false;
  }
  return true;
}

inline std::unique_ptr<CostMap> blank(int width, int height, double resolution = 0.05) {
  auto m = std::make_unique<CostMap>();
  m->seq = 1;
  m->ground_found = true;
  m->resolution = resolution;
  m->width = width;
  m->height = height;
  m->cost.fill(CostMap::kFree);
  return m;
}

inline void fill(CostMap& m, int x0, int y0, int x1, int y1, std::uint8_t value) {
  for (int y = std::max(0, y0); y <= std::min(m.height - 1, y1); ++y) {
    for (int x = std::max(0, x0); x <= std::min(m.width - 1, x1); ++x) {
      m.cost[static_cast<std::size_t>(y * m.width + x)] = value;
    }
  }
}

// Boxes of obstacle, inscribed and unknown cells; or noise; or a maze with corridors one cell wide.
inline std::unique_ptr<CostMap> random_map(rt::Random& r) {
  const int w = static_cast<int>(r.integer(12, 120)), h = static_cast<int>(r.integer(12, 120));
  auto m = blank(w, h, r.uniform(0.02, 0.1));
  const auto kind = r.integer(0, 3);
  const std::uint8_t cramped = kind == 0 ? kDrive : kDrive + 1;
  const std::uint8_t values[] = {CostMap::kInscribed, CostMap::kOccupied, CostMap::kUnknown,
                                 cramped};
  if (kind <= 1) {
    const auto boxes = r.integer(1, 40);
    for (int i = 0; i < boxes; ++i) {
      const int x = static_cast<int>(r.integer(-5, w)), y = static_cast<int>(r.integer(-5, h));
      fill(*m, x, y, x + static_cast<int>(r.integer(0, w / 3)),
           y + static_cast<int>(r.integer(0, h / 6)), values[r.integer(0, 3)]);
    }
  } else if (kind == 2) {
    const double density = r.uniform(0.05, 0.45);
    for (int i = 0; i < w * h; ++i) {
      if (r.uniform() < density) m->cost[static_cast<std::size_t>(i)] = values[r.integer(0, 2)];
    }
  } else {
    // Depth-first maze on the odd cells, with a few walls broken or some corridors closed.
    m->width = w / 4 * 2 + 1, m->height = h / 4 * 2 + 1;
    fill(*m, 0, 0, m->width, m->height, CostMap::kOccupied);
    std::vector<std::pair<int, int>> stack{{1, 1}};
    fill(*m, 1, 1, 1, 1, CostMap::kFree);
    while (!stack.empty()) {
      const auto [x, y] = stack.back();
      const int dirs[4][2] = {{2, 0}, {-2, 0}, {0, 2}, {0, -2}};
      std::vector<int> ways;
      for (int d = 0; d < 4; ++d) {
        const int nx = x + dirs[d][0], ny = y + dirs[d][1];
        if (nx > 0 && ny > 0 && nx < m->width - 1 && ny < m->height - 1 && !open(*m, nx, ny)) {
          ways.push_back(d);
        }
      }
      if (ways.empty()) {
        stack.pop_back();
        continue;
      }
      const int d =
          ways[static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(ways.size()) - 1))];
      const int nx = x + dirs[d][0], ny = y + dirs[d][1];
      fill(*m, std::min(x, nx), std::min(y, ny), std::max(x, nx), std::max(y, ny), CostMap::kFree);
      stack.push_back({nx, ny});
    }
    for (auto i = r.integer(0, 6); i > 0; --i) {
      const int x = static_cast<int>(r.integer(1, m->width - 2));
      const int y = static_cast<int>(r.integer(1, m->height - 2));
      fill(*m, x, y, x, y, r.uniform() < 0.7 ? CostMap::kFree : CostMap::kUnknown);
    }
  }
  return m;
}

}  // namespace oracle
