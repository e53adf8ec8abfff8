// From power-up to OP, and what a wrong chain is told.
#include <map>

#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/state_control.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

TEST(YoubotBus, EveryChainReachesOp) {
  const std::array<std::size_t, 4> sizes{5, 11, 17, 6};
  const std::array<int, 4> drives{4, 9, 14, 5};
  for (std::size_t k = 0; k < yb::kChainKinds.size(); ++k) {
    for (const auto generation : {yb::Generation::kOld, yb::Generation::kNew}) {
      yb::YoubotChainConfig c;
      c.kind = yb::kChainKinds[k];
      c.generation = generation;
      BusRig rig(c);
      rig.bring_up();
      if (HasFatalFailure()) return;
      ASSERT_EQ(rig.master.slaves().size(), sizes[k]);
      EXPECT_EQ(yb::find_chain(rig.master.slaves()), c.kind);
      EXPECT_TRUE(yb::check_chain(c.kind, rig.master.slaves()).empty());
      const auto r = rig.cycle();
      EXPECT_EQ(r.status, ec::CycleStatus::kOk);
      EXPECT_EQ(r.expected, 3 * drives[k]);
      EXPECT_EQ(r.counter, 3 * drives[k]);
      for (std::size_t i = 0; i < sizes[k]; ++i) {
        EXPECT_EQ(rig.chain.wire().slave(i).al_status().is(), ec::AlState::kOp) << i;
        EXPECT_EQ(rig.master.slaves()[i].open_ports(), i + 1 == sizes[k] ? 1 : 2) << i;
        EXPECT_TRUE(rig.master.slaves()[i].sii.checksum_good);
        EXPECT_EQ(rig.master.slaves()[i].sii.vendor, 0x286U);
      }
    }
  }
}

// Addresses, lengths, watchdog bit, LRW: what the EEPROM says is what is written.
TEST(YoubotBus, TheEepromDecides) {
  for (const std::size_t bytes : {16U, 18U, 20U, 32U}) {
    for (const bool no_lrw : {false, true}) {
      yb::YoubotChainConfig c;
      c.input_bytes = bytes;
      c.mailbox_start = 0x1200;
      c.mailbox_bytes = 48;
      c.outputs_start = 0x1800;
      c.inputs_start = 0x1900;
      c.data_watchdog = bytes != 18;
      c.forbids_lrw = no_lrw;
      c.esc.sii_reads_eight = no_lrw;
      c.esc.op_needs_outputs = !no_lrw;
      BusRig rig(c);
      rig.bring_up();
      if (HasFatalFailure()) return;
      EXPECT_EQ(rig.master.mapping().lrw, !no_lrw);
      const auto r = rig.cycle();
      EXPECT_EQ(r.status, ec::CycleStatus::kOk);
      EXPECT_EQ(r.expected, no_lrw ? 18 : 27);
      const auto memory = rig.chain.wire().slave(1).memory();
      EXPECT_EQ(ec::load_u16(memory, 0x0800), 0x1200);
      EXPECT_EQ(ec::load_u16(memory, 0x0802), 48);
      EXPECT_EQ(ec::load_u16(memory, 0x0808), 0x1230);
      EXPECT_EQ(ec::load_u16(memory, 0x0810), 0x1800);
      EXPECT_EQ(ec::load_u16(memory, 0x0812), 5);
      EXPECT_EQ(memory[0x0814], bytes != 18 ? 0x64 : 0x24);
      EXPECT_EQ(ec::load_u16(memory, 0x0818), 0x1900);
      EXPECT_EQ(ec::load_u16(memory, 0x081A), bytes);
      // FMMU 0: outputs at logical 0; FMMU 1: inputs behind nine drives' outputs.
      EXPECT_EQ(ec::load_u32(memory, 0x0600), 0U);
      EXPECT_EQ(memory[0x060B], 2);
      EXPECT_EQ(ec::load_u32(memory, 0x0610), 45U);
      EXPECT_EQ(ec::load_u16(memory, 0x0614), bytes);
      EXPECT_EQ(memory[0x061B], 1);
    }
  }
}

// Slaves that take their time to a state, and a chain that another master left running.
TEST(YoubotBus, SlowSlavesAndASecondStart) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBase;
  c.esc.state_looks = 20;
  c.esc.mailbox_delay = 3ms;
  BusRig rig(c);
  for (int start = 0; start < 3; ++start) {
    rig.bring_up();
    if (HasFatalFailure()) return;
    EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
    EXPECT_EQ(rig.tmcl(1, drivers::tmcl::Command::kGetAxisParameter, 250).value, 4000);
  }
}

