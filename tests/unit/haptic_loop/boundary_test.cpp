// The closed loop of twin and task against b / (T/2 + t_d), and its passivity. `teletact bench
// boundary` sweeps more.
#include "tools/measure/haptic/boundary.hpp"

#include <gtest/gtest.h>

namespace {

using teletact::LoopSetting;

TEST(Boundary, IsWhereTheFormulaSays) {
  for (const double b : {0.5, 2.0}) {
    for (const double ticks : {0.0, 1.0}) {
      LoopSetting s;
      s.damping = b;
      s.delay_s = 1e-3 * ticks;
      const auto row = teletact::find_boundary(s);
      std::printf("1 kHz, b %.1f, t_d %.0f ticks: K %.0f N/m, bound %.0f, ratio %.3f\n", b, ticks,
                  row.stiffness_max, s.bound(), row.ratio());
      EXPECT_GT(row.ratio(), 0.8);
      EXPECT_LT(row.ratio(), 1.2);
    }
  }
}

// At 2 and 4 kHz only the two sides: the whole bisection takes its 30 s many times.
TEST(Boundary, HigherRatesAllowMore) {
  for (const double rate : {2000.0, 4000.0}) {
    LoopSetting s;
    s.rate_hz = rate;
    s.damping = 1;
    EXPECT_LT(teletact::residual_speed(s, 0.8 * s.bound(), 30), 0.003) << rate;
    EXPECT_GE(teletact::residual_speed(s, 1.2 * s.bound(), 30), 0.003) << rate;
  }
}

TEST(Boundary, TheControllerKeepsTheLoopPassive) {
  for (const double rate : {1000.0, 4000.0}) {
    for (const double ticks : {0.0, 2.0}) {
      LoopSetting s;
      s.rate_hz = rate;
      s.damping = 1;
      s.delay_s = ticks / rate;
      for (const double share : {0.5, 1.25, 2.0}) {
        const auto row = teletact::measure_passivity(s, share * s.bound(), 2);
        std::printf(
            "%.0f Hz, t_d %.0f ticks, K %.2f of the bound: E + booked %.3f mJ, without %.3f "
            "mJ, controller %.2f N\n",
            rate, ticks, share, 1e3 * row.energy_min_J, 1e3 * row.energy_min_off_J,
            row.controller_max_N);
        EXPECT_GE(row.energy_min_J, -1e-3);
        EXPECT_GE(row.energy_min_J, row.energy_min_off_J - 1e-6);
      }
    }
  }
}

TEST(Boundary, LoopsOverBumpsCostNothing) {
  for (const double stiffness : {300.0, 1000.0}) {
    const auto row = teletact::measure_texture(stiffness);
    std::printf("%.1f N/mm: ten loops %.3f mJ, with a perturbed normal %.3f mJ\n", 1e-3 * stiffness,
                1e3 * row.height_J, 1e3 * row.normal_J);
    EXPECT_LE(row.height_J, 0.2e-3);
    EXPECT_GT(row.normal_J, 1e-3);
  }
}

TEST(Boundary, MaterialsAreFollowedSoftly) {
  for (const double rate : {1000.0, 4000.0}) {
    const auto row = teletact::measure_materials(rate);
    std::printf(
        "%.0f Hz: border %.3f N, flicker %.3f N beyond the hand's motion; E + booked %.3f mJ\n",
        rate, row.border_N, row.flicker_N, 1e3 * row.energy_min_J);
    EXPECT_LE(row.border_N, 0.15);
    EXPECT_LE(row.flicker_N, 0.15);
    EXPECT_GT(row.flicker_N, 0.001) << "the label never changed";
    std::printf("         flips of friction %.3f N, of the bumps' height %.3f N, period %.3f N\n",
                row.friction_N, row.amplitude_N, row.period_N);
    EXPECT_LE(row.friction_N, 0.15);
    EXPECT_LE(row.amplitude_N, 0.15);
    EXPECT_LE(row.period_N, 0.15);
    for (const double change : {row.friction_N, row.amplitude_N, row.period_N}) {
      EXPECT_GT(change, 0.001) << "the label never changed";
    }
    EXPECT_GE(row.energy_min_J, -1e-3);
  }
}

}  // namespace
