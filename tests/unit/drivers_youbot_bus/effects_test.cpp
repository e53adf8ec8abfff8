// Effects of the virtual youBot: their file, the arm's weight on its motors, I2t over the wire,
// and homing under all of them.
#include <cmath>
#include <numbers>

#include "drivers/youbot_bus/twin/loaded_motors.hpp"
#include "drivers/youbot_bus/youbot_setup.hpp"
#include "tests/support/paths.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

using drivers::ArmAngles;

constexpr double kTurn = 2 * std::numbers::pi;
// Torque at the joint per current, and turns of the motor (youbot.md, the table of units).
constexpr std::array<double, 5> kJoint_Nm_per_A{5.226, 5.226, 3.350, 3.621, 3.479};
constexpr std::array<double, 5> kTurns{156, 156, 100, 71, 71};
constexpr std::array<int, 5> kSign{-1, -1, 1, -1, -1};

yb::MotorEffects effects_of(const std::string& text) {
  const auto read = yb::read_motor_effects(text, "effects");
  EXPECT_TRUE(read) << read.error();
  return read ? read.value() : yb::MotorEffects{};
}

TEST(MotorEffects, WhatTheFileDoesNotNameIsNotBuilt) {
  EXPECT_FALSE(effects_of("").any());
  EXPECT_FALSE(effects_of("motor_stop = \"brake\"").any());
  EXPECT_EQ(effects_of("[gravity]\n[friction]\n").names(), "friction, gravity");
  const auto one = effects_of("[i2t]\njoint_rated_A = [1, 2, 3, 4, 5]\n");
  EXPECT_EQ(one.names(), "i2t");
  EXPECT_EQ(one.i2t->rated_A.joint[4], 5);
  EXPECT_EQ(one.i2t->rated_A.wheel, 2.3);
  // The example states the defaults.
  const auto example = yb::load_motor_effects(tests::in_tree("config/effects/youbot.toml"));
  ASSERT_TRUE(example) << example.error();
  EXPECT_EQ(example.value().names(), "inertia, friction, backlash, gravity, current_limit, i2t");
  EXPECT_EQ(example.value().inertia->load_kg_m2.joint, yb::InertiaEffect{}.load_kg_m2.joint);
  EXPECT_EQ(example.value().friction->coulomb_Nm.wheel, yb::FrictionEffect{}.coulomb_Nm.wheel);
  EXPECT_EQ(example.value().backlash->gap_deg.joint, yb::BacklashEffect{}.gap_deg.joint);
  EXPECT_EQ(example.value().current_limit->limit_A.joint, yb::CurrentLimitEffect{}.limit_A.joint);
  EXPECT_EQ(example.value().i2t->winding_s, yb::I2tEffect{}.winding_s);
}

TEST(MotorEffects, BadInputIsOneLineWithFileKeyValueAndRange) {
  const std::array<std::array<const char*, 4>, 6> bad{{
      {"[friction]\nwheel_coulomb_Nm = -1\n", "effects:2", "friction.wheel_coulomb_Nm", "-1"},
      {"[friction]\njoint_coulomb_Nm = [1, 2]\n", "effects:2", "joint_coulomb_Nm", "allowed"},
      {"[inertia]\njoint_rotor_kg_m2 = [1, 1, 1, 1, nan]\n", "effects:2", "joint_rotor", "allowed"},
      {"[gravitation]\n", "effects:1", "gravitation", "unknown key"},
      {"motor_stop = \"hold\"\n", "effects:1", "motor_stop", "brake"},
      {"[i2t\n", "effects:1", "not TOML", ""},
  }};
  for (const auto& b : bad) {
    const auto read = yb::read_motor_effects(b[0], "effects");
    ASSERT_FALSE(read) << b[0];
    for (std::size_t i = 1; i < 4; ++i)
      EXPECT_NE(read.error().find(b[i]), std::string::npos) << read.error();
    EXPECT_EQ(read.error().find('\n'), std::string::npos);
  }
  EXPECT_FALSE(yb::load_motor_effects("/nowhere/effects.toml"));
}