// Another master used more units than this one does, clocks and events.
TEST(YoubotBus, NothingOfAnotherMasterIsLeft) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBase;
  c.esc.fmmus = 8;
  c.esc.sync_managers = 8;
  BusRig rig(c);
  auto& registers = rig.master.registers();
  ASSERT_TRUE(rig.master.find(rig.startup.token()));
  std::array<std::uint8_t, 16> used{};
  used.fill(1);
  for (const std::uint16_t r : std::to_array<std::uint16_t>({0x0630, 0x0670, 0x0820, 0x0838}))
    EXPECT_TRUE(registers.write(0x1002, r, std::span(used).first(r < 0x0800 ? 16 : 8)));
  EXPECT_TRUE(registers.write_u8(0x1002, 0x0981, 3));
  EXPECT_TRUE(registers.write_u16(0x1002, 0x0200, 0xFFFF));
  ASSERT_TRUE(rig.master.find(rig.startup.token()));
  const auto memory = rig.chain.wire().slave(1).memory();
  for (std::size_t r = 0x0600; r < 0x0680; ++r) EXPECT_EQ(memory[r], 0) << r;
  for (std::size_t r = 0x0800; r < 0x0840; ++r) EXPECT_EQ(memory[r], 0) << r;
  EXPECT_EQ(memory[0x0981], 0);
  EXPECT_EQ(ec::load_u16(memory, 0x0200), 0);
}

// The chain was changed: a slave further on has the address that the first one gets.
TEST(YoubotBus, AddressesOfAnEarlierChainAreNoTrouble) {
  for (const int shift : {1, -1}) {
    BusRig rig;
    auto& registers = rig.master.registers();
    for (int i = 0; i < 11; ++i) {
      std::array<std::uint8_t, 2> old{};
      ec::store_u16(old, 0, static_cast<unsigned>(0x1001 + i - shift));
      EXPECT_EQ(registers.run(ec::Command::kApwr, ec::position_address(i, 0x0010), old), 1);
    }
    rig.bring_up();
    if (HasFatalFailure()) return;
    for (std::size_t i = 0; i < 11; ++i) EXPECT_EQ(rig.chain.wire().slave(i).station(), 0x1001 + i);
    EXPECT_EQ(rig.cycle().status, ec::CycleStatus::kOk);
  }
}

// The old error bit still shows for some looks after its acknowledge: that is no refusal.
TEST(YoubotBus, AnErrorThatIsSlowToClearIsNoRefusal) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBase;
  c.esc.state_looks = 6;
  BusRig rig(c);
  ASSERT_TRUE(rig.master.find(rig.startup.token()));
  ASSERT_TRUE(rig.master.configure(rig.startup.token()));
  rig.chain.wire().slave(1).fall(0x001B, rig.port.now());
  auto& registers = rig.master.registers();
  const auto& slave = rig.master.slaves()[1];
  const auto back = ec::request_state(registers, slave, ec::AlState::kPreOp, 1s);
  EXPECT_TRUE(back) << back.error();
  EXPECT_EQ(rig.chain.wire().slave(1).al_status(), (ec::AlStatus{2, 0}));
  // A real one is: OP out of PREOP.
  const auto refused = ec::request_state(registers, slave, ec::AlState::kOp, 1s);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().find("refuses OP; is PREOP + ERROR, code 0x0011"), std::string::npos)
      << refused.error();
}

// A drive in SAFEOP + ERROR keeps its outputs closed: the frame's counter tells, and inputs go on.
TEST(YoubotBus, InSafeOpWithAnErrorOutputsAreNotTaken) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBase;
  BusRig rig(c);
  rig.bring_up();
  if (HasFatalFailure()) return;
  EXPECT_EQ(rig.cycle().counter, 12);
  rig.chain.wire().slave(2).fall(ec::al_code::kWatchdog, rig.port.now());
  EXPECT_EQ(rig.cycle().counter, 10) << "one reads and does not take: 3 each, and 1";
  // Acknowledged, it takes them again: OP wants outputs first.
  const auto back =
      ec::request_state(rig.master.registers(), rig.master.slaves()[2], ec::AlState::kSafeOp, 1s);
  ASSERT_TRUE(back) << back.error();
  EXPECT_EQ(rig.cycle().counter, 12);
  EXPECT_EQ(rig.chain.wire().slave(2).al_status().is(), ec::AlState::kSafeOp);
}

