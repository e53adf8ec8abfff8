// The cycle: no allocation, no lock, no throw; mailbox beside process data; the same bytes twice.
#include "drivers/tmcl/tmcl_status.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using drivers::tmcl::Command;
using yb::ControllerMode;

// With lost frames, a fall, a recovery and a mailbox transfer under way; the chain's side included.
TEST(YoubotBusCycle, AllocatesNothing) {
  BusRig rig;
  rig.bring_up();
  const auto get = drivers::tmcl::encode(drivers::tmcl::Request{0, 6, 156, 0, 0});
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 2000; ++i) {
      if (i % 50 == 10) rig.port.faults().lose_back = 1;
      if (i % 100 == 20) (void)rig.master.post(3, get);
      if (i == 500) rig.chain.wire().slave(4).fall(0x001B, rig.port.now());
      if (i == 600) rig.master.recover();
      if (i == 900) rig.port.faults().lose_out = 150;
      if (i == 1100) rig.master.recover();
      if (i % 2 == 0) {
        (void)rig.cycle();
      } else {
        rig.port.set_now(rig.next += 1ms);
        (void)rig.master.read_inputs();
        (void)rig.master.write_outputs();
      }
      (void)rig.master.health();
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
  EXPECT_GT(rig.master.frames().lost, 150U);
}

TEST(YoubotBusCycle, SetpointsArriveAndPositionsComeBack) {
  for (const auto generation : {yb::Generation::kOld, yb::Generation::kNew}) {
    yb::YoubotChainConfig c;
    c.generation = generation;
    BusRig rig(c);
    rig.bring_up();
    rig.make_ready();
    const auto start = rig.inputs(1).position_ticks;
    rig.set(1, ControllerMode::kVelocity, 600);
    rig.set(10, ControllerMode::kPosition, -5000);
    rig.cycles(1001);
    EXPECT_EQ(rig.inputs(1).velocity_rpm, 600);
    EXPECT_NEAR(rig.inputs(1).position_ticks - start, 40000, 200);  // 10 turns of 4000 ticks
    EXPECT_NEAR(rig.inputs(10).position_ticks, -5000, 6);
    EXPECT_NE(rig.inputs(10).flags & (1U << 14U), 0U) << "position reached";
    EXPECT_EQ(rig.inputs(2).velocity_rpm, 0) << "nobody else moves";
    const auto target = rig.inputs(10).target_position_ticks;
    EXPECT_EQ(target, generation == yb::Generation::kOld ? 0 : -5000) << "1.48 has no targets";
  }
}

// Before the timeout flag is cleared and the commutation found, nothing turns.
TEST(YoubotBusCycle, ADriveThatIsNotReadyStands) {
  BusRig rig;
  rig.bring_up();
  rig.set(1, ControllerMode::kVelocity, 600);
  rig.cycles(300);
  EXPECT_EQ(rig.inputs(1).velocity_rpm, 0);
  EXPECT_NE(rig.inputs(1).flags & (1U << 16U), 0U);
  EXPECT_EQ(rig.tmcl(1, Command::kSetAxisParameter, 158, 1).status, 100);
  rig.cycles(400);  // firmware 2.00 finds the commutation by mode 2
  EXPECT_EQ(rig.inputs(1).velocity_rpm, 600);
}

TEST(YoubotBusCycle, TmclBesideProcessData) {
  BusRig rig;
  rig.bring_up();
  namespace status = drivers::tmcl::status;
  EXPECT_EQ(rig.tmcl(1, Command::kGetAxisParameter, 250).value, 4000);
  EXPECT_EQ(rig.tmcl(1, Command::kSetAxisParameter, 11, 1234).status, status::kOk);
  EXPECT_EQ(rig.tmcl(1, Command::kGetAxisParameter, 11).value, 1234);
  EXPECT_EQ(rig.tmcl(2, Command::kGetAxisParameter, 11).value, 2000) << "another slave's";
  EXPECT_EQ(rig.tmcl(1, Command::kSetAxisParameter, 11, 200000).status, status::kInvalidValue);
  EXPECT_EQ(rig.tmcl(1, Command::kSetAxisParameter, 250, 1).status, status::kPasswordProtected);
  EXPECT_EQ(rig.tmcl(1, Command::kSetAxisParameter, 3, 1).status, status::kWrongType);
  EXPECT_EQ(rig.tmcl(1, Command::kGetAxisParameter, 100).status, status::kWrongType);
  EXPECT_EQ(rig.tmcl(1, Command::kGetGlobal, 90).value, 100);
  EXPECT_EQ(rig.tmcl(1, Command::kSetGlobal, 16, 1, 2).status, status::kOk);
  EXPECT_EQ(rig.tmcl(1, Command::kGetGlobal, 16, 0, 2).value, 1);
  EXPECT_EQ(rig.tmcl(1, Command::kSetGlobal, 3, 1, 2).status, status::kPasswordProtected);
  EXPECT_EQ(rig.master.counters().lost, 0U);
  EXPECT_EQ(rig.master.counters().short_counter, 0U);
}

// Lost frames at random: every reply is the right one, or the transfer says that there is none.
TEST(YoubotBusCycle, MailboxThroughALossyWire) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    BusRig rig;
    rig.bring_up();
    rt::Random random(seed);
    int done = 0;
    for (std::int32_t k = 0; k < 40; ++k) {
      const auto slave = static_cast<std::size_t>(random.integer(1, 4));
      const drivers::tmcl::Request set{0, 5, 11, 0, 1000 + k};
      ASSERT_TRUE(rig.master.post(slave, drivers::tmcl::encode(set)));
      while (rig.master.mailbox().busy()) {
        if (random.uniform() < 0.2) rig.port.faults().lose_out = 1;
        if (random.uniform() < 0.2) rig.port.faults().lose_back = 1;
        (void)rig.cycle();
      }
      if (rig.master.mailbox().state() != ec::TransferState::kDone) continue;
      drivers::tmcl::Reply reply;
      ASSERT_TRUE(drivers::tmcl::decode(rig.master.mailbox().reply(), reply));
      EXPECT_TRUE(answers(reply, set)) << "seed " << seed << ", request " << k;
      ++done;
    }
    EXPECT_GT(done, 25) << "seed " << seed;
    EXPECT_GT(rig.master.mailbox().repeats(), 0U) << "seed " << seed;
  }
}

std::uint64_t hash_of_a_run() {
  BusRig rig;
  rig.bring_up();
  rig.make_ready();
  rt::Hash64 hash;
  rt::Random random(7);
  for (int i = 0; i < 500; ++i) {
    const auto slave = static_cast<std::size_t>(random.integer(1, 4));
    rig.set(slave, ControllerMode::kVelocity,
            static_cast<std::int32_t>(random.integer(-2000, 2000)));
    if (random.uniform() < 0.05) rig.port.faults().lose_back = 1;
    (void)rig.cycle();
    for (std::size_t s = 0; s < 11; ++s)
      hash.bytes(rig.master.inputs(s).data(), rig.master.inputs(s).size());
  }
  return hash.digest();
}

TEST(YoubotBusCycle, TheSameBytesTwice) { EXPECT_EQ(hash_of_a_run(), hash_of_a_run()); }

}  // namespace
}  // namespace tests
