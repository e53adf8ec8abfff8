// The file of what homing measured: written and read again, damaged at random, of another robot.
#include "drivers/youbot_bus/calibration_file.hpp"

#include <cmath>
#include <cstdio>

#include "drivers/youbot_bus/ethercat_youbot.hpp"
#include "drivers/youbot_bus/youbot_setup.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

constexpr std::array<std::int32_t, 5> kMost{696000, 312000, 384000, 186000, 306000};

std::vector<ec::SlaveInfo> slaves_of(yb::ChainKind kind, std::uint32_t first_serial = 1) {
  yb::YoubotChainConfig c;
  c.kind = kind;
  c.first_serial = first_serial;
  BusRig rig(c);
  EXPECT_TRUE(rig.master.find(rig.startup.token()));
  return rig.master.slaves();
}

yb::Calibration some(yb::ChainKind kind, rt::Random& random) {
  yb::Calibration c;
  c.date = "2026-11-25";
  c.chain = kind;
  c.boards = yb::identities(slaves_of(kind, static_cast<std::uint32_t>(random())));
  for (const auto& b : yb::boards_of(kind)) {
    if (b.kind != yb::BoardKind::kJoint) continue;
    const std::int64_t most = kMost[static_cast<std::size_t>(b.number - 1)];
    c.joints.push_back({b.arm, b.number, static_cast<std::int32_t>(random.integer(-most, most)), 1,
                        static_cast<std::int32_t>(random.integer(-20000, 20000))});
  }
  return c;
}

TEST(Calibration, WrittenAndReadAgainIsTheSame) {
  rt::Random random(3);
  for (const auto kind :
       {yb::ChainKind::kArm, yb::ChainKind::kBaseArm, yb::ChainKind::kBaseTwoArms})
    for (int i = 0; i < 100; ++i) {
      const yb::Calibration c = some(kind, random);
      EXPECT_EQ(yb::why_refused(c), "");
      const auto read = yb::read_calibration(yb::calibration_text(c), "file");
      ASSERT_TRUE(read) << read.error();
      EXPECT_EQ(read.value(), c);
    }
}

// A byte changed, left out or put in, a piece cut off, two pieces swapped: refused in one line,
// every time, that names the file.
TEST(Calibration, RandomDamageIsAlwaysRefused) {
  rt::Random random(4);
  const std::string whole = yb::calibration_text(some(yb::ChainKind::kBaseTwoArms, random));
  const auto at = [&](std::size_t n) {
    return static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(n) - 1));
  };
  for (int i = 0; i < 5000; ++i) {
    std::string text = whole;
    for (std::int64_t k = random.integer(1, 3); k > 0 && !text.empty(); --k) {
      const std::size_t p = at(text.size());
      const char c = static_cast<char>(random.integer(0, 255));
      switch (random.integer(0, 5)) {
        case 0:
          text[p] = c;
          break;
        case 1:
          text[p] = static_cast<char>(text[p] ^ 1 << random.integer(0, 7));
          break;
        case 2:
          text.erase(p, static_cast<std::size_t>(random.integer(1, 40)));
          break;
        case 3:
          text.insert(p, 1, c);
          break;
        case 4:
          text.resize(p);
          break;
        default:
          text = text.substr(p) + text.substr(0, p);
      }
    }
    const auto read = yb::read_calibration(text, "file");
    if (text == whole) continue;
    ASSERT_FALSE(read) << text;
    ASSERT_EQ(read.error().rfind("file: ", 0), 0U) << read.error();
    ASSERT_NE(read.error().find("damaged"), std::string::npos) << read.error();
    ASSERT_EQ(read.error().find('\n'), std::string::npos);
  }
}

// Damage behind which somebody has put a right check: still one line, or a calibration in range.
TEST(Calibration, ContentIsNotBelievedForItsCheck) {
  rt::Random random(5);
  const std::string whole = yb::calibration_text(some(yb::ChainKind::kBaseArm, random));
  const std::string content = whole.substr(0, whole.rfind("# check"));
  int refused = 0;
  for (int i = 0; i < 5000; ++i) {
    std::string text = content;
    for (std::int64_t k = random.integer(1, 4); k > 0; --k)
      text[static_cast<std::size_t>(
          random.integer(0, static_cast<std::int64_t>(text.size()) - 1))] =
          static_cast<char>(random.integer(0, 255));
    const auto read = yb::read_calibration(yb::with_check(text), "file");
    if (read) {
      EXPECT_EQ(yb::why_refused(read.value()), "");
    } else {
      ++refused;
      ASSERT_EQ(read.error().rfind("file", 0), 0U) << read.error();
      ASSERT_EQ(read.error().find('\n'), std::string::npos) << read.error();
    }
  }
  EXPECT_GT(refused, 3000);
}

