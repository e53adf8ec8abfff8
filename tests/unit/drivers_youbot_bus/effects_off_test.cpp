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
  c.esc.error_closes_outputs = false;  // the tree before there were effects knew no other
  rt::Startup startup;
  yb::YoubotChain::MotorMaker maker;
  if (ideal) maker = [](const yb::BoardPlace&) { return std::make_unique<yb::IdealMotor>(); };
  yb::YoubotChain chain(startup.token(), c, maker);
  ec::TwinPort port(chain.wire());
  ec::Master master(startup.token(), port);
  EXPECT_TRUE(master.find(startup.token()) && master.configure(startup.token()) &&
              master.start(startup.token()));
  // From one instant on, however many frames the set-up takes.
  for (auto t = rt::time_from_ns(1'000'000'000); t <= rt::time_from_ns(2'000'000'000); t += 1ms) {
    if (t <= port.now()) continue;
    port.set_now(t);
    (void)master.exchange();
  }
  port.set_now(rt::time_from_ns(2'001'000'000));
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
  // As the tree before there were effects says it; the master of that tree and this one agree.
  EXPECT_EQ(hash_of_a_chain(false, false), 9657777787882625498ULL);
  EXPECT_EQ(hash_of_a_chain(true, false), 6982924475481576948ULL);
}

}  // namespace
}  // namespace tests
