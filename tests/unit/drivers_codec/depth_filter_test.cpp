// The filter in time against its rules, pixel by pixel and in plain integers, on every instruction
// set that this machine has: readings with noise, steps, drifts and holes, modes that change, any
// legal bound.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

#include "drivers/codec/depth_filter.hpp"
#include "drivers/codec/depth_lattice.hpp"
#include "perception/simd/isa.hpp"
#include "rt/random.hpp"

namespace {

using drivers::DepthMode;
using drivers::codec::DepthFilter;
using drivers::codec::FilterDemand;
using drivers::codec::StripeShape;

struct Pixel {
  int mean = 0;  // 256ths of a point
  int above = 0, below = 0, debt = 0, age = 0;
};
struct Verdict {
  int target = 0;
  bool due = false, restless = false;
};

int floor_div(int a, int b) { return a / b - (a % b != 0 && (a < 0) != (b < 0) ? 1 : 0); }

// depth_filter.hpp, line by line. `turn`: whose frame it is.
Verdict judged(Pixel& p, int x, int y, const FilterDemand& demand, int turn) {
  const bool quiet = demand.mode == DepthMode::kQuiet;
  if (p.age == 0 && y == 0) p.above = p.below = 8 * 256 * 2 / 5;
  if (x == 0) {
    p.age = 0;
    return {0, false, y != 0};
  }
  const int most = demand.quiet_bound[x / drivers::codec::kBoundCell];
  const int spread = std::min({p.above + p.below, 4 * p.above, 4 * p.below});
  const int gate = std::min(std::max(spread * 21 / 4 / 256, demand.least_gate), most);
  const int off = x - (p.mean >> 8);
  if (p.age == 0 || std::abs(off) > gate) {
    p.mean = x * 256, p.debt = 0, p.age = 1;
    return {x, true, true};
  }
  int bound = demand.bound;
  if (quiet) bound = std::min(p.age < 8 ? gate * 3 / 4 : gate + 8, most);
  p.above += floor_div(std::max(off, 0) * 256 - p.above, 16);
  p.below += floor_div(std::max(-off, 0) * 256 - p.below, 16);
  p.age = std::min(p.age + 1, 64);
  p.mean += static_cast<int>((std::int64_t{x * 256 - p.mean} * (65536 / p.age)) >> 16);
  const int level = (p.mean + 128) >> 8;

  bool holds = y != 0 && std::abs(x - y) <= bound;
  int goal = level;
  if (quiet) {
    const int frames = p.age == 64 ? 16 : 8;
    goal += floor_div(p.debt + x - level + frames / 2, frames);
    holds = holds && (turn % frames != 0 || 8 * std::abs(goal - y) < 5 * demand.step);
  }
  const int within = std::max(0, bound - demand.step / 2);
  return {std::max(1, std::clamp(holds ? y : goal, x - within, x + within)), !holds, false};
}

int turn_of(std::uint32_t seq, int bx, int by) {
  return static_cast<int>(seq) + 5 * bx + 3 * by + (bx >> 2) + 7 * (by >> 2);
}

// A scene of 16 x 16 cells that change now and then.
class Readings {
 public:
  Readings(const StripeShape& shape, rt::Random& random, int furthest)
      : shape_(shape), random_(random), furthest_(furthest) {
    for (auto& level : levels_) level = random.uniform(200, furthest);
  }
  std::vector<std::uint16_t> next() {
    for (auto& level : levels_) {
      if (random_.uniform() < 0.02) level = random_.uniform(200, furthest_);
      if (random_.uniform() < 0.2) level += random_.uniform(-30, 30);
      level = std::clamp(level, 200.0, static_cast<double>(furthest_));
    }
    std::vector<std::uint16_t> image(static_cast<std::size_t>(shape_.width * shape_.rows));
    for (std::size_t i = 0; i < image.size(); ++i) {
      const int u = static_cast<int>(i) % shape_.width, v = static_cast<int>(i) / shape_.width;
      const std::size_t cell = static_cast<std::size_t>(u / 16 + 7 * (v / 16)) % levels_.size();
      const double spread = cell % 3 == 0 ? 40 : 8, hole = cell % 5 == 0 ? 0.2 : 0.002;
      const double z = levels_[cell] + spread * random_.normal();
      if (random_.uniform() >= hole) {
        image[i] = static_cast<std::uint16_t>(std::clamp(z, 1.0, 1.0 * furthest_));
      }
    }
    return image;
  }