TEST(Calibration, WhatCanNotBeIsNamedWithItsRange) {
  rt::Random random(6);
  yb::Calibration good = some(yb::ChainKind::kBaseArm, random);
  for (auto& j : good.joints) j.offset_ticks = 1111 * j.joint, j.stop_mA = 700 + j.joint;
  const std::string text = yb::calibration_text(good);
  const std::string content = text.substr(0, text.rfind("# check"));
  struct Bad {
    const char *from, *to;
    std::array<const char*, 2> says;
  };
  const std::array<Bad, 10> bad{{
      {"version = 1", "version = 2", {"version", "1"}},
      {"2026-11-25", "2026-13-25", {"date", "2026-01-31"}},
      {"base+arm", "base", {"chain", "base+2arms"}},
      {"base+arm", "base+2arms", {"board", "17"}},
      {"TMCM-1632", "TMCM-1610", {"TMCM-1610", "wheel front left"}},
      {"offset_ticks = 2222",
       "offset_ticks = 312001",
       {"joint[1].offset_ticks", "-312000..312000"}},
      {"offset_ticks = 1111", "offset_ticks = nan", {"offset_ticks", "696000"}},
      {"direction = 1", "direction = -1", {"direction", "1"}},
      {"stop_mA = 703", "stop_mA = 20001", {"stop_mA", "20000"}},
      {"joint = 4", "joint = 5", {"joint[3]", "joint 4"}},
  }};
  for (const Bad& b : bad) {
    std::string changed = content;
    const auto at = changed.find(b.from);
    ASSERT_NE(at, std::string::npos) << b.from;
    changed.replace(at, std::string(b.from).size(), b.to);
    const auto read = yb::read_calibration(yb::with_check(changed), "file");
    ASSERT_FALSE(read) << b.to;
    for (const char* word : b.says)
      EXPECT_NE(read.error().find(word), std::string::npos) << read.error();
  }
  EXPECT_TRUE(yb::read_calibration(yb::with_check(content), "file"));
  EXPECT_FALSE(yb::load_calibration("/nowhere/calibration.toml"));
  EXPECT_FALSE(yb::load_calibration("/tmp"));
  EXPECT_FALSE(yb::read_calibration(std::string(100'000, '#'), "file"));
}

TEST(Calibration, AnotherRobotIsNamedByItsFirstSlaveThatDiffers) {
  rt::Random random(8);
  yb::Calibration c;
  c.boards = yb::identities(slaves_of(yb::ChainKind::kBaseArm, 1000));
  EXPECT_EQ(yb::other_robot(c, slaves_of(yb::ChainKind::kBaseArm, 1000)), "");
  EXPECT_TRUE(c.has_serials());
  const std::string other = yb::other_robot(c, slaves_of(yb::ChainKind::kBaseArm, 1001));
  EXPECT_NE(other.find("slave 1 is 'KR-845'"), std::string::npos) << other;
  EXPECT_NE(other.find("serial 1001, the file has"), std::string::npos) << other;
  EXPECT_NE(yb::other_robot(c, slaves_of(yb::ChainKind::kArm)).find("11 slaves"),
            std::string::npos);
  // A joint's board was replaced.
  c.boards[8].serial = 77;
  EXPECT_NE(yb::other_robot(c, slaves_of(yb::ChainKind::kBaseArm, 1000)).find("slave 9"),
            std::string::npos);
}

// From the virtual arm's homing to the robot's bus: measured are the ways to the stops.
TEST(Calibration, HomingMeasuresAndTheBusRefusesAnotherRobots) {
  yb::YoubotChainConfig chain;
  chain.end_stops = true;
  chain.first_serial = 500;
  BusRig rig(chain);
  rig.bring_up();
  yb::DriveSession session(rig.startup.token(), rig.master, rig.port, chain.kind);
  const yb::Progress quiet = [](const std::string&) {};
  ASSERT_TRUE(yb::commutate(session, quiet));
  yb::Calibration c{"2026-11-25", chain.kind, yb::identities(rig.master.slaves()), {}};
  ASSERT_TRUE(yb::home_arm(session, 1, quiet, &c.joints));
  ASSERT_EQ(c.joints.size(), 5U);
  EXPECT_EQ(yb::why_refused(c), "");
  for (const yb::HomedJoint& j : c.joints) {
    // It stood a tenth of joint 1's travel a fifth of its number before its stop, and its encoder
    // began there (twin/youbot_chain.cpp).
    EXPECT_NEAR(j.offset_ticks, 0.1 * j.joint * 585867 / 5, 15) << j.joint;
    EXPECT_GT(j.stop_mA, 500);
  }
  // Homed once more, it measures what the first time left.
  std::vector<yb::HomedJoint> again;
  ASSERT_TRUE(yb::home_arm(session, 1, quiet, &again));
  for (const yb::HomedJoint& j : again) EXPECT_LE(std::abs(j.offset_ticks), 60) << j.joint;

  const std::string path = testing::TempDir() + "/youbot_calibration.toml";
  std::FILE* f = std::fopen(path.c_str(), "wb");
  ASSERT_NE(f, nullptr);
  const std::string text = yb::calibration_text(c);
  EXPECT_EQ(std::fwrite(text.data(), 1, text.size(), f), text.size());
  std::fclose(f);
  const auto read = yb::load_calibration(path);
  ASSERT_TRUE(read) << read.error();
  for (const std::uint32_t serial : {500U, 501U}) {
    rt::Startup startup;
    chain.first_serial = serial;
    chain.initialised = true;
    yb::YoubotChain robot(startup.token(), chain);
    yb::YoubotConfig y;
    y.calibration = read.value();
    const auto opened =
        yb::EtherCatYoubot::open(startup.token(), std::make_unique<ec::TwinPort>(robot.wire()), y);
    EXPECT_EQ(opened.has_value(), serial == 500) << (opened ? "" : opened.error());
    if (!opened) {
      EXPECT_NE(opened.error().find("calibration: it is another robot's: slave 1"),
                std::string::npos)
          << opened.error();
    }
  }
  std::remove(path.c_str());
}

}  // namespace
}  // namespace tests
