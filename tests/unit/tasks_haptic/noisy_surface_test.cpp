// A hand that presses a floor with noise and stands there: noise is not a surface that leaves, and
// a noisy surface that leaves still does.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "rt/quantile.hpp"
#include "tests/support/whole.hpp"
#include "tests/unit/tasks_haptic/noisy_floor.hpp"
#include "tools/measure/support/field_optimum.hpp"

namespace {

using rig::noisy_floor_scene;
using rig::press;
using rig::Rig;
using rig::Row;
using rig::Vec3;
using Kind = tasks::TouchEvent::Kind;

constexpr double kDepth_m = 0.01, kStiffness_N_per_m = 1000, kForceLimit_N = 12;
constexpr int kHeld_ticks = 2000, kStride = 20;

// The force that the samples of this tick allow: the path-constrained minimum, by search
// (field_optimum.hpp), on the two windows and their blend.
class Reference {
 public:
  Vec3 force(const Rig& r, const Row& row) {
    const double voxel = r.setup().voxel;
    const Vec3 h = r.setup().X_WS * row.h;
    const Eigen::Array3i first = (h / voxel).array().floor().cast<int>() - 3;
    const support::ReferenceField field(
        [&](int x, int y, int z) {
          return r.pops().node_value({x, y, z}, row.telemetry.blend);
        },
        voxel, first, {8, 8, 8});
    if (field(h) > 0) {
      p_ = h;
    } else {
      if (!((p_ - h).norm() > 1e-4)) p_ = h + Vec3(0, 0, 1e-3);
      p_ = support::FieldOptimum(field, 0, voxel).descend(p_, h);
    }
    const Vec3 f = kStiffness_N_per_m * (p_ - h);
    return f * std::min(1.0, kForceLimit_N / std::max(f.norm(), 1e-9));
  }

 private:
  Vec3 p_ = Vec3::Zero();
};

struct Held {
  int lost_ms = 0;  // the longest time without contact
  int left = 0;     // events that say that the surface left
  std::vector<double> error_N;
};

Held hold(double sigma_m, std::uint64_t seed) {
  Rig r(noisy_floor_scene(sigma_m, seed));
  press(r, kDepth_m);
  Reference reference;
  Held out;
  for (int i = 0, lost = 0; i < kHeld_ticks; ++i) {
    const Row row = r.tick(Vec3(0, 0, -kDepth_m));
    lost = row.telemetry.in_contact ? 0 : lost + 1;
    out.lost_ms = std::max(out.lost_ms, lost);
    for (int e = 0; e < r.out().event_count; ++e) {
      const auto kind = r.out().events[static_cast<std::size_t>(e)].kind;
      out.left += kind == Kind::kSurfaceLeft ? 1 : 0;
    }
    if (i % kStride == 0) out.error_N.push_back((row.f - reference.force(r, row)).norm());
  }
  return out;
}

// Constants were chosen on the even seeds; the odd ones judge.
TEST(NoisySurface, AFloorThatIsDrawnAnewDoesNotLetTheHandGo) {
  const std::uint64_t seeds = tests::whole() ? 200 : 10;
  for (const double sigma_mm : {1.0, 2.0, 3.0}) {
    for (const std::uint64_t half : {0U, 1U}) {
      std::vector<double> errors;
      int lost_ms = 0, lost_runs = 0, left = 0;
      for (std::uint64_t seed = half; seed < seeds; seed += 2) {
        const Held held = hold(1e-3 * sigma_mm, seed);
        errors.insert(errors.end(), held.error_N.begin(), held.error_N.end());
        lost_ms = std::max(lost_ms, held.lost_ms);
        lost_runs += held.lost_ms > 50 ? 1 : 0;
        left += held.left;
        if (held.lost_ms > 50)
          std::printf("  seed %d: contact lost for %d ms\n", static_cast<int>(seed), held.lost_ms);
      }
      std::printf(
          "%.0f mm, %s seeds: longest without contact %d ms, above 50 ms in %d of %d runs, told "
          "to leave %d times; force error p50 %.3f, p95 %.3f N, most %.2f N\n",
          sigma_mm, half == 0 ? "even" : "odd", lost_ms, lost_runs, static_cast<int>(seeds / 2),
          left, rt::quantile(errors, 0.5), rt::quantile(errors, 0.95), rt::quantile(errors, 1));
      EXPECT_LE(lost_ms, 50);
      EXPECT_EQ(left, 0);
      EXPECT_LE(rt::quantile(errors, 0.95), 0.3);
    }
  }
}

}  // namespace
