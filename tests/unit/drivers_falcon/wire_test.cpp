// What happens to the answers on the wire: lost, damaged, impossible, silent, unplugged.
#include "tests/unit/drivers_falcon/device_rig.hpp"

namespace tests {
namespace {

TEST(FalconDevice, LostAnswersAreAskedForAgain) {
  Rig rig;
  rig.twin.faults().lose_answers = 1;
  rig.ticks(4);
  EXPECT_TRUE(rig.sample.repeated);
  EXPECT_GT(rig.device->counters().repeats, 0U);
  rig.ticks(10);
  EXPECT_FALSE(rig.sample.repeated);
  EXPECT_EQ(rig.device->counters().kicks, 1U);
  EXPECT_EQ(rig.device->counters().losses, 0U);
}

// Damaged, doubled, noisy answers in contact: no position that the hand was not at, no loss.
TEST(FalconDevice, DamagedAnswersNeverMoveTheHand) {
  const std::uint64_t seed = 522;
  rt::Random random(seed);
  FalconTwinConfig c = ready_twin();
  c.seed = seed;
  Rig rig(c);
  rig.enable();
  rig.push({0.05, 0.02, 0});
  int far = 0;
  for (int i = 0; i < 20000; ++i) {
    auto& faults = rig.twin.faults();
    switch (random.integer(0, 7)) {
      case 0:
        faults.damage_answers = 1;
        break;
      case 1:
        faults.noise_bytes = static_cast<std::uint32_t>(random.integer(1, 90));
        break;
      case 2:
        faults.double_answers = 1;
        break;
      case 3:
        faults.lose_answers = random.integer(0, 9) == 0 ? 1 : 0;
        break;
      case 4:
        faults.line_errors = 1;
        break;
      default:
        break;
    }
    if (i % 500 == 0) rig.push(Vec3(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), 0));
    rig.tick(-20 * rig.sample.p_DH);
    ASSERT_TRUE(rig.sensed);
    ASSERT_EQ(rig.sample.state, DeviceState::kForce) << "tick " << i << " seed " << seed;
    ASSERT_FALSE(rig.sample.button) << "tick " << i << " seed " << seed;
    // What may pass for a motion at twice the speed limit: 118 counts of one leg.
    const double off = (rig.sample.p_DH - rig.twin.plant().true_position()).norm();
    ASSERT_LT(off, 0.010) << "tick " << i << " seed " << seed;
    far += off > 0.001;
  }
  // 0.5 % of the frames carry a change that the format allows; beside it the hand moves on while an
  // answer is lost. 2 % of the ticks.
  EXPECT_LT(far, 400);
  const auto n = rig.device->counters();
  EXPECT_GT(n.damaged, 1000U);
  EXPECT_GT(n.leaps, 50U);
  EXPECT_GT(n.line_errors, 1000U);
  EXPECT_EQ(n.losses, 0U);
}

TEST(FalconDevice, ALastingSlipIsBelieved) {
  Rig rig;
  rig.twin.faults().slip_cnt = {0, 400, 0};
  rig.ticks(10);
  EXPECT_EQ(rig.device->counters().leaps, 3U);
  EXPECT_GT(rig.sample.p_DH.norm(), 0.003);
  EXPECT_FALSE(rig.sample.repeated);
}

TEST(FalconDevice, ImpossibleAnglesAreNoSample) {
  Rig rig;
  const Vec3 before = rig.sample.p_DH;
  rig.twin.faults().slip_cnt = {-3000, 2500, -3000};
  rig.ticks(20);
  EXPECT_GT(rig.device->counters().unsolved, 5U);
  EXPECT_TRUE(rig.sample.repeated);
  EXPECT_EQ(rig.sample.p_DH, before);
  rig.twin.faults().slip_cnt = {};
  rig.ticks(10);
  EXPECT_FALSE(rig.sample.repeated);
}

TEST(FalconDevice, SilenceIsALoss) {
  Rig rig;
  rig.enable();
  rig.held = true;
  rig.twin.faults().silent = true;
  rig.ticks(90);
  EXPECT_TRUE(rig.device->connected());
  rig.ticks(30);
  EXPECT_FALSE(rig.device->connected());
  EXPECT_FALSE(rig.sensed);
}

TEST(FalconDevice, UnpluggedInContactGoesLimpAndComesBack) {
  Rig rig;
  rig.enable();
  rig.twin.plant().set_external_force({1.5, 0, 0});
  const auto wall = [&] {
    const double depth = rig.sample.p_DH.x() - 0.002;
    return Vec3(depth > 0 ? -300 * depth : 0, 0, 0);
  };
  for (int i = 0; i < 1500; ++i) rig.tick(wall());
  ASSERT_NEAR(rig.twin.motor_force_D().x(), -1.5, 0.2);
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.faults().unplugged = true;
  }
  for (int i = 0; i < 10; ++i) {
    rig.tick(wall());
    EXPECT_FALSE(rig.sensed);
  }
  EXPECT_EQ(rig.device->counters().losses, 1U);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kDisconnect);
  std::this_thread::sleep_for(30ms);
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.plant().set_external_force(Vec3::Zero());
    rig.twin.faults().unplugged = false;  // the chip kept its power: firmware and marks are there
  }
  ASSERT_TRUE(rig.wait_until([&] { return rig.sensed; }));
  ASSERT_TRUE(rig.wait_until([&] { return rig.device->counters().reopened > 0; }));
  EXPECT_EQ(rig.device->counters().reopened, 1U);
  rig.ticks(10, {-1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  rig.enable();
  rig.ticks(5, {-1, 0, 0});
  EXPECT_NEAR(rig.twin.motor_force_D().x(), -1, 0.05);
}

// With the power gone the firmware is loaded again and the marks are looked for again.
TEST(FalconDevice, PowerCycleLoadsTheFirmwareAgain) {
  const FirmwareFile file;
  FalconTwinConfig c = ready_twin();
  c.firmware = file.bytes;
  FalconConfig d = quick_config();
  d.firmware = file.path;
  Rig rig(c, d);
  rig.enable();
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.faults().unplugged = true;
  }
  rig.ticks(5);
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.power_cycle();
    rig.twin.faults().unplugged = false;
  }
  ASSERT_TRUE(rig.wait_until([&] { return rig.sensed; }));
  EXPECT_TRUE(rig.twin.running());
  EXPECT_EQ(rig.sample.state, DeviceState::kReset);
}

}  // namespace
}  // namespace tests