 private:
  StripeShape shape_;
  rt::Random& random_;
  int furthest_;
  std::vector<double> levels_ = std::vector<double>(60);
};

// Bounds as the stream makes them, or any.
std::vector<std::int32_t> bounds(rt::Random& random, int furthest, bool any) {
  std::vector<std::int32_t> table(
      static_cast<std::size_t>(furthest / drivers::codec::kBoundCell + 1));
  for (std::size_t i = 0; i < table.size(); ++i) {
    table[i] = any ? static_cast<int>(random.integer(1, drivers::codec::kMostBound))
                   : std::max(40, 104 - std::max(0, static_cast<int>(i) - 60));
  }
  return table;
}

struct Case {
  StripeShape shape;
  FilterDemand demand;
  std::vector<std::int32_t> bound;
  int furthest = 25000;
};

Case drawn(rt::Random& random) {
  Case c;
  c.shape.width = c.shape.used_width = 8 * static_cast<int>(random.integer(1, 13));
  c.shape.rows = c.shape.used_rows = 8 * static_cast<int>(random.integer(1, 4));
  c.furthest = random.uniform() < 0.5 ? 7000 : 25000;
  c.bound = bounds(random, c.furthest, random.uniform() < 0.5);
  const auto other =
      std::find_if(c.bound.begin(), c.bound.end(), [&](int b) { return b != c.bound[0]; });
  c.demand.near_points = static_cast<int>(other - c.bound.begin()) * drivers::codec::kBoundCell;
  c.demand.least_gate = random.uniform() < 0.5 ? 32 : 10;
  return c;
}

void demand_next(FilterDemand& demand, rt::Random& random) {
  const int step = drivers::kDepthStepEighths[static_cast<std::size_t>(
      random.integer(0, drivers::kDepthSteps - 1))];
  const double draw = random.uniform();
  if (draw < 0.03) demand.mode = DepthMode::kMoving;
  if (draw > 0.90) demand.mode = DepthMode::kFaithful;
  if (draw > 0.03 && draw < 0.5) demand.mode = DepthMode::kQuiet;
  demand.step = step;
  demand.bound = std::max(20, step / 2);
  ++demand.seq;
}

// 100 frames; false: a pixel is not what the rules say.
bool follows(Case c, rt::Random& random, const std::string& of) {
  const auto pixels = static_cast<std::size_t>(c.shape.width * c.shape.rows);
  c.demand.quiet_bound = c.bound.data();
  DepthFilter filter(c.shape);
  Readings readings(c.shape, random, c.furthest);
  std::vector<Pixel> memory(pixels);
  std::vector<std::uint16_t> points(pixels);
  for (int frame = 0; frame < 100; ++frame) {
    demand_next(c.demand, random);
    const auto reading = readings.next();
    const std::uint32_t restless = filter.plan(c.shape, c.demand, reading.data(), points.data());
    const bool still = c.demand.mode != DepthMode::kMoving;
    std::uint32_t expected = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      const int u = static_cast<int>(i) % c.shape.width, v = static_cast<int>(i) / c.shape.width;
      Verdict want{reading[i], true, false};
      if (still) {
        want =
            judged(memory[i], reading[i], points[i], c.demand, turn_of(c.demand.seq, u / 8, v / 8));
      } else {
        memory[i].age = 0;
      }
      expected += want.restless ? 1 : 0;
      const bool due = filter.due()[i] != 0;
      if (filter.target()[i] != want.target || (reading[i] != 0 && due != want.due)) {
        ADD_FAILURE() << of << ", frame " << frame << ", pixel " << u << ", " << v << " of "
                      << c.shape.width << " x " << c.shape.rows << ": reading " << reading[i]
                      << ", before " << points[i] << ", target " << filter.target()[i] << ", due "
                      << due << "; by the rules " << want.target << ", " << want.due;
        return false;
      }
      // What a coder does: to the nearest step where something is due.
      if (reading[i] == 0) {
        points[i] = 0;
      } else if (due || points[i] == 0) {
        const int near = static_cast<int>(random.integer(-(c.demand.step / 2), c.demand.step / 2));
        points[i] = static_cast<std::uint16_t>(std::max(1, want.target + near));
      }
      if (c.demand.mode == DepthMode::kQuiet) {
        memory[i].debt = std::clamp(memory[i].debt + reading[i] - points[i], -2047, 2047);
      }
    }
    EXPECT_EQ(restless, expected) << of << ", frame " << frame;
    filter.settle(c.shape, c.demand, reading.data(), points.data());
  }
  return true;
}

TEST(DepthFilter, EveryPixelFollowsTheRulesOnEveryInstructionSet) {
  for (const auto isa : perception::simd::available()) {
    ASSERT_TRUE(perception::simd::choose(isa));
    for (std::uint64_t seed = 1; seed <= 25; ++seed) {
      rt::Random random(seed);
      const Case c = drawn(random);
      const std::string of =
          std::string(perception::simd::name_of(isa)) + ", seed " + std::to_string(seed);
      if (!follows(c, random, of)) break;
    }
  }
  ASSERT_TRUE(perception::simd::choose("auto"));
}

// What the filter's 16 bits rest on.
TEST(DepthFilter, PointsOfBothLawsFitFifteenBits) {
  rt::Startup set_up;
  for (const auto law : {drivers::DepthNoiseLaw::kStrict, drivers::DepthNoiseLaw::kLenient}) {
    const drivers::codec::DepthLattice lattice(set_up.token(), law);
    EXPECT_LE(lattice.points(), 1 << 15);
    EXPECT_EQ(lattice.to_point(65535), lattice.points() - 1);
  }
}

}  // namespace
