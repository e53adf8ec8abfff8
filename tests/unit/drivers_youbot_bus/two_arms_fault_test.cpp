// Faults of the second arm of a youBot with two: each is named with its slave, and the arm by the
// chain's layout; the rest of the robot keeps out of it. As fault_test.cpp has it for the first.
#include "drivers/tmcl/motor_faults.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

using drivers::tmcl::Command;
using yb::ControllerMode;

// 17 slaves, from 0: the second arm's board is 11, its joints are 12 to 16.
constexpr std::size_t kWheel = 1, kArm2 = 11, kArm1Joint3 = 8, kArm2Joint3 = 14;

struct TwoArmRig : BusRig {
  static yb::YoubotChainConfig layout() {
    yb::YoubotChainConfig c;
    c.kind = yb::ChainKind::kBaseTwoArms;
    return c;
  }
  TwoArmRig() : BusRig(layout()) {
    bring_up();
    EXPECT_EQ(master.slaves().size(), 17U);
  }
  [[nodiscard]] std::string name(int slave) const {
    return slave < 0 ? "nobody" : chain.boards()[static_cast<std::size_t>(slave)].name();
  }
  [[nodiscard]] int recover() {
    master.recover();
    int k = 0;
    for (; k < 3000 && master.recovering(); ++k) (void)cycle();
    return k;
  }
};

TEST(YoubotTwoArms, ASlaveOfTheSecondArmThatFallsIsNamedWithIt) {
  TwoArmRig rig;
  for (std::size_t i = kArm2; i < 17; ++i) {
    rig.chain.wire().slave(i).fall(0x0050, rig.port.now());
    (void)rig.cycle();
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kSlaveState) << "somebody, at once";
    int cycles = 1;
    for (; cycles < 50 && rig.master.health().slave < 0; ++cycles) (void)rig.cycle();
    EXPECT_LE(cycles, 18) << "a cycle asks one of 17; slave " << i;
    ASSERT_EQ(rig.master.health().slave, static_cast<int>(i));
    EXPECT_EQ(rig.name(rig.master.health().slave),
              i == kArm2 ? "arm 2 master board" : "arm 2 joint " + std::to_string(i - kArm2));
    EXPECT_EQ(rig.health().rfind("slave " + std::to_string(i + 1) + " ", 0), 0U) << rig.health();
    EXPECT_NE(rig.health().find("SAFEOP + ERROR, code 0x0050"), std::string::npos) << rig.health();
    for (std::size_t k = 0; k < 17; ++k)
      EXPECT_EQ(rig.chain.wire().slave(k).al_status().is() == ec::AlState::kOp, k != i) << k;
    EXPECT_LT(rig.recover(), 1000);
    EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
  }
}

// The drive that tripped stands; the same joint of the other arm turns on.
TEST(YoubotTwoArms, AThermalTripOfTheSecondArmIsItsAlone) {
  TwoArmRig rig;
  rig.make_ready();
  for (const std::size_t s : {kArm1Joint3, kArm2Joint3}) rig.set(s, ControllerMode::kVelocity, 300);
  rig.cycles(100);
  EXPECT_EQ(rig.inputs(kArm2Joint3).velocity_rpm, 300);
  rig.chain.drive(kArm2Joint3)->trip_i2t(rig.port.now());
  rig.cycles(10);
  for (std::size_t s = 0; s < 17; ++s) {
    if (rig.chain.drive(s) == nullptr) continue;
    const auto faults = drivers::tmcl::faults_of(rig.inputs(s).flags);
    ASSERT_EQ(faults.count, s == kArm2Joint3 ? 1 : 0) << rig.name(static_cast<int>(s));
    if (s == kArm2Joint3) {
      EXPECT_STREQ(faults.entry[0]->name, "I2t exceeded");
    }
  }
  EXPECT_EQ(rig.name(kArm2Joint3), "arm 2 joint 3");
  EXPECT_EQ(rig.inputs(kArm2Joint3).velocity_rpm, 0);
  EXPECT_EQ(rig.inputs(kArm1Joint3).velocity_rpm, 300);
  // The act, before and after the winding has cooled.
  for (const bool cool : {false, true}) {
    if (cool) rig.cycles(1000);
    EXPECT_EQ(rig.tmcl(kArm2Joint3, Command::kSetAxisParameter, 29, 0).status, 100);
    rig.cycles(2);
    EXPECT_EQ(drivers::tmcl::fault_bits(rig.inputs(kArm2Joint3).flags) == 0, cool);
  }
  rig.cycles(20);
  EXPECT_EQ(rig.inputs(kArm2Joint3).velocity_rpm, 300);
}

// Base and first arm stay in OP and are told to stop; the second arm stops by its own watchdog.
TEST(YoubotTwoArms, ACutBetweenTheArmsNamesTheSecondOne) {
  TwoArmRig rig;
  rig.make_ready();
  for (const std::size_t s : {kWheel, kArm1Joint3, kArm2Joint3})
    rig.set(s, ControllerMode::kVelocity, 300);
  rig.cycles(100);
  rig.chain.wire().cut_behind(kArm2);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kShort);
  EXPECT_EQ(rig.master.present(), 11);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kSlavesMissing);
  EXPECT_EQ(rig.name(rig.master.health().slave), "arm 2 master board");
  EXPECT_EQ(rig.health().rfind("slave 12 ", 0), 0U) << rig.health();
  rig.cycles(200);
  EXPECT_TRUE(rig.master.stopped());
  for (const std::size_t s : {kWheel, kArm1Joint3}) {
    EXPECT_EQ(rig.chain.wire().slave(s).al_status().is(), ec::AlState::kOp);
    EXPECT_EQ(rig.chain.drive(s)->command().mode, ControllerMode::kStop);
  }
  EXPECT_NE(rig.chain.drive(kArm2Joint3)->flags(rig.port.now()) & (1U << 16U), 0U);
  EXPECT_EQ(rig.chain.drive(kArm2Joint3)->command().mode, ControllerMode::kStop);
  rig.chain.wire().cut_behind(17);
  rig.cycles(50);
  EXPECT_TRUE(rig.master.stopped()) << "an act, not a cable";
  EXPECT_LT(rig.recover(), 1000);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
  // Only who heard nothing has latched its timeout.
  EXPECT_EQ(drivers::tmcl::fault_bits(rig.inputs(kArm1Joint3).flags), 0U);
  EXPECT_EQ(drivers::tmcl::fault_bits(rig.inputs(kArm2Joint3).flags), 1U << 16U);
  EXPECT_EQ(rig.tmcl(kArm2Joint3, Command::kSetAxisParameter, 158, 1).status, 100);
  rig.cycles(2);
  EXPECT_EQ(drivers::tmcl::fault_bits(rig.inputs(kArm2Joint3).flags), 0U);
}

}  // namespace
}  // namespace tests
