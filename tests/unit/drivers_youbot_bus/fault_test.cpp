// Every fault of the chain: seen within its bound, named, and recovered from by an act.
//   working counter 1 cycle   AL state 12 cycles, that somebody fell 1 cycle   a cut names its
//   place in 1 cycle   lost frames: each counted, 100 in a row stop
#include "drivers/tmcl/motor_faults.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

using drivers::tmcl::Command;
using yb::ControllerMode;

constexpr std::size_t kWheel = 1, kJoint5 = 10;

TEST(YoubotBusFaults, ALostFrameIsCountedAndNothingElse) {
  BusRig rig;
  rig.bring_up();
  rig.make_ready();
  rig.set(kWheel, ControllerMode::kVelocity, 600);
  rig.cycles(500);
  const auto before = rig.master.counters();
  for (const bool out : {true, false}) {
    (out ? rig.port.faults().lose_out : rig.port.faults().lose_back) = 1;
    const auto old = rig.inputs(kWheel);
    EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kLost);
    EXPECT_EQ(rig.inputs(kWheel), old) << "the last good inputs stay";
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kFramesLost);
    EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone);
  }
  EXPECT_EQ(rig.master.counters().lost, before.lost + 2);
  EXPECT_EQ(rig.master.counters().short_counter, before.short_counter);
  EXPECT_FALSE(rig.master.stopped());
  EXPECT_EQ(rig.inputs(kWheel).velocity_rpm, 600);
}

TEST(YoubotBusFaults, LateAndDoubledFramesAreLeft) {
  BusRig rig;
  rig.bring_up();
  const auto foreign = rig.master.frames().foreign;
  rig.port.faults().delay = 1;
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kLost);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.frames().foreign, foreign + 1);
  rig.port.faults().duplicate = 1;
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.frames().foreign, foreign + 2);
}

// Whatever byte of its heads is wrong: the inputs are those of a good frame, or the frame is lost.
TEST(YoubotBusFaults, ADamagedFrameIsNeverBelieved) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    static BusRig rig;
    if (seed == 1) rig.bring_up();
    rig.cycles(2);
    rig.port.faults().seed = seed;
    rig.port.faults().corrupt = 1;
    const auto before = rig.inputs(kWheel);
    const auto r = rig.cycle();
    EXPECT_TRUE(r.status == ec::CycleStatus::kOk || r.status == ec::CycleStatus::kLost)
        << "seed " << seed;
    EXPECT_EQ(rig.inputs(kWheel).position_ticks, before.position_ticks) << "seed " << seed;
    EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk) << "seed " << seed;
    if (seed == 200) {
      EXPECT_GT(rig.master.counters().lost, 100U);
    }
  }
}

TEST(YoubotBusFaults, AWrongCounterIsSeenInItsCycle) {
  BusRig rig;
  rig.bring_up();
  rig.port.faults().wrong_counter = 1;
  const auto r = rig.cycle();
  EXPECT_EQ(r.status, ec::CycleStatus::kShort);
  EXPECT_EQ(r.counter, 26);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kWorkingCounter);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.counters().short_counter, 1U);
}

TEST(YoubotBusFaults, HundredLostInARowStopAndOnlyAnActRecovers) {
  BusRig rig;
  rig.bring_up();
  rig.make_ready();
  rig.set(kWheel, ControllerMode::kVelocity, 600);
  rig.cycles(100);
  // A frame within the drives' watchdog (100 ms), and all is well.
  rig.port.faults().lose_out = 98;
  rig.cycles(98);
  EXPECT_FALSE(rig.master.stopped());
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  rig.port.faults().lose_out = 100;
  rig.cycles(99);
  EXPECT_FALSE(rig.master.stopped());
  rig.cycles(1);
  EXPECT_TRUE(rig.master.stopped());
  // Frames come again: the slaves' watchdog (100 ms) has bitten, and nothing moves by itself.
  rig.cycles(50);
  EXPECT_TRUE(rig.master.stopped());
  rig.set(kWheel, ControllerMode::kVelocity, 600);
  (void)rig.cycle();
  for (const auto b : rig.master.outputs(kWheel)) EXPECT_EQ(b, 0);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kSlaveState);
  EXPECT_NE(rig.health().find("SAFEOP + ERROR, code 0x001B: sync manager watchdog"),
            std::string::npos)
      << rig.health();
  rig.master.recover();
  for (int i = 0; i < 2000 && rig.master.recovering(); ++i) (void)rig.cycle();
  EXPECT_FALSE(rig.master.stopped());
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
  // The motors' own timeout is latched and named.
  const auto faults = drivers::tmcl::faults_of(rig.inputs(kWheel).flags);
  ASSERT_EQ(faults.count, 1);
  EXPECT_STREQ(faults.entry[0]->name, "EtherCAT timeout");
  EXPECT_EQ(rig.tmcl(kWheel, Command::kSetAxisParameter, 158, 1).status, 100);
  rig.cycles(2);
  EXPECT_EQ(drivers::tmcl::fault_bits(rig.inputs(kWheel).flags), 0U);
}

