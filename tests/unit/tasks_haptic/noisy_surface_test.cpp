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
constexpr int kHeld_ticks = 2000, kStride = 10;

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
  int lost_ms = 0;                            // the longest time without contact
  int left = 0;                               // events that say that the surface left
  std::vector<double> error_N, size_error_N;  // of the force to the optimum's, and of its size
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
    if (i % kStride != 0) continue;
    const Vec3 optimum = reference.force(r, row);
    out.error_N.push_back((row.f - optimum).norm());
    out.size_error_N.push_back(std::abs(row.f.norm() - optimum.norm()));
  }
  return out;
}

struct Tally {
  std::vector<double> error_N, size_error_N;
  int lost_ms = 0, lost_runs = 0, left = 0, runs = 0;
  void take(const Held& held) {
    error_N.insert(error_N.end(), held.error_N.begin(), held.error_N.end());
    size_error_N.insert(size_error_N.end(), held.size_error_N.begin(), held.size_error_N.end());
    lost_ms = std::max(lost_ms, held.lost_ms);
    lost_runs += held.lost_ms > 50 ? 1 : 0;
    left += held.left;
    ++runs;
  }
  void print(const char* what) const {
    std::printf(
        "%s: longest without contact %d ms, above 50 ms in %d of %d runs, told to leave %d times; "
        "off the optimum p50 %.3f, p95 %.3f, most %.2f N, in size p95 %.3f, most %.2f N\n",
        what, lost_ms, lost_runs, runs, left, rt::quantile(error_N, 0.5),
        rt::quantile(error_N, 0.95), rt::quantile(error_N, 1), rt::quantile(size_error_N, 0.95),
        rt::quantile(size_error_N, 1));
  }
};

// Constants were chosen on the even seeds; the odd ones judge. The size of the force is held at
// each noise; its direction where small bends are gone over (haptic.shade) over all.
TEST(NoisySurface, AFloorThatIsDrawnAnewDoesNotLetTheHandGo) {
  const std::uint64_t seeds = tests::whole() ? 200 : 10;
  for (const std::uint64_t half : {0U, 1U}) {
    Tally all;
    for (const double sigma_mm : {1.0, 2.0, 3.0}) {
      Tally tally;
      for (std::uint64_t seed = half; seed < seeds; seed += 2) {
        const Held held = hold(1e-3 * sigma_mm, seed);
        tally.take(held);
        all.take(held);
        EXPECT_LE(held.lost_ms, 50) << sigma_mm << " mm, seed " << seed;
      }
      tally.print((std::to_string(sigma_mm) + " mm").c_str());
      EXPECT_EQ(tally.left, 0);
      EXPECT_LE(rt::quantile(tally.size_error_N, 0.95), 0.3);
    }
    all.print(half == 0 ? "even seeds, all" : "odd seeds, all");
    EXPECT_LE(rt::quantile(all.error_N, 0.95), 0.3);
  }
}

// Beside the noise the floor starts to go or to come: the hand is let go, once.
TEST(NoisySurface, ANoisyFloorThatLeavesStillLetsTheHandGo) {
  constexpr double kAt_s = 0.8;
  for (const double sigma_mm : {1.0, 2.0, 3.0}) {
    for (const double mm_a_frame : {20.0, 50.0, -20.0, -50.0}) {
      int latest_ms = 0;
      for (std::uint64_t seed = 0; seed < (tests::whole() ? 40U : 4U); ++seed) {
        const auto sinks = [=](double t) {
          return 1e-3 * mm_a_frame * std::max(0.0, std::floor((t - kAt_s) * 30 + 1));
        };
        Rig r(noisy_floor_scene(1e-3 * sigma_mm, seed, sinks));
        press(r, kDepth_m);
        int left = 0, released_ms = -1;
        double end_N = -1;
        for (int i = 0; i < 1100; ++i) {
          const Row row = r.tick(Vec3(0, 0, -kDepth_m));
          for (int e = 0; e < r.out().event_count; ++e) {
            const auto kind = r.out().events[static_cast<std::size_t>(e)].kind;
            left += kind == Kind::kSurfaceLeft ? 1 : 0;
          }
          end_N = row.f.norm();
          if (row.t > kAt_s && released_ms < 0 && end_N < 1e-9)
            released_ms = static_cast<int>(std::lround(1e3 * (row.t - kAt_s)));
        }
        EXPECT_EQ(end_N, 0) << sigma_mm << " mm, " << mm_a_frame << " mm a frame, seed " << seed;
        EXPECT_GE(released_ms, 0);
        // Of a floor that goes the hand may be free before noise and motion are told apart.
        EXPECT_LE(left, 1) << sigma_mm << " mm, " << mm_a_frame << " mm a frame, seed " << seed;
        EXPECT_GE(left, mm_a_frame < 0 ? 1 : 0) << sigma_mm << " mm, seed " << seed;
        latest_ms = std::max(latest_ms, released_ms);
      }
      std::printf("%.0f mm of noise, %+.0f mm a frame: let go after %d ms at most\n", sigma_mm,
                  mm_a_frame, latest_ms);
      EXPECT_LE(latest_ms, sigma_mm < 3 ? 150 : 250);  // a way of up to four windows
    }
  }
}

}  // namespace
