#include "tasks/planning/planner.hpp"

#include <ompl/base/MotionValidator.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateSampler.h>
#include <ompl/base/goals/GoalState.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>

#include <algorithm>
#include <cmath>

#include "rt/random.hpp"
#include "tasks/planning/flood.hpp"

namespace tasks {

namespace ob = ompl::base;
namespace og = ompl::geometric;
using perception::CostMap;

void PlannerConfig::describe(config::Section& s) {
  s.integer("iterations", iterations, 10, 100000,
            "of RRT-Connect, a quarter at each further level");
  s.number("range_m", range_m, 0.05, 5.0, "longest edge of the search trees");
  s.number("guide_share", guide_share, 0.0, 1.0, "samples on the grid's own shortest chain");
  s.integer("shortcuts", shortcuts, 0, 5000, "tries of the random shortcut pass");
  s.integer("comfort_cost", comfort_cost, 0, kDriveableCost,
            "map cost above which a cell is only used when there is no other way");
  s.integer("drive_cost", drive_cost, 0, kDriveableCost, "map cost above which nothing is driven");
  s.flag("grid_fallback", grid_fallback, "the grid's shortest chain when the iterations are spent");
}

namespace {

Point2 point_of(const ob::State* state) {
  const auto* v = state->as<ob::RealVectorStateSpace::StateType>()->values;
  return {v[0], v[1]};
}
void set_point(ob::State* state, Point2 p) {
  auto* v = state->as<ob::RealVectorStateSpace::StateType>()->values;
  v[0] = p.x;
  v[1] = p.y;
}

}  // namespace

struct Planner::Impl {
  explicit Impl(const PlannerConfig& c);

  // What the search works on; set by flood() and plan().
  const CostMap* map = nullptr;
  Flood* way = nullptr;  // the flood in use: comfort or driveable
  rt::Random random{0};
  std::uint64_t budget = 0, used = 0;
  const rt::Tick* tick = nullptr;

  PlannerConfig config;
  Flood comfort, driveable;
  bool comfort_ok = false, driveable_ok = false;
  Point2 start{};
  bool exact_start = false;  // the start is a point, not a cell
  std::array<Flood::Seed, 4096> seeds{};
  std::array<std::int32_t, static_cast<std::size_t>(CostMap::kMaxCells) * CostMap::kMaxCells>
      chain{};
  std::int32_t chain_size = 0;
  std::array<Point2, kMaxVertices + 2> vertices{}, scratch{};
  std::array<double, kMaxVertices + 2> along{};
  int size = 0;
  bool from_grid = false;

  std::shared_ptr<ob::RealVectorStateSpace> space;
  ob::SpaceInformationPtr info;
  ob::ProblemDefinitionPtr problem;
  std::shared_ptr<og::RRTConnect> rrt;
  ob::State *start_state = nullptr, *goal_state = nullptr;

  [[nodiscard]] Point2 centre(std::int32_t cell) const {
    const std::int32_t ix = cell % map->width, iy = cell / map->width;
    return {(ix + 0.5) * map->resolution, (iy + 0.5) * map->resolution};
  }
  [[nodiscard]] std::int32_t cell_of(Point2 p) const {
    const int ix = static_cast<int>(std::floor(p.x / map->resolution));
    const int iy = static_cast<int>(std::floor(p.y / map->resolution));
    return map->contains(ix, iy) ? static_cast<std::int32_t>(map->index(ix, iy)) : -1;
  }
  Point2 sample() {
    // The longer the search takes, the more it is a maze, and the more the chain is worth.
    const double spent = static_cast<double>(used) / static_cast<double>(budget);
    const bool guided = random.uniform() < config.guide_share * (1.0 + 4.0 * spent);
    const auto cells =
        guided ? std::span<const std::int32_t>(chain.data(), static_cast<std::size_t>(chain_size))
               : way->cells();
    const auto i = random.integer(0, static_cast<std::int64_t>(cells.size()) - 1);
    const std::int32_t c = cells[static_cast<std::size_t>(i)];
    const std::int32_t ix = c % map->width, iy = c / map->width;
    return {(ix + random.uniform()) * map->resolution, (iy + random.uniform()) * map->resolution};
  }

