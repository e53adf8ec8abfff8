// What a virtual slave does with frames that are no good, and what it counts of them: reserved
// commands, error counters, lost links, a reload of the EEPROM.
#include <gtest/gtest.h>

#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/sii.hpp"
#include "tests/unit/drivers_ethercat/esc_rig.hpp"

namespace tests {
namespace {

using namespace drivers::ethercat;

std::uint8_t byte_of(WireRig& rig, std::size_t slave, std::size_t reg) {
  Bytes b(1);
  const auto station = static_cast<std::uint16_t>(0x1001 + slave);
  EXPECT_EQ(rig.run(Command::kFprd, station_address(station, static_cast<std::uint16_t>(reg)), b),
            1);
  return b[0];
}

// Counters of frames: port 0 and 1 refused, port 0 and 1 refused before, processing unit.
using Counts = std::array<int, 5>;
Counts counts_of(WireRig& rig, std::size_t slave) {
  Counts c{};
  for (std::size_t i = 0; const std::size_t reg : {0x0300, 0x0302, 0x0308, 0x0309, 0x030C})
    c[i++] = byte_of(rig, slave, reg);
  return c;
}

// ETG.1000.4, 5.4: a reserved command is NOP. What stands behind it in the frame is worked on.
TEST(EscErrors, AReservedCommandIsNopAndTheFrameGoesOn) {
  for (const int reserved : {15, 16, 100, 255}) {
    WireRig rig;
    rig.scan_all();
    FrameWriter w;
    const std::array<std::uint8_t, 2> mask{0x0C, 0x00};
    ASSERT_TRUE(w.add(Command::kBrd, 9, broadcast_address(0), 1));
    ASSERT_TRUE(w.add(static_cast<Command>(reserved), 9, 0x01300005, 4));
    ASSERT_TRUE(w.add(Command::kBwr, 9, broadcast_address(0x0200), 2, mask));
    const auto sent = w.finish();
    Bytes f(sent.begin(), sent.end());
    rig.wire.pass(f, rig.port.now());
    FrameView v;
    parse_frame(f, v);
    EXPECT_EQ(v.fault, FrameFault::kUnknownCommand) << "whoever checks frames is told";
    ASSERT_EQ(v.count, 3U);
    EXPECT_EQ(v.datagram[0].counter, 3);
    EXPECT_EQ(v.datagram[1].counter, 0) << reserved;
    EXPECT_EQ(v.datagram[1].address, 0x01300005U) << "no position is counted";
    EXPECT_EQ(v.datagram[1].data[0], 0);
    EXPECT_EQ(v.datagram[2].counter, 3) << "the datagram behind it";
    EXPECT_EQ(byte_of(rig, 2, 0x0200), 0x0C);
    EXPECT_EQ(byte_of(rig, 0, reg::kUnitErrors), 0) << "no fault of the frame";
  }
}

// A fault of the structure is named before a reserved command, and ends the reading.
TEST(EscErrors, AFaultOfTheStructureIsTheWorse) {
  FrameWriter w;
  ASSERT_TRUE(w.add(static_cast<Command>(15), 1, 0, 4));
  ASSERT_TRUE(w.add(Command::kBrd, 1, 0, 4));
  const auto sent = w.finish();
  Bytes f(sent.begin(), sent.end());
  f[39] |= 0x80;  // the second says that a third follows
  FrameView v;
  parse_frame(f, v);
  EXPECT_EQ(v.fault, FrameFault::kMoreTooMany);
  f.assign(sent.begin(), sent.end());
  f[14] -= 1;
  parse_frame(f, v);
  EXPECT_EQ(v.fault, FrameFault::kCutDatagram);
  EXPECT_EQ(v.count, 1U);
}

// ESC data sheet II, 0x0300 to 0x030C: the port that hears the damage first refuses the frame, the
// others hear its mark; on the way back no processing unit is passed.
TEST(EscErrors, ADamagedFrameIsCountedWhereItIsHeard) {
  WireRig rig(4);
  rig.scan_all();
  Bytes one(1);
  const auto damage = [&](std::size_t cable, bool out) {
    rig.port.faults().cable = cable;
    (out ? rig.port.faults().corrupt_out : rig.port.faults().corrupt) = 1;
    (void)rig.run(Command::kBrd, broadcast_address(0), one);  // asked again when it is lost
  };
  const auto clear = [&] {
    Bytes zero(1);
    for (const std::uint16_t reg : {std::uint16_t{0x0300}, std::uint16_t{0x030C}})
      EXPECT_EQ(rig.run(Command::kBwr, broadcast_address(reg), zero), 4);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(counts_of(rig, i), Counts{}) << i;
  };
  damage(2, true);  // between slaves 2 and 3, on its way out
  EXPECT_EQ(counts_of(rig, 0), (Counts{0, 0, 0, 1, 0}));
  EXPECT_EQ(counts_of(rig, 1), (Counts{0, 0, 0, 1, 0}));
  EXPECT_EQ(counts_of(rig, 2), (Counts{1, 0, 0, 1, 1}));
  EXPECT_EQ(counts_of(rig, 3), (Counts{0, 0, 1, 0, 1})) << "the last one hears it once";
  clear();
  damage(2, false);
  EXPECT_EQ(counts_of(rig, 0), (Counts{0, 0, 0, 1, 0}));
  EXPECT_EQ(counts_of(rig, 1), (Counts{0, 1, 0, 0, 0}));
  EXPECT_EQ(counts_of(rig, 2), Counts{});
  EXPECT_EQ(counts_of(rig, 3), Counts{});
  clear();
  damage(0, false);  // between slave 1 and the card: no slave hears it
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(counts_of(rig, i), Counts{}) << i;
  damage(0, true);
  EXPECT_EQ(counts_of(rig, 0), (Counts{1, 0, 0, 1, 1}));
  clear();
  // At its largest value it stays.
  for (int i = 0; i < 300; ++i) damage(1, false);
  EXPECT_EQ(counts_of(rig, 0)[1], 0xFF);
}

// Slaves that the damage reaches first do nothing with the frame.
TEST(EscErrors, WhatIsDamagedOnItsWayOutIsNotTaken) {
  WireRig rig;
  rig.scan_all();
  FrameWriter w;
  const std::array<std::uint8_t, 2> mask{0x0C, 0x00};
  ASSERT_TRUE(w.add(Command::kBwr, 1, broadcast_address(0x0200), 2, mask));
  Bytes f(w.finish().begin(), w.finish().end());
  rig.wire.pass_damaged(f, rig.port.now(), {1, true});
  EXPECT_EQ(byte_of(rig, 0, 0x0200), 0x0C);
  EXPECT_EQ(byte_of(rig, 1, 0x0200), 0);
  EXPECT_EQ(byte_of(rig, 2, 0x0200), 0);
}

// ESC data sheet II, 0x0310: a byte a port, at both ends of the cable.
TEST(EscErrors, ACutIsALostLinkAtBothItsEnds) {
  WireRig rig(4);
  rig.scan_all();
  const auto lost = [&](std::size_t slave) {
    return std::pair<int, int>{byte_of(rig, slave, 0x0310), byte_of(rig, slave, 0x0311)};
  };
  rig.wire.cut_behind(2);
  EXPECT_EQ(lost(0), (std::pair{0, 0}));
  EXPECT_EQ(lost(1), (std::pair{0, 1}));
  rig.wire.cut_behind(2);  // it is cut already
  rig.wire.cut_behind(4);
  EXPECT_EQ(lost(1), (std::pair{0, 1}));
  EXPECT_EQ(lost(2), (std::pair{1, 0}));
  EXPECT_EQ(lost(3), (std::pair{0, 0}));
  rig.port.faults().link_down = true;  // the master's own cable
  Bytes one(1);
  (void)rig.run(Command::kBrd, broadcast_address(0), one);
  (void)rig.run(Command::kBrd, broadcast_address(0), one);
  rig.port.faults().link_down = false;
  EXPECT_EQ(lost(0), (std::pair{1, 0}));
  // A write of any of them clears them all.
  Bytes zero(1);
  EXPECT_EQ(rig.run(Command::kFpwr, station_address(0x1003, 0x0313), zero), 1);
  EXPECT_EQ(lost(2), (std::pair{0, 0}));
  EXPECT_EQ(lost(1), (std::pair{0, 1})) << "of this slave alone";
}

// Bits 0 and 1 of DL status: the application works, and its watchdog has not expired.
TEST(EscErrors, TheApplicationsWatchdogIsFed) {
  WireRig rig(2);
  rig.scan_all();
  for (const std::uint16_t station : {std::uint16_t{0x1001}, std::uint16_t{0x1002}})
    EXPECT_EQ(rig.registers.read_u16(station, 0x0110).value_or(0) & 3U, 3U);
}

bool reload(WireRig& rig, unsigned& control) {
  Bytes command{0x00, 0x04};
  EXPECT_EQ(rig.run(Command::kFpwr, station_address(0x1001, 0x0502), command), 1);
  for (int looks = 0; looks < 20; ++looks) {
    control = rig.registers.read_u16(0x1001, 0x0502).value_or(0xFFFF);
    if ((control & 0x8000U) == 0) return looks > 0;
  }
  return false;
}

// ESC data sheet II, 0x0502, command 4: what the EEPROM says is loaded again.
TEST(EscErrors, AReloadTakesAliasAndConfiguration) {
  EscConfig c;
  c.sii_busy_looks = 3;
  WireRig rig(1, c);
  rig.scan_all();
  auto sealed = SiiBuilder().alias(0x0777).image();
  sealed[2] = 0x34;  // word 1: configuration of the application's interface
  sealed[14] = sii_checksum(std::span<const std::uint8_t>(sealed).first<14>());
  auto& eeprom = rig.wire.slave(0).eeprom();
  std::copy_n(sealed.begin(), 16, eeprom.begin());
  EXPECT_EQ(rig.registers.read_u16(0x1001, 0x0012).value_or(9), 0) << "not by itself";
  unsigned control = 0;
  EXPECT_TRUE(reload(rig, control)) << "busy for some looks";
  EXPECT_EQ(control & 0x7800U, 0U) << "no error, and none refused";
  EXPECT_EQ(rig.registers.read_u16(0x1001, 0x0012).value_or(0), 0x0777);
  EXPECT_EQ(rig.registers.read_u16(0x1001, 0x0140).value_or(0), 0x0C08);
  EXPECT_EQ(rig.registers.read_u16(0x1001, 0x0150).value_or(0), 0x34);
  // Not with a wrong checksum: said so, and everything stays.
  eeprom[8] ^= 1;
  EXPECT_TRUE(reload(rig, control));
  EXPECT_EQ(control & 0x7800U, 0x0800U);
  EXPECT_EQ(rig.registers.read_u16(0x1001, 0x0012).value_or(0), 0x0777);
}

}  // namespace
}  // namespace tests