// An arm at a pose of its description, each joint's zero at raw position 0.
struct ArmRig {
  ArmRig(const std::string& effects, const ArmAngles& q) {
    const auto e = effects_of(effects);
    std::vector<yb::LoadedDriveConfig> drives;
    for (int j = 0; j < 5; ++j) {
      const auto k = static_cast<std::size_t>(j);
      drives.push_back(yb::loaded_config({yb::BoardKind::kJoint, j + 1, 1}, e, {}));
      EXPECT_NEAR(drives[k].torque_Nm_per_A * drives[k].gear, kJoint_Nm_per_A[k], 6e-4);
      drives[k].start_rad = kSign[k] * q[k];
    }
    auto weight = yb::arm_weight(e, drives);
    if (weight) weight->zero_rad = {};
    all = std::make_unique<yb::LoadedMotors>(startup.token(), drives, weight);
    for (std::size_t j = 0; j < 5; ++j) inertia[j] = drives[j].rotor_kg_m2 * kTurns[j] * kTurns[j];
    (void)all->motion(0, now);
  }
  void hold(const ArmAngles& q) {
    for (std::size_t j = 0; j < 5; ++j) {
      const double ticks = kSign[j] * q[j] / kTurn * 4000 * kTurns[j];
      all->command(j, {yb::ControllerMode::kPosition, ticks}, now);
    }
  }
  rt::Startup startup;
  std::unique_ptr<yb::LoadedMotors> all;
  ArmAngles inertia{};  // at the joint, without a load's own
  rt::Time now = rt::time_from_ns(1'000'000'000);
};

// Among them: level forward, level over the shoulder, folded, the candle leaning.
constexpr std::array<ArmAngles, 4> kPoses{{{2.9, 2.7, -2.55, 1.79, 2.9},
                                           {1, 0.0, -2.6, 1.8, 1},
                                           {0, 0.3, -0.5, 0.4, 0},
                                           {5, 1.3, -2, 3, 5}}};

TEST(MotorEffects, TheCurrentThatHoldsTheArmIsItsWeight) {
  for (const ArmAngles& q : kPoses) {
    ArmRig rig("[gravity]\npayload_kg = 0.5\n", q);
    rig.hold(q);
    rig.now += 3s;
    drivers::ArmMasses masses;
    masses.payload_kg = 0.5;
    const ArmAngles weight = drivers::arm_gravity_Nm(q, masses);
    for (std::size_t j = 0; j < 5; ++j) {
      const auto m = rig.all->motion(j, rig.now);
      EXPECT_NEAR(1e-3 * m.current_mA, -kSign[j] * weight[j] / kJoint_Nm_per_A[j], 2e-3) << j + 1;
      EXPECT_NEAR(rig.all->angles_rad()[j], q[j], 1e-6);
    }
  }
}

// Friction and play make a held arm hunt, by less than they are.
TEST(MotorEffects, UnderAllOfThemAHeldArmStaysWithinItsPlay) {
  const std::string all = "[inertia]\n[friction]\n[backlash]\n[gravity]\n[current_limit]\n[i2t]\n";
  for (const ArmAngles& q : kPoses) {
    ArmRig rig(all, q);
    rig.hold(q);
    rig.now += 2s;
    for (int i = 0; i < 400; ++i) {
      rig.now += 10ms;
      for (std::size_t j = 0; j < 5; ++j) {
        rt::Time when{};
        ASSERT_FALSE(rig.all->take_trip(j, rig.now, when)) << j + 1;
        const double gap = yb::BacklashEffect{}.gap_deg.joint[j] * kTurn / 360;
        ASSERT_NEAR(rig.all->angles_rad()[j], q[j], 0.6 * gap) << j + 1;
      }
    }
  }
}

TEST(MotorEffects, WithoutTorqueTheArmSinksWhereItsWeightGoes) {
  for (const ArmAngles& q : kPoses) {
    ArmRig rig("[gravity]\n", q);
    const ArmAngles weight = drivers::arm_gravity_Nm(q);
    rig.now += 20ms;
    (void)rig.all->motion(0, rig.now);
    const ArmAngles after = rig.all->angles_rad();
    for (std::size_t j = 0; j < 5; ++j) {
      const double fall = weight[j] / rig.inertia[j] * 0.02 * 0.02 / 2;
      EXPECT_NEAR(after[j] - q[j], fall, 0.01 * std::abs(fall) + 1e-12) << j + 1;
    }
  }
  // No weight, or friction that bears it: it stands.
  for (const char* stands :
       {"[inertia]\n", "[gravity]\n[friction]\njoint_coulomb_Nm = [1,1,1,1,1]\n"}) {
    ArmRig rig(stands, kPoses[0]);
    rig.now += 2s;
    for (std::size_t j = 0; j < 5; ++j)
      EXPECT_NEAR(rig.all->motion(j, rig.now).position_ticks,
                  kSign[j] * kPoses[0][j] / kTurn * 4000 * kTurns[j], 1e-6);
  }
}

TEST(MotorEffects, I2tTripsOverTheWireAndIsClearedWhenTheWindingIsCool) {
  using drivers::tmcl::Command;
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBase;
  c.effects = effects_of(
      "[i2t]\nwheel_rated_A = 1\nwinding_s = 0.5\n[inertia]\n[friction]\n"
      "wheel_viscous_Nm_s = 1e-3\n");
  BusRig rig(c);
  rig.bring_up();
  rig.make_ready();
  EXPECT_EQ(rig.tmcl(2, Command::kGetAxisParameter, 25).value, 500);
  EXPECT_EQ(rig.tmcl(2, Command::kGetAxisParameter, 26).value, 1000);
  rig.set(2, yb::ControllerMode::kCurrent, 2000);
  const auto limit = static_cast<int>(-1e3 * 0.5 * std::log(1 - 0.25));  // cycles of 1 ms: 143
  rig.cycles(limit - 3);
  EXPECT_EQ(rig.inputs(2).flags >> 17U & 1U, 0U);
  EXPECT_NEAR(rig.inputs(2).current_mA, 2000, 1);
  rig.cycles(7);
  EXPECT_EQ(rig.inputs(2).flags >> 17U & 1U, 1U);
  EXPECT_EQ(rig.inputs(1).flags >> 17U & 1U, 0U) << "its neighbour is cool";
  EXPECT_EQ(rig.tmcl(2, Command::kGetAxisParameter, 28).value, 1);
  EXPECT_EQ(rig.tmcl(2, Command::kSetAxisParameter, 29).status, 100);
  rig.cycles(50);
  EXPECT_EQ(rig.inputs(2).flags >> 17U & 1U, 1U) << "too early";
  EXPECT_EQ(rig.inputs(2).current_mA, 0);
  rig.cycles(600);
  EXPECT_EQ(rig.tmcl(2, Command::kSetAxisParameter, 29).status, 100);
  rig.cycles(3);
  EXPECT_EQ(rig.inputs(2).flags >> 17U & 1U, 0U);
  EXPECT_NEAR(rig.inputs(2).current_mA, 2000, 1);
}

// The board's own watchdog: every joint of an arm coasts from its instant, whoever is asked first.
TEST(MotorEffects, ASilentWireStopsAllJointsAtTheBoardsTime) {
  yb::YoubotChainConfig c;
  c.effects = effects_of("[inertia]\n[friction]\n");
  c.data_watchdog = false;
  BusRig rig(c);
  rig.bring_up();
  rig.make_ready();
  for (std::size_t i = 6; i < 11; ++i) {
    rig.set(i, yb::ControllerMode::kVelocity, 300);
  }
  rig.cycles(500);
  std::array<double, 5> before{};
  for (std::size_t j = 0; j < 5; ++j)
    before[j] = rig.chain.drive(6 + j)->motor().motion(rig.port.now()).position_ticks;
  rig.pause(5s);
  rig.cycles(2);
  for (std::size_t j = 0; j < 5; ++j) {
    const double way =
        rig.chain.drive(6 + j)->motor().motion(rig.port.now()).position_ticks - before[j];
    // 100 ms at 300 rpm, 20000 ticks a second, and the way on which Coulomb friction stops it.
    const yb::InertiaEffect inertia;
    const double all =
        inertia.rotor_kg_m2.joint[j] + inertia.load_kg_m2.joint[j] / (kTurns[j] * kTurns[j]);
    const double speed = 300 * kTurn / 60;
    const double coast = speed * speed * all / (2 * 0.01) / kTurn * 4000;
    EXPECT_NEAR(way, 2000 + coast, 30) << j + 1;
    EXPECT_EQ(rig.inputs(6 + j).flags >> 16U & 1U, 1U);
  }
}

TEST(MotorEffects, HomingFindsTheStopsUnderAllOfThem) {
  yb::YoubotChainConfig c;
  c.end_stops = true;
  const auto all = yb::load_motor_effects(tests::in_tree("config/effects/youbot.toml"));
  ASSERT_TRUE(all) << all.error();
  c.effects = all.value();
  BusRig rig(c);
  rig.bring_up();
  yb::DriveSession session(rig.startup.token(), rig.master, rig.port, c.kind);
  const yb::Progress quiet = [](const std::string&) {};
  const auto found = yb::commutate(session, quiet);
  ASSERT_TRUE(found) << found.error();
  const auto homed = yb::home_arm(session, 1, quiet);
  ASSERT_TRUE(homed) << homed.error();
  for (int j = 1; j <= 5; ++j) {
    const auto i = static_cast<std::size_t>(5 + j), k = static_cast<std::size_t>(j - 1);
    auto& motor = dynamic_cast<yb::LoadedMotor&>(rig.chain.drive(i)->motor());
    const double zero =
        motor.motion(rig.port.now()).position_ticks - session.inputs(i).position_ticks;
    // Of the motor, which at the stop is half the play ahead of its joint.
    const double off_deg = 360 * (zero - 1234.0 * j) / 4000 / kTurns[k];
    EXPECT_LE(std::abs(off_deg - all.value().backlash->gap_deg.joint[k] / 2), 0.1) << "joint " << j;
  }
}

}  // namespace
}  // namespace tests
