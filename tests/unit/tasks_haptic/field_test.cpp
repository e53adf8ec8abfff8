// The blended field against a slow reference, and its borders.
#include "tasks/haptic/field.hpp"

#include <gtest/gtest.h>

#include <memory>

#include "rt/random.hpp"
#include "tasks/haptic/nearest_on_planes.hpp"

namespace {

using perception::SurfacePatch;
using perception::Vec3;
using tasks::Field;
using tasks::FieldSample;

struct NodeValue {
  bool known = false;
  double v = 0;
};

std::unique_ptr<SurfacePatch> random_patch(rt::Random& random, double unknown_share) {
  auto p = std::make_unique<SurfacePatch>();
  p->seq = 1;
  p->voxel_size = 0.01;
  p->metres_per_unit = static_cast<float>(0.05 / 32767);
  p->nodes = static_cast<int>(4 * random.integer(2, 5));
  for (auto& o : p->origin_node) o = static_cast<std::int32_t>(random.integer(-6, 2));
  for (std::size_t i = 0; i < p->cells(); ++i) {
    p->material[i] = random.uniform() < unknown_share ? 0 : 1;
    p->distance[i] = static_cast<std::int16_t>(random.integer(-32767, 32767));
  }
  return p;
}

NodeValue node(const SurfacePatch& p, int x, int y, int z) {
  const int i = x - p.origin_node[0], j = y - p.origin_node[1], k = z - p.origin_node[2];
  if (i < 0 || j < 0 || k < 0 || i >= p.nodes || j >= p.nodes || k >= p.nodes) return {};
  const std::size_t at = p.index(i, j, k);
  if (p.material[at] == 0) return {};
  return {true, static_cast<double>(p.distance[at]) * static_cast<double>(p.metres_per_unit)};
}

TEST(Field, EqualsASlowReferenceOnRandomPairs) {
  constexpr std::uint64_t kSeed = 31;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  int known = 0, unknown = 0;
  for (int round = 0; round < 60; ++round) {
    const auto a = random_patch(random, 0.02), b = random_patch(random, 0.02);
    const double s = random.uniform();
    Field field;
    field.set(round % 3 == 0 ? nullptr : a.get(), b.get(), s);
    for (int i = 0; i < 300; ++i) {
      const Vec3 p(random.uniform(-0.08, 0.2), random.uniform(-0.08, 0.2),
                   random.uniform(-0.08, 0.2));
      bool all = true;
      const auto reference = [&](const Vec3& at, const Vec3& cell) {
        double sum = 0;
        for (int c = 0; c < 8; ++c) {
          const int x = static_cast<int>(cell.x()) + (c >> 2),
                    y = static_cast<int>(cell.y()) + ((c >> 1) & 1),
                    z = static_cast<int>(cell.z()) + (c & 1);
          const NodeValue n = node(*b, x, y, z),
                          o = round % 3 == 0 ? NodeValue{} : node(*a, x, y, z);
          if (!n.known && !o.known) {
            all = false;
            continue;
          }
          const double v = n.known && o.known ? (1 - s) * o.v + s * n.v : n.known ? n.v : o.v;
          const Vec3 w = at / 0.01 - Vec3(x, y, z);
          sum += v * (1 - std::abs(w.x())) * (1 - std::abs(w.y())) * (1 - std::abs(w.z()));
        }
        return sum;
      };
      const Vec3 cell = (p / 0.01).array().floor();
      const double v = reference(p, cell);
      const FieldSample f = field.sample(p);
      ASSERT_EQ(f.known, all);
      (all ? known : unknown)++;
      if (!all) continue;
      ASSERT_NEAR(f.value, v, 1e-12);
      for (int axis = 0; axis < 3; ++axis) {  // linear along an axis: exact within the cell
        Vec3 lo = p, hi = p;
        lo[axis] = 0.01 * cell[axis];
        hi[axis] = 0.01 * (cell[axis] + 1) - 1e-12;
        const double slope = (reference(hi, cell) - reference(lo, cell)) / (hi[axis] - lo[axis]);
        ASSERT_NEAR(f.gradient[axis], slope, 1e-6);
      }
    }
  }
  EXPECT_GT(known, 500);
  EXPECT_GT(unknown, 500);
}

TEST(Field, NotANumberAndFarAwayAreUnknown) {
  rt::Random random(1);
  const auto a = random_patch(random, 0);
  Field field;
  EXPECT_FALSE(field.sample(Vec3::Zero()).known);
  EXPECT_TRUE(field.near_edge(Vec3::Zero()));
  field.set(nullptr, a.get(), 1);
  const double nan = std::nan(""), inf = HUGE_VAL;
  for (const double bad : {nan, inf, -inf, 1e300, 1e12, -1e12}) {
    for (int axis = 0; axis < 3; ++axis) {
      Vec3 p = Vec3::Zero();
      p[axis] = bad;
      EXPECT_FALSE(field.sample(p).known);
      EXPECT_TRUE(field.near_edge(p));
    }
  }
}

TEST(Field, SeenFreeWithoutADistanceIsPositiveAndNearItsNeighbours) {
  auto p = std::make_unique<SurfacePatch>();
  p->seq = 1;
  p->voxel_size = 0.01;
  p->metres_per_unit = static_cast<float>(0.05 / 32767);
  p->nodes = 16;
  const auto units = [](double m) {
    return static_cast<std::int16_t>(std::lround(m / 0.05 * 32767));
  };
  for (int x = 0; x < 16; ++x) {
    for (int y = 0; y < 16; ++y) {
      for (int z = 0; z < 16; ++z) {
        const std::size_t i = p->index(x, y, z);
        const double d = 0.01 * z - 0.055;
        p->set_free(i, d > 0);
        // One node next to the surface and everything above the truncation has no distance.
        if (d > 0.05 || (x == 8 && y == 8 && z == 6)) continue;
        p->material[i] = 1;
        p->distance[i] = units(d);
      }
    }
  }
  Field field;
  field.set(nullptr, p.get(), 1);
  EXPECT_NEAR(field.sample({0.08, 0.08, 0.06}).value, 0.005, 1e-5);  // as if it had been measured
  EXPECT_NEAR(field.sample({0.03, 0.03, 0.15 - 1e-9}).value, 0.05, 1e-5);
  // A free node inside what is otherwise solid stays free.
  const std::size_t deep = p->index(4, 4, 2);
  p->material[deep] = 0;
  p->set_free(deep, true);
  field.set(nullptr, p.get(), 1);
  EXPECT_NEAR(field.sample({0.04, 0.04, 0.02}).value, 0.005, 1e-9);
}

// The programme of up to three planes against a dense search over the active sets by projection.
TEST(NearestOnPlanes, SatisfiesTheOptimalityConditionsOnRandomPlanes) {
  constexpr std::uint64_t kSeed = 8;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  std::array<int, 4> active{};
  int unsolved = 0;
  for (int i = 0; i < 20000; ++i) {
    std::array<tasks::HalfSpace, 3> planes;
    const auto n = static_cast<std::size_t>(random.integer(1, 3));
    for (std::size_t k = 0; k < n; ++k) {
      planes[k].n = Vec3(random.normal(), random.normal(), random.normal() + 1).normalized();
      planes[k].d = 0.003 * random.normal();  // feasible point: far along +z, almost always
    }
    const Vec3 h = 0.01 * Vec3(random.normal(), random.normal(), random.normal());
    const auto r = nearest_on_planes(planes, n, h);
    if (!r.solved) {
      ++unsolved;
      continue;
    }
    int count = 0;
    for (std::size_t k = 0; k < n; ++k) {
      EXPECT_GE(planes[k].distance(r.x), -1e-8);
      count += (r.active >> k) & 1U;
    }
    ++active[static_cast<std::size_t>(count)];
    // No feasible point nearby is nearer to h.
    for (int t = 0; t < 30; ++t) {
      Vec3 y = r.x + 1e-4 * Vec3(random.normal(), random.normal(), random.normal());
      bool feasible = true;
      for (std::size_t k = 0; k < n; ++k) feasible = feasible && planes[k].distance(y) >= 0;
      if (feasible) {
        EXPECT_GE((y - h).norm(), (r.x - h).norm() - 1e-8);
      }
    }
  }
  std::printf("active sets of size 0..3: %d %d %d %d, unsolved %d\n", active[0], active[1],
              active[2], active[3], unsolved);
  for (const int a : active) EXPECT_GT(a, 100);
  EXPECT_LT(unsolved, 400);
}

}  // namespace