  [[nodiscard]] std::uint8_t drive_limit() const {
    return static_cast<std::uint8_t>(config.drive_cost);
  }
  bool flood(int seed_count, std::uint8_t start_cost, const rt::Tick& t);
  std::int32_t trace_chain(std::int32_t goal_cell);
  PlanStatus search(Point2 goal);
  bool follow_chain(Point2 goal);
  void prune();
  void shortcut();
};

namespace {

// Samples of the flooded cells, by our generator. The base class owns a generator of the library;
// it is never asked.
template <class Owner>
class CellSampler : public ob::StateSampler {
 public:
  CellSampler(const ob::StateSpace* space, Owner* owner) : ob::StateSampler(space), owner_(owner) {}
  void sampleUniform(ob::State* state) override { set_point(state, owner_->sample()); }
  void sampleUniformNear(ob::State* state, const ob::State*, double) override {
    set_point(state, owner_->sample());
  }
  void sampleGaussian(ob::State* state, const ob::State*, double) override {
    set_point(state, owner_->sample());
  }

 private:
  Owner* owner_;
};

template <class Owner>
class CellMotionValidator : public ob::MotionValidator {
 public:
  CellMotionValidator(const ob::SpaceInformationPtr& info, const Owner* owner)
      : ob::MotionValidator(info), owner_(owner) {}
  bool checkMotion(const ob::State* a, const ob::State* b) const override {
    return edge_clear(*owner_->map, point_of(a), point_of(b), owner_->way->limit());
  }
  // RRT-Connect without intermediate states does not ask for the last valid one.
  bool checkMotion(const ob::State* a, const ob::State* b,
                   std::pair<ob::State*, double>& last_valid) const override {
    if (checkMotion(a, b)) return true;
    if (last_valid.first != nullptr) si_->copyState(last_valid.first, a);
    last_valid.second = 0.0;
    return false;
  }

