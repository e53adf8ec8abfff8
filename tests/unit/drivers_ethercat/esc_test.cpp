// The virtual slave against the words of the standard: what other masters ask of it.
#include <gtest/gtest.h>

#include <algorithm>

#include "rt/random.hpp"
#include "tests/unit/drivers_ethercat/esc_rig.hpp"

namespace tests {
namespace {

using namespace drivers::ethercat;
using namespace std::chrono_literals;

// Counters and addresses of every command: BRD counts all, AP the one, FP the one, both count
// right.
TEST(Esc, CountersOfEveryCommand) {
  WireRig rig;
  rig.scan_all();
  Bytes two(2);
  EXPECT_EQ(rig.run(Command::kBrd, broadcast_address(0x0130), two), 3);
  EXPECT_EQ(rig.run(Command::kBwr, broadcast_address(0x0200), two), 3);
  EXPECT_EQ(rig.run(Command::kBrw, broadcast_address(0x0200), two), 9);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(rig.run(Command::kAprd, position_address(i, 0x0010), two), 1);
    EXPECT_EQ(load_u16(two), 0x1001 + i);
    EXPECT_EQ(rig.run(Command::kFprd,
                      station_address(static_cast<std::uint16_t>(0x1001 + i), 0x0010), two),
              1);
    EXPECT_EQ(rig.run(Command::kFprw,
                      station_address(static_cast<std::uint16_t>(0x1001 + i), 0x0200), two),
              3);
  }
  EXPECT_EQ(rig.run(Command::kAprd, position_address(3, 0), two), 0) << "nobody there";
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x2000, 0), two), 0);
  EXPECT_EQ(rig.run(Command::kNop, 0, two), 0);
  EXPECT_EQ(rig.run(Command::kFrmw, station_address(0x1002, 0x0910), two), 3);
  EXPECT_EQ(rig.run(Command::kArmw, position_address(1, 0x0910), two), 3);
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x0E00), two), 1)
      << "a register that is not built reads 0 and counts";
  EXPECT_EQ(load_u16(two), 0);
}

// Several datagrams in a frame; position fields count the slaves; source bit; no padding added.
TEST(Esc, AFrameComesBackAsTheStandardSays) {
  WireRig rig;
  FrameWriter w;
  ASSERT_TRUE(w.add(Command::kBrd, 9, broadcast_address(0), 1));
  ASSERT_TRUE(w.add(Command::kAprd, 9, position_address(1, 0x0004), 2));
  const auto sent = w.finish();
  for (const std::size_t size : {sent.size(), std::size_t{16 + 13 + 14}}) {
    Bytes f(sent.begin(), sent.begin() + static_cast<std::ptrdiff_t>(size));
    rig.wire.pass(f, rig.port.now());
    EXPECT_EQ(f.size(), size);
    EXPECT_EQ(f[6], 0x12) << "bit 1 of the source address";
    FrameView v;
    parse_frame(f, v);
    ASSERT_TRUE(v.good());
    EXPECT_EQ(v.datagram[0].address & 0xFFFFU, 3U);
    EXPECT_EQ(v.datagram[0].counter, 3);
    EXPECT_EQ(v.datagram[0].data[0], 0x11);
    EXPECT_EQ(v.datagram[1].address & 0xFFFFU, 2U) << "-1 and three slaves";
    EXPECT_EQ(v.datagram[1].counter, 1);
    EXPECT_EQ(v.datagram[1].index, 9);
  }
  Bytes other(60, 0);
  other[12] = 0x08;
  const Bytes before = other;
  rig.wire.pass(other, rig.port.now());
  EXPECT_EQ(other, before) << "no EtherCAT: as it was";
}

