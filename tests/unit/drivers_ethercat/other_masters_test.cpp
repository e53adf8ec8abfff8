// What masters other than ours ask of the virtual chain, and ours does not.
#include <gtest/gtest.h>

#include "tests/unit/drivers_ethercat/esc_rig.hpp"

namespace tests {
namespace {

using namespace drivers::ethercat;
using namespace std::chrono_literals;

AlStatus ask(WireRig& rig, unsigned control) {
  EXPECT_TRUE(rig.registers.write_u16(0x1001, 0x0120, control));
  return rig.al(0);
}

// The mailbox block `i` of slave 1, one byte of it another.
void write_mailbox(WireRig& rig, std::size_t i, std::size_t at = 0, std::uint8_t flip = 0) {
  RegisterBlock b = rig.mapping.slaves[0].mailbox_setup[i];
  b.bytes[at] ^= flip;
  const std::array<std::uint8_t, 1> off{0};
  ASSERT_TRUE(rig.registers.write(0x1001, static_cast<std::uint16_t>(b.reg + 6), off));
  ASSERT_TRUE(rig.registers.write(0x1001, b.reg, std::span(b.bytes).first(8)));
}

// IgH and KickCAT set up a mailbox only where the SII names a protocol for it (word 0x1C).
TEST(OtherMasters, PreopWithoutAMailboxThatHasNoProtocol) {
  WireRig rig(1);
  rig.scan_all();
  EXPECT_EQ(ask(rig, 0x02), (AlStatus{0x02, 0x0000}));
  Bytes whole(32, 5), reply(32);
  EXPECT_EQ(rig.run(Command::kFpwr, station_address(0x1001, 0x1000), whole), 1) << "memory";
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x1020), reply), 1);
  EXPECT_EQ(reply, Bytes(32, 0)) << "nobody serves it";
  EXPECT_EQ(ask(rig, 0x01), (AlStatus{0x01, 0x0000}));
  // One of the two, and both.
  write_mailbox(rig, 0);
  EXPECT_EQ(ask(rig, 0x02), (AlStatus{0x02, 0x0000}));
  EXPECT_EQ(ask(rig, 0x01), (AlStatus{0x01, 0x0000}));
  write_mailbox(rig, 1);
  EXPECT_EQ(ask(rig, 0x02), (AlStatus{0x02, 0x0000}));
  // With a protocol it has to be there.
  WireRig coe(1, {}, 4);
  coe.scan_all();
  EXPECT_EQ(ask(coe, 0x02), (AlStatus{0x11, 0x0016}));
}

// One that is on has to be the slave's: start, length, mode and direction.
TEST(OtherMasters, PreopRefusesAWrongMailbox) {
  for (const std::size_t i : {0U, 1U}) {
    for (const auto& [at, flip] : {std::pair<std::size_t, std::uint8_t>{0, 0x40},
                                   {1, 0x01},
                                   {2, 0x01},
                                   {4, 0x02},
                                   {4, 0x04}}) {
      WireRig rig(1);
      rig.scan_all();
      write_mailbox(rig, i, at, flip);
      EXPECT_EQ(ask(rig, 0x02), (AlStatus{0x11, 0x0016})) << i << ": byte " << at;
      write_mailbox(rig, i);
      EXPECT_EQ(ask(rig, 0x12), (AlStatus{0x02, 0x0000})) << i << ": byte " << at;
    }
  }
}

// `n` reads of `bytes` bytes of AL status, of slaves in turn, by ETG.1000.4, 5.3 and by hand.
Bytes many_reads(std::size_t n, std::size_t bytes) {
  Bytes f(12, 0x10);
  const auto put = [&](std::initializer_list<std::size_t> list) {
    for (const std::size_t b : list) f.push_back(static_cast<std::uint8_t>(b));
  };
  const std::size_t length = n * (12 + bytes);
  put({0x88, 0xA4, length % 256, 0x10 + length / 256});
  for (std::size_t i = 0; i < n; ++i) {
    put({4, i, 1 + i % 3, 0x10, 0x30, 0x01, bytes, i + 1 < n ? 0x80U : 0U, 0, 0});
    f.resize(f.size() + bytes + 2, 0);
  }
  return f;
}

