#include "tasks/planning/planner.hpp"

#include <gtest/gtest.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <pthread.h>

#include <chrono>
#include <cstring>
#include <ctime>
#include <thread>

#include "rt/memory/section.hpp"
#include "tests/unit/tasks_planning/grid_oracle.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using perception::CostMap;
using tasks::Planner;
using tasks::PlannerConfig;
using tasks::PlanStatus;
using tasks::Point2;

rt::Startup startup;

Point2 centre(const CostMap& m, int x, int y) {
  return {(x + 0.5) * m.resolution, (y + 0.5) * m.resolution};
}

double length(std::span<const Point2> v) {
  double sum = 0;
  for (std::size_t i = 1; i < v.size(); ++i)
    sum += std::hypot(v[i].x - v[i - 1].x, v[i].y - v[i - 1].y);
  return sum;
}

std::pair<int, int> open_cell(const CostMap& m, rt::Random& r) {
  for (int tries = 0; tries < 10000; ++tries) {
    const int x = static_cast<int>(r.integer(0, m.width - 1));
    const int y = static_cast<int>(r.integer(0, m.height - 1));
    if (oracle::open(m, x, y)) return {x, y};
  }
  return {-1, -1};
}

TEST(EdgeClear, AgreesWithDenseSampling) {
  const std::uint64_t seed = 11;
  rt::Random r(seed);
  int clear = 0, blocked = 0;
  for (int i = 0; i < 60; ++i) {
    const auto m = oracle::random_map(r);
    for (int j = 0; j < 60; ++j) {
      const double w = m->width * m->resolution, h = m->height * m->resolution;
      const Point2 a{r.uniform(-0.2, w + 0.2), r.uniform(-0.2, h + 0.2)};
      const double reach = r.uniform() < 0.5 ? 0.3 : w;
      const Point2 b{a.x + r.uniform(-reach, reach), a.y + r.uniform(-reach, reach)};
      const bool got = tasks::edge_clear(*m, a, b, oracle::kDrive);
      EXPECT_EQ(got, tasks::edge_clear(*m, b, a, oracle::kDrive)) << "seed " << seed;
      if (got) {
        ++clear;
        ASSERT_TRUE(oracle::free_segment(*m, a, b, 0.0001)) << "seed " << seed << " map " << i;
      } else {
        // Sampling may miss a touched corner, never more than a sliver of it.
        ++blocked;
        if (oracle::free_segment(*m, a, b, 0.00002)) {
          bool near = false;
          for (double dx : {-1e-4, 1e-4}) {
            for (double dy : {-1e-4, 1e-4}) {
              near |= !oracle::free_segment(*m, {a.x + dx, a.y + dy}, {b.x + dx, b.y + dy}, 1e-4);
            }
          }
          ASSERT_TRUE(near) << "seed " << seed << " map " << i << " case " << j;
        }
      }
    }
  }
  std::printf("seed %llu: %d clear, %d blocked\n", static_cast<unsigned long long>(seed), clear,
              blocked);
  EXPECT_GT(clear, 300);
  EXPECT_GT(blocked, 300);
}