// Each slave lets OP wait for so long after it was asked first.
class SlowToOp final : public ec::Port {
 public:
  SlowToOp(ec::TwinPort& wire, rt::Nanos wait) : wire_(wire), wait_(wait) {}
  bool send(std::span<const std::uint8_t> f) noexcept override {
    std::array<std::uint8_t, ec::kMaxFrame> copy{};
    std::copy(f.begin(), f.end(), copy.begin());
    ec::parse_frame(f, view_);
    for (std::size_t i = 0; i < view_.count; ++i) {
      const ec::DatagramView& d = view_.datagram[i];
      if (d.command != ec::Command::kFpwr || d.address >> 16U != 0x0120 || d.data[0] != 8) continue;
      const auto [first, anew] = asked_.try_emplace(d.address & 0xFFFFU, now());
      if (now() - first->second < wait_) copy[d.at] = 4;  // still in SAFEOP
    }
    return wire_.send(std::span(copy).first(f.size()));
  }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept override {
    return wire_.receive(into, deadline);
  }
  [[nodiscard]] rt::Time now() const noexcept override { return wire_.now(); }
  void sleep_until(rt::Time t) noexcept override { wire_.sleep_until(t); }

 private:
  ec::TwinPort& wire_;
  rt::Nanos wait_;
  ec::FrameView view_;
  std::map<std::uint32_t, rt::Time> asked_;
};

// What is within the time of a state is waited for, of every slave; what is not ends the start.
TEST(YoubotBus, FiveSlavesThatTakeTheirTimeToOp) {
  for (const rt::Nanos wait : {400ms, 1900ms, 2500ms}) {
    yb::YoubotChainConfig c;
    c.kind = yb::ChainKind::kBase;
    BusRig rig(c);
    SlowToOp slow(rig.port, wait);
    ec::Master master(rig.startup.token(), slow);
    ASSERT_TRUE(master.find(rig.startup.token()));
    ASSERT_TRUE(master.configure(rig.startup.token()));
    const auto begun = slow.now();
    const auto started = master.start(rig.startup.token());
    EXPECT_EQ(static_cast<bool>(started), wait < 2s) << started.error();
    EXPECT_LE(slow.now() - begun, wait < 2s ? 10s : 2500ms) << "one slave alone is not waited for";
  }
}

TEST(YoubotBus, ReadAndWriteInTwoFrames) {
  BusRig rig;
  rig.bring_up();
  const auto in = rig.master.read_inputs();
  EXPECT_EQ(in.status, ec::CycleStatus::kOk);
  EXPECT_EQ(in.counter, 9);
  const auto out = rig.master.write_outputs();
  EXPECT_EQ(out.status, ec::CycleStatus::kOk);
  EXPECT_EQ(out.counter, 9);
}

// Both frames of a job are lost: it ends before the next one's release, and is one lost cycle.
TEST(YoubotBus, TwoLostFramesEndWithinTheirMillisecond) {
  BusRig rig;
  rig.bring_up();
  const auto cycles = rig.master.counters();
  const auto frames = rig.master.frames();
  rig.port.faults().lose_out = 2;
  const auto begun = rig.port.now();
  EXPECT_EQ(rig.master.read_inputs().status, ec::CycleStatus::kLost);
  EXPECT_EQ(rig.master.write_outputs().status, ec::CycleStatus::kLost);
  const auto took = rig.port.now() - begun;
  EXPECT_GE(took, 500us);
  EXPECT_LE(took, 750us + 10us);
  EXPECT_EQ(rig.master.counters().lost - cycles.lost, 1U);
  EXPECT_EQ(rig.master.frames().lost - frames.lost, 2U);
  // A write alone lost has the whole time.
  EXPECT_EQ(rig.master.read_inputs().status, ec::CycleStatus::kOk);
  rig.port.faults().lose_out = 1;
  const auto again = rig.port.now();
  EXPECT_EQ(rig.master.write_outputs().status, ec::CycleStatus::kLost);
  EXPECT_GE(rig.port.now() - again, 500us);
}

TEST(YoubotBus, AWrongChainIsNamedSlaveBySlave) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kArm;
  BusRig rig(c);
  ASSERT_TRUE(rig.master.find(rig.startup.token()));
  const auto wrong = yb::check_chain(yb::ChainKind::kBaseArm, rig.master.slaves());
  // KR-845 is in its place; five joints are where wheels and the arm's master board belong.
  ASSERT_EQ(wrong.size(), 10U);
  EXPECT_EQ(wrong[0],
            "slave 2: 'TMCM-1610' where wheel front left ('TMCM-174' or 'TMCM-1632') belongs");
  EXPECT_EQ(wrong[4],
            "slave 6: 'TMCM-1610' where arm 1 master board ('KR-843' or 'KR-845') belongs");
  EXPECT_EQ(wrong[9], "slave 11: arm 1 joint 5 ('TMCM-KR-841' or 'TMCM-1610') is missing");
  const auto few = yb::check_chain(yb::ChainKind::kBase, rig.master.slaves());
  ASSERT_EQ(few.size(), 5U);
  EXPECT_EQ(few[4], "slave 6: 'TMCM-1610' is one too many");
}