// A gap of 50 ms is held, one of 200 ms stops the drives.
TEST(YoubotBusFaults, GapsInTraffic) {
  BusRig rig;
  rig.bring_up();
  rig.make_ready();
  rig.set(kWheel, ControllerMode::kVelocity, 600);
  rig.cycles(100);
  rig.pause(50ms);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone);
  EXPECT_EQ(rig.inputs(kWheel).velocity_rpm, 600);
  const auto before = rig.inputs(kWheel).position_ticks;
  rig.pause(200ms);
  const auto r = rig.cycle();
  EXPECT_EQ(r.status, ec::CycleStatus::kShort) << "in SAFEOP + ERROR they take no outputs";
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kSlaveState) << "in its first cycle";
  EXPECT_EQ(rig.master.read_inputs().status, ec::CycleStatus::kOk) << "and tell their inputs";
  EXPECT_EQ(rig.inputs(kWheel).velocity_rpm, 0);
  // It stopped 100 ms after the last frame, not when the next one came: 600 rpm are 40000 ticks/s.
  EXPECT_NEAR(rig.inputs(kWheel).position_ticks - before, 4000 + 120, 100);
  EXPECT_EQ(rig.chain.wire().slave(kWheel).memory()[0x0442], 1) << "watchdog counter";
}

TEST(YoubotBusFaults, ASlaveThatFallsIsNamedWithinTwelveCycles) {
  for (std::size_t i = 0; i < 11; ++i) {
    BusRig rig;
    rig.bring_up();
    rig.chain.wire().slave(i).fall(0x0050, rig.port.now());
    (void)rig.cycle();
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kSlaveState) << "somebody, at once";
    int cycles = 1;
    for (; cycles < 50 && rig.master.health().slave < 0; ++cycles) (void)rig.cycle();
    EXPECT_LE(cycles, 12) << "slave " << i;
    EXPECT_EQ(rig.master.health().slave, static_cast<int>(i));
    EXPECT_EQ(rig.master.health().al.code, 0x0050);
    EXPECT_NE(rig.health().find("EEPROM no access"), std::string::npos) << rig.health();
    rig.master.recover();
    for (int k = 0; k < 2000 && rig.master.recovering(); ++k) (void)rig.cycle();
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
  }
}

TEST(YoubotBusFaults, ACutNamesItsPlaceInOneCycle) {
  BusRig rig;
  rig.bring_up();
  for (std::size_t n = 0; n < 11; ++n) {
    rig.chain.wire().cut_behind(n);
    const auto r = rig.cycle();
    // No slave at all: the frame comes back from nobody, or not; the twin's comes back.
    EXPECT_EQ(r.status, n >= 11 ? ec::CycleStatus::kOk : ec::CycleStatus::kShort);
    EXPECT_EQ(rig.master.present(), static_cast<int>(n));
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kSlavesMissing);
    EXPECT_EQ(rig.master.health().slave, static_cast<int>(n));
    rig.chain.wire().cut_behind(11);
    (void)rig.cycle();
    EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
  }
  // The ports tell it too.
  rig.chain.wire().cut_behind(6);
  EXPECT_EQ(rig.master.registers().read_u16(0x1006, 0x0110).value_or(0), 0x5613);
  EXPECT_EQ(rig.master.registers().read_u16(0x1005, 0x0110).value_or(0), 0x5A33);
}

