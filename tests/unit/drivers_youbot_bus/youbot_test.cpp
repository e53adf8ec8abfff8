// A whole youBot behind robot_io's interface: which one it is, what is refused, the arm at rest.
#include "drivers/youbot_bus/ethercat_youbot.hpp"

#include <gtest/gtest.h>

#include <thread>

#include "drivers/ethercat/twin/twin_port.hpp"
#include "drivers/youbot/motor_flags.hpp"
#include "drivers/youbot_bus/drive_session.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"

namespace tests {
namespace {

using namespace std::chrono_literals;
using drivers::BusStatus;
using drivers::MotorMode;
using drivers::MotorSetpoints;
using drivers::MotorStates;
namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

// A motor that counts whether it was ever told to turn.
class WatchedMotor final : public yb::DriveMotor {
 public:
  explicit WatchedMotor(int& told) : told_(told) {}
  void shift(double ticks) { motion_.position_ticks += ticks; }
  void command(const yb::MotorCommand& c, rt::Time) noexcept override {
    if (c.mode != yb::ControllerMode::kStop) ++told_;
  }
  yb::MotorMotion motion(rt::Time) noexcept override { return motion_; }

 private:
  int& told_;
  yb::MotorMotion motion_;
};

struct YoubotRig {
  explicit YoubotRig(yb::YoubotChainConfig c, const yb::YoubotConfig& y = {}, bool ready = true) {
    c.initialised = ready;
    chain = std::make_unique<yb::YoubotChain>(startup.token(), c, [&](const yb::BoardPlace& b) {
      (void)b;
      auto m = std::make_unique<WatchedMotor>(told);
      motors.push_back(m.get());
      return m;
    });
    auto made = std::make_unique<ec::TwinPort>(chain->wire());
    port = made.get();
    auto opened = yb::EtherCatYoubot::open(startup.token(), std::move(made), y);
    if (opened)
      bot = std::move(opened.value());
    else
      error = opened.error();
  }
  static yb::YoubotChainConfig chain_of(yb::ChainKind k, yb::Generation g = yb::Generation::kNew) {
    yb::YoubotChainConfig c;
    c.kind = k;
    c.generation = g;
    return c;
  }
  BusStatus job(MotorMode mode, double rad_per_s = 0) {
    port->set_now(port->now() + 1ms);
    const auto in = bot->sense(port->now(), states);
    MotorSetpoints s{mode, {}};
    s.wheel_rad_per_s.fill(rad_per_s);
    const auto out = bot->act(port->now(), s);
    return in != BusStatus::kOk ? in : out;
  }
  [[nodiscard]] yb::DriveOutputs told_to(std::size_t slave) const {
    yb::DriveOutputs o;
    EXPECT_TRUE(yb::decode(bot->master().outputs(slave), o));
    return o;
  }
  rt::Startup startup;
  int told = 0;
  std::vector<WatchedMotor*> motors;  // by drive, wheels first
  std::unique_ptr<yb::YoubotChain> chain;
  ec::TwinPort* port = nullptr;
  std::unique_ptr<yb::EtherCatYoubot> bot;
  std::string error;
  MotorStates states;
};

TEST(EtherCatYoubot, EachLayoutByItsNames) {
  for (const auto g : {yb::Generation::kOld, yb::Generation::kNew}) {
    for (const auto k :
         {yb::ChainKind::kBase, yb::ChainKind::kBaseArm, yb::ChainKind::kBaseTwoArms}) {
      for (const std::size_t bytes : {16U, 20U, 32U}) {
        auto c = YoubotRig::chain_of(k, g);
        c.input_bytes = bytes;
        YoubotRig rig(c);
        ASSERT_TRUE(rig.bot) << rig.error;
        EXPECT_EQ(rig.bot->kind(), k);
        rig.motors[2]->shift(2000);
        EXPECT_EQ(rig.job(MotorMode::kVelocity, 3), BusStatus::kOk);
        EXPECT_NEAR(rig.states.wheel_rad[2], 2000 * 2 * 3.14159265 / 4000 / 25.838, 1e-3);
        for (std::size_t s = 1; s <= 4; ++s)
          EXPECT_EQ(rig.told_to(s).mode, yb::ControllerMode::kVelocity);
      }
    }
  }
}

TEST(EtherCatYoubot, WrongChainsAreNamedAndNothingTurns) {
  YoubotRig arm(YoubotRig::chain_of(yb::ChainKind::kArm));
  EXPECT_FALSE(arm.bot);
  EXPECT_NE(arm.error.find("no wheels"), std::string::npos) << arm.error;
  yb::YoubotConfig wants;
  wants.chain = "base+arm";
  YoubotRig base(YoubotRig::chain_of(yb::ChainKind::kBase), wants);
  EXPECT_FALSE(base.bot);
  EXPECT_NE(base.error.find("slave 6: arm 1 master board"), std::string::npos) << base.error;
  EXPECT_EQ(arm.told + base.told, 0);
}

// Finding the commutation moves a motor: not without a person's word.
TEST(EtherCatYoubot, NoCommutationIsRefusedWithoutMotion) {
  YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBaseArm), {}, false);
  EXPECT_FALSE(rig.bot);
  EXPECT_NE(rig.error.find("wheel front left has no commutation"), std::string::npos) << rig.error;
  EXPECT_EQ(rig.told, 0);
}

