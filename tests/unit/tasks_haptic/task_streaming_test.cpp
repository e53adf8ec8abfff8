// The task while the surface under the hand changes: blends, their length, the energy they give.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "tests/unit/tasks_haptic/floor.hpp"
#include "tools/measure/support/haptic_score.hpp"

namespace {

using rig::floor_scene;
using rig::Path;
using rig::press;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;

// 88 mJ in one step of the surface, 7.5 mm, just below what lets the hand go
// (surface_left_test.cpp): the blend is slowed from 50 mJ on and outlasts the liveness of its
// patch, which is no reason to let go.
TEST(HapticTask, ABlendSlowedByTheEnergyBudgetIsNotAStalePatch) {
  Scene s = floor_scene();
  s.solid = [](const Vec3& p, double t) { return solids::floor(p) - (t > 0.55 ? 0.0075 : 0.0); };
  Rig r(s);
  press(r);
  double event_J = 0, fastest = 0, last_blend = 0, before_J = 0;
  int slowed = 0;
  for (const Row& row : r.run([](double) { return Vec3(0, 0, -0.008); }, 0, 1.0)) {
    const double rate = row.telemetry.blend - last_blend;
    if (rate < 0) event_J = 0;
    event_J += row.telemetry.booked_J - before_J;
    fastest = std::max(fastest, rate);
    if (event_J > 0.05 && rate > 0) {
      EXPECT_LE(rate, 0.3 * fastest);
      ++slowed;
    }
    last_blend = row.telemetry.blend;
    before_J = row.telemetry.booked_J;
    EXPECT_FALSE(row.telemetry.stale) << row.t;
    EXPECT_GE(row.f.z(), 7.9) << row.t;
  }
  EXPECT_GT(slowed, 25);
}

// 72 mJ to fade in: slower from 50 mJ on, and one event however many windows come meanwhile.
TEST(HapticTask, AFadeInOverTheEnergyBudgetIsSlowed) {
  Scene s = floor_scene();
  Rig r(s);
  double last_gain = 0;
  int slow = 0;
  for (const Row& row : r.run([](double) { return Vec3(0, 0, -0.012); }, 0, 0.3)) {
    const double rate = row.telemetry.gain - last_gain;
    if (row.telemetry.booked_J > 0.05 && rate > 0) {
      EXPECT_LE(rate, 0.3 / 50) << row.t;
      ++slow;
    }
    last_gain = row.telemetry.gain;
  }
  EXPECT_EQ(last_gain, 1);
  EXPECT_GT(slow, 30);
}

TEST(HapticTask, TakesAPatchOnlyBetweenBlends) {
  Rig r(floor_scene());
  int wanted = 0;
  for (int i = 0; i < 1000; ++i) {
    if (r.task().wants_patch()) ++wanted;
    const Row row = r.tick({0, 0, 0.01});
    EXPECT_EQ(row.telemetry.blend < 1.0, !r.task().wants_patch());
  }
  EXPECT_GE(wanted, 20);
  EXPECT_LE(wanted, 120);  // most ticks are inside a blend
}

// Ticks of the longest blend until it is whole, over a floor that is `height` above its place.
int longest_blend(const std::function<double(double t)>& height, double depth) {
  Scene s = floor_scene();
  s.solid = [&](const Vec3& p, double t) { return solids::floor(p) - height(t); };
  Rig r(s);
  press(r, depth);
  int longest = 0, now = 0;
  double last = 1;
  for (const Row& row : r.run([&](double) { return Vec3(0, 0, -depth); }, 0, 0.6)) {
    const double blend = row.telemetry.blend;
    now = blend < last ? 1 : blend < 1 ? now + 1 : now;
    longest = std::max(longest, now);
    last = blend;
  }
  return longest;
}

// One period for what moves, sinks, or rises a little; 1.46 for a step that presses the hand, so
// that one that yields is given less energy.
TEST(HapticTask, AStepUnderAHandIsBlendedLonger) {
  const auto step = [](double by) { return [by](double t) { return t > 0.5 ? by : 0.0; }; };
  EXPECT_EQ(longest_blend(step(0.005), 0.002), 48);
  EXPECT_EQ(longest_blend(step(0.005), 0.004), 48);
  EXPECT_EQ(longest_blend(step(0.004), 0.002), 32);
  EXPECT_LT(longest_blend(step(0.005), 0.008), 48) << "52 mJ: the budget's";
  EXPECT_EQ(longest_blend(step(-0.005), 0.006), 32);
  EXPECT_EQ(longest_blend(step(0.005), -0.002), 32) << "nobody is pressed";
  for (const double v : {0.05, 0.1, 0.12}) {
    EXPECT_EQ(longest_blend([v](double t) { return v * std::clamp(t - 0.5, 0.0, 0.07); }, 0.002),
              32)
        << v;
  }
  // Steps that go on are a motion.
  EXPECT_EQ(
      longest_blend(
          [](double t) { return 0.001 * std::min(6.0, std::ceil(std::max(0.0, t - 0.5) * 30)); },
          0.002),
      32);
}

// The floor is there in one window and gone in the next, thirty times a second, under a hand that
// holds and then slides.
TEST(HapticTask, AFlickeringSurfaceStaysWithinItsLimits) {
  for (const bool pc : {false, true}) {
    Scene s = floor_scene();
    s.solid = [](const Vec3& p, double t) {
      const auto frame = static_cast<int>(std::floor(t * 30 + 1e-6));
      return solids::floor(p) +
             (frame > 12 && frame % 2 == 1 ? 0.1 : 0);  // 0.1: nothing but free space
    };
    s.config.passivity_controller = pc;
    Rig r(s);
    press(r);
    const Path slide({{0, 0, -0.008}, {0.05, 0, -0.008}}, 0.1);
    double j = 0, j_raw = 0, sliding_j = 0, least = 1, most = 0;
    Vec3 f = Vec3::Zero();
    for (int k = 0; k < 2000; ++k) {
      const double t = 1e-3 * k;
      const Row row = r.tick(k < 1500 ? Vec3(0, 0, -0.008) : slide(t - 1.5));
      if (k > 0)
        (k < 1500 ? j : sliding_j) = std::max(k < 1500 ? j : sliding_j, (row.f - f).norm());
      f = row.f;
      j_raw = std::max(j_raw, row.telemetry.step_raw_N);
      ASSERT_TRUE(row.f.allFinite());
      EXPECT_GE(row.f.z(), -1e-6) << "pulled into the floor at " << t;
      EXPECT_LE(row.f.norm(), 8.02);
      EXPECT_GE(row.p.z(), row.h.z() - 1e-9);
      EXPECT_GE(row.telemetry.energy_J + row.telemetry.booked_J, -1e-3) << t;
      if (k > 500 && k < 1500) {
        least = std::min(least, row.f.z());
        most = std::max(most, row.f.z());
      }
    }
    std::printf("flicker: J %.3f N (raw %.2f), sliding %.3f; force %.2f to %.2f N\n", j, j_raw,
                sliding_j, least, most);
    EXPECT_LE(j, 0.3 + 1e-6);
    EXPECT_LE(sliding_j, 0.3 + 1e-6);
    EXPECT_GT(most - least, 0.5) << "nothing flickered";
  }
}

TEST(HapticTask, ANewMapIsNotBlendedWithTheOld) {
  Rig r(floor_scene());
  press(r);
  auto patch = std::make_unique<perception::SurfacePatch>();
  r.fill(*patch, Vec3::Zero(), 0.3, 100);
  patch->map_id = 9;
  while (!r.task().wants_patch()) r.tick({0, 0, -0.008});
  rt::Tick tick;
  tick.release = r.now();
  r.in().patch_newest = patch.get();
  (void)r.task().step(tick, r.in(), r.out());
  EXPECT_TRUE(r.task().wants_patch());
  EXPECT_EQ(r.out().telemetry.blend, 1.0);
  EXPECT_LE(r.out().telemetry.step_N, 0.3 + 1e-9);
  EXPECT_LT(r.out().telemetry.gain, 0.1);
}

TEST(HapticTask, ScaleKeepsStiffnessAtTheDevice) {
  for (const double scale : {0.5, 1.0, 4.0}) {
    Scene s = floor_scene();
    s.config.scale = scale;
    s.config.workspace_yaw_deg = 90;
    s.config.workspace_W_m = {0.5, -0.2, 0.1 * scale};
    s.nodes = 64;
    Rig r(s);
    // The rig hands positions straight to the device: 2 mm below the floor, measured by the hand.
    for (int i = 0; i <= 120; ++i) {
      r.tick(s.X_WS.inverse() * Vec3(0, 0, -0.1 + 0.01 - 1e-4 * i));
    }
    EXPECT_NEAR(r.out().force.f_H_D.z(), 2, 0.01) << scale;
    EXPECT_NEAR(r.out().state.p_WH.x(), 0.5, 1e-12);
  }
}

TEST(HapticTask, EnergyOfAHeldSpringMatchesTheClosedForm) {
  // Six cycles of 3 Hz, 5 mm from end to end, wholly inside: Delta E = -(K T / 2) integral v^2 dt.
  for (const double rate : {1000.0}) {
    Scene s = floor_scene();
    s.config.passivity_controller = false;
    Rig r(s);
    press(r, 0.008);
    const double begin = r.out().telemetry.energy_J, w = 2 * std::numbers::pi * 3;
    const auto hand = [&](double t) { return Vec3(0, 0, -0.008 + 0.0025 * std::sin(w * t)); };
    r.run(hand, 0, 2.0);
    r.tick(hand(2.0));
    const double spent = r.out().telemetry.energy_J - begin;
    const double closed = -0.5 * 1000 / rate * 0.5 * std::pow(0.0025 * w, 2) * 2.0;
    std::printf("energy over six cycles: observer %.4f mJ, closed form %.4f mJ\n", 1e3 * spent,
                1e3 * closed);
    EXPECT_NEAR(spent, closed, 0.03 * std::abs(closed));
    EXPECT_NEAR(closed, -1.11e-3, 0.01e-3);
  }
}

TEST(HapticTask, PassivityControllerPaysForTheHold) {
  double spent[2];
  for (const bool on : {false, true}) {
    Scene s = floor_scene();
    s.config.passivity_controller = on;
    s.config.credit_N_s_per_m = 0;  // a device that pays for nothing
    Rig r(s);
    press(r, 0.008);
    const double begin = r.out().telemetry.energy_J, w = 2 * std::numbers::pi * 3;
    const auto hand = [&](double t) { return Vec3(0, 0, -0.008 + 0.0025 * std::sin(w * t)); };
    for (const Row& row : r.run(hand, 0, 10.0)) EXPECT_LE(row.f.norm(), 12 + 1e-9);
    r.tick(hand(10.0));
    spent[on ? 1 : 0] = r.out().telemetry.energy_J - begin;
  }
  std::printf("energy over thirty cycles: %.3f mJ without, %.3f mJ with the controller\n",
              1e3 * spent[0], 1e3 * spent[1]);
  EXPECT_LT(spent[0], -5e-3);
  EXPECT_GE(spent[1], -1e-3);
  EXPECT_GT(spent[1], spent[0] - 1e-6);
}

// In at 100 mm/s and out again, six times: where the device pays for the hold the controller
// changes no bit of any force; where it pays for nothing it acts.
TEST(HapticTask, PassivityControllerLeavesWhatTheDevicePaysFor) {
  const auto forces = [](bool on, double credit) {
    Scene s = floor_scene();
    s.config.passivity_controller = on;
    s.config.credit_N_s_per_m = credit;
    Rig r(s);
    std::vector<Vec3> points{{0, 0, 0.005}};
    for (int i = 0; i < 6; ++i) {
      points.emplace_back(0, 0, -0.008);
      points.emplace_back(0, 0, 0.005);
    }
    const Path path(points, 0.1);
    std::vector<Vec3> out;
    double least = 0;
    for (const Row& row : r.run(path, 0, path.duration())) {
      out.push_back(row.f);
      const tasks::HapticTelemetry& t = row.telemetry;
      least = std::min(least, t.energy_J + t.booked_J + t.credit_J);
    }
    if (on || credit > 0) {
      EXPECT_GE(least, -1e-3) << credit;
    } else {
      EXPECT_LT(least, -1e-3);
    }
    return out;
  };
  const auto plain = forces(false, 0);
  EXPECT_EQ(forces(true, 2), plain);
  EXPECT_EQ(forces(false, 2), plain);
  EXPECT_NE(forces(true, 0), plain);
}

TEST(HapticTask, InjectionByARisingSurfaceIsBooked) {
  Scene s;
  s.solid = [](const Vec3& p, double t) { return solids::floor(p) - (t > 0.5 ? 0.003 : 0.0); };
  Rig r(s);
  r.run(Path({{0, 0, 0.02}, {0, 0, -0.006}}, 0.1), 0, 0.45);
  EXPECT_NEAR(r.out().telemetry.booked_J, 0, 2e-5);
  r.run([](double) { return Vec3(0, 0, -0.006); }, 0.45, 1.0);
  const double closed = 0.5 * 1000 * (0.009 * 0.009 - 0.006 * 0.006);
  EXPECT_NEAR(r.out().telemetry.booked_J, closed, 0.02 * closed);
  // The hand leaves: it gets back more than it put in; with the booking it is passive.
  double least = 1, least_booked = 1;
  for (const Row& row : r.run(Path({{0, 0, -0.006}, {0, 0, 0.02}}, 0.05), 0, 0.52)) {
    least = std::min(least, row.telemetry.energy_J);
    least_booked = std::min(least_booked, row.telemetry.energy_J + row.telemetry.booked_J);
  }
  EXPECT_LT(least, -0.015);
  EXPECT_GE(least_booked, -1e-3);
}

}  // namespace
