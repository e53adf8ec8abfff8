// Set-up of a youBot: what a check reads, commutation, the arm's homing, a joint's limits.
#include "drivers/tmcl/motor_faults.hpp"
#include "drivers/youbot_bus/gripper_setup.hpp"
#include "drivers/youbot_bus/youbot_setup.hpp"

#include <cmath>
#include <numbers>

#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

// The truth at the motors themselves, which the boards never say.
struct SetupRig : BusRig {
  explicit SetupRig(yb::ChainKind kind, yb::Generation g = yb::Generation::kNew,
                    std::size_t input_bytes = 0)
      : BusRig(config(kind, g, input_bytes)), session(startup.token(), master, port, kind) {
    bring_up();
  }
  // Of 0 bytes: those of the generation.
  static yb::YoubotChainConfig config(yb::ChainKind kind, yb::Generation g,
                                      std::size_t input_bytes) {
    yb::YoubotChainConfig c;
    c.kind = kind;
    c.generation = g;
    c.input_bytes = input_bytes;
    c.end_stops = true;
    return c;
  }
  double true_ticks(std::size_t i) {
    return chain.drive(i)->motor().motion(port.now()).position_ticks;
  }
  double travelled() {
    double sum = 0;
    for (const std::size_t i : session.drives()) sum += std::abs(true_ticks(i) - before[i]);
    return sum;
  }
  void remember() {
    before.assign(session.boards().size(), 0);
    for (const std::size_t i : session.drives()) before[i] = true_ticks(i);
  }
  yb::DriveSession session;
  std::vector<double> before;
  std::vector<std::string> said;
  yb::Progress say = [this](const std::string& s) { said.push_back(s); };
};

// Where each stop of the virtual arm is (twin/youbot_chain.cpp).
double stop_ticks(int joint) { return 1234.0 * joint; }
constexpr std::array<double, 5> kGear{156, 156, 100, 71, 71};

TEST(YoubotSetup, CheckReadsAndMovesNothing) {
  for (const auto kind : yb::kChainKinds) {
    SetupRig rig(kind);
    rig.remember();
    const auto reports = yb::check(rig.session);
    ASSERT_TRUE(reports) << reports.error();
    EXPECT_EQ(reports.value().size(), rig.session.drives().size());
    for (const auto& r : reports.value()) {
      EXPECT_FALSE(r.commutated);
      EXPECT_NE(r.wrong.find("no commutation"), std::string::npos);
      EXPECT_NEAR(r.supply_V, 24, 1e-9);
      EXPECT_NEAR(r.temperature_C, 25, 1);
      EXPECT_EQ(r.firmware.version, 200);
    }
    EXPECT_EQ(rig.travelled(), 0);
  }
}

// The first firmware's 16 bytes have no room for the flag: its check asks the board.
TEST(YoubotSetup, CheckTellsATrippedDriveOfEveryInputSize) {
  for (const std::size_t bytes : {16U, 18U, 20U, 32U}) {
    SetupRig rig(yb::ChainKind::kBaseArm, bytes == 32 ? yb::Generation::kNew : yb::Generation::kOld,
                 bytes);
    rig.chain.drive(3)->trip_i2t(rig.port.now());
    const auto reports = yb::check(rig.session);
    ASSERT_TRUE(reports) << reports.error();
    for (const auto& r : reports.value())
      EXPECT_EQ(r.wrong.find("I2t") != std::string::npos, r.position == 3)
          << bytes << " bytes, slave " << r.position << ": " << r.wrong;
  }
}

// Each bit that is a fault keeps a drive from being called ready, by its name; the others do not.
TEST(YoubotSetup, CheckNamesEachFaultOfADrive) {
  SetupRig rig(yb::ChainKind::kBaseArm);
  ASSERT_TRUE(yb::commutate(rig.session, rig.say));
  for (const auto& f : drivers::tmcl::motor_flags()) {
    if (f.kind == drivers::tmcl::FlagKind::kLatched) continue;
    rig.chain.drive(2)->set_faults(1U << f.bit, rig.port.now());
    const auto reports = yb::check(rig.session);
    ASSERT_TRUE(reports) << reports.error();
    const std::string wheel = reports.value()[1].wrong;  // slave 3
    EXPECT_EQ(wheel, f.kind == drivers::tmcl::FlagKind::kFault ? f.name : "") << f.name;
    rig.chain.drive(2)->set_faults(0, rig.port.now());
  }
}