TEST(EtherCatYoubot, TheArmHoldsWhereItIsWithTheWheelsOff) {
  YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBaseTwoArms));
  ASSERT_TRUE(rig.bot) << rig.error;
  // Somebody pushes: what is held stays, and is not what is measured.
  for (std::size_t d = 4; d < rig.motors.size(); ++d) rig.motors[d]->shift(700);
  const auto holds = [&] {
    for (const std::size_t first : {6U, 12U})
      for (std::size_t j = 0; j < 5; ++j)
        EXPECT_EQ(rig.told_to(first + j), (yb::DriveOutputs{0, yb::ControllerMode::kPosition}));
  };
  for (const auto mode : {MotorMode::kStop, MotorMode::kVelocity}) {
    EXPECT_EQ(rig.job(mode, 1), BusStatus::kOk);
    holds();
  }
  rig.bot->make_safe();
  EXPECT_EQ(rig.job(MotorMode::kVelocity, 1), BusStatus::kOk);
  holds();
  for (std::size_t w = 1; w <= 4; ++w) EXPECT_EQ(rig.told_to(w), yb::DriveOutputs{});
  rig.port->faults().lose_back = 1;
  EXPECT_EQ(rig.job(MotorMode::kStop), BusStatus::kFrameLost);
  holds();
}

// The power goes and comes: encoders begin anew, and so does what is held.
TEST(EtherCatYoubot, AfterThePowerWasOffTheArmHoldsItsNewPosition) {
  YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBaseArm));
  ASSERT_TRUE(rig.bot) << rig.error;
  for (int i = 0; i < 10; ++i) ASSERT_EQ(rig.job(MotorMode::kStop), BusStatus::kOk);
  for (std::size_t d = 4; d < rig.motors.size(); ++d) rig.motors[d]->shift(700);
  EXPECT_EQ(rig.job(MotorMode::kStop), BusStatus::kOk);
  rig.chain->emergency_stop();
  for (int i = 0; i < 200; ++i) EXPECT_EQ(rig.job(MotorMode::kVelocity, 1), BusStatus::kDown);
  rig.chain->release_emergency_stop(rig.port->now());
  for (int i = 0; i < 50; ++i) EXPECT_EQ(rig.job(MotorMode::kVelocity, 1), BusStatus::kDown);
  // It sinks behind the boards' new zero.
  for (std::size_t d = 4; d < rig.motors.size(); ++d) rig.motors[d]->shift(300);
  rig.bot->rearm();
  int jobs = 0;
  for (; jobs < 3000 && rig.told_to(6).mode != yb::ControllerMode::kPosition; ++jobs) {
    (void)rig.job(MotorMode::kStop);
    for (std::size_t j = 6; j < 11; ++j) {
      yb::DriveInputs in;
      ASSERT_TRUE(yb::decode(rig.bot->master().inputs(j), in));
      const auto o = rig.told_to(j);
      ASSERT_TRUE(o.mode == yb::ControllerMode::kStop || o.value == in.position_ticks) << j;
    }
  }
  EXPECT_LT(jobs, 3000);
  EXPECT_EQ(rig.told_to(6).value, 300) << "not the 0 of before, nor its 700";
}