TEST(EdgeClear, BordersCornersAndNonsense) {
  auto m = oracle::blank(20, 20, 1.0);
  oracle::fill(*m, 10, 10, 10, 10, CostMap::kInscribed);
  EXPECT_TRUE(tasks::edge_clear(*m, {1.5, 1.5}, {18.5, 1.5}));
  EXPECT_FALSE(tasks::edge_clear(*m, {1.5, 10.5}, {18.5, 10.5}));
  EXPECT_FALSE(tasks::edge_clear(*m, {5, 10}, {15, 10})) << "along its lower border";
  EXPECT_FALSE(tasks::edge_clear(*m, {5, 11}, {15, 11})) << "along its upper border";
  EXPECT_FALSE(tasks::edge_clear(*m, {8, 12}, {12, 8})) << "through it";
  EXPECT_FALSE(tasks::edge_clear(*m, {9, 12}, {12, 9})) << "through it";
  EXPECT_FALSE(tasks::edge_clear(*m, {9.5, 12.5}, {12.5, 9.5})) << "touches the corner (11, 11)";
  EXPECT_TRUE(tasks::edge_clear(*m, {9.5, 12.6}, {12.6, 9.5}));
  EXPECT_TRUE(tasks::point_clear(*m, {10.5, 9.5}));
  EXPECT_FALSE(tasks::point_clear(*m, {10.5, 10.0})) << "a border belongs to both";
  EXPECT_FALSE(tasks::point_clear(*m, {-0.1, 5}));
  EXPECT_FALSE(tasks::edge_clear(*m, {5, 5}, {25, 5})) << "off the map";
  const double nan = std::nan("");
  EXPECT_FALSE(tasks::edge_clear(*m, {nan, 5}, {5, 5}));
  EXPECT_FALSE(tasks::edge_clear(*m, {5, 5}, {5, 1e300}));
  oracle::fill(*m, 3, 0, 3, 19, CostMap::kUnknown);
  EXPECT_FALSE(tasks::edge_clear(*m, {1.5, 5.5}, {8.5, 5.5}));
  EXPECT_TRUE(tasks::edge_clear_or_unknown(*m, {1.5, 5.5}, {8.5, 5.5}, CostMap::kInscribed));
  m->resolution = 0;
  EXPECT_FALSE(tasks::point_clear(*m, {1, 1}));
}

// Solvable exactly when Dijkstra says so; the path collides with nothing; it is about as short.
TEST(Planner, AgreesWithDijkstraOnRandomMaps) {
  const std::uint64_t seed = 20240615;
  rt::Random r(seed);
  Planner planner(startup.token(), PlannerConfig{});
  int solvable = 0, not_solvable = 0, from_grid = 0;
  double ratio_sum = 0, ratio_max = 0, worst_ms = 0;
  std::uint32_t iterations_max = 0;
  for (int i = 0; i < 400; ++i) {
    const auto m = oracle::random_map(r);
    const auto [sx, sy] = open_cell(*m, r);
    const auto [gx, gy] = open_cell(*m, r);
    if (sx < 0 || gx < 0) continue;
    const double shortest = oracle::dijkstra(*m, sx, sy, gx, gy);
    const Point2 a = centre(*m, sx, sy), b = centre(*m, gx, gy);
    const rt::Tick tick{.k = static_cast<std::uint64_t>(i)};
    const auto t0 = std::chrono::steady_clock::now();
    ASSERT_TRUE(planner.flood(*m, a, tick));
    ASSERT_EQ(planner.reachable(gx, gy), std::isfinite(shortest))
        << "seed " << seed << " map " << i;
    const PlanStatus status = planner.plan(b, seed, tick.k, tick);
    worst_ms = std::max(
        worst_ms,
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - t0).count());
    iterations_max = std::max(iterations_max, planner.iterations());
    if (!std::isfinite(shortest)) {
      ++not_solvable;
      EXPECT_EQ(status, PlanStatus::kUnreachable) << "seed " << seed << " map " << i;
      continue;
    }
    ++solvable;
    from_grid += planner.from_grid();
    ASSERT_EQ(status, PlanStatus::kFound) << "seed " << seed << " map " << i;
    const auto v = planner.vertices();
    ASSERT_EQ(v.front(), a);
    ASSERT_EQ(v.back(), b);
    for (std::size_t k = 1; k < v.size(); ++k) {
      ASSERT_TRUE(oracle::free_segment(*m, v[k - 1], v[k])) << "seed " << seed << " map " << i;
    }
    if (shortest > 0) {
      const double ratio = length(v) / shortest;
      ratio_sum += ratio;
      ratio_max = std::max(ratio_max, ratio);
    } else {
      ratio_sum += 1;
    }
  }
  std::printf(
      "seed %llu: %d solvable (%d by the grid), %d not; length / Dijkstra mean %.3f max %.3f; "
      "at most %u iterations, %.1f ms\n",
      static_cast<unsigned long long>(seed), solvable, from_grid, not_solvable,
      ratio_sum / solvable, ratio_max, iterations_max, worst_ms);
  EXPECT_GT(solvable, 150);
  EXPECT_GT(not_solvable, 30);
  EXPECT_LT(from_grid, solvable / 4) << "the search does most of the work, mazes included";
  EXPECT_LE(ratio_sum / solvable, 1.35);
}