// One that was plugged in while the chain was in OP: counted in that cycle, and it is in INIT. None
// of those that were found is to blame; one that falls meanwhile still is.
TEST(YoubotBusFaults, ASlaveTooManyIsNamedInItsCycle) {
  BusRig rig;
  rig.bring_up();
  rig.chain.wire().add(std::make_unique<ec::Esc>(rig.startup.token(), ec::EscConfig{},
                                                 rig.chain.wire().slave(0).eeprom(),
                                                 std::make_unique<ec::EscApplication>()));
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk) << "its counter is nobody's";
  EXPECT_EQ(rig.master.present(), 12);
  ec::BusHealth h = rig.master.health();
  EXPECT_EQ(h.fault, ec::BusFault::kSlaveState);
  EXPECT_EQ(h.slave, 11) << "no slave of those that were found";
  EXPECT_EQ(h.too_many, 1);
  EXPECT_EQ(rig.health(), "12 slaves answer and 11 were found: 1 too many, plugged in since");
  rig.chain.wire().slave(4).fall(ec::al_code::kUnspecified, rig.port.now());
  rig.cycles(12);
  h = rig.master.health();
  EXPECT_EQ(h.slave, 4);
  EXPECT_EQ(h.too_many, 0);
  rig.chain.wire().cut_behind(11);
  rig.master.recover();
  for (int i = 0; i < 1000 && rig.master.recovering(); ++i) (void)rig.cycle();
  rig.cycles(12);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
}

TEST(YoubotBusFaults, EmergencyStopAndTheWayBack) {
  BusRig rig;
  rig.bring_up();
  rig.make_ready();
  rig.set(kWheel, ControllerMode::kVelocity, 600);
  rig.cycles(50);
  rig.chain.emergency_stop();
  (void)rig.cycle();
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kSlavesMissing);
  EXPECT_EQ(rig.master.health().slave, 1);
  rig.cycles(100);
  EXPECT_TRUE(rig.master.stopped());
  rig.chain.release_emergency_stop(rig.port.now());
  rig.cycles(20);
  EXPECT_TRUE(rig.master.stopped()) << "an act, not a timeout";
  rig.master.recover();
  int cycles = 0;
  for (; cycles < 5000 && rig.master.recovering(); ++cycles) (void)rig.cycle();
  EXPECT_LT(cycles, 1000);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone) << rig.health();
  for (std::size_t i = 0; i < 11; ++i)
    EXPECT_EQ(rig.chain.wire().slave(i).memory()[0x0500], 1) << "the EEPROM is slave " << i << "'s";
  // Power was off: commutation is to be found again, the timeout flag is set.
  EXPECT_EQ(rig.inputs(kWheel).flags & (1U << 15U), 0U);
  EXPECT_NE(rig.inputs(kWheel).flags & (1U << 16U), 0U);
  rig.make_ready();
  EXPECT_NE(rig.inputs(kJoint5).flags & (1U << 15U), 0U);
  EXPECT_EQ(rig.inputs(kJoint5).flags & (1U << 16U), 0U);
}

TEST(YoubotBusFaults, LinkLossAndReturn) {
  BusRig rig;
  rig.bring_up();
  rig.port.faults().link_down = true;
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kLinkDown);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kLinkDown);
  rig.cycles(10);
  EXPECT_EQ(rig.master.counters().link_down, 11U);
  rig.port.faults().link_down = false;
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone);
  EXPECT_FALSE(rig.master.stopped());
}

// ENOBUFS of a card whose queue is full: one frame is lost, and the cable is not out.
TEST(YoubotBusFaults, ARefusedFrameIsALostOne) {
  BusRig rig;
  rig.bring_up();
  rig.port.faults().refuse = 1;
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kLost);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kFramesLost);
  EXPECT_EQ(rig.master.frames().refused, 1U);
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.counters().link_down, 0U);
  // A card that goes on refusing sends nothing.
  rig.port.faults().refuse = 10;
  for (int i = 0; i < 10; ++i)
    EXPECT_EQ(rig.cycle().status, i < 2 ? ec::CycleStatus::kLost : ec::CycleStatus::kLinkDown) << i;
  EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  EXPECT_EQ(rig.master.health().fault, ec::BusFault::kNone);
}