TEST(Esc, StateMachineRefusesWithItsCodes) {
  WireRig rig;
  rig.scan_all();
  const auto ask = [&](unsigned control) {
    EXPECT_TRUE(rig.registers.write_u16(0x1001, 0x0120, control));
    return rig.al(0);
  };
  EXPECT_EQ(ask(0x04), (AlStatus{0x11, 0x0011})) << "INIT to SAFEOP";
  EXPECT_EQ(ask(0x02), (AlStatus{0x11, 0x0011})) << "an error stands until acknowledged";
  EXPECT_EQ(ask(0x11), (AlStatus{0x01, 0x0000}));
  // Out mailbox of half its length.
  const std::array<std::uint8_t, 8> half{0x00, 0x10, 16, 0, 0x26, 0, 1, 0};
  const std::array<std::uint8_t, 1> off{0};
  EXPECT_TRUE(rig.registers.write(0x1001, 0x0800, half));
  EXPECT_EQ(ask(0x02), (AlStatus{0x11, 0x0016})) << "mailbox set up wrongly";
  EXPECT_TRUE(rig.registers.write(0x1001, 0x0806, off));
  EXPECT_EQ(ask(0x17), (AlStatus{0x11, 0x0012})) << "no such state";
  EXPECT_EQ(ask(0x13), (AlStatus{0x11, 0x0013})) << "no bootstrap";
  EXPECT_EQ(ask(0x11), (AlStatus{0x01, 0x0000}));
  ASSERT_TRUE(to_preop(rig.registers, rig.slaves[0], rig.mapping.slaves[0], 1s));
  EXPECT_EQ(ask(0x04), (AlStatus{0x12, 0x001D})) << "outputs not set up";
  const auto& m = rig.mapping.slaves[0];
  EXPECT_TRUE(
      rig.registers.write(0x1001, m.data_setup[0].reg, std::span(m.data_setup[0].bytes).first(8)));
  EXPECT_EQ(ask(0x14), (AlStatus{0x12, 0x001E})) << "inputs not set up";
  EXPECT_EQ(ask(0x12), (AlStatus{0x02, 0x0000}));
  ASSERT_TRUE(to_safeop(rig.registers, rig.slaves[0], m, 1s));
  EXPECT_EQ(ask(0x08), (AlStatus{0x14, 0x0019})) << "no outputs came yet";
  EXPECT_EQ(ask(0x14), (AlStatus{0x04, 0x0000}));
  const auto done = request_state(rig.registers, rig.slaves[0], AlState::kOp, 1s);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error(),
            "slave 1 'echo': refuses OP; is SAFEOP + ERROR, code 0x0019: no valid outputs");
}