// SOEM asks up to 64 slaves for their state in one frame (FPRD_multi); 124 datagrams fit.
TEST(OtherMasters, AFrameOfAsManyDatagramsAsFit) {
  WireRig rig(3);
  rig.scan_all();
  for (const auto& [n, bytes] :
       {std::pair<std::size_t, std::size_t>{16, 6}, {17, 6}, {64, 6}, {83, 6}, {124, 0}}) {
    Bytes f = many_reads(n, bytes);
    ASSERT_LE(f.size(), 1514U);
    rig.wire.pass(f, rig.port.now());
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t at = 16 + i * (12 + bytes) + 10;
      if (bytes > 0) {
        EXPECT_EQ(f[at], 1) << "INIT: " << n << ", " << i;
      }
      EXPECT_EQ(f[at + bytes], 1) << "counter: " << n << ", " << i;
    }
  }
  Bytes errors(1);
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x030C), errors), 1);
  EXPECT_EQ(errors[0], 0) << "frames that the processing unit refused";
}

// The irq field of a datagram that comes back.
unsigned irq_of(WireRig& rig, Command c, std::uint32_t address, std::size_t bytes) {
  FrameWriter w;
  EXPECT_TRUE(w.add(c, 1, address, bytes));
  const auto sent = w.finish();
  Bytes f(sent.begin(), sent.end());
  rig.wire.pass(f, rig.port.now());
  FrameView v;
  parse_frame(f, v);
  EXPECT_TRUE(v.good());
  return v.datagram[0].irq;
}
unsigned irq_of(WireRig& rig) { return irq_of(rig, Command::kNop, 0, 0); }
unsigned request_of(WireRig& rig, std::uint16_t station) {
  return rig.registers.read_u16(station, 0x0210).value_or(0xFFFF);
}

// ESC data sheet II, 0x0200 and 0x0210: bit 2 DL status, 3 AL status, 4 and on sync managers.
TEST(OtherMasters, EventsComeBackInEveryDatagram) {
  WireRig rig(3);
  rig.scan_all();  // reads DL and AL status, so both events are gone
  Bytes mask{0x0C, 0x00};
  EXPECT_EQ(rig.run(Command::kBwr, broadcast_address(0x0200), mask), 3);
  EXPECT_EQ(irq_of(rig), 0U);
  // A new AL state of one slave: in any datagram that passes it, until it is read.
  ASSERT_TRUE(rig.registers.write_u16(0x1002, 0x0120, 0x02));
  EXPECT_EQ(irq_of(rig), 0x08U);
  EXPECT_EQ(irq_of(rig, Command::kFprd, station_address(0x1001, 0), 1), 0x08U);
  EXPECT_EQ(request_of(rig, 0x1002), 0x08U);
  EXPECT_EQ(request_of(rig, 0x1001), 0U);
  (void)rig.al(0);
  EXPECT_EQ(irq_of(rig), 0x08U) << "read of another slave";
  (void)rig.al(1);
  EXPECT_EQ(irq_of(rig), 0U);
  // A cut behind slave 2: its DL status is another.
  rig.wire.cut_behind(2);
  EXPECT_EQ(irq_of(rig), 0x04U);
  EXPECT_EQ(rig.registers.read_u16(0x1002, 0x0110).value_or(0), 0x5613);
  EXPECT_EQ(irq_of(rig), 0U);
  rig.wire.cut_behind(3);
  EXPECT_EQ(irq_of(rig), 0x04U);
  // Masked, it is there and not told.
  Bytes none(2, 0);
  EXPECT_EQ(rig.run(Command::kBwr, broadcast_address(0x0200), none), 3);
  EXPECT_EQ(irq_of(rig), 0U);
  EXPECT_EQ(request_of(rig, 0x1002), 0x04U);
}