TEST(Planner, LargestMapFitsTheBudget) {
  const std::uint64_t seed = 5;
  rt::Random r(seed);
  Planner planner(startup.token(), PlannerConfig{});
  double worst_ms = 0;
  for (int i = 0; i < 20; ++i) {
    auto m = oracle::blank(256, 256);
    for (int k = 0; k < 120; ++k) {
      const int x = static_cast<int>(r.integer(5, 245)), y = static_cast<int>(r.integer(5, 245));
      oracle::fill(*m, x, y, x + static_cast<int>(r.integer(1, 40)), y + 2, CostMap::kOccupied);
    }
    oracle::fill(*m, 0, 0, 3, 3, 0);
    oracle::fill(*m, 252, 252, 255, 255, 0);
    const rt::Tick tick{.k = static_cast<std::uint64_t>(i)};
    const auto t0 = std::chrono::steady_clock::now();
    ASSERT_TRUE(planner.flood(*m, centre(*m, 1, 1), tick));
    const auto status = planner.plan(centre(*m, 254, 254), seed, tick.k, tick);
    worst_ms = std::max(
        worst_ms,
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - t0).count());
    EXPECT_EQ(status == PlanStatus::kFound, planner.reachable(254, 254)) << i;
  }
  std::printf("256 x 256 cells, 120 walls: at most %.1f ms a plan\n", worst_ms);
}

TEST(Planner, KeepsComfortableClearanceWhereItCan) {
  // Two ways through a wall: a cramped one straight ahead and a roomy one aside.
  auto m = oracle::blank(60, 60);
  oracle::fill(*m, 30, 0, 31, 59, CostMap::kOccupied);
  oracle::fill(*m, 30, 29, 31, 31, 150);
  oracle::fill(*m, 30, 50, 31, 56, 0);
  Planner planner(startup.token(), PlannerConfig{});
  const rt::Tick tick{};
  const Point2 a = centre(*m, 10, 30), b = centre(*m, 50, 30);
  ASSERT_TRUE(planner.flood(*m, a, tick));
  ASSERT_EQ(planner.plan(b, 1, 0, tick), PlanStatus::kFound);
  EXPECT_GT(length(planner.vertices()), 2.5) << "went round";
  oracle::fill(*m, 30, 50, 31, 56, CostMap::kOccupied);
  ASSERT_TRUE(planner.flood(*m, a, tick));
  ASSERT_EQ(planner.plan(b, 1, 0, tick), PlanStatus::kFound);
  EXPECT_LT(length(planner.vertices()), 2.2) << "through the cramped one when it is the only one";
}

// Somebody else draws from the library's process-wide generator and plans in between.
void disturb_library() {
  ompl::RNG rng;
  for (int i = 0; i < 1000; ++i) (void)rng.uniform01();
  auto space = std::make_shared<ompl::base::RealVectorStateSpace>(2);
  space->setBounds(0, 10);
  ompl::geometric::SimpleSetup setup(space);
  setup.setStateValidityChecker([](const ompl::base::State*) { return true; });
  ompl::base::ScopedState<> a(space), b(space);
  a.random();
  b.random();
  setup.setStartAndGoalStates(a, b);
  setup.setPlanner(std::make_shared<ompl::geometric::RRTConnect>(setup.getSpaceInformation()));
  (void)setup.solve(0.01);
}

