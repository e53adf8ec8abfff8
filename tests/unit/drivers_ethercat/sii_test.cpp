// EEPROM content: words written out by hand, every category, damage, any bytes.
#include "drivers/ethercat/sii.hpp"

#include <gtest/gtest.h>

#include "drivers/ethercat/twin/sii_builder.hpp"
#include "rt/random.hpp"

namespace {

using namespace drivers::ethercat;
using Bytes = std::vector<std::uint8_t>;

// CRC-8, polynomial x^8 + x^2 + x + 1, start 0xFF.
TEST(Sii, Checksum) {
  std::array<std::uint8_t, 14> b{};
  // One bit of input and one of output at a time; 0xFF over fourteen zero bytes, by long division.
  unsigned crc = 0xFF;
  for (int i = 0; i < 14 * 8; ++i) crc = crc & 0x80U ? (crc * 2 ^ 0x107U) & 0xFFU : crc * 2;
  EXPECT_EQ(sii_checksum(b), crc);
  b[13] = 1;  // the last byte's bits end where the divisor is: x^8 mod p = x^2 + x + 1
  EXPECT_EQ(sii_checksum(b), crc ^ 0x07U);
}

Bytes by_hand() {
  Bytes b(0x80, 0);
  b[0x10] = 0x86;
  b[0x11] = 0x02;  // vendor 0x286
  b[0x14] = 0x44;
  b[0x15] = 0x33;
  b[0x16] = 0x22;
  b[0x17] = 0x11;  // product 0x11223344
  b[0x18] = 7;     // revision
  b[0x1C] = 9;     // serial
  b[0x30] = 0x00;
  b[0x31] = 0x10;  // mailbox out 0x1000
  b[0x32] = 0x80;  // 128
  b[0x34] = 0x80;
  b[0x35] = 0x10;  // mailbox in 0x1080
  b[0x36] = 0x40;  // 64
  b[0x38] = 0x04;  // CoE
  const Bytes categories{
      10,   0,    4,  0, 2,    3,    'A', 'B', 'C',  1,    'x', 0,  // strings
      40,   0,    1,  0, 1,    2,                                   // FMMU
      41,   0,    4,  0, 0x00, 0x11, 5,   0,   0x64, 0,    1,   3,  // outputs
      51,   0,    12, 0, 0x00, 0x16, 2,   2,   0,    0,    0,   0,  // RxPDO
      0x00, 0x70, 1,  0, 7,    32,   0,   0,   0x00, 0x70, 2,   0,
      5,    8,    0,  0, 0x34, 0x12, 1,   0,   0xAA, 0xBB,  // unknown: passed over
      0xFF, 0xFF};
  b.insert(b.end(), categories.begin(), categories.end());
  return b;
}

TEST(Sii, WordsByHand) {
  const auto r = parse_sii(by_hand());
  ASSERT_TRUE(r) << r.error();
  const SiiContent& s = r.value();
  EXPECT_EQ(s.vendor, 0x286U);
  EXPECT_EQ(s.product, 0x11223344U);
  EXPECT_EQ(s.revision, 7U);
  EXPECT_EQ(s.serial, 9U);
  EXPECT_EQ(s.mailbox_out_start, 0x1000);
  EXPECT_EQ(s.mailbox_out_length, 128);
  EXPECT_EQ(s.mailbox_in_start, 0x1080);
  EXPECT_EQ(s.mailbox_in_length, 64);
  EXPECT_TRUE(s.has_coe());
  EXPECT_FALSE(s.checksum_good) << "0 there is no reason to refuse";
  ASSERT_EQ(s.strings.size(), 2U);
  EXPECT_EQ(s.name, "ABC");
  EXPECT_EQ(s.strings[1], "x");
  EXPECT_EQ(s.fmmus, (Bytes{1, 2}));
  ASSERT_EQ(s.sync_managers.size(), 1U);
  EXPECT_EQ(s.sync_managers[0].start, 0x1100);
  EXPECT_EQ(s.sync_managers[0].length, 5);
  EXPECT_EQ(s.sync_managers[0].control, 0x64);
  EXPECT_EQ(s.sync_managers[0].type, 3);
  ASSERT_EQ(s.rx_pdos.size(), 1U);
  EXPECT_EQ(s.rx_pdos[0].index, 0x1600);
  EXPECT_EQ(s.rx_pdos[0].sync_manager, 2);
  EXPECT_EQ(s.rx_pdos[0].bits, 40U);
}

// The first 64 words of a drive's EEPROM as another master's tool dumped it (SOEM issue 47, vendor
// 0x26C). The tool prints the checksum of the device and its own: both 0x0040.
Bytes words_of_a_device() {
  Bytes b{0x05, 0x06, 0x0B, 0x0E, 0x64, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
          0x00, 0x00, 0x00, 0x40, 0x00, 0x6C, 0x02, 0x00, 0x00, 0x02, 0x00,
          0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00};
  b.resize(0x28, 0);
  const Bytes mailboxes{0x00, 0x10, 0x80, 0x00, 0x80, 0x10, 0x80, 0x00,  // bootstrap
                        0x00, 0x10, 0x80, 0x00, 0x80, 0x10, 0x80, 0x00,  // standard
                        0x0C, 0x00};                                     // CoE and FoE
  b.insert(b.end(), mailboxes.begin(), mailboxes.end());
  b.resize(0x7C, 0);
  const Bytes size{0x7F, 0x00, 0x01, 0x00};  // 128 KiBit, version 1
  b.insert(b.end(), size.begin(), size.end());
  return b;
}

TEST(Sii, ChecksumsOfDevices) {
  const Bytes drive = words_of_a_device();
  EXPECT_EQ(sii_checksum(std::span(drive).first<14>()), 0x40);
  // EL1008 (product 0x03F03052) by the same tool: word 0 0x0104, word 1 and alias 0, checksum 0x39;
  // words 2, 3, 5 and 6, which the tool does not print, are taken as 0.
  const std::array<std::uint8_t, 14> terminal{0x04, 0x01};
  EXPECT_EQ(sii_checksum(terminal), 0x39);
}

TEST(Sii, WordsOfADevice) {
  Bytes b = words_of_a_device();
  ASSERT_EQ(b.size(), 0x80U);
  b.insert(b.end(), {0xFF, 0xFF});
  const auto r = parse_sii(b);
  ASSERT_TRUE(r) << r.error();
  const SiiContent& s = r.value();
  EXPECT_TRUE(s.checksum_good);
  EXPECT_EQ(s.alias, 0);
  EXPECT_EQ(s.vendor, 0x26CU);
  EXPECT_EQ(s.product, 2U);
  EXPECT_EQ(s.revision, 1U);
  EXPECT_EQ(s.serial, 0U);
  EXPECT_EQ(s.mailbox_out_start, 0x1000);
  EXPECT_EQ(s.mailbox_out_length, 128);
  EXPECT_EQ(s.mailbox_in_start, 0x1080);
  EXPECT_EQ(s.mailbox_in_length, 128);
  EXPECT_EQ(s.protocols, 0x0C);
  b[0x0E] = 0x41;
  EXPECT_FALSE(parse_sii(b).value().checksum_good);
}

// Categories by ETG.2010, tables of strings, general, FMMU and sync managers: head {type, size in
// words}, data padded to a word; the name is the first string.
TEST(Sii, CategoryHeads) {
  Bytes b = words_of_a_device();
  const Bytes categories{
      0x0A, 0x00, 0x07, 0x00, 0x02, 0x09, 'T',  'M',  'C',  'M',  '-',  '1',   // strings, 7 words
      '6',  '3',  '2',  0x02, 'k',  'W',                                       //
      0x1E, 0x00, 0x10, 0x00, 0x00, 0x00, 0x02, 0x01, 0x00, 0x00, 0x00, 0x00,  // general, 16 words
      0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,  // flags: no LRW
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,  //
      0x28, 0x00, 0x02, 0x00, 0x01, 0x02, 0x03, 0xFF,                          // FMMU, 2 words
      0x29, 0x00, 0x10, 0x00,                                                  // 4 sync managers
      0x00, 0x10, 0x80, 0x00, 0x26, 0x00, 0x01, 0x01,                          // mailbox out
      0x80, 0x10, 0x80, 0x00, 0x22, 0x00, 0x01, 0x02,                          // mailbox in
      0x00, 0x11, 0x05, 0x00, 0x64, 0x00, 0x01, 0x03,                          // outputs
      0x00, 0x14, 0x14, 0x00, 0x20, 0x00, 0x01, 0x04,                          // inputs
      0xFF, 0xFF};
  b.insert(b.end(), categories.begin(), categories.end());
  const auto r = parse_sii(b);
  ASSERT_TRUE(r) << r.error();
  const SiiContent& s = r.value();
  EXPECT_EQ(s.strings, (std::vector<std::string>{"TMCM-1632", "kW"}));
  EXPECT_EQ(s.name, "TMCM-1632");
  EXPECT_EQ(s.general_flags, 0x02);
  EXPECT_TRUE(s.forbids_lrw());
  EXPECT_EQ(s.fmmus, (Bytes{1, 2, 3, 0xFF}));
  ASSERT_EQ(s.sync_managers.size(), 4U);
  const std::array<std::array<int, 4>, 4> want{{{0x1000, 128, 0x26, 1},
                                                {0x1080, 128, 0x22, 2},
                                                {0x1100, 5, 0x64, 3},
                                                {0x1400, 20, 0x20, 4}}};
  for (std::size_t i = 0; i < want.size(); ++i) {
    const SiiSyncManager& m = s.sync_managers[i];
    EXPECT_EQ((std::array<int, 4>{m.start, m.length, m.control, m.type}), want[i]) << i;
    EXPECT_EQ(m.enable, 1) << i;
  }
}

TEST(Sii, WhatTheBuilderWrites) {
  SiiBuilder sii;
  sii.identity(1, 2, 3, 4).alias(0x1234).mailbox(0x1000, 32, 0x1020, 48, 0);
  sii.strings({"NAME", "group"}).general(2, 1, 1, 0x02).fmmus({1, 2, 3});
  sii.pdo(true, 0x1A00, 3, {16, 32}).pdo(false, 0x1600, 2, {8});
  const auto image = sii.image(1024);
  EXPECT_EQ(image.size(), 1024U);
  const auto r = parse_sii(image);
  ASSERT_TRUE(r) << r.error();
  EXPECT_TRUE(r.value().checksum_good);
  EXPECT_EQ(r.value().alias, 0x1234);
  EXPECT_TRUE(r.value().forbids_lrw());
  EXPECT_TRUE(r.value().has_mailbox());
  EXPECT_FALSE(r.value().has_coe());
  EXPECT_EQ(r.value().tx_pdos.at(0).bits, 48U);
  // Every single bit of the first seven words changes the checksum.
  for (std::size_t bit = 0; bit < 14 * 8; ++bit) {
    auto bad = image;
    bad[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    const auto s = parse_sii(bad);
    ASSERT_TRUE(s);
    EXPECT_FALSE(s.value().checksum_good) << bit;
  }
}

TEST(Sii, WhatIsWrongIsOneLine) {
  const Bytes good = by_hand();
  for (std::size_t n = 0; n < good.size(); ++n) {
    const auto r = parse_sii(std::span(good).first(n));
    ASSERT_FALSE(r) << n;
    EXPECT_EQ(r.error().rfind("SII word 0x", 0), 0U) << r.error();
    EXPECT_EQ(r.error().find('\n'), std::string::npos);
  }
  Bytes bad = good;
  bad[0x80 + 4] = 9;  // nine strings where there are two
  EXPECT_NE(parse_sii(bad).error().find("a string reaches behind"), std::string::npos);
  bad = good;
  bad[0x80 + 12 + 6 + 12 + 6] = 200;  // entries of the PDO
  EXPECT_NE(parse_sii(bad).error().find("a PDO reaches behind"), std::string::npos);
  bad = good;
  bad[0x80 + 6] = '\n';
  EXPECT_EQ(parse_sii(bad).value().name, ".BC") << "text of a table";
}

TEST(Sii, AnyBytes) {
  const std::uint64_t seed = 51;
  rt::Random random(seed);
  int accepted = 0;
  for (int i = 0; i < 30000; ++i) {
    Bytes b = by_hand();
    for (auto n = random.integer(1, 6); n > 0; --n)
      b[static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(b.size()) - 1))] =
          static_cast<std::uint8_t>(random.integer(0, 255));
    if (random.uniform() < 0.1) b.resize(static_cast<std::size_t>(random.integer(0, 200)));
    const auto r = parse_sii(b);
    if (!r) {
      EXPECT_EQ(r.error().find('\n'), std::string::npos);
    }
    accepted += r ? 1 : 0;
  }
  EXPECT_GT(accepted, 1000) << "seed " << seed;
  EXPECT_LT(accepted, 29000) << "seed " << seed;
}

}  // namespace