// Set-up clears I2t of what has cooled down, and says no more than that of what has not.
TEST(YoubotSetup, I2tIsClearedWhenTheWindingIsCool) {
  for (const std::size_t bytes : {16U, 32U}) {
    SetupRig rig(yb::ChainKind::kBaseArm, bytes == 32 ? yb::Generation::kNew : yb::Generation::kOld,
                 bytes);
    ASSERT_TRUE(yb::commutate(rig.session, rig.say));
    for (const std::size_t slave : {2U, 7U}) rig.chain.drive(slave)->trip_i2t(rig.port.now());
    auto cleared = yb::clear_i2t(rig.session);
    ASSERT_TRUE(cleared) << cleared.error();
    EXPECT_EQ(cleared.value(), 0) << "still hot";
    rig.cycles(2000);
    cleared = yb::clear_i2t(rig.session);
    ASSERT_TRUE(cleared) << cleared.error();
    EXPECT_EQ(cleared.value(), 2);
    const auto reports = yb::check(rig.session);
    ASSERT_TRUE(reports) << reports.error();
    for (const auto& r : reports.value())
      EXPECT_EQ(r.wrong.find("I2t"), std::string::npos) << r.name;
  }
}

TEST(YoubotSetup, ADriveThatMayTakeMoreCurrentIsNamed) {
  SetupRig rig(yb::ChainKind::kBaseArm);
  const auto has = rig.session.get(3, 6);
  ASSERT_TRUE(has);
  auto above = yb::above_current(rig.session, has.value());
  ASSERT_TRUE(above) << above.error();
  EXPECT_EQ(above.value(), "");
  above = yb::above_current(rig.session, has.value() - 1);
  ASSERT_TRUE(above) << above.error();
  EXPECT_EQ(above.value(), "wheel front left may take 8000 mA (axis parameter 6)");
}

TEST(YoubotSetup, HomingFindsEachStopToATenthOfADegree) {
  for (const auto g : {yb::Generation::kOld, yb::Generation::kNew}) {
    SetupRig rig(yb::ChainKind::kBaseArm, g);
    const auto found = yb::commutate(rig.session, rig.say);
    ASSERT_TRUE(found) << found.error();
    const auto homed = yb::home_arm(rig.session, 1, rig.say);
    ASSERT_TRUE(homed) << homed.error();
    EXPECT_EQ(rig.said.size(), 6U);
    for (int j = 1; j <= 5; ++j) {
      const auto i = static_cast<std::size_t>(5 + j);
      const double zero = rig.true_ticks(i) - rig.session.inputs(i).position_ticks;
      const double off_deg =
          360 * (zero - stop_ticks(j)) / 4000 / kGear[static_cast<std::size_t>(j - 1)];
      EXPECT_LE(std::abs(off_deg), 0.1) << "joint " << j;
    }
    const auto after = yb::check(rig.session);
    ASSERT_TRUE(after) << after.error();
    for (const auto& r : after.value()) EXPECT_EQ(r.wrong, "") << r.name;
    // A second commutation moves nothing: every drive knows it.
    rig.remember();
    ASSERT_TRUE(yb::commutate(rig.session, rig.say));
    EXPECT_LT(rig.travelled(), 5);
  }
}

// A joint that finds no stop is named, and the arm holds.
TEST(YoubotSetup, AStuckEncoderOrALostBusEndsHomingByName) {
  SetupRig rig(yb::ChainKind::kBaseArm);
  ASSERT_TRUE(yb::commutate(rig.session, rig.say));
  rig.port.faults().lose_out = 1'000'000;
  const auto lost = yb::home_arm(rig.session, 1, rig.say);
  ASSERT_FALSE(lost);
  EXPECT_NE(lost.error().find("the bus has failed"), std::string::npos) << lost.error();
  EXPECT_FALSE(yb::home_arm(rig.session, 2, rig.say));
}

TEST(YoubotSetup, JogMovesOneDriveAndAJointStopsAtItsLimit) {
  SetupRig rig(yb::ChainKind::kBaseArm);
  ASSERT_TRUE(yb::commutate(rig.session, rig.say));
  const auto early = yb::jog(rig.session, 6, 0.1, 1);
  ASSERT_FALSE(early);
  EXPECT_NE(early.error().find("not homed"), std::string::npos);
  ASSERT_TRUE(yb::home_arm(rig.session, 1, rig.say));
  rig.remember();
  const auto wheel = yb::jog(rig.session, 1, 2.0, 1.0);
  ASSERT_TRUE(wheel) << wheel.error();
  const double turned = (rig.true_ticks(1) - rig.before[1]) / 4000 * 2 * std::numbers::pi / 25.838;
  EXPECT_NEAR(turned, 2.0, 0.02);
  EXPECT_LT(rig.travelled() - std::abs(rig.true_ticks(1) - rig.before[1]), 50) << "nobody else";
  // Joint 4 away from its stop: positive angles are negative ticks.
  const auto away = yb::jog(rig.session, 9, 0.5, 1.0);
  ASSERT_TRUE(away) << away.error();
  EXPECT_NEAR(rig.session.inputs(9).position_ticks, -0.5 / (2 * std::numbers::pi) * 71 * 4000, 300);
  const auto back = yb::jog(rig.session, 9, -0.5, 5.0);
  ASSERT_FALSE(back);
  EXPECT_NE(back.error().find("limit"), std::string::npos);
  EXPECT_LE(rig.session.inputs(9).position_ticks, yb::joint_facts(4).high_ticks + 20);
  EXPECT_LT(rig.true_ticks(9), stop_ticks(4)) << "it never saw the stop";
}