TEST(Planner, SameSeedAndJobGiveTheSameBytes) {
  const std::uint64_t seed = 77;
  rt::Random r(seed);
  int differing = 0;
  for (int i = 0; i < 20; ++i) {
    auto m = oracle::blank(100, 100);
    for (int k = 0; k < 30; ++k) {
      const int x = static_cast<int>(r.integer(5, 90)), y = static_cast<int>(r.integer(5, 90));
      oracle::fill(*m, x, y, x + 12, y + 1, CostMap::kOccupied);
    }
    const Point2 a = centre(*m, 1, 1), b = centre(*m, 98, 98);
    const auto run = [&](Planner& p, std::uint64_t s, std::uint64_t job) {
      const rt::Tick tick{.k = job};
      EXPECT_TRUE(p.flood(*m, a, tick));
      EXPECT_EQ(p.plan(b, s, job, tick), PlanStatus::kFound);
      const auto v = p.vertices();
      return std::vector<Point2>(v.begin(), v.end());
    };
    Planner one(startup.token(), PlannerConfig{});
    const auto first = run(one, seed, 3);
    (void)run(one, seed, 4);  // another job in between
    disturb_library();
    const auto again = run(one, seed, 3);
    Planner two(startup.token(), PlannerConfig{});
    disturb_library();
    const auto other = run(two, seed, 3);
    ASSERT_EQ(first.size(), again.size());
    ASSERT_EQ(first.size(), other.size());
    EXPECT_EQ(0, std::memcmp(first.data(), again.data(), first.size() * sizeof(Point2)));
    EXPECT_EQ(0, std::memcmp(first.data(), other.data(), first.size() * sizeof(Point2)));
    differing += run(one, seed, 4) != first || run(one, seed + 1, 3) != first;
  }
  EXPECT_GT(differing, 10) << "another job or seed draws other samples";
}

TEST(Planner, EndsByIterationsAndByTheToken) {
  // The goal is connected, but behind a maze that three iterations can not solve.
  auto m = oracle::blank(100, 100);
  for (int x = 10; x < 90; x += 10) {
    const bool up = x % 20 == 0;
    oracle::fill(*m, x, up ? 0 : 2, x + 1, up ? 97 : 99, CostMap::kOccupied);
  }
  PlannerConfig config;
  config.iterations = 10;
  config.guide_share = 0;
  config.grid_fallback = false;
  Planner planner(startup.token(), config);
  rt::Tick tick{};
  const Point2 a = centre(*m, 2, 50), b = centre(*m, 97, 50);
  ASSERT_TRUE(planner.flood(*m, a, tick));
  EXPECT_EQ(planner.plan(b, 1, 0, tick), PlanStatus::kBudgetSpent);
  EXPECT_LE(planner.iterations(), 12U);
  EXPECT_TRUE(planner.vertices().empty());
  tick.level = 1;
  EXPECT_EQ(planner.plan(b, 1, 0, tick), PlanStatus::kBudgetSpent);
  EXPECT_LE(planner.iterations(), 4U) << "a quarter of it at level 1";

  rt::CancelToken token;
  tick.level = 0;
  tick.cancel = &token;
  token.request();
  EXPECT_EQ(planner.plan(b, 1, 0, tick), PlanStatus::kCancelled);
  EXPECT_FALSE(planner.flood(*m, a, tick));
  token.clear();
  ASSERT_TRUE(planner.flood(*m, a, tick));
  EXPECT_EQ(planner.plan(b, 1, 0, tick), PlanStatus::kBudgetSpent);

  config.grid_fallback = true;
  Planner with_grid(startup.token(), config);
  ASSERT_TRUE(with_grid.flood(*m, a, tick));
  ASSERT_EQ(with_grid.plan(b, 1, 0, tick), PlanStatus::kFound);
  EXPECT_TRUE(with_grid.from_grid());
  const auto v = with_grid.vertices();
  for (std::size_t k = 1; k < v.size(); ++k) EXPECT_TRUE(oracle::free_segment(*m, v[k - 1], v[k]));
}