// A card that is up and has no carrier takes every frame, and none comes back.
class NoCarrier final : public ec::Port {
 public:
  explicit NoCarrier(ec::TwinPort& wire) : wire_(wire) {}
  bool send(std::span<const std::uint8_t> f) noexcept override { return pulled || wire_.send(f); }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept override {
    return wire_.receive(into, deadline);
  }
  bool link_up() noexcept override { return ++asked, !pulled; }
  [[nodiscard]] rt::Time now() const noexcept override { return wire_.now(); }
  void sleep_until(rt::Time t) noexcept override { wire_.sleep_until(t); }
  bool pulled = false;
  int asked = 0;

 private:
  ec::TwinPort& wire_;
};

TEST(YoubotBusFaults, APulledCableIsALinkDownInItsCycleAndAGoodCycleDoesNotAsk) {
  BusRig rig;
  NoCarrier card(rig.port);
  ec::Master master(rig.startup.token(), card);
  ASSERT_TRUE(master.find(rig.startup.token()));
  ASSERT_TRUE(master.configure(rig.startup.token()));
  ASSERT_TRUE(master.start(rig.startup.token()));
  EXPECT_EQ(card.asked, 0);
  card.pulled = true;
  EXPECT_EQ(master.exchange().status, ec::CycleStatus::kLinkDown);
  EXPECT_EQ(master.health().fault, ec::BusFault::kLinkDown);
  EXPECT_EQ(card.asked, 1);
  // Two halves of a job: together no longer than two lost frames.
  const auto begun = rig.port.now();
  EXPECT_EQ(master.read_inputs().status, ec::CycleStatus::kLinkDown);
  EXPECT_EQ(master.write_outputs().status, ec::CycleStatus::kLinkDown);
  EXPECT_LE(rig.port.now() - begun, 750us + 10us);
  EXPECT_EQ(master.counters().link_down, 2U);
  EXPECT_EQ(master.counters().lost, 0U);
  card.pulled = false;
  EXPECT_EQ(master.exchange().status, ec::CycleStatus::kOk);
  EXPECT_EQ(master.health().fault, ec::BusFault::kNone);
  // Lost with a carrier is lost.
  rig.port.faults().lose_out = 1;
  EXPECT_EQ(master.exchange().status, ec::CycleStatus::kLost);
  EXPECT_EQ(master.health().fault, ec::BusFault::kFramesLost);
}

TEST(YoubotBusFaults, StuckEncoderAndThermalTrip) {
  BusRig rig;
  rig.bring_up();
  rig.make_ready();
  rig.set(kWheel, ControllerMode::kVelocity, 600);
  rig.cycles(200);
  rig.chain.drive(kWheel)->stick_encoder(true);
  (void)rig.cycle();
  const auto held = rig.inputs(kWheel).position_ticks;
  rig.cycles(100);
  EXPECT_EQ(rig.inputs(kWheel).position_ticks, held);
  rig.chain.drive(kWheel)->stick_encoder(false);
  rig.cycles(1);
  EXPECT_NEAR(rig.inputs(kWheel).position_ticks - held, 101 * 40, 50);
  rig.chain.drive(kWheel)->trip_i2t(rig.port.now());
  rig.cycles(10);  // down from 600 rpm in 6 ms
  const auto faults = drivers::tmcl::faults_of(rig.inputs(kWheel).flags);
  ASSERT_EQ(faults.count, 1);
  EXPECT_STREQ(faults.entry[0]->name, "I2t exceeded");
  EXPECT_EQ(rig.inputs(kWheel).velocity_rpm, 0);
  // Not before the winding has cooled.
  EXPECT_EQ(rig.tmcl(kWheel, Command::kSetAxisParameter, 29, 0).status, 100);
  rig.cycles(2);
  EXPECT_NE(drivers::tmcl::fault_bits(rig.inputs(kWheel).flags), 0U);
  rig.cycles(1000);
  EXPECT_EQ(rig.tmcl(kWheel, Command::kSetAxisParameter, 29, 0).status, 100);
  rig.cycles(2);
  EXPECT_EQ(drivers::tmcl::fault_bits(rig.inputs(kWheel).flags), 0U);
}

}  // namespace
}  // namespace tests