TEST(Esc, WatchdogDropsToSafeOp) {
  for (const int ms : {10, 100}) {
    WireRig rig(1);
    rig.scan_all();
    rig.all_to(AlState::kSafeOp);
    ASSERT_TRUE(rig.registers.write_u16(0x1001, 0x0420, static_cast<unsigned>(10 * ms)));
    Bytes data(10, 0);
    EXPECT_EQ(rig.run(Command::kLrw, 0, data), 3);
    ASSERT_TRUE(request_state(rig.registers, rig.slaves[0], AlState::kOp, 1s));
    EXPECT_EQ(rig.run(Command::kLrw, 0, data), 3);
    const auto fed = rig.port.now();
    rig.port.set_now(fed + rt::Nanos{ms * 1'000'000 - 300'000});
    EXPECT_EQ(rig.al(0), (AlStatus{0x08, 0})) << ms << " ms: not yet";
    EXPECT_EQ(rig.registers.read_u16(0x1001, 0x0440).value_or(9), 1);
    rig.port.set_now(fed + rt::Nanos{ms * 1'000'000 + 300'000});
    EXPECT_EQ(rig.al(0), (AlStatus{0x14, 0x001B})) << ms;
    EXPECT_EQ(rig.registers.read_u16(0x1001, 0x0440).value_or(9), 0);
    // Switched off, it waits for ever.
    ASSERT_TRUE(rig.registers.write_u16(0x1001, 0x0120, 0x14));
    ASSERT_TRUE(rig.registers.write_u16(0x1001, 0x0420, 0));
    EXPECT_EQ(rig.run(Command::kLrw, 0, data), 3);
    ASSERT_TRUE(request_state(rig.registers, rig.slaves[0], AlState::kOp, 1s));
    rig.port.set_now(rig.port.now() + 10s);
    EXPECT_EQ(rig.al(0), (AlStatus{0x08, 0}));
  }
}

TEST(Esc, ProcessDataThroughFmmus) {
  WireRig rig;
  rig.scan_all();
  rig.all_to(AlState::kPreOp);
  Bytes image(3 * 4 + 3 * 6, 0);
  EXPECT_EQ(rig.run(Command::kLrw, 0, image), 0) << "closed before SAFEOP";
  for (std::size_t i = 0; i < 3; ++i)
    ASSERT_TRUE(to_safeop(rig.registers, rig.slaves[i], rig.mapping.slaves[i], 1s));
  EXPECT_EQ(rig.run(Command::kLrw, 0, image), 9);
  for (std::size_t i = 0; i < 3; ++i)
    ASSERT_TRUE(request_state(rig.registers, rig.slaves[i], AlState::kOp, 1s));
  for (std::size_t i = 0; i < 12; ++i) image[i] = static_cast<std::uint8_t>(10 + i);
  EXPECT_EQ(rig.run(Command::kLrw, 0, image), 9);
  EXPECT_EQ(rig.run(Command::kLrw, 0, image), 9);
  for (std::size_t s = 0; s < 3; ++s) {
    for (std::size_t k = 0; k < 6; ++k)
      EXPECT_EQ(image[12 + 6 * s + k], (k < 4 ? 10 + 4 * s + k : 0) + 1) << s << " " << k;
  }
  Bytes in(18, 0), out(12, 1), one(4, 5), part(3, 5);
  EXPECT_EQ(rig.run(Command::kLrd, 12, in), 3);
  EXPECT_EQ(rig.run(Command::kLwr, 0, out), 3);
  EXPECT_EQ(rig.run(Command::kLwr, 4, one), 1) << "one slave's outputs";
  EXPECT_EQ(rig.run(Command::kLwr, 0x10000, one), 0) << "nobody's";
  // Without its last byte a buffer is not handed over.
  EXPECT_EQ(rig.run(Command::kLwr, 0, part), 1);
  Bytes now(6, 0);
  EXPECT_EQ(rig.run(Command::kLrd, 12, now), 1);
  EXPECT_EQ(now[0], 2) << "still the byte of the whole write";
}

TEST(Esc, MailboxFillsAndEmptiesByItsLastByte) {
  WireRig rig(1);
  rig.scan_all();
  rig.all_to(AlState::kPreOp);
  Bytes whole(32), part(31), tail(1), reply(32);
  for (std::size_t i = 0; i < 32; ++i) whole[i] = static_cast<std::uint8_t>(i);
  const auto at = [](std::uint16_t r) { return station_address(0x1001, r); };
  EXPECT_EQ(rig.run(Command::kFprd, at(0x1020), reply), 0) << "empty";
  EXPECT_EQ(rig.run(Command::kFpwr, at(0x1000), part), 1);
  EXPECT_EQ(rig.wire.slave(0).memory()[0x0805] & 8, 0) << "not full before its last byte";
  EXPECT_EQ(rig.run(Command::kFpwr, at(0x1000), whole), 1);
  Bytes full(1);
  EXPECT_EQ(rig.run(Command::kFprd, at(0x080D), full), 1);
  EXPECT_EQ(full[0] & 8, 8);
  EXPECT_EQ(rig.run(Command::kFprd, at(0x1020), part), 1) << "a part does not empty it";
  EXPECT_EQ(rig.run(Command::kFprd, at(0x1020), reply), 1);
  for (std::size_t i = 0; i < 32; ++i) EXPECT_EQ(reply[i], 31 - i);
  EXPECT_EQ(rig.run(Command::kFprd, at(0x1020), tail), 0) << "empty again";
  // Repeat request: the same once more.
  Bytes repeat{0x03};
  EXPECT_EQ(rig.run(Command::kFpwr, at(0x080E), repeat), 1);
  Bytes both(2), again(32);
  EXPECT_EQ(rig.run(Command::kFprd, at(0x080E), both), 1);
  EXPECT_EQ(both[1] & 2, 2) << "acknowledged";
  EXPECT_EQ(rig.run(Command::kFprd, at(0x1020), again), 1);
  EXPECT_EQ(again, reply);
}

TEST(Esc, SettingsReadBack) {
  WireRig rig(2);
  rig.scan_all();
  rig.all_to(AlState::kSafeOp);
  for (const SlaveMapping& m : rig.mapping.slaves) {
    for (int k = 0; k < m.data_blocks; ++k) {
      const RegisterBlock& b = m.data_setup[static_cast<std::size_t>(k)];
      Bytes back(b.size);
      EXPECT_EQ(rig.run(Command::kFprd, station_address(m.station, b.reg), back), 1);
      for (std::size_t i = 0; i < b.size; ++i) {
        const bool status = b.size == 8 && (i == 5 || i == 7);
        if (!status) {
          EXPECT_EQ(back[i], b.bytes[i]) << b.reg << " " << i;
        }
      }
    }
  }
}

TEST(Esc, EepromByFourAndByEight) {
  for (const bool eight : {false, true}) {
    EscConfig c;
    c.sii_reads_eight = eight;
    c.sii_busy_looks = 5;
    WireRig rig(1, c);
    rig.scan_all();
    const auto images = read_sii_images(rig.registers, std::array<std::uint16_t, 1>{0x1001});
    const auto& image = images.at(0);
    ASSERT_TRUE(image) << image.error();
    const auto& all = rig.wire.slave(0).eeprom();
    ASSERT_LE(image.value().size(), all.size());
    EXPECT_TRUE(std::equal(image.value().begin(), image.value().end(), all.begin()));
  }
  // A wrong checksum shows in the control register and does not stop the reading.
  WireRig rig(1);
  rig.wire.slave(0).eeprom()[0] ^= 1;
  rig.scan_all();
  EXPECT_FALSE(rig.slaves.at(0).sii.checksum_good);
  EXPECT_NE(rig.registers.read_u16(0x1001, 0x0502).value_or(0) & (1U << 11U), 0U);
  // An EEPROM without an end is one line, not a long read.
  WireRig endless(1);
  auto& bytes = endless.wire.slave(0).eeprom();
  bytes[0x80] = 1;
  bytes[0x81] = 0;
  bytes[0x82] = 0xFF;
  bytes[0x83] = 0xFF;
  const auto found = scan(endless.startup.token(), endless.registers);
  ASSERT_TRUE(found) << found.error();
  const std::string& problem = found.value().at(0).problem;
  EXPECT_NE(problem.find("larger than any EEPROM"), std::string::npos) << problem;
}

TEST(Esc, ClocksAnswer) {
  WireRig rig(1);
  rig.scan_all();
  Bytes time(8), latch(4);
  EXPECT_EQ(rig.run(Command::kBwr, broadcast_address(0x0900), latch), 1);
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x0910), time), 1);
  EXPECT_GT(load_u32(time) + load_u32(time, 4), 0U);
  Bytes received(4);
  EXPECT_EQ(rig.run(Command::kFprd, station_address(0x1001, 0x0900), received), 1);
  EXPECT_NE(load_u32(received), 0U);
}

// Any datagrams: nothing is read or written outside, counters grow by at most 3 a slave.
TEST(Esc, AnyDatagrams) {
  const std::uint64_t seed = 71;
  rt::Random random(seed);
  WireRig rig(2);
  for (int i = 0; i < 20000; ++i) {
    FrameWriter w;
    const auto many = random.integer(1, 3);
    for (int k = 0; k < many; ++k) {
      Bytes data(static_cast<std::size_t>(random.integer(0, 80)));
      for (auto& b : data) b = static_cast<std::uint8_t>(random.integer(0, 255));
      const auto reg = static_cast<std::uint32_t>(
          random.uniform() < 0.8 ? random.integer(0, 0x1200) : random.integer(0, 0xFFFF));
      const auto low = static_cast<std::uint32_t>(
          random.uniform() < 0.5 ? random.integer(0, 1) : random.integer(0, 0xFFFF));
      ASSERT_TRUE(w.add(static_cast<Command>(random.integer(0, 14)), 1, low | reg << 16U,
                        data.size(), data));
    }
    const auto sent = w.finish();
    Bytes f(sent.begin(), sent.end());
    rig.port.set_now(rig.port.now() + rt::Nanos{random.integer(0, 1'000'000)});
    rig.wire.pass(f, rig.port.now());
    FrameView v;
    parse_frame(f, v);
    ASSERT_TRUE(v.good()) << "seed " << seed << ", frame " << i;
    for (std::size_t k = 0; k < v.count; ++k) ASSERT_LE(v.datagram[k].counter, 6);
  }
}

}  // namespace
}  // namespace tests