// Control bit 4 of a sync manager: a reply lies in the in mailbox, the out mailbox was taken.
TEST(OtherMasters, EventsOfMailboxes) {
  WireRig rig(1);
  rig.scan_all();
  Bytes mask{0xF0, 0x0F};
  EXPECT_EQ(rig.run(Command::kBwr, broadcast_address(0x0200), mask), 1);
  write_mailbox(rig, 0, 4, 0x10);
  write_mailbox(rig, 1, 4, 0x10);
  EXPECT_EQ(ask(rig, 0x02), (AlStatus{0x02, 0x0000}));
  EXPECT_EQ(irq_of(rig), 0U);
  Bytes whole(32, 5), part(31), reply(32);
  EXPECT_EQ(rig.run(Command::kFpwr, station_address(0x1001, 0x1000), whole), 1);
  EXPECT_EQ(irq_of(rig), 0x30U) << "SM0 was read, SM1 was written";
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x1020), part), 1);
  EXPECT_EQ(irq_of(rig), 0x10U) << "its first byte was read";
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x1020), reply), 1);
  EXPECT_EQ(rig.run(Command::kFpwr, station_address(0x1001, 0x1000), part), 1);
  EXPECT_EQ(irq_of(rig), 0U) << "SM0's first byte was written";
}

// Beckhoff's slave stack (5.x, AL_ControlInd) and SOES (ESC_state): in an error INIT alone is
// served without an acknowledgement.
TEST(OtherMasters, InitIsServedWithoutAnAcknowledgement) {
  WireRig rig(1);
  rig.scan_all();
  rig.all_to(AlState::kSafeOp);
  EXPECT_EQ(ask(rig, 0x08), (AlStatus{0x14, 0x0019}));
  for (const unsigned state : {0x08U, 0x04U, 0x02U})
    EXPECT_EQ(ask(rig, state), (AlStatus{0x14, 0x0019})) << state << ": stands";
  EXPECT_EQ(ask(rig, 0x01), (AlStatus{0x01, 0x0000}));
}

// FMMUs and sync managers that the slave does not have (0x0004, 0x0005) are no memory.
TEST(OtherMasters, RegistersBeyondTheCountsReadZero) {
  EscConfig c;
  c.fmmus = 3;
  c.sync_managers = 4;
  WireRig rig(1, c);
  rig.scan_all();
  Bytes ones(0x100, 0xFF);
  EXPECT_EQ(rig.run(Command::kFpwr, station_address(0x1001, 0x0600), ones), 1);
  ones.assign(0x40, 0x00);
  for (std::size_t i = 0; i < 8; ++i) ones[8 * i + 1] = 0x18;  // start 0x1800
  EXPECT_EQ(rig.run(Command::kFpwr, station_address(0x1001, 0x0800), ones), 1);
  Bytes fmmus(0x100), managers(0x40);
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x0600), fmmus), 1);
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x0800), managers), 1);
  for (std::size_t i = 0; i < fmmus.size(); ++i)
    EXPECT_EQ(fmmus[i], i < 3 * 16 ? 0xFF : 0) << "FMMU " << i / 16;
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_EQ(managers[8 * i + 1], i < 4 ? 0x18 : 0) << "sync manager " << i;
}

// SOEM's and IgH's measurement: a link's delay is half of what a slave's round trip is shorter than
// that of the slave before it (ESC data sheet I, 9.1.2).
TEST(OtherMasters, ReceiveTimesGrowAlongTheLine) {
  WireRig rig(4);
  rig.scan_all();
  Bytes latch(4);
  EXPECT_EQ(rig.run(Command::kBwr, broadcast_address(0x0900), latch), 4);
  std::array<std::int64_t, 4> there{}, around{};
  for (std::size_t i = 0; i < 4; ++i) {
    Bytes t(8);
    const auto station = static_cast<std::uint16_t>(0x1001 + i);
    EXPECT_EQ(rig.run(Command::kFprd, station_address(station, 0x0900), t), 1);
    there[i] = load_u32(t);
    around[i] = i < 3 ? load_u32(t, 4) - there[i] : 0;
    Bytes unit(8);
    EXPECT_EQ(rig.run(Command::kFprd, station_address(station, 0x0918), unit), 1);
    EXPECT_EQ(load_u32(unit), there[i]);
  }
  for (std::size_t i = 1; i < 4; ++i) {
    EXPECT_EQ(there[i] - there[i - 1], 500) << i;
    EXPECT_EQ((around[i - 1] - around[i]) / 2, 500) << i;
  }
}

}  // namespace
}  // namespace tests