// A bit that a board's firmware sets without a meaning, as the scene says: neither a wheel's nor a
// joint's stops the robot. Nothing else is hidden.
TEST(EtherCatYoubot, IgnoredFlagsAreNoFaults) {
  yb::YoubotConfig c;
  c.ignored_flags = 1U << 6U | 1U << 12U;
  for (const bool ignored : {true, false}) {
    YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBaseArm), ignored ? c : yb::YoubotConfig{});
    ASSERT_TRUE(rig.bot) << rig.error;
    rig.chain->drive(2)->set_faults(1U << 6U | 1U << 3U, rig.port->now());
    rig.chain->drive(7)->set_faults(1U << 12U, rig.port->now());
    rig.port->set_now(rig.port->now() + 1ms);
    ASSERT_EQ(rig.bot->sense(rig.port->now(), rig.states), BusStatus::kOk);
    EXPECT_EQ(rig.bot->detail().trouble,
              ignored ? drivers::BusTrouble::kNone : drivers::BusTrouble::kJointFault);
    const std::uint32_t told = rig.states.flags[1] & drivers::motor_flag::kFaults;
    EXPECT_EQ(told, ignored ? 1U << 3U : 1U << 6U | 1U << 3U);
  }
}

TEST(EtherCatYoubot, DrivesThatMayTakeTooMuchCurrentAreRefused) {
  for (const int most_mA : {7999, 8000}) {
    yb::YoubotConfig c;
    c.most_current_mA = most_mA;
    YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBaseArm), c);
    EXPECT_EQ(rig.bot != nullptr, most_mA == 8000) << rig.error;
    if (!rig.bot) {
      EXPECT_NE(rig.error.find("wheel front left may take 8000 mA"), std::string::npos)
          << rig.error;
    }
  }
}

TEST(EtherCatYoubot, FreeIsZeroTorqueOnlyWithTheWheelsOff) {
  yb::YoubotConfig c;
  c.arm_rest = yb::ArmRest::kFree;
  YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBaseArm), c);
  ASSERT_TRUE(rig.bot) << rig.error;
  EXPECT_EQ(rig.job(MotorMode::kStop), BusStatus::kOk);
  EXPECT_EQ(rig.told_to(7), (yb::DriveOutputs{0, yb::ControllerMode::kCurrent}));
  EXPECT_EQ(rig.job(MotorMode::kVelocity, 1), BusStatus::kOk);
  EXPECT_EQ(rig.told_to(7).mode, yb::ControllerMode::kPosition);
}

// The wire outlives the robot's bus: what is left of it.
TEST(EtherCatYoubot, ItsEndIsMotorStopAndSafeop) {
  for (const bool kept : {false, true}) {
    YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBaseArm));
    ASSERT_TRUE(rig.bot) << rig.error;
    if (kept)
      rig.bot->keep_alive(rig.startup.token());
    else
      EXPECT_EQ(rig.job(MotorMode::kVelocity, 3), BusStatus::kOk);
    rig.bot.reset();
    for (std::size_t i = 0; i < rig.chain->boards().size(); ++i) {
      EXPECT_EQ(rig.chain->wire().slave(i).al_status(), (ec::AlStatus{4, 0})) << i;
      if (rig.chain->drive(i) == nullptr) continue;
      const auto memory = rig.chain->wire().slave(i).memory();
      for (std::size_t b = 0x1100; b < 0x1105; ++b) EXPECT_EQ(memory[b], 0) << i;
    }
  }
}

// From the keeper's hand to the owner's.
TEST(EtherCatYoubot, TheKeeperHandsOver) {
  YoubotRig rig(YoubotRig::chain_of(yb::ChainKind::kBase));
  ASSERT_TRUE(rig.bot) << rig.error;
  rig.bot->keep_alive(rig.startup.token());
  BusStatus s = BusStatus::kFrameLost;
  for (int i = 0; i < 10000 && s == BusStatus::kFrameLost; ++i) {
    s = rig.bot->sense(rt::time_from_ns(1'000'000'000), rig.states);
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_EQ(s, BusStatus::kOk);
}

}  // namespace
}  // namespace tests
