// Paths of straight lines.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tasks/prediction/prediction_task.hpp"

namespace tests {

using perception::Pose2;
using tasks::Path;

inline Path make_path(std::uint64_t seq, const std::vector<Pose2>& corners, double step = 0.05) {
  Path p;
  p.seq = seq;
  for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
    const Pose2 a = corners[i], b = corners[i + 1];
    const int n = std::max(1, static_cast<int>(std::hypot(b.x - a.x, b.y - a.y) / step));
    for (int k = 0; k < n; ++k) {
      const double f = static_cast<double>(k) / n;
      p.points[static_cast<std::size_t>(p.size++)] = {a.x + f * (b.x - a.x), a.y + f * (b.y - a.y),
                                                      a.yaw + f * (b.yaw - a.yaw)};
    }
  }
  const Pose2 e = corners.back();
  p.points[static_cast<std::size_t>(p.size++)] = {e.x, e.y, e.yaw};
  p.marked_W = {e.x, e.y, 0};
  return p;
}

inline double distance_to(const Path& p, double x, double y) {
  double best = 1e9;
  for (int i = 0; i + 1 < p.size; ++i) {
    const auto& a = p.points[static_cast<std::size_t>(i)];
    const auto& b = p.points[static_cast<std::size_t>(i + 1)];
    for (int k = 0; k <= 20; ++k) {
      const double f = k / 20.0;
      best = std::min(best, std::hypot(a[0] + f * (b[0] - a[0]) - x, a[1] + f * (b[1] - a[1]) - y));
    }
  }
  return best;
}

}  // namespace tests
