// The descent over the cells: where it rests nothing is nearer, and it rests where the oracle does.
#include "tasks/haptic/cell_flow.hpp"
#include "rt/quantile.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "rt/random.hpp"
#include "tools/measure/support/field_optimum.hpp"

namespace {

using perception::SurfacePatch;
using perception::Vec3;
using tasks::Field;
using tasks::ProxyConfig;
using tasks::ProxyState;

constexpr double kVoxel = 0.01, kUnit = static_cast<double>(static_cast<float>(0.05 / 32767));

// A floor with noise of sigma on each node, tilted.
std::unique_ptr<SurfacePatch> rough_floor(rt::Random& random, double sigma, const Vec3& n) {
  auto p = std::make_unique<SurfacePatch>();
  p->seq = 1;
  p->voxel_size = kVoxel;
  p->metres_per_unit = static_cast<float>(0.05 / 32767);
  p->nodes = 24;
  p->origin_node = {-12, -12, -12};
  for (int x = 0; x < 24; ++x) {
    for (int y = 0; y < 24; ++y) {
      for (int z = 0; z < 24; ++z) {
        const double d = n.dot(kVoxel * Vec3(x - 12, y - 12, z - 12)) + sigma * random.normal();
        const std::size_t i = p->index(x, y, z);
        p->distance[i] = static_cast<std::int16_t>(std::lround(std::clamp(d, -0.05, 0.05) / kUnit));
        p->material[i] = 1;
        p->set_free(i, d > 0);
      }
    }
  }
  return p;
}

support::ReferenceField as_the_oracle_reads(const SurfacePatch& p) {
  return {[&](int x, int y, int z) {
            return kUnit * static_cast<double>(p.distance[p.index(x + 12, y + 12, z + 12)]);
          },
          kVoxel, Eigen::Array3i::Constant(-11), Eigen::Array3i::Constant(22)};
}

TEST(CellFlow, NothingNearbyIsNearerAndTheOracleRestsThereToo) {
  constexpr std::uint64_t kSeed = 41;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  for (int round = 0; round < 8; ++round) {
    const double sigma = 2.5e-4 * (round + 1);
    const Vec3 n = Vec3(random.normal(), random.normal(), 4).normalized();
    const auto patch = rough_floor(random, sigma, n);
    const support::ReferenceField reference = as_the_oracle_reads(*patch);
    const support::FieldOptimum optimum(reference, 0.0);
    Field field;
    field.set(nullptr, patch.get(), 1);
    const Vec3 a = n.unitOrthogonal(), from = -0.02 * a - 0.008 * n, to = 0.02 * a - 0.006 * n;
    ProxyState state;
    const ProxyConfig config;
    Vec3 h = from + 0.02 * n;
    tasks::step_constrained(field, h, state, config);
    Vec3 best = h;
    std::vector<double> apart;
    std::uint32_t work = 0;
    for (int i = 0; i <= 600; ++i) {
      const Vec3 last = h;
      h = i < 200 ? Vec3(from + (200 - i) * 1e-4 * n)
                  : Vec3(from + (i - 200) * 1e-4 * (to - from).normalized());
      tasks::step_constrained(field, h, state, config);
      work = std::max(work, field.take_work());
      best = optimum.follow(best, last, h);
      const Vec3 p = state.p_WP();
      ASSERT_GE(reference(p), -1e-8);
      apart.push_back((p - best).norm());
      if (i % 10 != 0 || (p - h).norm() < 1e-3) continue;
      for (int k = 0; k < 1000; ++k) {
        const Vec3 way =
            2e-5 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
        if ((p + way - h).norm() > (p - h).norm() - 3e-6) continue;
        EXPECT_LT(reference(p + way), 2e-6) << sigma << " " << i;
      }
    }
    const double p95 = rt::quantile(apart, 0.95);
    std::printf(
        "sigma %.2f mm: p95 %.3f mm, max %.3f mm off the oracle, at most %u samples a tick\n",
        1e3 * sigma, 1e3 * p95, 1e3 * rt::quantile(apart, 1), work);
    EXPECT_LT(p95, 0.5e-3) << sigma;
  }
}

}  // namespace