// Beyond a joint's speed nothing moves, and the line says which speed it may have.
TEST(YoubotSetup, JogHasEachDrivesOwnSpeedLimit) {
  SetupRig rig(yb::ChainKind::kBaseArm);
  ASSERT_TRUE(yb::commutate(rig.session, rig.say));
  ASSERT_TRUE(yb::home_arm(rig.session, 1, rig.say));
  rig.remember();
  for (const double speed : {1.6, -3.0, std::nan("")}) {
    const auto refused = yb::jog(rig.session, 9, speed, 0.1);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().find("arm 1 joint 4: "), std::string::npos);
    EXPECT_NE(refused.error().find("its limit of 1.57 rad/s"), std::string::npos)
        << refused.error();
  }
  EXPECT_LT(rig.travelled(), 5);
  EXPECT_TRUE(yb::jog(rig.session, 9, 1.5, 0.2));
  EXPECT_TRUE(yb::jog(rig.session, 1, -3.0, 0.1)) << "a wheel may";
  EXPECT_FALSE(yb::jog(rig.session, 1, 3.1, 0.1));
}

// A drive that brakes slowly is braked earlier: half the acceleration, twice the way.
TEST(YoubotSetup, JogBrakesByTheDrivesOwnAcceleration) {
  std::array<double, 2> short_of{};
  for (const std::size_t slow : {0U, 1U}) {
    SetupRig rig(yb::ChainKind::kBaseArm);
    ASSERT_TRUE(yb::commutate(rig.session, rig.say));
    ASSERT_TRUE(yb::home_arm(rig.session, 1, rig.say));
    ASSERT_TRUE(yb::jog(rig.session, 9, 1.0, 1.5));
    ASSERT_TRUE(rig.session.put(9, 11, slow == 1 ? 500 : 2000));
    rig.remember();
    ASSERT_FALSE(yb::jog(rig.session, 9, -1.0, 5.0));
    short_of[slow] = yb::joint_facts(4).high_ticks - rig.true_ticks(9) + stop_ticks(4);
  }
  // 678 rpm at 2000 rpm/s: 7660 ticks; at 500: 30600. The twin's motor brakes as it likes.
  EXPECT_GT(short_of[1], short_of[0] + 15000);
}

constexpr std::array<std::uint8_t, 2> kBothBars{0, 1};

// Found behind joint 5, read, set up as the reference has it; nothing without set_up_gripper().
TEST(YoubotSetup, EachArmsGripperIsFoundAndSetUp) {
  for (const auto kind : yb::kChainKinds) {
    SetupRig rig(kind);
    auto grippers = yb::look_at_grippers(rig.session);
    ASSERT_TRUE(grippers) << grippers.error();
    const std::size_t arms = kind == yb::ChainKind::kBase          ? 0
                             : kind == yb::ChainKind::kBaseTwoArms ? 2
                                                                   : 1;
    ASSERT_EQ(grippers.value().size(), arms);
    for (const yb::GripperReport& g : grippers.value()) {
      EXPECT_EQ(g.firmware.controller, 842);
      EXPECT_FALSE(g.calibrated);
      EXPECT_EQ(rig.session.boards()[g.position].number, 5);
      const auto gripper = [&](std::uint8_t type, std::uint8_t bar) {
        return rig.session.ask(g.position, {1, 6, type, bar, 0}).value();
      };
      EXPECT_EQ(gripper(174, 0), 0) << "looking changes nothing";
      // Somewhere: the zero is where it ends, closed.
      for (const std::uint8_t bar : kBothBars)
        ASSERT_TRUE(rig.session.ask(g.position, {1, 5, 1, bar, 4321}));
      rig.said.clear();
      const auto done = yb::set_up_gripper(rig.session, g, rig.say);
      ASSERT_TRUE(done) << done.error();
      EXPECT_EQ(rig.said.size(), 1U);
      for (const std::uint8_t bar : kBothBars) {
        EXPECT_EQ(gripper(174, bar), 50);
        EXPECT_EQ(gripper(173, bar), 1);
        EXPECT_EQ(gripper(1, bar), 0);
      }
    }
    grippers = yb::look_at_grippers(rig.session);
    ASSERT_TRUE(grippers) << grippers.error();
    for (const yb::GripperReport& g : grippers.value()) {
      EXPECT_TRUE(g.calibrated);
      rig.said.clear();
      EXPECT_TRUE(yb::set_up_gripper(rig.session, g, rig.say));
      EXPECT_TRUE(rig.said.empty()) << "no motion a second time";
    }
  }
}

}  // namespace
}  // namespace tests