 private:
  const Owner* owner_;
};

}  // namespace

Planner::Impl::Impl(const PlannerConfig& c) : config(c) {
  // The library writes to the console by itself otherwise; there is no switch per planner.
  ompl::msg::noOutputHandler();
  space = std::make_shared<ob::RealVectorStateSpace>(2);
  const double extent = 1e4;  // of no effect: our sampler and validator know the map's own bounds
  ob::RealVectorBounds bounds(2);
  bounds.setLow(-extent);
  bounds.setHigh(extent);
  space->setBounds(bounds);
  space->setStateSamplerAllocator([this](const ob::StateSpace* s) -> ob::StateSamplerPtr {
    return std::make_shared<CellSampler<Impl>>(s, this);
  });
  info = std::make_shared<ob::SpaceInformation>(space);
  info->setStateValidityChecker(
      [this](const ob::State* s) { return point_clear(*map, point_of(s), way->limit()); });
  info->setMotionValidator(std::make_shared<CellMotionValidator<Impl>>(info, this));
  info->setup();
  problem = std::make_shared<ob::ProblemDefinition>(info);
  rrt = std::make_shared<og::RRTConnect>(info, false);
  rrt->setRange(config.range_m);
  rrt->setProblemDefinition(problem);
  rrt->setNearestNeighbors<ompl::NearestNeighborsLinear>();
  start_state = space->allocState();
  goal_state = space->allocState();
}

Planner::Planner(rt::NonRealtime&, const PlannerConfig& config)
    : impl_(std::make_unique<Impl>(config)) {}

Planner::~Planner() {
  impl_->space->freeState(impl_->start_state);
  impl_->space->freeState(impl_->goal_state);
}

bool Planner::Impl::flood(int seed_count, std::uint8_t start_cost, const rt::Tick& t) {
  const std::span<const Flood::Seed> s(seeds.data(), static_cast<std::size_t>(seed_count));
  const auto limit = std::min(
      drive_limit(), static_cast<std::uint8_t>(std::max<int>(config.comfort_cost, start_cost)));
  driveable_ok = driveable.run(*map, s, drive_limit(), t);
  comfort_ok = driveable_ok && !t.cancelled() && comfort.run(*map, s, limit, t);
  return driveable_ok && !t.cancelled();
}

bool Planner::flood(const CostMap& map, Point2 start, const rt::Tick& tick) noexcept {
  Impl& m = *impl_;
  m.map = &map;
  m.driveable_ok = m.comfort_ok = false;
  if (!map.ground_found || !point_clear(map, start, m.drive_limit())) return false;
  const std::int32_t cell = m.cell_of(start);
  m.seeds[0] = {cell, 0};
  m.start = start;
  m.exact_start = true;
  return m.flood(1, map.cost[static_cast<std::size_t>(cell)], tick);
}

bool Planner::flood(const CostMap& map, std::span<const Source> starts,
                    const rt::Tick& tick) noexcept {
  Impl& m = *impl_;
  m.map = &map;
  m.driveable_ok = m.comfort_ok = false;
  if (!map.ground_found || starts.empty()) return false;
  const std::size_t n = std::min(starts.size(), m.seeds.size());
  for (std::size_t i = 0; i < n; ++i) {
    m.seeds[i] = {static_cast<std::int32_t>(map.index(starts[i].ix, starts[i].iy)),
                  static_cast<std::int32_t>(starts[i].reach_m / map.resolution * Flood::kStraight)};
  }
  m.exact_start = false;
  return m.flood(static_cast<int>(n), 0, tick);
}

std::uint8_t Planner::drive_limit() const noexcept { return impl_->drive_limit(); }

bool Planner::reachable(int ix, int iy) const noexcept {
  const Impl& m = *impl_;
  return m.driveable_ok && m.map->contains(ix, iy) &&
         m.driveable.reached(static_cast<std::int32_t>(m.map->index(ix, iy)));
}

std::span<const Point2> Planner::vertices() const noexcept {
  return {impl_->vertices.data(), static_cast<std::size_t>(impl_->size)};
}
bool Planner::from_grid() const noexcept { return impl_->from_grid; }
std::uint32_t Planner::iterations() const noexcept {
  return static_cast<std::uint32_t>(impl_->used);
}

// The flood's way from the goal back to a seed; returns the seed's cell.
std::int32_t Planner::Impl::trace_chain(std::int32_t goal_cell) {
  chain_size = 0;
  std::int32_t c = goal_cell;
  for (;;) {
    chain[static_cast<std::size_t>(chain_size++)] = c;
    const std::int32_t p = way->parent(c);
    if (p == c) return c;
    c = p;
  }
}

PlanStatus Planner::Impl::search(Point2 goal) {
  const ob::PlannerTerminationCondition done([this] {
    // Evaluated in the caller's thread, once an iteration.
    return used++ >= budget || tick->cancelled();
  });
  set_point(start_state, start);
  set_point(goal_state, goal);
  rrt->clear();
  problem->clearSolutionPaths();
  problem->clearStartStates();
  problem->setStartAndGoalStates(start_state, goal_state, 1e-9);
  rrt->setProblemDefinition(problem);
  const ob::PlannerStatus status = rrt->solve(done);
  if (status != ob::PlannerStatus::EXACT_SOLUTION) {
    return tick->cancelled() ? PlanStatus::kCancelled : PlanStatus::kBudgetSpent;
  }
  const auto path = std::static_pointer_cast<og::PathGeometric>(problem->getSolutionPath());
  if (path->getStateCount() > static_cast<std::size_t>(kMaxVertices)) {
    return PlanStatus::kBudgetSpent;
  }
  size = 0;
  for (const ob::State* s : path->getStates()) {
    vertices[static_cast<std::size_t>(size++)] = point_of(s);
  }
  rrt->clear();
  problem->clearSolutionPaths();
  return PlanStatus::kFound;
}

// The chain with its straight runs pulled tight: from each cell to the farthest one in sight within
// the longest edge.
bool Planner::Impl::follow_chain(Point2 goal) {
  size = 0;
  const auto on_chain = [&](std::int32_t i) {
    if (i == 0) return goal;  // the chain runs from the goal's cell to the start's
    return i == chain_size - 1 ? start : centre(chain[static_cast<std::size_t>(i)]);
  };
  std::int32_t i = chain_size - 1;
  vertices[static_cast<std::size_t>(size++)] = on_chain(i);
  while (i > 0) {
    const Point2 here = on_chain(i);
    std::int32_t next = i - 1;
    while (next > 0 && distance(here, on_chain(next - 1)) <= config.range_m &&
           edge_clear(*map, here, on_chain(next - 1), way->limit())) {
      --next;
    }
    if (size == kMaxVertices || tick->cancelled()) return false;
    vertices[static_cast<std::size_t>(size++)] = on_chain(next);
    i = next;
  }
  return true;
}

// From each vertex straight to the farthest one in sight.
void Planner::Impl::prune() {
  int out = 0, i = 0;
  scratch[static_cast<std::size_t>(out++)] = vertices[0];
  while (i < size - 1) {
    int j = size - 1;
    while (j > i + 1 && !edge_clear(*map, vertices[static_cast<std::size_t>(i)],
                                    vertices[static_cast<std::size_t>(j)], way->limit())) {
      --j;
      if (tick->cancelled()) return;
    }
    scratch[static_cast<std::size_t>(out++)] = vertices[static_cast<std::size_t>(j)];
    i = j;
  }
  vertices = scratch;
  size = out;
}

// Two random points of the path, joined straight where that is free: cuts corners that no vertex
// sees past.
void Planner::Impl::shortcut() {
  for (int n = 0; n < config.shortcuts && size > 2 && !tick->cancelled(); ++n) {
    along[0] = 0;
    for (int i = 1; i < size; ++i) {
      const auto k = static_cast<std::size_t>(i);
      along[k] = along[k - 1] + distance(vertices[k - 1], vertices[k]);
    }
    const double total = along[static_cast<std::size_t>(size - 1)];
    double sa = random.uniform(0, total), sb = random.uniform(0, total);
    if (sa > sb) std::swap(sa, sb);
    const auto on_path = [&](double s, int& segment) {
      segment = 0;
      while (segment < size - 2 && along[static_cast<std::size_t>(segment + 1)] < s) ++segment;
      const auto k = static_cast<std::size_t>(segment);
      const double length = along[k + 1] - along[k];
      const double t = length > 0 ? std::clamp((s - along[k]) / length, 0.0, 1.0) : 0.0;
      return Point2{vertices[k].x + t * (vertices[k + 1].x - vertices[k].x),
                    vertices[k].y + t * (vertices[k + 1].y - vertices[k].y)};
    };
    int i = 0, j = 0;
    const Point2 a = on_path(sa, i), b = on_path(sb, j);
    if (i == j || distance(a, b) > (sb - sa) * 0.999) continue;
    const int grown = (i + 1) + 2 + (size - 1 - j);
    if (grown > kMaxVertices) continue;
    // The pieces a and b leave behind lie on edges that were clear, but rounding may move them a
    // hair.
    if (!edge_clear(*map, a, b, way->limit()) ||
        !edge_clear(*map, vertices[static_cast<std::size_t>(i)], a, way->limit()) ||
        !edge_clear(*map, b, vertices[static_cast<std::size_t>(j + 1)], way->limit())) {
      continue;
    }
    int out = 0;
    for (int k = 0; k <= i; ++k) {
      scratch[static_cast<std::size_t>(out++)] = vertices[static_cast<std::size_t>(k)];
    }
    scratch[static_cast<std::size_t>(out++)] = a;
    scratch[static_cast<std::size_t>(out++)] = b;
    for (int k = j + 1; k < size; ++k) {
      scratch[static_cast<std::size_t>(out++)] = vertices[static_cast<std::size_t>(k)];
    }
    vertices = scratch;
    size = out;
  }
}

PlanStatus Planner::plan(Point2 goal, std::uint64_t seed, std::uint64_t job,
                         const rt::Tick& tick) noexcept {
  Impl& m = *impl_;
  m.size = 0;
  m.used = 0;
  m.from_grid = false;
  if (m.map == nullptr || !m.map->ground_found) return PlanStatus::kNoMap;
  if (tick.cancelled()) return PlanStatus::kCancelled;
  if (!m.driveable_ok) return PlanStatus::kStartBlocked;
  if (!point_clear(*m.map, goal, m.drive_limit())) return PlanStatus::kGoalBlocked;
  const std::int32_t cell = m.cell_of(goal);
  if (!m.driveable.reached(cell)) return PlanStatus::kUnreachable;
  const bool comfortable = m.comfort_ok && m.comfort.reached(cell) &&
                           point_clear(*m.map, goal, m.comfort.limit()) &&
                           (!m.exact_start || point_clear(*m.map, m.start, m.comfort.limit()));
  m.way = comfortable ? &m.comfort : &m.driveable;
  const std::int32_t root = m.trace_chain(cell);
  if (!m.exact_start) m.start = m.centre(root);
  m.random = rt::Random(seed, job);
  m.budget = static_cast<std::uint64_t>(std::max(1, m.config.iterations >> (2 * tick.level)));
  m.tick = &tick;
  PlanStatus status = PlanStatus::kLibraryFault;
  if (edge_clear(*m.map, m.start, goal, m.way->limit())) {
    // In sight: nothing to search.
    m.vertices[0] = m.start;
    m.vertices[1] = goal;
    m.size = 2;
    return PlanStatus::kFound;
  }
  try {
    status = m.search(goal);
  } catch (...) {
    m.size = 0;
    return PlanStatus::kLibraryFault;
  }
  if (status == PlanStatus::kBudgetSpent && m.config.grid_fallback && m.follow_chain(goal)) {
    status = PlanStatus::kFound;
    m.from_grid = true;
  }
  if (status != PlanStatus::kFound) {
    m.size = 0;
    return tick.cancelled() ? PlanStatus::kCancelled : status;
  }
  m.prune();
  m.shortcut();
  m.prune();
  if (tick.cancelled()) {
    m.size = 0;
    return PlanStatus::kCancelled;
  }
  return PlanStatus::kFound;
}

}  // namespace tasks
