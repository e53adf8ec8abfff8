// Paths for the base on a cost map: RRT-Connect in the plane (Kuffner, LaValle: RRT-Connect, ICRA
// 2000; OMPL's implementation), then shortcuts of our own. The base is holonomic and the map's
// inscribed cells already hold its radius, so a position is what is planned; the heading is laid on
// afterwards.
//
// A path is valid if no cell it touches, ends included, is inscribed, occupied or unknown; edges
// are checked exactly, cell by cell, not by sampling.
//
// Two things come before the sampling, both exact on the grid and cheap (one flood fill):
//   - what is not connected to the start is refused at once instead of after the whole budget;
//   - samples are drawn from the connected cells, a share of them along the flood's own chain of
//     cells, so a passage one cell wide does not have to be hit by luck.
// If the iterations are spent without a path (a maze), the flood's chain of cells is the path. So a
// connected goal always gets a path, and from_grid() says which of the two made it.
//
// Deterministic: every random number comes from rt::Random(seed, job). OMPL's own generators are
// seeded process-wide and are kept out of the result: the state sampler is ours, the goal is a
// single state, and nearest neighbours are looked for linearly (OMPL's GNAT picks its pivots at
// random). It ends by iterations and by the cancel token, never by time.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>

#include "config/schema.hpp"
#include "perception/ground/cost_map.hpp"
#include "rt/clock/tick.hpp"
#include "rt/memory/non_realtime.hpp"

namespace tasks {

struct Point2 {
  double x = 0, y = 0;  // m, grid frame M of the cost map
  friend bool operator==(const Point2&, const Point2&) = default;
};

[[nodiscard]] inline double distance(Point2 a, Point2 b) {
  return std::hypot(b.x - a.x, b.y - a.y);
}

// Largest cost at which the body still fits: everything below inscribed. New paths keep to
// PlannerConfig::drive_cost, one that is driven holds up to here.
inline constexpr std::uint8_t kDriveableCost = perception::CostMap::kInscribed - 1;

// The cell at p is on the map and costs at most `limit`.
[[nodiscard]] bool point_clear(const perception::CostMap& map, Point2 p,
                               std::uint8_t limit = kDriveableCost) noexcept;
// Every cell that the closed segment touches is on the map and costs at most `limit`. A segment
// along a cell's border touches both sides.
[[nodiscard]] bool edge_clear(const perception::CostMap& map, Point2 a, Point2 b,
                              std::uint8_t limit = kDriveableCost) noexcept;
// The same, but unknown cells may be crossed.
[[nodiscard]] bool edge_clear_or_unknown(const perception::CostMap& map, Point2 a, Point2 b,
                                         std::uint8_t limit) noexcept;

struct PlannerConfig {
  int iterations = 4000;  // of RRT-Connect at level 0; a quarter at each further level
  double range_m = 0.6;   // longest tree edge
  double guide_share =
      0.2;                // of the samples lie on the flood's chain, up to five times as much later
  int shortcuts = 150;    // tries of the random shortcut pass
  int comfort_cost = 96;  // cells above it are only used when there is no other way
  // Cells above it are not driven, though the body would just fit. That leaves at least 75 mm
  // beyond the radius for the base's deviation from its path (prediction.path.corridor_m, tracking)
  // and for half a cell.
  int drive_cost = 176;
  bool grid_fallback = true;  // the flood's chain when the iterations are spent

  void describe(config::Section& s);
};

enum class PlanStatus : std::uint8_t {
  kFound,
  kNoMap,         // no ground
  kStartBlocked,  // the start's cell is not driveable
  kGoalBlocked,
  kUnreachable,  // no connection on the grid: more iterations would not help
  kBudgetSpent,  // connected, but not found within the iterations (and no fallback wanted)
  kCancelled,
  kLibraryFault,  // the planning library threw
};

class Planner {
 public:
  static constexpr int kMaxVertices = 512;

  Planner(rt::NonRealtime&, const PlannerConfig&);
  ~Planner();
  Planner(const Planner&) = delete;
  Planner& operator=(const Planner&) = delete;

  // A cell where the path may begin, and what it costs to get there.
  struct Source {
    int ix = 0, iy = 0;
    double reach_m = 0;
  };
  // Marks the cells connected to the start: one point whose cell is driveable, or several cells of
  // which the best one for the goal becomes the start. False if nothing is driveable there, or
  // cancelled. `map` must stay unchanged until plan() has returned.
  bool flood(const perception::CostMap& map, Point2 start, const rt::Tick& tick) noexcept;
  bool flood(const perception::CostMap& map, std::span<const Source> starts,
             const rt::Tick& tick) noexcept;
  // Largest cost that a path of this planner touches.
  [[nodiscard]] std::uint8_t drive_limit() const noexcept;
  // Valid after flood(): the cell is connected to the start.
  [[nodiscard]] bool reachable(int ix, int iy) const noexcept;

  // After flood(). The vertices of the path, start and goal included, are vertices().
  PlanStatus plan(Point2 goal, std::uint64_t seed, std::uint64_t job,
                  const rt::Tick& tick) noexcept;
  [[nodiscard]] std::span<const Point2> vertices() const noexcept;
  // The last path came from the flood's chain, not from the search.
  [[nodiscard]] bool from_grid() const noexcept;
  // Iterations of the last plan(): a deterministic count of the work.
  [[nodiscard]] std::uint32_t iterations() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tasks
