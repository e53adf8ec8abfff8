// Frames: the tables' bytes, every length, damage, any bytes.
#include "drivers/ethercat/frame.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "rt/random.hpp"

namespace {

using namespace drivers::ethercat;
using Bytes = std::vector<std::uint8_t>;

Bytes copy(std::span<const std::uint8_t> s) { return {s.begin(), s.end()}; }

// A BRD of register 0x0130, two bytes, written out by hand from ETG.1000.4, 5.3.
TEST(EtherCatFrame, BytesOfABroadcastRead) {
  FrameWriter w;
  ASSERT_TRUE(w.add(Command::kBrd, 0x2A, broadcast_address(0x0130), 2));
  const Bytes got = copy(w.finish());
  Bytes want{0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF,  // destination
             0x10, 0x10, 0x10, 0x10, 0x10, 0x10,  // source
             0x88, 0xA4,                          // EtherType
             0x0E, 0x10,                          // length 14, type 1
             0x07, 0x2A,                          // BRD, index
             0x00, 0x00, 0x30, 0x01,              // position 0, register 0x0130
             0x02, 0x00,                          // length 2, the last
             0x00, 0x00,                          // irq
             0x00, 0x00,                          // data
             0x00, 0x00};                         // working counter
  want.resize(60, 0);
  EXPECT_EQ(got, want);
}

// Two datagrams: the first says that another follows; APWR to the third slave has position -2.
TEST(EtherCatFrame, MoreBitAndPosition) {
  FrameWriter w;
  const std::array<std::uint8_t, 2> station{0x03, 0x10};
  ASSERT_TRUE(w.add(Command::kApwr, 1, position_address(2, 0x0010), 2, station));
  ASSERT_TRUE(w.add(Command::kLrw, 1, 0x00010000, 4));
  const Bytes b = copy(w.finish());
  EXPECT_EQ(b[16], 2);
  EXPECT_EQ((Bytes{b.begin() + 18, b.begin() + 22}), (Bytes{0xFE, 0xFF, 0x10, 0x00}));
  EXPECT_EQ((Bytes{b.begin() + 22, b.begin() + 24}), (Bytes{0x02, 0x80}));
  EXPECT_EQ((Bytes{b.begin() + 26, b.begin() + 28}), (Bytes{0x03, 0x10}));
  EXPECT_EQ(b[30], 12);  // LRW behind the first counter
  EXPECT_EQ((Bytes{b.begin() + 32, b.begin() + 36}), (Bytes{0x00, 0x00, 0x01, 0x00}));
  EXPECT_EQ((Bytes{b.begin() + 36, b.begin() + 38}), (Bytes{0x04, 0x00}));
  EXPECT_EQ(b[14], 30);
}

// What a cycle of a base sends for one wheel, byte by byte from the tables of ETG.1000.4 (5.3
// EtherCAT head, 5.4 PDUs): LRW of its 25 bytes, BRD of AL status, FPRD of one slave's.
const Bytes kCycleOut{
    0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x10, 0x10, 0x10, 0x10, 0x10, 0x10,
    0x88, 0xA4, 0x45, 0x10,                                      // 37 + 14 + 18 bytes, type 1
    0x0C, 0x2B, 0x00, 0x00, 0x01, 0x00, 0x19, 0x80, 0x00, 0x00,  // LRW, 0x00010000, 25, more
    0x58, 0x02, 0x00, 0x00, 0x02,                                // outputs: 600 rpm, velocity mode
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,  // inputs, 20
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,  // working counter
    0x07, 0x2B, 0x00, 0x00, 0x30, 0x01, 0x02, 0x80, 0x00, 0x00,              // BRD 0x0130, 2, more
    0x00, 0x00, 0x00, 0x00,                                                  //
    0x04, 0x2B, 0x02, 0x10, 0x30, 0x01, 0x06, 0x00, 0x00, 0x00,  // FPRD 0x1002, 0x0130, 6, last
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00};

TEST(EtherCatFrame, BytesOfACycle) {
  FrameWriter w;
  const std::array<std::uint8_t, 5> outputs{0x58, 0x02, 0x00, 0x00, 0x02};
  ASSERT_TRUE(w.add(Command::kLrw, 0x2B, 0x00010000, 25, outputs));
  ASSERT_TRUE(w.add(Command::kBrd, 0x2B, broadcast_address(0x0130), 2));
  ASSERT_TRUE(w.add(Command::kFprd, 0x2B, station_address(0x1002, 0x0130), 6));
  EXPECT_EQ(copy(w.finish()), kCycleOut);
}

// The same frame as five slaves give it back: the first has marked the source, LRW counts 3 (wrote
// 2, read 1), BRD 5 and as many positions, FPRD 1.
TEST(EtherCatFrame, BytesOfACyclesReply) {
  Bytes b = kCycleOut;
  const auto put = [&](std::size_t at, const Bytes& bytes) {
    std::copy(bytes.begin(), bytes.end(), b.begin() + static_cast<std::ptrdiff_t>(at));
  };
  put(6, {0x12});
  put(24, {0x04, 0x00});                                      // LRW: irq, an AL event
  put(31, {0xFE, 0xFF, 0xFF, 0xFF, 0x2C, 0x01, 0x00, 0x00});  // position -2, 300 mA
  put(39, {0x58, 0x02, 0x00, 0x00, 0x00, 0x82, 0x00, 0x00});  // 600 rpm, flags 9 and 15
  put(51, {0x03, 0x00});                                      // LRW counter
  put(55, {0x05, 0x00});                                      // BRD: slaves passed
  put(63, {0x08, 0x00, 0x05, 0x00});                          // OP, counter
  put(77, {0x08, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x00});  // OP, code 0, counter
  FrameView v;
  parse_frame(b, v);
  ASSERT_TRUE(v.good()) << to_text(v.fault);
  ASSERT_EQ(v.count, 3U);
  EXPECT_EQ(v.source[0], 0x12);
  EXPECT_EQ(v.bytes, 85U);
  const DatagramView &lrw = v.datagram[0], &brd = v.datagram[1], &fprd = v.datagram[2];
  EXPECT_EQ(lrw.command, Command::kLrw);
  EXPECT_EQ(lrw.address, 0x00010000U);
  EXPECT_EQ(lrw.data.size(), 25U);
  EXPECT_EQ(lrw.irq, 0x0004);
  EXPECT_EQ(lrw.counter, 3);
  EXPECT_EQ(copy(lrw.data.subspan(5, 8)), (Bytes{0xFE, 0xFF, 0xFF, 0xFF, 0x2C, 0x01, 0x00, 0x00}));
  EXPECT_TRUE(lrw.more && brd.more && !fprd.more);
  EXPECT_EQ(brd.command, Command::kBrd);
  EXPECT_EQ(brd.address, 0x01300005U);
  EXPECT_EQ(copy(brd.data), (Bytes{0x08, 0x00}));
  EXPECT_EQ(brd.counter, 5);
  EXPECT_EQ(fprd.command, Command::kFprd);
  EXPECT_EQ(fprd.address, 0x01301002U);
  EXPECT_EQ(fprd.data.size(), 6U);
  EXPECT_EQ(fprd.counter, 1);
}

// Bits of the length word: 11 bits of length, 14 circulating, 15 more; bits 11 to 13 say nothing.
TEST(EtherCatFrame, LengthWord) {
  Bytes b = kCycleOut;
  b[23] = 0x80 | 0x40;  // of LRW
  b[60] = 0x80 | 0x38;  // of BRD: reserved bits set
  FrameView v;
  parse_frame(b, v);
  ASSERT_TRUE(v.good()) << to_text(v.fault);
  EXPECT_TRUE(v.datagram[0].circulating);
  EXPECT_EQ(v.datagram[0].data.size(), 25U);
  EXPECT_FALSE(v.datagram[1].circulating);
  EXPECT_EQ(v.datagram[1].data.size(), 2U);
}

TEST(EtherCatFrame, EveryLengthAndCommandSurvives) {
  FrameView v;
  for (std::size_t n = 0; n <= kMaxData; ++n) {
    FrameWriter w;
    Bytes data(n);
    for (std::size_t i = 0; i < n; ++i) data[i] = static_cast<std::uint8_t>(i * 7 + n);
    const auto c = static_cast<Command>(n % 15);
    ASSERT_TRUE(
        w.add(c, static_cast<std::uint8_t>(n), 0xDEAD0000U + static_cast<unsigned>(n), n, data));
    const auto frame = w.finish();
    EXPECT_EQ(frame.size(), std::max<std::size_t>(60, 28 + n));
    parse_frame(frame, v);
    ASSERT_TRUE(v.good()) << n << ": " << to_text(v.fault);
    ASSERT_EQ(v.count, 1U);
    EXPECT_EQ(v.datagram[0].command, c);
    EXPECT_EQ(v.datagram[0].address, 0xDEAD0000U + n);
    EXPECT_TRUE(
        std::equal(data.begin(), data.end(), v.datagram[0].data.begin(), v.datagram[0].data.end()));
    parse_frame(frame.first(28 + n), v);  // a virtual pair does not pad
    EXPECT_TRUE(v.good()) << n;
  }
  FrameWriter w;
  EXPECT_FALSE(w.add(Command::kLrw, 1, 0, kMaxData + 1));
  ASSERT_TRUE(w.add(Command::kLrw, 1, 0, kMaxData));
  EXPECT_FALSE(w.add(Command::kNop, 1, 0, 0)) << "full";
  FrameWriter many;
  for (int i = 0; i < 124; ++i) ASSERT_TRUE(many.add(Command::kNop, 1, 0, 0));
  EXPECT_FALSE(many.add(Command::kNop, 1, 0, 0));
}

TEST(EtherCatFrame, EachFaultIsNamed) {
  FrameWriter w;
  ASSERT_TRUE(w.add(Command::kBrd, 1, 0, 4));
  ASSERT_TRUE(w.add(Command::kLrd, 1, 0, 40));
  const Bytes good = copy(w.finish());
  const auto fault = [&](std::size_t at, std::uint8_t value, std::size_t size = 0) {
    Bytes b = good;
    b[at] = value;
    if (size > 0) b.resize(size);
    FrameView v;
    parse_frame(b, v);
    return v.fault;
  };
  EXPECT_EQ(fault(0, 0xFF), FrameFault::kNone);
  EXPECT_EQ(fault(0, 0xFF, 15), FrameFault::kTooShort);
  EXPECT_EQ(fault(0, 0xFF, 1515), FrameFault::kTooLong);
  EXPECT_EQ(fault(12, 0x08), FrameFault::kOtherProtocol);
  EXPECT_EQ(fault(15, 0x40), FrameFault::kWrongType);
  EXPECT_EQ(fault(14, good[14] + 1), FrameFault::kLengthOverrun);
  EXPECT_EQ(fault(14, good[14] - 1), FrameFault::kCutDatagram);
  EXPECT_EQ(fault(14, 0), FrameFault::kEmpty);
  EXPECT_EQ(fault(16, 15), FrameFault::kUnknownCommand);
  EXPECT_EQ(fault(23, 0x00), FrameFault::kMoreMissing) << "the first says it is the last";
  EXPECT_EQ(fault(39, 0x80), FrameFault::kMoreTooMany) << "the last says that another follows";
  EXPECT_EQ(fault(22, 0xFF), FrameFault::kCutDatagram);
  for (int f = 0; f <= static_cast<int>(FrameFault::kUnknownCommand); ++f)
    EXPECT_GT(std::string(to_text(static_cast<FrameFault>(f))).size(), 3U);
}

// The reference: walks the bytes by the words of the standard, one check after the other.
bool well_formed(const Bytes& b) {
  if (b.size() < 16 || b.size() > 1514 || b[12] != 0x88 || b[13] != 0xA4) return false;
  const std::size_t length = b[14] + 256 * static_cast<std::size_t>(b[15] & 7);
  if (b[15] / 16 != 1 || length == 0 || 16 + length > b.size()) return false;
  std::size_t at = 16, left = length;
  for (bool more = true; more;) {
    if (left < 12 || b[at] > 14) return false;
    const std::size_t n = b[at + 6] + 256 * static_cast<std::size_t>(b[at + 7] & 7);
    if (left < 12 + n) return false;
    more = (b[at + 7] & 0x80) != 0;
    at += 12 + n;
    left -= 12 + n;
  }
  return left == 0;
}

TEST(EtherCatFrame, AnyBytes) {
  const std::uint64_t seed = 41;
  rt::Random random(seed);
  int accepted = 0;
  for (int i = 0; i < 30000; ++i) {
    FrameWriter w;
    const auto datagrams = random.integer(1, random.uniform() < 0.1 ? 124 : 4);
    for (int d = 0; d < datagrams; ++d)
      (void)w.add(static_cast<Command>(random.integer(0, 14)), 3, 0x01300000,
                  static_cast<std::size_t>(random.integer(0, 60)));
    Bytes b = copy(w.finish());
    for (auto n = random.integer(0, 3); n > 0; --n)
      b[static_cast<std::size_t>(random.integer(12, 45))] =
          static_cast<std::uint8_t>(random.integer(0, 255));
    if (random.uniform() < 0.2) b.resize(static_cast<std::size_t>(random.integer(0, 80)));
    FrameView v;
    parse_frame(b, v);
    ASSERT_EQ(v.good(), well_formed(b))
        << "seed " << seed << ", input " << i << ": " << to_text(v.fault);
    accepted += v.good() ? 1 : 0;
  }
  EXPECT_GT(accepted, 3000);
  EXPECT_LT(accepted, 27000);
}

}  // namespace