TEST(YoubotBus, ADriveWithoutItsDataIsNamed) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBase;
  rt::Startup startup;
  ec::TwinChain wire;
  const auto boards = yb::boards_of(c.kind);
  for (const auto& b : boards) {
    auto with = c;
    with.input_bytes = b.number == 2 ? 16 : 20;
    auto eeprom = yb::youbot_eeprom(b, with, 1);
    if (b.kind == yb::BoardKind::kWheel && b.number == 3) {  // its mailbox is gone
      for (std::size_t i = 0x30; i < 0x38; ++i) eeprom[i] = 0;
    }
    wire.add(std::make_unique<ec::Esc>(startup.token(), c.esc, eeprom,
                                       std::make_unique<ec::EscApplication>()));
  }
  ec::TwinPort port(wire);
  ec::Master master(startup.token(), port);
  ASSERT_TRUE(master.find(startup.token()));
  const auto wrong = yb::check_chain(c.kind, master.slaves());
  ASSERT_EQ(wrong.size(), 1U);
  EXPECT_EQ(wrong[0], "slave 5: wheel back right: no mailbox, a drive has one");
}

// Without it every slave would end in SAFEOP + ERROR 0x001B, 100 ms later.
TEST(YoubotBus, TheEndLeavesSafeopAndZeros) {
  for (const bool lossy : {false, true}) {
    BusRig rig;
    rig.bring_up();
    rig.make_ready();
    rig.set(1, yb::ControllerMode::kVelocity, 600);
    rig.cycles(50);
    rig.chain.wire().slave(4).fall(0x0050, rig.port.now());
    if (lossy) rig.port.faults().lose_out = 2;
    const auto begun = rig.port.now();
    rig.master.stop(rig.startup.token());
    EXPECT_LE(rig.port.now() - begun, 60ms);
    rig.pause(500ms);
    for (int i = 0; i < 11; ++i)
      EXPECT_EQ(ec::read_al_status(rig.master.registers(), static_cast<std::uint16_t>(0x1001 + i)),
                (ec::AlStatus{4, 0}))
          << i << (lossy ? " lossy" : "");
    const auto memory = rig.chain.wire().slave(1).memory();
    for (std::size_t b = 0x1100; b < 0x1105 && !lossy; ++b) EXPECT_EQ(memory[b], 0);
    // A second time, and a cycle behind it, change nothing.
    const auto frames = rig.master.frames().sent;
    rig.master.stop(rig.startup.token());
    EXPECT_EQ(rig.master.frames().sent, frames);
    EXPECT_TRUE(rig.master.stopped());
  }
}

// No frame comes back: the end does not hang, and a slave that begins anew is not blamed.
TEST(YoubotBus, TheEndOfABusThatIsGoneIsShort) {
  BusRig rig;
  rig.bring_up();
  rig.chain.wire().slave(3).power_cycle(rig.port.now());
  rig.master.stop(rig.startup.token());
  for (std::size_t i = 0; i < 11; ++i)
    EXPECT_EQ(rig.chain.wire().slave(i).al_status(), (ec::AlStatus{1, 0})) << i;
  BusRig dead;
  dead.bring_up();
  dead.port.faults().lose_out = 1'000'000;
  const auto begun = dead.port.now();
  dead.master.stop(dead.startup.token());
  EXPECT_LE(dead.port.now() - begun, 60ms);
}

TEST(YoubotBus, NoSlaveAndNoCableAreDifferent) {
  BusRig rig;
  rig.port.faults().link_down = true;
  auto found = rig.master.find(rig.startup.token());
  ASSERT_FALSE(found);
  EXPECT_NE(found.error().find("no frame came back"), std::string::npos);
  rig.port.faults().link_down = false;
  rig.chain.wire().cut_behind(0);
  ASSERT_TRUE(rig.master.find(rig.startup.token()));
  EXPECT_TRUE(rig.master.slaves().empty());
  EXPECT_FALSE(rig.master.configure(rig.startup.token()));
}

}  // namespace
}  // namespace tests
