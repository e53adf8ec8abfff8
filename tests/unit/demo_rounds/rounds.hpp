// The scene `rounds` with wheels that slip by another seed: four marks, and what odometry alone
// would have made of them.
#pragma once

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "tests/unit/demo_driving/drive.hpp"
#include "tools/host/run_truth.hpp"

namespace tests {

struct Round {
  int marks = 0, arrivals = 0;
  unsigned collisions = 0;
  double way_m = 0, worst_m = 0, uncorrected_m = 0;  // of the arrivals; at the last one
  double ate_mm = -1;
  double stated_m = 0, unsure_s = 0;      // largest stated error
  double error_m = 0, speed_m_per_s = 0;  // at the end: the desk's pose to the twin's; of the base
  double stated_at_end_m = 0;
};

// `dark_from_s`: no image arrives from then on.
inline Round go_round(std::uint64_t seed, double seconds, double dark_from_s = -1,
                      const std::vector<std::string>& more = {}) {
  std::vector<std::string> overrides{"robot.plant.wheel_slip_seed=" + std::to_string(seed),
                                     "camera.seed=" + std::to_string(seed)};
  overrides.insert(overrides.end(), more.begin(), more.end());
  const auto s = teletact::load_scene(teletact::find_config("scenes", "rounds"), overrides);
  DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  if (dark_from_s >= 0) {
    options.fault_plan = testing::TempDir() + "dark_" + std::to_string(seed) + ".toml";
    std::ofstream(options.fault_plan)
        << "name = \"dark\"\npurpose = \"no image from here on\"\n[[fault]]\nkind = \"drop\"\n"
        << "target = \"frame\"\nfirst = " << static_cast<int>(30 * dark_from_s) << "\n";
  }
  const VirtualRun r =
      teletact::run_virtual(startup().token(), *s, options, teletact::reference_calibration());
  if (!options.fault_plan.empty()) std::remove(options.fault_plan.c_str());
  Round out;
  out.marks = static_cast<int>(r.op.view.task.marks);
  out.arrivals = static_cast<int>(r.op.view.arrivals);
  const auto& truth = r.robot.view.truth;
  EXPECT_GT(truth.size(), 100U);
  out.collisions = truth.back().collisions;
  out.way_m = truth.back().path_m;
  for (const auto& a : r.op.view.arrived) {
    const auto X = teletact::true_base_at(r.robot, a.stamp);
    const auto X_OB = teletact::odometry_at(r.robot, a.stamp);
    EXPECT_TRUE(X && X_OB);
    if (!X || !X_OB) continue;
    const double off = std::hypot(X->x - a.goal_x_m, X->y - a.goal_y_m);
    out.worst_m = std::max(out.worst_m, off);
    out.uncorrected_m = std::hypot(X->x - X_OB->x, X->y - X_OB->y);
    std::printf(
        "    at %.1f s: (%.2f, %.2f), %.1f mm off, by odometry %.0f mm off, stated %.1f mm\n",
        1e-9 * static_cast<double>(rt::ns_of(a.stamp) - r.op.epoch_ns), X->x, X->y, 1e3 * off,
        1e3 * out.uncorrected_m, 1e3 * a.error_m);
  }
  out.ate_mm = teletact::rendered_figures(*s, r.op, r.robot).ate_first_pose_mm;
  out.stated_m = r.op.view.error_max_m;
  out.unsure_s = r.op.view.unsure_s;
  const auto& w = r.op.view.world;
  const auto X_WB =
      perception::compose({w.X_WO[0], w.X_WO[1], w.X_WO[2]},
                          {r.op.view.robot.x_m, r.op.view.robot.y_m, r.op.view.robot.yaw_rad});
  out.error_m = std::hypot(X_WB.x - truth.back().x_m, X_WB.y - truth.back().y_m);
  out.stated_at_end_m = w.error_m;
  const auto& before = truth[truth.size() - 26];  // half a second
  out.speed_m_per_s =
      (truth.back().path_m - before.path_m) / rt::seconds(truth.back().stamp - before.stamp);
  std::printf(
      "  seed %llu: %d marks, %d arrivals, %.2f m, %u collisions, worst %.1f mm, uncorrected %.0f "
      "mm, "
      "ATE %.1f mm, stated at most %.0f mm, unsure %.1f s, at the end off %.1f mm of %.0f, %.3f "
      "m/s\n",
      static_cast<unsigned long long>(seed), out.marks, out.arrivals, out.way_m, out.collisions,
      1e3 * out.worst_m, 1e3 * out.uncorrected_m, out.ate_mm, 1e3 * out.stated_m, out.unsure_s,
      1e3 * out.error_m, 1e3 * out.stated_at_end_m, out.speed_m_per_s);
  std::fflush(stdout);
  return out;
}

inline constexpr double kRounds_s = 65;

// What odometry alone is off by at the last arrival: at least so much, or there is nothing to
// correct. The slips are of random size to either side and cancel over some ways: over which
// depends on each turn of the way (docs/prediction.md).
inline constexpr double kUncorrected_m = 0.2;

inline void expect_all_reached(const Round& r, std::uint64_t seed) {
  EXPECT_EQ(r.marks, 4) << "seed " << seed;
  EXPECT_EQ(r.arrivals, 4) << "seed " << seed;
  EXPECT_GE(r.way_m, 10) << "seed " << seed;
  EXPECT_EQ(r.collisions, 0U) << "seed " << seed;
  EXPECT_LE(r.worst_m, 0.030) << "seed " << seed;
  EXPECT_GT(r.uncorrected_m, r.worst_m) << "the wheels slip, seed " << seed;
}

// Where it got to is known to what it says, and it moves no more.
inline void expect_stands(const Round& r, std::uint64_t seed) {
  EXPECT_LE(r.error_m, 0.15) << "seed " << seed;
  EXPECT_LE(r.error_m, r.stated_at_end_m) << "seed " << seed;
  EXPECT_LT(r.speed_m_per_s, 1e-3) << "stands, seed " << seed;
  EXPECT_EQ(r.collisions, 0U) << "seed " << seed;
}

}  // namespace tests