TEST(Planner, TokenEndsARunningSearchSoon) {
  auto m = oracle::blank(256, 256);
  for (int x = 10; x < 240; x += 10) {
    const bool up = x % 20 == 0;
    oracle::fill(*m, x, up ? 0 : 1, x + 1, up ? 254 : 255, CostMap::kOccupied);
  }
  PlannerConfig config;
  config.iterations = 100000;
  config.guide_share = 0;
  config.grid_fallback = false;
  Planner planner(startup.token(), config);
  rt::CancelToken token;
  rt::Tick tick{};
  tick.cancel = &token;
  ASSERT_TRUE(planner.flood(*m, centre(*m, 2, 128), tick));
  // What the search still works after the request, in CPU of its thread: others on the machine do
  // not count.
  clockid_t searching{};
  ASSERT_EQ(pthread_getcpuclockid(pthread_self(), &searching), 0);
  const auto cpu_ms = [&] {
    timespec t{};
    clock_gettime(searching, &t);
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
  };
  double asked_ms = -1;
  std::thread canceller([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    asked_ms = cpu_ms();
    token.request();
  });
  const auto status = planner.plan(centre(*m, 253, 128), 1, 0, tick);
  const double ended_ms = cpu_ms();
  canceller.join();
  EXPECT_EQ(status, PlanStatus::kCancelled);
  EXPECT_GT(ended_ms, asked_ms) << "it ended before it was asked to";
  EXPECT_LT(ended_ms - asked_ms, 50);
}

TEST(Planner, WhatCanNotBePlannedSaysWhy) {
  auto m = oracle::blank(40, 40);
  oracle::fill(*m, 20, 0, 20, 39, CostMap::kUnknown);
  Planner planner(startup.token(), PlannerConfig{});
  const rt::Tick tick{};
  EXPECT_EQ(planner.plan({0.1, 0.1}, 1, 0, tick), PlanStatus::kNoMap);
  EXPECT_FALSE(planner.flood(*m, centre(*m, 20, 5), tick));
  EXPECT_EQ(planner.plan({0.1, 0.1}, 1, 0, tick), PlanStatus::kStartBlocked);
  ASSERT_TRUE(planner.flood(*m, centre(*m, 5, 5), tick));
  EXPECT_EQ(planner.plan(centre(*m, 20, 5), 1, 0, tick), PlanStatus::kGoalBlocked);
  EXPECT_EQ(planner.plan(centre(*m, 30, 5), 1, 0, tick), PlanStatus::kUnreachable);
  EXPECT_EQ(planner.plan({-1, 0}, 1, 0, tick), PlanStatus::kGoalBlocked);
  EXPECT_EQ(planner.plan({std::nan(""), 0}, 1, 0, tick), PlanStatus::kGoalBlocked);
  EXPECT_EQ(planner.plan(centre(*m, 6, 5), 1, 0, tick), PlanStatus::kFound);
  m->ground_found = false;
  EXPECT_FALSE(planner.flood(*m, centre(*m, 5, 5), tick));
}

TEST(Planner, OurOwnCodeAllocatesNothing) {
  auto m = oracle::blank(256, 256);
  oracle::fill(*m, 100, 0, 101, 200, CostMap::kOccupied);
  Planner planner(startup.token(), PlannerConfig{});
  const rt::Tick tick{};
  rt_guard::reset();
  {
    rt::Section s;
    ASSERT_TRUE(planner.flood(*m, centre(*m, 5, 5), tick));
    ASSERT_EQ(planner.plan(centre(*m, 90, 90), 1, 0, tick), PlanStatus::kFound);  // in sight
  }
  if (rt_guard::linked()) {
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  } else {
    std::printf("guard not linked\n");
  }
  rt_guard::reset();
  {
    rt::Section s;
    ASSERT_EQ(planner.plan(centre(*m, 200, 20), 1, 0, tick), PlanStatus::kFound);
  }
  std::printf("the library: %llu allocations, %llu locks in one plan\n",
              static_cast<unsigned long long>(rt_guard::counts().allocations),
              static_cast<unsigned long long>(rt_guard::counts().locks));
}

}  // namespace
