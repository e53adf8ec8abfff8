// A slave that can not be driven: the scan has it and the others, and nothing is driven.
#include "drivers/ethercat/twin/sii_builder.hpp"
#include "drivers/youbot_bus/ethercat_youbot.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

// A base whose second slave has this EEPROM.
struct OddRig {
  explicit OddRig(const std::vector<std::uint8_t>& eeprom) {
    yb::YoubotChainConfig c;
    c.kind = yb::ChainKind::kBase;
    const auto boards = yb::boards_of(c.kind);
    for (std::size_t i = 0; i < boards.size(); ++i)
      wire.add(std::make_unique<ec::Esc>(startup.token(), c.esc,
                                         i == 1 ? eeprom : yb::youbot_eeprom(boards[i], c, 1),
                                         std::make_unique<ec::EscApplication>()));
  }
  rt::Startup startup;
  ec::TwinChain wire;
  ec::TwinPort port{wire};
  ec::Master master{startup.token(), port};
};

std::vector<std::uint8_t> damaged() {
  yb::YoubotChainConfig c;
  auto bytes = yb::youbot_eeprom({yb::BoardKind::kWheel, 0, 0}, c, 1);
  bytes.resize(0x90);  // its categories end in the middle of one, and 0xFF follows
  bytes[0x82] = 0xFF;
  bytes[0x83] = 0x3F;
  return bytes;
}

std::vector<std::uint8_t> with(std::uint16_t mailbox, bool second) {
  ec::SiiBuilder sii;
  sii.identity(0x286, 0x101, 2, 1).strings({"TMCM-1632"});
  const auto in = static_cast<std::uint16_t>(0x1000 + mailbox);
  sii.mailbox(0x1000, mailbox, in, mailbox, 0);
  sii.fmmus({1, 2});
  sii.managers({{0x1000, mailbox, 0x26, 1, 1},
                {in, mailbox, 0x22, 1, 2},
                {0x1900, 5, 0x64, 1, 3},
                {0x1A00, 20, 0x20, 1, static_cast<std::uint8_t>(second ? 3 : 4)}});
  return sii.image();
}

// The master of the public youBot driver lists such a board; what its bytes are is not known.
TEST(OddSlave, ProductCode0x11With40BytesEachWayIsRefusedWithASentence) {
  for (const char* name : {"TMCM-1632", "Trinamic"}) {
    ec::SiiBuilder sii;
    sii.identity(0x286, 0x11, 2, 1).strings({name});
    sii.fmmus({1, 2});
    sii.managers(
        {{0, 0, 0, 0, 1}, {0, 0, 0, 0, 2}, {0x1000, 40, 0x24, 1, 3}, {0x1100, 40, 0x20, 1, 4}});
    OddRig rig(sii.image());
    const auto up = yb::bring_up(rig.startup.token(), rig.master, "base");
    ASSERT_FALSE(up) << name;
    EXPECT_NE(up.error().find("slave 2: product code 0x11 with 40 bytes each way"),
              std::string::npos)
        << up.error();
  }
}

TEST(OddSlave, IsNamedAndTheOthersAreThere) {
  const std::vector<std::pair<std::vector<std::uint8_t>, std::string>> odd{
      {damaged(), "slave 2: "},
      {with(128, true), "more than one sync manager with process data a direction"},
      {with(600, false), "a mailbox of more than 512 bytes is not served"}};
  for (const auto& [eeprom, reason] : odd) {
    OddRig rig(eeprom);
    auto& nrt = rig.startup.token();
    const auto found = rig.master.find(nrt);
    ASSERT_TRUE(found) << found.error();
    const auto& slaves = rig.master.slaves();
    ASSERT_EQ(slaves.size(), 5U);
    ASSERT_EQ(rig.master.mapping().slaves.size(), 5U);
    EXPECT_NE(slaves[1].problem.find(reason), std::string::npos) << slaves[1].problem;
    for (const std::size_t i : {0U, 2U, 3U, 4U}) {
      EXPECT_EQ(slaves[i].problem, "") << reason;
      EXPECT_EQ(rig.master.mapping().slaves[i].output_bytes, i == 0 ? 0U : 5U);
    }
    EXPECT_EQ(rig.master.mapping().with_outputs, 3) << reason;
    const auto wrong = yb::check_chain(yb::ChainKind::kBase, slaves);
    ASSERT_EQ(wrong.size(), 1U) << reason;
    EXPECT_EQ(wrong[0], slaves[1].problem);
    // Driven it is not.
    const auto configured = rig.master.configure(nrt);
    ASSERT_FALSE(configured) << reason;
    EXPECT_EQ(configured.error(), slaves[1].problem);
    for (std::size_t i = 0; i < 5; ++i)
      EXPECT_EQ(rig.wire.slave(i).al_status().is(), ec::AlState::kInit);
  }
}

// Each could be driven, all together have more data than a frame takes.
TEST(OddSlave, AChainWithTooMuchDataIsShownAndNotDriven) {
  ec::SiiBuilder sii;
  sii.identity(1, 2, 3, 4).strings({"large"});
  sii.fmmus({1});
  sii.managers({{0x1000, 500, 0x24, 1, 3}});
  OddRig rig(sii.image());
  yb::YoubotChainConfig c;
  rig.wire.add(std::make_unique<ec::Esc>(rig.startup.token(), c.esc, sii.image(),
                                         std::make_unique<ec::EscApplication>()));
  ASSERT_TRUE(rig.master.find(rig.startup.token()));
  EXPECT_EQ(rig.master.slaves().size(), 6U);
  EXPECT_NE(rig.master.problem().find("bytes of process data"), std::string::npos);
  EXPECT_FALSE(rig.master.configure(rig.startup.token()));
}

}  // namespace
}  // namespace tests
