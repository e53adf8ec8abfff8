// A start on a wire that loses, damages and miscounts frames; and what a failure is called.
#include <gmock/gmock.h>

#include "drivers/ethercat/scan.hpp"
#include "drivers/youbot_bus/chain_wait.hpp"
#include "drivers/youbot_bus/ethercat_youbot.hpp"
#include "tests/unit/tool_twin/faulty_port.hpp"

namespace {

using tests::FaultyPort;
namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

struct Start {
  bool op = false;
  std::string why;
};

Start start(const std::vector<std::string>& faults, int seed) {
  rt::Startup startup;
  yb::YoubotChainConfig c;
  c.initialised = true;
  yb::YoubotChain chain(startup.token(), c);
  auto port = std::make_unique<FaultyPort>(chain, faults);
  port->draw(seed);
  const auto youbot = yb::EtherCatYoubot::open(startup.token(), std::move(port), {});
  if (!youbot) return {false, youbot.error()};
  for (std::size_t i = 0; i < chain.boards().size(); ++i)
    if (chain.wire().slave(i).al_status().is() != ec::AlState::kOp) return {false, "not in OP"};
  return {true, {}};
}

// Of 20 starts at least 18, and each failure names lost frames.
TEST(Patience, FiveOfAHundredFramesCostNoStart) {
  const std::vector<std::vector<std::string>> kinds{
      {"lose-out:0.05"},
      {"lose-back:0.05"},
      {"corrupt:0.05"},
      {"counter:0.05"},
      {"lose-back:0.02", "corrupt:0.02", "counter:0.02", "delay:0.02"}};
  for (const auto& faults : kinds) {
    int reached = 0;
    for (int seed = 0; seed < 20; ++seed) {
      const Start s = start(faults, seed);
      reached += s.op ? 1 : 0;
      if (!s.op) {
        EXPECT_THAT(s.why, testing::HasSubstr("frames")) << faults[0] << " seed " << seed;
      }
    }
    EXPECT_GE(reached, 18) << faults[0];
  }
}

// Half of all frames gone: it may fail, and then says why.
TEST(Patience, AHopelessWireIsCalledThat) {
  for (int seed = 0; seed < 4; ++seed) {
    const Start s = start({"lose-out:0.9"}, seed);
    EXPECT_FALSE(s.op) << seed;
    EXPECT_THAT(s.why, testing::AnyOf(testing::HasSubstr("frames were lost"),
                                      testing::HasSubstr("no frame came back")))
        << seed;
    EXPECT_THAT(s.why, testing::Not(testing::HasSubstr("not a youBot"))) << seed;
  }
}

TEST(Patience, AScanOfElevenBoardsIsSomeHundredFrames) {
  rt::Startup startup;
  yb::YoubotChain chain(startup.token(), {});
  FaultyPort port(chain, {});
  ec::Master master(startup.token(), port);
  ASSERT_TRUE(master.find(startup.token()));
  ASSERT_EQ(master.slaves().size(), 11U);
  EXPECT_EQ(yb::find_chain(master.slaves()), yb::ChainKind::kBaseArm);
  EXPECT_LT(port.frames(), 1000);
  EXPECT_EQ(master.losses(), "");
}

// Lost frames, a slave that is not there, an EEPROM that is damaged, another device.
TEST(Patience, EachCauseHasWordsOfItsOwn) {
  rt::Startup startup;
  const auto bring_up = [&](const std::function<void(yb::YoubotChain&)>& damage,
                            const std::vector<std::string>& faults) {
    yb::YoubotChain chain(startup.token(), {});
    damage(chain);
    FaultyPort port(chain, faults);
    ec::Master master(startup.token(), port);
    const auto there = yb::bring_up(startup.token(), master, "base+arm");
    return there ? std::string("up") : there.error();
  };
  EXPECT_THAT(bring_up([](auto&) {}, {"silence"}), testing::HasSubstr("no frame came back"));
  EXPECT_THAT(bring_up([](auto&) {}, {"cut:6"}), testing::HasSubstr("slaves 7 to 11 are missing"));
  const auto no_eeprom = bring_up([](auto& c) { c.wire().slave(2).eeprom().clear(); }, {});
  EXPECT_THAT(no_eeprom, testing::HasSubstr("slave 3: SII"));
  EXPECT_THAT(no_eeprom, testing::Not(testing::HasSubstr("not a youBot")));
  const auto renamed = [](yb::YoubotChain& c) {
    auto& bytes = c.wire().slave(2).eeprom();
    const std::string name = "TMCM-1632";
    const auto at = std::search(bytes.begin(), bytes.end(), name.begin(), name.end());
    ASSERT_NE(at, bytes.end());
    *at = 'X';
  };
  EXPECT_THAT(bring_up(renamed, {}),
              testing::AllOf(testing::HasSubstr("not a youBot"), testing::HasSubstr("slave 3")));
}

// What a person is told while they mend it, and that it goes on then.
TEST(Patience, AChainThatIsNotWholeIsWaitedFor) {
  rt::Startup startup;
  struct Case {
    const char *fault, *chain, *told;
  };
  for (const auto& [fault, chain, told] :
       {Case{"cut:6@0-3", "base+arm",
             "slaves 7 to 11 are missing: look at the cable behind 6, or at the emergency stop"},
        Case{"cut:10@0-3", "any",
             "slave 11 is missing: look at the cable behind 10, or at the emergency stop"},
        Case{"estop@0-3", "base+arm",
             "slaves 2 to 11 are missing: look at the cable behind 1, or at the emergency stop"},
        Case{"silence@0-3", "base+arm",
             "no frame comes back: look at the cable to the first slave"}}) {
    yb::YoubotChainConfig c;
    c.initialised = true;
    yb::YoubotChain boards(startup.token(), c);
    auto port = std::make_unique<FaultyPort>(boards, std::vector<std::string>{fault});
    const rt::Time begun = port->now();
    std::vector<std::string> said;
    const auto all = yb::await_chain(startup.token(), *port, chain, [&](const std::string& line) {
      said.push_back(line);
      return true;
    });
    ASSERT_TRUE(all) << fault;
    EXPECT_EQ(all.value(), 11) << fault;
    EXPECT_GE(port->now(), begun + std::chrono::seconds{3});
    EXPECT_LE(port->now(), begun + std::chrono::seconds{4});
    EXPECT_THAT(said, testing::Each(std::string(told))) << fault;
    EXPECT_GE(said.size(), 10U);
    EXPECT_LE(port->frames(), 1000) << "it looks and does not flood";
    const auto youbot = yb::EtherCatYoubot::open(startup.token(), std::move(port), {});
    EXPECT_TRUE(youbot) << fault << ": " << youbot.error();
  }
}

TEST(Patience, WaitingEndsWhenAPersonEndsItAndDoesNotBeginForAWholeChain) {
  rt::Startup startup;
  yb::YoubotChain boards(startup.token(), {});
  FaultyPort cut(boards, {"cut:6"});
  int looks = 0;
  const auto none = yb::await_chain(startup.token(), cut, "base+arm",
                                    [&](const std::string&) { return ++looks < 5; });
  ASSERT_FALSE(none);
  EXPECT_EQ(looks, 5);
  EXPECT_THAT(none.error(), testing::HasSubstr("slaves 7 to 11 are missing"));
  yb::YoubotChain whole(startup.token(), {});
  FaultyPort good(whole, {});
  const auto refused = [](const std::string& line) {
    ADD_FAILURE() << line;
    return false;
  };
  EXPECT_TRUE(yb::await_chain(startup.token(), good, "base+arm", refused));
  EXPECT_TRUE(yb::await_chain(startup.token(), good, "base", refused))
      << "too many: not waited for";
  EXPECT_EQ(good.frames(), 6);
}

}  // namespace
