// A virtual chain without effects says byte for byte what it said before there were any.
#include "rt/hash.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

// All that a chain without effects says in three seconds of commands of every mode.
std::uint64_t hash_of_a_chain(bool stops, bool ideal) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBaseArm;
  c.end_stops = stops;
  rt::Startup startup;
  yb::YoubotChain::MotorMaker maker;
  if (ideal) maker = [](const yb::BoardPlace&) { return std::make_unique<yb::IdealMotor>(); };
  yb::YoubotChain chain(startup.token(), c, maker);
  ec::TwinPort port(chain.wire());
  ec::Master master(startup.token(), port);
  EXPECT_TRUE(master.find(startup.token()) && master.configure(startup.token()) &&
              master.start(startup.token()));
  rt::Hash64 hash;
  const std::array modes{yb::ControllerMode::kInitialise, yb::ControllerMode::kVelocity,
                         yb::ControllerMode::kPosition,   yb::ControllerMode::kCurrent,
                         yb::ControllerMode::kPwm,        yb::ControllerMode::kStop};
  const auto clear = drivers::tmcl::encode(drivers::tmcl::Request{0, 5, 158, 0, 1});
  std::size_t cleared = 0;
  for (int k = 0; k < 3000; ++k) {
    port.set_now(port.now() + (k == 2500 ? 150ms : 1ms));
    if (!master.mailbox().busy() && cleared < 11) {
      const bool posted = chain.drive(cleared) == nullptr || master.post(cleared, clear);
      EXPECT_TRUE(posted);
      ++cleared;
    }
    for (std::size_t i = 0; i < 11; ++i) {
      if (chain.drive(i) == nullptr) continue;
      const auto mode = k < 1000 ? modes[0] : modes[static_cast<std::size_t>(k / 300) % 6];
      const yb::DriveOutputs o{(k * 7 + static_cast<int>(i) * 131) % 2000 - 900, mode};
      EXPECT_TRUE(yb::encode(o, master.outputs(i)));
    }
    (void)master.exchange();
    for (std::size_t i = 0; i < 11; ++i)
      for (const std::uint8_t b : master.inputs(i)) hash.value(b);
  }
  return hash.digest();
}

TEST(ChainWithoutEffects, EveryByteIsWhatItWas) {
  EXPECT_EQ(hash_of_a_chain(false, false), hash_of_a_chain(false, true));
  // Of the tree before there were effects.
  EXPECT_EQ(hash_of_a_chain(false, false), 5472050167800652615ULL);
  EXPECT_EQ(hash_of_a_chain(true, false), 680379027754011984ULL);
}

}  // namespace
}  // namespace tests
