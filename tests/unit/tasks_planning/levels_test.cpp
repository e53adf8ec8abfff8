// What the levels of the task table do on the hardest maps of the largest size, and what a plan
// takes there.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "rt/clock/box_time.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/planning/planner.hpp"
#include "tests/unit/tasks_planning/grid_oracle.hpp"

namespace {

using perception::CostMap;
using tasks::Planner;
using tasks::PlanStatus;
using tasks::Point2;

rt::Startup startup;

struct Case {
  std::unique_ptr<CostMap> map;
  Point2 from, to;
};

Point2 centre(const CostMap& m, int x, int y) {
  return {(x + 0.5) * m.resolution, (y + 0.5) * m.resolution};
}

// Walls with a gap at alternate ends: a search without a guide finds no way through.
Case serpent(int size, int pitch, int gap) {
  Case c;
  c.map = oracle::blank(size, size);
  for (int x = pitch; x < size - pitch; x += pitch) {
    const bool up = (x / pitch) % 2 == 0;
    oracle::fill(*c.map, x, up ? 0 : gap, x + 1, up ? size - 1 - gap : size - 1,
                 CostMap::kOccupied);
  }
  c.from = centre(*c.map, 1, size / 2);
  c.to = centre(*c.map, size - 2, size / 2);
  return c;
}

Case scattered(rt::Random& r) {
  Case c;
  c.map = oracle::blank(256, 256);
  for (int k = 0; k < 120; ++k) {
    const int x = static_cast<int>(r.integer(5, 245)), y = static_cast<int>(r.integer(5, 245));
    oracle::fill(*c.map, x, y, x + static_cast<int>(r.integer(1, 40)), y + 2, CostMap::kOccupied);
  }
  oracle::fill(*c.map, 0, 0, 3, 3, 0);
  oracle::fill(*c.map, 252, 252, 255, 255, 0);
  c.from = centre(*c.map, 1, 1);
  c.to = centre(*c.map, 254, 254);
  return c;
}

TEST(PlannerLevels, TheBriefOneAnswersTheHardestMapsWithAQuarterOfTheSearch) {
  const std::uint64_t seed = 31;
  RecordProperty("seed", std::to_string(seed));
  rt::Random r(seed);
  std::vector<Case> cases;
  for (int i = 0; i < 20; ++i) cases.push_back(scattered(r));
  for (const int pitch : {4, 6, 10, 20, 40})
    for (const int gap : {1, 2, 4}) cases.push_back(serpent(256, pitch, gap));
  const tasks::PlannerConfig config;
  Planner planner(startup.token(), config);
  const auto& variants = tasks::kTaskTable[tasks::index_of(tasks::TaskId::kPlanning)].variants;
  std::vector<PlanStatus> full(cases.size());
  int searched[2] = {};  // maps whose search ran into the level's limit
  for (const int level : {0, 1}) {
    const auto& v = variants[static_cast<std::size_t>(level)];
    const auto limit = static_cast<std::uint32_t>(config.iterations >> (2 * level));
    double worst_ms = 0;
    int answered = 0;
    for (std::size_t i = 0; i < cases.size(); ++i) {
      const Case& c = cases[i];
      rt::Tick tick{.k = i};
      tick.level = level;
      std::int64_t least = INT64_MAX;
      PlanStatus status{};
      for (int again = 0; again < 3; ++again) {  // the same work each time: the least is its own
        const std::int64_t before = rt::thread_cpu_ns();
        ASSERT_TRUE(planner.flood(*c.map, c.from, tick)) << "seed " << seed << " map " << i;
        status = planner.plan(c.to, seed, tick.k, tick);
        least = std::min(least, rt::thread_cpu_ns() - before);
      }
      const int x = static_cast<int>(c.to.x / c.map->resolution),
                y = static_cast<int>(c.to.y / c.map->resolution);
      // A way of more corners than a path may have is not found at either.
      if (level == 0) {
        EXPECT_TRUE(status == PlanStatus::kFound || status == PlanStatus::kUnreachable ||
                    status == PlanStatus::kBudgetSpent)
            << "map " << i;
        full[i] = status;
      } else {
        EXPECT_EQ(status, full[i]) << "map " << i;
      }
      if (i < 20) {
        EXPECT_EQ(status == PlanStatus::kFound, planner.reachable(x, y)) << "map " << i;
      }
      EXPECT_LE(planner.iterations(), limit + 1) << v.name << ", map " << i;
      searched[level] += planner.iterations() >= limit ? 1 : 0;
      const auto way = planner.vertices();
      for (std::size_t k = 1; k < way.size(); ++k)
        ASSERT_TRUE(oracle::free_segment(*c.map, way[k - 1], way[k], 0.01)) << "map " << i;
      answered += status == PlanStatus::kFound ? 1 : 0;
      worst_ms = std::max(worst_ms, 1e-6 * static_cast<double>(least));
    }
    std::printf(
        "%s: %d of %zu maps have a way, the search was spent on %d; at most %.1f ms of CPU, budget "
        "%.0f\n",
        std::string(v.name).c_str(), answered, cases.size(), searched[level], worst_ms,
        1e-3 * static_cast<double>(v.budget_us));
    EXPECT_GT(answered, 20);
  }
  EXPECT_GT(searched[1], 0) << "no map is hard enough to tell";
  EXPECT_EQ(variants[1].name, "brief");
  EXPECT_EQ(variants[1].budget_us, 5000);
}

}  // namespace
