#include "drivers/youbot/robot_plant.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "drivers/youbot/virtual_youbot.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_youbot/disagreement.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::BusStatus;
using drivers::MecanumConfig;
using drivers::MotorMode;
using drivers::MotorSetpoints;
using drivers::MotorStates;
using drivers::PlantState;
using drivers::RobotPlant;
using drivers::RobotPlantConfig;
using drivers::VirtualYoubot;
using drivers::WheelVector;
using perception::Pose2;
using perception::Twist2;

constexpr rt::Time kStart = rt::time_from_ns(5'000'000'000);

struct Rig {
  rt::Startup startup;
  rt::NonRealtime& nrt() { return startup.token(); }
};

bool same_bits(const PlantState& a, const PlantState& b) {
  const auto eq = [](double x, double y) { return std::memcmp(&x, &y, sizeof x) == 0; };
  bool ok = a.time == b.time && a.collisions == b.collisions && eq(a.X_WB.x, b.X_WB.x) &&
            eq(a.X_WB.y, b.X_WB.y) && eq(a.X_WB.yaw, b.X_WB.yaw) && eq(a.v_B.vx, b.v_B.vx) &&
            eq(a.path_m, b.path_m);
  for (int i = 0; i < 4; ++i) {
    ok = ok && eq(a.wheel_rad[i], b.wheel_rad[i]) &&
         eq(a.wheel_rad_per_s[i], b.wheel_rad_per_s[i]) && eq(a.torque_Nm[i], b.torque_Nm[i]);
  }
  return ok;
}

RobotPlantConfig everything() {
  RobotPlantConfig c;
  c.slip_ratio = 0.02;
  c.wheel_slip_max = 0.1;
  c.wheel_radius_error = {0.01, -0.01, 0.005, 0};
  c.encoder_ticks_per_motor_turn = 4000;
  c.dead_time_s = 0.002;
  c.gear_friction_Nm = 0.3;
  return c;
}

// The same commands at the same instants, read in between at random instants or not at all.
TEST(Plant, DoesNotDependOnWhoAsks) {
  Rig rig;
  const std::uint64_t seed = 31;
  for (int order = 0; order <= 2; ++order) {
    RobotPlantConfig c = everything();
    c.speed_loop_order = order;
    const auto wall = [](const Pose2& p, rt::Time) { return p.x > 0.8; };
    RobotPlant quiet(rig.nrt(), c, {}, {}, wall), asked(rig.nrt(), c, {}, {}, wall);
    rt::Random commands(seed), readers(seed + 1 + static_cast<std::uint64_t>(order));
    quiet.advance(kStart);
    asked.advance(kStart);
    rt::Time t = kStart;
    for (int k = 0; k < 1500; ++k) {
      const rt::Time next = t + rt::Nanos{commands.integer(200'000, 4'000'000)};
      for (int n = 0; n < 3; ++n) {
        asked.advance(t + rt::Nanos{readers.integer(0, (next - t).count())});
      }
      t = next;
      const Twist2 v{commands.uniform(0, 0.6), commands.uniform(-0.3, 0.3),
                     commands.uniform(-0.5, 0.5)};
      quiet.advance(t);
      asked.advance(t);
      ASSERT_TRUE(same_bits(quiet.state(), asked.state()))
          << "seed " << seed << " order " << order << " command " << k;
      const WheelVector w = quiet.kinematics().inverse(v);
      quiet.command(t, w, true);
      asked.command(t, w, true);
    }
    EXPECT_GT(quiet.state().path_m, 0.3);
    EXPECT_GT(quiet.state().collisions, 0U);
  }
}

TEST(Plant, StandingStillIsSkippedNotIntegrated) {
  Rig rig;
  RobotPlant plant(rig.nrt(), {}, {}, {1, 2, 0.3});
  plant.advance(kStart);
  plant.advance(kStart + 24h);  // would be 864 million sub-steps
  EXPECT_EQ(plant.state().X_WB, (Pose2{1, 2, 0.3}));
  EXPECT_EQ(plant.state().time, kStart + 24h);
}

// First-order lag below the torque limit: w(t) = w_s (1 - exp(-t / tau)), to the order of the step.
TEST(Plant, FirstOrderMatchesClosedForm) {
  Rig rig;
  RobotPlantConfig c;
  c.speed_loop_order = 1;
  c.substep_us = 10;
  c.torque_limit_Nm = 50;
  RobotPlant plant(rig.nrt(), c, {}, {});
  plant.advance(kStart);
  const WheelVector w = plant.kinematics().inverse({0.2, 0.1, 0.3});
  plant.command(kStart, w, true);
  for (int ms = 1; ms <= 100; ++ms) {
    plant.advance(kStart + std::chrono::milliseconds{ms});
    const double f = 1 - std::exp(-c.speed_loop_rad_per_s * ms * 1e-3);
    for (int i = 0; i < 4; ++i) {
      ASSERT_NEAR(plant.state().wheel_rad_per_s[i], w[i] * f, 2e-4 * std::abs(w[i])) << ms;
    }
  }
}

// Torque-limited start: constant acceleration 4 tau r / (m r^2 + 4 J_w) of the base.
TEST(Plant, TorqueLimitGivesTheAccelerationOfTheMass) {
  Rig rig;
  RobotPlantConfig c;
  c.torque_limit_Nm = 1.0;
  RobotPlant plant(rig.nrt(), c, {}, {});
  plant.advance(kStart);
  plant.command(kStart, plant.kinematics().inverse({1.0, 0, 0}), true);
  plant.advance(kStart + 200ms);
  const double r = plant.kinematics().wheel_radius();
  const double a = 4 * c.torque_limit_Nm * r / (c.mass_kg * r * r + 4 * c.wheel_inertia_kg_m2);
  EXPECT_NEAR(plant.state().v_B.vx, a * 0.2, 0.01 * a * 0.2);
  EXPECT_NEAR(plant.state().X_WB.x, 0.5 * a * 0.04, 0.01 * 0.5 * a * 0.04);
}

TEST(Plant, SecondOrderSettlesWithoutSteadyError) {
  Rig rig;
  for (const double friction : {0.0, 0.5}) {
    RobotPlantConfig c;
    c.gear_friction_Nm = friction;
    RobotPlant plant(rig.nrt(), c, {}, {});
    plant.advance(kStart);
    const Twist2 v{0.3, -0.2, 0.4};
    plant.command(kStart, plant.kinematics().inverse(v), true);
    plant.advance(kStart + 2s);
    EXPECT_NEAR(plant.state().v_B.vx, v.vx, 1e-6);
    EXPECT_NEAR(plant.state().v_B.vy, v.vy, 1e-6);
    EXPECT_NEAR(plant.state().v_B.wz, v.wz, 1e-6);
  }
}

TEST(Plant, EffectsAreBuiltOnlyWhenNamed) {
  Rig rig;
  RobotPlantConfig plain;
  plain.speed_loop_order = 0;
  EXPECT_TRUE(RobotPlant(rig.nrt(), plain, {}, {}).effects().empty());
  EXPECT_EQ(RobotPlant(rig.nrt(), everything(), {}, {}).effects(),
            (std::vector<std::string>{"motor_dynamics", "slip", "wheel_slip", "wheel_radius",
                                      "encoder_quantisation", "dead_time", "gear_friction"}));
}

TEST(Plant, DeadTimeDelaysTheWheels) {
  Rig rig;
  RobotPlantConfig c;
  c.speed_loop_order = 0;
  c.dead_time_s = 0.005;
  RobotPlant plant(rig.nrt(), c, {}, {});
  plant.advance(kStart);
  plant.command(kStart, {1, 1, 1, 1}, true);
  plant.advance(kStart + 5ms);
  EXPECT_EQ(plant.state().wheel_rad_per_s[0], 0);
  plant.advance(kStart + 5100us);
  EXPECT_EQ(plant.state().wheel_rad_per_s[0], 1);
}

TEST(Plant, SlipSeparatesTruthFromWheels) {
  Rig rig;
  RobotPlantConfig c;
  c.speed_loop_order = 0;
  c.slip_ratio = 0.1;
  RobotPlant plant(rig.nrt(), c, {}, {});
  plant.advance(kStart);
  plant.command(kStart, plant.kinematics().inverse({0.5, 0, 0}), true);
  plant.advance(kStart + 2s);
  EXPECT_NEAR(plant.state().X_WB.x, 0.9, 1e-4);
}

// Straight at 0.5 m/s. In each interval the body goes as the wheels' travel on the floor says,
// worked out here wheel by wheel; over many intervals the shares are even from 0 to the largest,
// and each wheel's are its own.
TEST(Plant, EachWheelSlipsByItselfAndIsDrawnAnew) {
  Rig rig;
  RobotPlantConfig c;
  c.speed_loop_order = 0;
  c.wheel_slip_max = 0.1;
  c.wheel_slip_seed = 7;
  RobotPlant plant(rig.nrt(), c, {}, {});
  const WheelVector w = plant.kinematics().inverse({0.5, 0, 0});
  plant.advance(kStart);
  plant.command(kStart, w, true);
  plant.advance(kStart + 1us * 100);
  constexpr int kIntervals = 400;
  double sum = 0, least = 1, most = 0, turn2 = 0;
  Twist2 last;
  for (int n = 0; n < kIntervals; ++n) {
    plant.advance(kStart + n * 500ms + 250ms);
    const Twist2 v = plant.state().v_B;
    EXPECT_FALSE(v == last) << "drawn anew, interval " << n;
    last = v;
    const double along = 1 - v.vx / 0.5;  // mean of the four shares
    EXPECT_GE(along, 0);
    EXPECT_LE(along, 0.1);
    sum += along, least = std::min(least, along), most = std::max(most, along);
    turn2 += v.wz * v.wz;
    plant.advance(kStart + n * 500ms + 490ms);
    EXPECT_EQ(plant.state().v_B, v) << "the same for the whole interval";
  }
  // Means of four even draws: 0.05 +- 0.1 / sqrt(12 * 4), and a turn of v / (4 k) times their
  // signed sum.
  EXPECT_NEAR(sum / kIntervals, 0.05, 4 * 0.0144 / std::sqrt(kIntervals));
  EXPECT_LT(least, 0.025);
  EXPECT_GT(most, 0.075);
  const double expected = 0.5 / (4 * plant.kinematics().lever()) * 0.1 / std::sqrt(12.0) * 2;
  EXPECT_NEAR(std::sqrt(turn2 / kIntervals), expected, 0.15 * expected);
}

TEST(Plant, AnotherSeedSlipsOtherwiseTheSameOneTheSame) {
  Rig rig;
  RobotPlantConfig c;
  c.wheel_slip_max = 0.1;
  const auto end = [&](std::uint64_t seed) {
    c.wheel_slip_seed = seed;
    RobotPlant plant(rig.nrt(), c, {}, {});
    plant.advance(kStart);
    plant.command(kStart, plant.kinematics().inverse({0.3, 0.1, 0.2}), true);
    plant.advance(kStart + 3s);
    return plant.state();
  };
  EXPECT_TRUE(same_bits(end(1), end(1)));
  EXPECT_FALSE(same_bits(end(1), end(2)));
}

// Wheels of another radius: the body goes as wheels of that radius go, while the angles are those
// commanded.
TEST(Plant, RadiusErrorIsTheBodysAlone) {
  Rig rig;
  RobotPlantConfig c;
  c.speed_loop_order = 0;
  c.wheel_radius_error.fill(-0.01);
  MecanumConfig worn;
  worn.wheel_radius_m *= 0.99;
  const WheelVector w = drivers::Mecanum().inverse({0.4, -0.1, 0.3});
  RobotPlant plant(rig.nrt(), c, {}, {});
  plant.advance(kStart);
  plant.command(kStart, w, true);
  plant.advance(kStart + 2s);
  const Twist2 v = drivers::Mecanum(worn).forward(w);
  EXPECT_NEAR(plant.state().v_B.vx, v.vx, 1e-12);
  EXPECT_NEAR(plant.state().v_B.vy, v.vy, 1e-12);
  EXPECT_NEAR(plant.state().v_B.wz, v.wz, 1e-12);
  EXPECT_NEAR(plant.state().wheel_rad[1], 2 * w[1], 1e-3);
}

// What the tasks have found of the robot is no property of the robot: the twin stays as it is.
TEST(Plant, IsNotChangedByACalibration) {
  Rig rig;
  RobotPlantConfig c;
  c.wheel_radius_error = {0.01, -0.02, 0, 0.005};
  MecanumConfig calibrated;
  calibrated.wheel_scale = {1.01, 0.98, 1, 1.005};
  calibrated.lever_scale = 1.03, calibrated.slide_scale = 0.97;
  const WheelVector w = drivers::Mecanum().inverse({0.3, 0.1, -0.2});
  const auto end = [&](const MecanumConfig& base) {
    RobotPlant plant(rig.nrt(), c, base, {});
    plant.advance(kStart);
    plant.command(kStart, w, true);
    plant.advance(kStart + 2s);
    return plant.state();
  };
  EXPECT_TRUE(same_bits(end({}), end(calibrated)));
}

TEST(Plant, EncoderReportsWholeTicksAndRpm) {
  Rig rig;
  RobotPlantConfig c;
  c.encoder_ticks_per_motor_turn = 4000;
  RobotPlant plant(rig.nrt(), c, {}, {});
  plant.advance(kStart);
  plant.command(kStart, plant.kinematics().inverse({0.123, 0.05, 0.2}), true);
  plant.advance(kStart + 777ms);
  for (int i = 0; i < 4; ++i) {
    const double turns = plant.encoder_rad()[i] / (2 * std::numbers::pi);
    const double ticks = turns * 103351.64835;
    EXPECT_NEAR(ticks, std::round(ticks), 1e-3);
    EXPECT_NEAR(plant.encoder_rad()[i], plant.state().wheel_rad[i], 0.5 * 2 * M_PI / 103351.0);
    const double rpm = plant.kinematics().motor_rpm(plant.encoder_rad_per_s()[i]);
    EXPECT_NEAR(rpm, std::round(rpm), 1e-6);
  }
}

// A wall at x = 0.5: the base stops at it, is counted once, stays, and can leave again.
// A thing that comes to a standing robot counts, once, if it is known that things move.
TEST(Plant, ARobotAtRestIsRunInto) {
  Rig rig;
  for (const bool known : {false, true}) {
    RobotPlant plant(rig.nrt(), {}, {}, {}, [](const Pose2&, rt::Time t) {
      return t >= kStart + rt::Nanos{1'000'000'000};
    });
    if (known) plant.things_move();
    plant.advance(kStart);
    plant.advance(kStart + rt::Nanos{900'000'000});
    EXPECT_EQ(plant.state().collisions, 0U);
    plant.advance(kStart + rt::Nanos{2'000'000'000});
    EXPECT_EQ(plant.state().collisions, known ? 1U : 0U);
    EXPECT_EQ(plant.state().in_contact, known);
  }
}

TEST(Plant, WallStopsTheBaseAndCountsOnce) {
  Rig rig;
  RobotPlant plant(rig.nrt(), {}, {}, {}, [](const Pose2& p, rt::Time) { return p.x > 0.5; });
  plant.advance(kStart);
  plant.command(kStart, plant.kinematics().inverse({0.4, 0, 0}), true);
  plant.advance(kStart + 3s);
  EXPECT_EQ(plant.state().collisions, 1U);
  EXPECT_TRUE(plant.state().in_contact);
  EXPECT_LE(plant.state().X_WB.x, 0.5);
  EXPECT_GT(plant.state().X_WB.x, 0.499);
  EXPECT_EQ(plant.state().v_B.vx, 0);
  EXPECT_NEAR(plant.state().wheel_rad_per_s[1] * 0.0475, 0.4, 1e-3);  // the wheels turn on
  plant.command(kStart + 3s, plant.kinematics().inverse({-0.4, 0, 0}), true);
  plant.advance(kStart + 4s);
  EXPECT_FALSE(plant.state().in_contact);
  EXPECT_LT(plant.state().X_WB.x, 0.25);
  plant.command(kStart + 4s, plant.kinematics().inverse({0.4, 0, 0}), true);
  plant.advance(kStart + 8s);
  EXPECT_EQ(plant.state().collisions, 2U);
}

TEST(Plant, RefusesToStartInsideAnObstacle) {
  Rig rig;
  EXPECT_THROW(RobotPlant(rig.nrt(), {}, {}, {}, [](const Pose2&, rt::Time) { return true; }),
               std::invalid_argument);
  EXPECT_THROW(RobotPlant(rig.nrt(), {}, {}, {std::nan(""), 0, 0}), std::invalid_argument);
}

struct Bus : Rig {
  VirtualYoubot bus{nrt(), {}, RobotPlant(nrt(), {}, {}, {})};
  MotorStates states;
  rt::Time now = kStart;
  drivers::Mecanum kinematics;
  BusStatus drive(const Twist2& v, int ms, MotorMode mode = MotorMode::kVelocity) {
    BusStatus s = BusStatus::kDown;
    for (int i = 0; i < ms; ++i) {
      rt::Section section;
      s = bus.exchange(now, {mode, kinematics.inverse(v)}, states);
      now += 1ms;
    }
    return s;
  }
  [[nodiscard]] const PlantState& truth() const { return bus.plant().state(); }
};

TEST(VirtualYoubot, DrivesAndReports) {
  Bus b;
  EXPECT_EQ(b.drive({0.3, 0, 0}, 2000), BusStatus::kOk);
  EXPECT_NEAR(b.truth().X_WB.x, 0.6, 0.02);
  EXPECT_EQ(b.states.seq, 2000U);
  EXPECT_NE(b.states.flags[0] & drivers::motor_flag::kInitialised, 0U);
  EXPECT_NE(b.states.flags[0] & drivers::motor_flag::kVelocityMode, 0U);
  EXPECT_EQ(b.states.flags[0] & drivers::motor_flag::kTimeout, 0U);
  b.drive({0.3, 0, 0}, 500, MotorMode::kStop);
  EXPECT_NE(b.states.flags[0] & drivers::motor_flag::kMotorHalted, 0U);
}

TEST(VirtualYoubot, WatchdogStopsAtItsInstantAndLatches) {
  Bus b;
  b.drive({0.4, 0, 0}, 1000);
  b.now += 98ms;  // 99 ms after the last exchange: nothing yet
  b.drive({0.4, 0, 0}, 1);
  EXPECT_FALSE(b.bus.timed_out());
  const double before = b.truth().X_WB.x;
  b.now += 5s;
  b.drive({0.4, 0, 0}, 1);
  EXPECT_TRUE(b.bus.timed_out());
  // 100 ms at 0.4 m/s, then the stop: far from 5 s of driving.
  EXPECT_GT(b.truth().X_WB.x - before, 0.039);
  EXPECT_LT(b.truth().X_WB.x - before, 0.08);
  EXPECT_NE(b.states.flags[2] & drivers::motor_flag::kTimeout, 0U);
  const double stopped = b.truth().X_WB.x;
  b.drive({0.4, 0, 0}, 500);
  EXPECT_NEAR(b.truth().X_WB.x, stopped, 1e-6);  // setpoints have no effect
  b.bus.rearm();
  b.drive({0.4, 0, 0}, 500);
  EXPECT_GT(b.truth().X_WB.x, stopped + 0.15);
}

TEST(VirtualYoubot, MakeSafeHoldsUntilRearmed) {
  Bus b;
  b.drive({0.4, 0, 0}, 1000);
  b.bus.make_safe();
  b.drive({0.4, 0, 0}, 300);
  const double stopped = b.truth().X_WB.x;
  EXPECT_EQ(b.states.flags[0] & drivers::motor_flag::kVelocityMode, 0U);
  b.drive({0.4, 0, 0}, 300);
  EXPECT_NEAR(b.truth().X_WB.x, stopped, 1e-6);
  b.bus.rearm();
  b.drive({0.4, 0, 0}, 300);
  EXPECT_GT(b.truth().X_WB.x, stopped + 0.05);
}

TEST(VirtualYoubot, InjectedFaults) {
  Bus b;
  b.drive({0.2, 0, 0}, 10);
  const MotorStates before = b.states;
  b.bus.faults().lose_frames = 3;
  EXPECT_EQ(b.drive({0.2, 0, 0}, 3), BusStatus::kFrameLost);
  EXPECT_EQ(b.states.seq, before.seq);  // untouched
  EXPECT_EQ(b.drive({0.2, 0, 0}, 1), BusStatus::kOk);
  b.bus.faults().down = true;
  EXPECT_EQ(b.drive({0.2, 0, 0}, 1), BusStatus::kDown);
  b.bus.faults().down = false;
  b.bus.faults().stuck_wheel = 1;
  b.drive({0.2, 0, 0}, 300);
  EXPECT_EQ(b.states.wheel_rad_per_s[1], 0);
  EXPECT_GT(std::abs(disagreement(b.states.wheel_rad_per_s)), 0.5);
  b.bus.faults().nan_angle = true;
  b.drive({0.2, 0, 0}, 1);
  EXPECT_TRUE(std::isnan(b.states.wheel_rad[0]));
}

TEST(VirtualYoubot, NotFiniteSetpointStopsTheMotors) {
  Bus b;
  b.drive({0.3, 0, 0}, 500);
  b.drive({std::nan(""), 0, 0}, 500);
  EXPECT_NEAR(b.truth().v_B.vx, 0, 1e-6);
  EXPECT_TRUE(perception::is_finite(b.truth().X_WB));
}

TEST(PoseHistory, InterpolatesAndRefusesWhatItDoesNotHold) {
  Bus b;
  drivers::PoseHistory::Sample s;
  EXPECT_FALSE(b.bus.history().newest(s));
  b.drive({0.5, 0, 0.5}, 3000);
  const rt::Time last = b.now - 1ms;
  ASSERT_TRUE(b.bus.history().newest(s));
  EXPECT_EQ(s.time, last);
  EXPECT_TRUE(b.bus.history().at(last + 10ms, s));
  EXPECT_FALSE(b.bus.history().at(last + 200ms, s));
  EXPECT_FALSE(b.bus.history().at(last - 2s, s));
  // Between two samples: on the arc of the motion.
  drivers::PoseHistory::Sample a, m;
  ASSERT_TRUE(b.bus.history().at(last - 500ms, a));
  ASSERT_TRUE(b.bus.history().at(last - 499500us, m));
  const Pose2 want = perception::integrate(a.X_WB, a.v_B, 0.0005);
  EXPECT_NEAR(m.X_WB.x, want.x, 1e-12);
  EXPECT_NEAR(m.X_WB.y, want.y, 1e-12);
}

}  // namespace
