// TMCL against the byte tables of the manuals, every number of the parameter table, any bytes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "drivers/tmcl/motor_faults.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "rt/random.hpp"

namespace {

using namespace drivers::tmcl;
using Bytes = std::vector<std::uint8_t>;

template <class A>
Bytes bytes_of(const A& a) {
  return {a.begin(), a.end()};
}

// TMCL reference manual, the examples of its command pages: address 01, value in hexadecimal.
TEST(Tmcl, TheManualsExamples) {
  const auto serial = [](Request r) { return bytes_of(to_serial(encode(r))); };
  // ROR 0, 350
  EXPECT_EQ(serial({1, 1, 0, 0, 350}), (Bytes{1, 1, 0, 0, 0, 0, 0x01, 0x5E, 0x61}));
  // ROL 0, 1200
  EXPECT_EQ(serial({1, 2, 0, 0, 1200}), (Bytes{1, 2, 0, 0, 0, 0, 0x04, 0xB0, 0xB7}));
  // MST 0
  EXPECT_EQ(serial({1, 3, 0, 0, 0}), (Bytes{1, 3, 0, 0, 0, 0, 0, 0, 0x04}));
  // MVP ABS, 0, 9000
  EXPECT_EQ(serial({1, 4, 0, 0, 9000}), (Bytes{1, 4, 0, 0, 0, 0, 0x23, 0x28, 0x50}));
  // MVP REL, 0, -1000
  EXPECT_EQ(serial({1, 4, 1, 0, -1000}), (Bytes{1, 4, 1, 0, 0xFF, 0xFF, 0xFC, 0x18, 0x18}));
  // SAP 6, 0, 2000 (maximum current)
  EXPECT_EQ(serial({1, 5, 6, 0, 2000}), (Bytes{1, 5, 6, 0, 0, 0, 0x07, 0xD0, 0xE3}));
  // GAP 0, 0
  EXPECT_EQ(serial({1, 6, 0, 0, 0}), (Bytes{1, 6, 0, 0, 0, 0, 0, 0, 0x07}));
  // The reply to it: host 02, status 100, position 711
  EXPECT_EQ(bytes_of(to_serial(encode(Reply{2, 1, 100, 6, 711}))),
            (Bytes{2, 1, 0x64, 6, 0, 0, 0x02, 0xC7, 0x36}));
}

// The bytes of published examples, read and written. None was made by the code under test.
TEST(Tmcl, PublishedRequestsBothWays) {
  struct Vector {
    const char* source;
    Bytes bytes;  // eight: printed without the checksum, as in a mailbox
    Request request;
  };
  const std::vector<Vector> vectors{
      {"TMCM-1640 V2.00, 4.6.1: ROR 0, 350", {1, 1, 0, 0, 0, 0, 0x01, 0x5E}, {1, 1, 0, 0, 350}},
      {"TMCM-351 V4.45, 4.6.1: ROR 2, 350", {1, 1, 0, 2, 0, 0, 0x01, 0x5E}, {1, 1, 0, 2, 350}},
      {"TMCM-1640 V2.00, 4.6.6: GAP 1, 0", {1, 6, 1, 0, 0, 0, 0, 0}, {1, 6, 1, 0, 0}},
      {"TMCM-3230 V1.07, 3.6.6: GAP 1, 0", {1, 6, 1, 0, 0, 0, 0, 0, 0x08}, {1, 6, 1, 0, 0}},
      {"TMCM-6110 V1.19, 5.6.6: GAP 6, 1", {1, 6, 6, 1, 0, 0, 0, 0}, {1, 6, 6, 1, 0}},
      {"TMCM-1180 V4.42, page 50: GGP 66, 0",
       {1, 0x0A, 0x42, 0, 0, 0, 0, 0, 0x4D},
       {1, 10, 66, 0, 0}},
  };
  for (const Vector& v : vectors) {
    const MailboxFrame wire = encode(v.request);
    EXPECT_EQ(v.bytes.size() == 8 ? bytes_of(wire) : bytes_of(to_serial(wire)), v.bytes)
        << v.source;
    MailboxFrame frame{};
    if (v.bytes.size() == 9) {
      ASSERT_TRUE(from_serial(v.bytes, frame)) << v.source;
    } else {
      std::copy(v.bytes.begin(), v.bytes.end(), frame.begin());
    }
    Request back;
    ASSERT_TRUE(decode(frame, back)) << v.source;
    EXPECT_EQ(back, v.request) << v.source;
  }
}

TEST(Tmcl, PublishedReplies) {
  Reply r;
  // TMCM-1640 V2.00, 4.6.6: position 711; reply address 0.
  ASSERT_TRUE(decode(Bytes{0x00, 0x01, 0x64, 0x06, 0x00, 0x00, 0x02, 0xC7}, r));
  EXPECT_EQ(r, (Reply{0, 1, 100, 6, 711}));
  // TMCM-1180 V4.42, page 50: the address of the module, 1.
  MailboxFrame frame{};
  ASSERT_TRUE(from_serial(Bytes{0x02, 0x01, 0x64, 0x0A, 0x00, 0x00, 0x00, 0x01, 0x72}, frame));
  ASSERT_TRUE(decode(frame, r));
  EXPECT_EQ(r, (Reply{2, 1, 100, 10, 1}));
  EXPECT_EQ(bytes_of(to_serial(encode(r))), (Bytes{0x02, 0x01, 0x64, 0x0A, 0, 0, 0, 0x01, 0x72}));
}

// The page of ROR in the manual of the TMCM-1180 (5.7.1) ends in 62. The sum of its bytes is 61, as
// the rule of all these manuals has it: what is printed there is no frame.
TEST(Tmcl, AMisprintedChecksumIsRefused) {
  MailboxFrame frame{};
  EXPECT_FALSE(from_serial(Bytes{1, 1, 0, 0, 0, 0, 0x01, 0x5E, 0x62}, frame));
  EXPECT_TRUE(from_serial(Bytes{1, 1, 0, 0, 0, 0, 0x01, 0x5E, 0x61}, frame));
}

TEST(Tmcl, EveryRequestSurvives) {
  const std::uint64_t seed = 22;
  rt::Random random(seed);
  for (int i = 0; i < 20000; ++i) {
    const auto byte = [&] { return static_cast<std::uint8_t>(random.integer(0, 255)); };
    const Request r{byte(), byte(), byte(), byte(), static_cast<std::int32_t>(random())};
    Request back;
    ASSERT_TRUE(decode(encode(r), back)) << "seed " << seed;
    ASSERT_EQ(back, r) << "seed " << seed;
    const Reply a{byte(), byte(), byte(), byte(), static_cast<std::int32_t>(random())};
    Reply again;
    ASSERT_TRUE(decode(encode(a), again)) << "seed " << seed;
    ASSERT_EQ(again, a) << "seed " << seed;
    // One wrong bit in the serial form is always seen: the sum changes by a power of two.
    auto wire = to_serial(encode(r));
    MailboxFrame frame{};
    ASSERT_TRUE(from_serial(wire, frame));
    wire[static_cast<std::size_t>(random.integer(0, 8))] ^=
        static_cast<std::uint8_t>(1U << static_cast<unsigned>(random.integer(0, 7)));
    ASSERT_FALSE(from_serial(wire, frame)) << "seed " << seed;
  }
}

TEST(Tmcl, AnyBytes) {
  rt::Random random(23);
  for (int i = 0; i < 20000; ++i) {
    Bytes b(static_cast<std::size_t>(random.integer(0, 20)));
    for (auto& x : b) x = static_cast<std::uint8_t>(random.integer(0, 255));
    Request r{9, 9, 9, 9, 9};
    EXPECT_EQ(decode(b, r), b.size() >= 8);
    if (b.size() < 8) {
      EXPECT_EQ(r, (Request{9, 9, 9, 9, 9}));
    }
    MailboxFrame f{};
    if (from_serial(b, f)) {
      EXPECT_EQ(b.size(), 9U);
    }
    (void)firmware_of(b);
  }
}

TEST(Tmcl, AReplyAnswersItsRequest) {
  const Request set{0, 5, 11, 0, 500}, get{0, 6, 11, 0, 0};
  EXPECT_TRUE(answers({0, 0, 100, 5, 500}, set));
  EXPECT_FALSE(answers({0, 0, 100, 5, 501}, set)) << "another value";
  EXPECT_FALSE(answers({0, 0, 4, 5, 500}, set)) << "invalid value";
  EXPECT_FALSE(answers({0, 0, 100, 6, 500}, set)) << "another command";
  EXPECT_TRUE(answers({0, 0, 100, 6, 77}, get));
}

TEST(Tmcl, FirmwareTexts) {
  const auto of = [](const std::string& s) {
    return firmware_of(std::span(reinterpret_cast<const std::uint8_t*>(s.data()), s.size()));
  };
  EXPECT_EQ(of("1632V200"), (Firmware{1632, 200}));
  EXPECT_EQ(of("841V1.48"), (Firmware{841, 148}));
  EXPECT_EQ(of("174V1.48"), (Firmware{174, 148}));
  EXPECT_EQ(of("1610V2.0"), (Firmware{1610, 20}));
  EXPECT_EQ(of(std::string("842V1\0\0\0", 8)), (Firmware{842, 1}));
  for (const char* bad :
       {"1632V20", "V2001632", "1632X200", "1632VV00", "16 2V200", "1632V2-0", "1632200V"})
    EXPECT_FALSE(of(bad)) << bad;
}

TEST(Tmcl, StatusCodesOfTheManual) {
  EXPECT_STREQ(status_text(100), "executed");
  EXPECT_STREQ(status_text(101), "loaded into the program memory");
  EXPECT_STREQ(status_text(1), "wrong checksum");
  EXPECT_STREQ(status_text(2), "invalid command");
  EXPECT_STREQ(status_text(3), "wrong type");
  EXPECT_STREQ(status_text(4), "invalid value");
  EXPECT_STREQ(status_text(5), "configuration EEPROM locked");
  EXPECT_STREQ(status_text(6), "command not available");
  EXPECT_STREQ(status_text(8), "parameter is password protected");
  EXPECT_STREQ(status_text(7), "unknown status");
}

TEST(Tmcl, ParameterTable) {
  const auto table = axis_parameters();
  for (std::size_t i = 1; i < table.size(); ++i)
    EXPECT_LT(table[i - 1].number, table[i].number) << "find_axis_parameter() needs the order";
  for (const auto& p : table) {
    EXPECT_EQ(find_axis_parameter(p.number), &p);
    EXPECT_LE(p.lowest, p.highest) << int{p.number};
    EXPECT_GT(std::string(p.name).size(), 2U);
  }
  EXPECT_EQ(find_axis_parameter(16), nullptr);
  EXPECT_EQ(find_axis_parameter(-1), nullptr);
  EXPECT_EQ(find_axis_parameter(255), nullptr);
  // Of the driver's own lists: protected, read-only, write-only.
  for (const int n : {6,   9,   25,  26,  28,  133, 134, 159, 160, 165, 177,
                      238, 239, 240, 241, 244, 245, 250, 251, 253, 254}) {
    EXPECT_EQ(find_axis_parameter(n)->access, Access::kProtected) << n;
  }
  for (const int n : {3, 13, 27, 150, 151, 152, 156, 157, 200, 201, 226, 227, 228, 229})
    EXPECT_EQ(find_axis_parameter(n)->access, Access::kRead) << n;
  for (const int n : {29, 158}) EXPECT_EQ(find_axis_parameter(n)->access, Access::kWrite) << n;
}

// The thermistor's own law, from the temperature to the reading and back.
TEST(Tmcl, DriverTemperature) {
  for (double c = 0; c <= 120; c += 10) {
    const double kohm = 10 * std::exp(3434.0 * (1 / (c + 273.16) - 1 / 298.16));
    const auto adc = static_cast<std::int32_t>(std::lround(9011.2 / (kohm + 2.2)));
    EXPECT_NEAR(driver_temperature_C(adc), c, 0.3) << c;
  }
  EXPECT_TRUE(std::isnan(driver_temperature_C(0)));
  EXPECT_TRUE(std::isnan(driver_temperature_C(-5)));
  EXPECT_TRUE(std::isnan(driver_temperature_C(4096)));
}

TEST(Tmcl, FlagsToFaults) {
  EXPECT_EQ(faults_of(0).count, 0);
  // Halted, velocity mode, initialised, position reached: no faults.
  EXPECT_EQ(fault_bits(1U << 4U | 1U << 9U | 1U << 15U | 1U << 14U), 0U);
  const auto two = faults_of(1U << 17U | 1U << 0U | 1U << 4U);
  ASSERT_EQ(two.count, 2);
  EXPECT_STREQ(two.entry[0]->name, "over-current");
  EXPECT_EQ(two.entry[0]->kind, FlagKind::kFault);
  EXPECT_STREQ(two.entry[1]->name, "I2t exceeded");
  EXPECT_EQ(two.entry[1]->kind, FlagKind::kLatched);
  EXPECT_EQ(two.entry[1]->clear_parameter, 29);
  EXPECT_EQ(motor_flags()[16].clear_parameter, 158);
  EXPECT_EQ(fault_bits(0xFFFC0000U), 0U) << "bits without a meaning";
  for (std::size_t i = 0; i < motor_flags().size(); ++i) EXPECT_EQ(motor_flags()[i].bit, i);
  // Count by count against the table of the reference: 10 faults in 18 bits.
  int faults = 0;
  for (unsigned b = 0; b < 32; ++b) faults += fault_bits(1U << b) != 0 ? 1 : 0;
  EXPECT_EQ(faults, 10);
}

}  // namespace
