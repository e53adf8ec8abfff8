// `teletact twin youbot --fault`: what is asked for, what is refused, what the chain then does.
#include "tools/bus/twin_faults.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "tools/bus/youbot_command.hpp"

namespace {

using namespace teletact;
using namespace std::chrono_literals;
namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

TEST(TwinFaults, KindsAndTheirValues) {
  const TwinFault lose = parse_twin_fault("lose-out:0.25");
  EXPECT_EQ(lose.kind, TwinFaultKind::kLoseOut);
  EXPECT_EQ(lose.share, 0.25);
  EXPECT_EQ(lose.from_s, 0);
  const TwinFault cut = parse_twin_fault("cut:4@2.5");
  EXPECT_EQ(cut.kind, TwinFaultKind::kCut);
  EXPECT_EQ(cut.slave, 4U);
  EXPECT_EQ(cut.from_s, 2.5);
  EXPECT_EQ(parse_twin_fault("estop@1").kind, TwinFaultKind::kEmergencyStop);
  EXPECT_EQ(parse_twin_fault("counter:1").kind, TwinFaultKind::kCounter);
  EXPECT_EQ(parse_twin_fault("stick:2").kind, TwinFaultKind::kStick);
}

std::string refusal_of(const std::string& text) {
  try {
    (void)parse_twin_fault(text);
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "taken";
}

TEST(TwinFaults, BadInputIsOneLineWithWhatIsAllowed) {
  for (const char* text : {"", "cuts:1", ":", "@1", "LOSE-OUT:0.1"})
    EXPECT_THAT(refusal_of(text), testing::HasSubstr("lose-out, lose-back, duplicate")) << text;
  for (const char* text : {"lose-out", "delay:0", "delay:1.1", "corrupt:nan", "counter:", "delay:x",
                           "duplicate:-1", "delay:0.1x"})
    EXPECT_THAT(refusal_of(text), testing::HasSubstr("above 0 and at most 1")) << text;
  for (const char* text : {"cut", "fall:0", "i2t:1.5", "stick:-2", "cut:65", "cut:inf"})
    EXPECT_THAT(refusal_of(text), testing::HasSubstr("counted from 1")) << text;
  for (const char* text : {"estop@", "estop@-1", "cut:1@x", "cut:1@1@2", "estop@nan", "estop@1e9"})
    EXPECT_THAT(refusal_of(text), testing::HasSubstr("0 to 1000000")) << text;
  EXPECT_THAT(refusal_of("estop:1"), testing::HasSubstr("takes no value"));
  EXPECT_EQ(refusal_of("cuts:1").find('\n'), std::string::npos);
}

struct TwinRig {
  explicit TwinRig(const std::vector<std::string>& texts) {
    std::vector<TwinFault> faults;
    for (const auto& t : texts) faults.push_back(parse_twin_fault(t));
    twin.emplace(chain, faults);
    twin->start(now);
  }
  // A broadcast read: what comes back at once.
  std::vector<std::vector<std::uint8_t>> ask() {
    ec::FrameWriter w;
    EXPECT_TRUE(w.add(ec::Command::kBrd, 7, ec::broadcast_address(0x0000), 1));
    const auto sent = w.finish();
    std::array<std::uint8_t, 1514> bytes{};
    std::copy(sent.begin(), sent.end(), bytes.begin());
    twin->take(std::span(bytes).first(sent.size()), now);
    return given();
  }
  std::vector<std::vector<std::uint8_t>> given() {
    std::vector<std::vector<std::uint8_t>> out;
    std::array<std::uint8_t, 1514> bytes{};
    while (const std::size_t n = twin->give(bytes, now))
      out.emplace_back(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
    return out;
  }
  // Slaves that a whole frame came back from; -1: none came.
  int counter() {
    const auto back = ask();
    if (back.empty()) return -1;
    ec::FrameView v;
    ec::parse_frame(back.front(), v);
    return v.good() ? v.datagram[0].counter : -2;
  }
  rt::Startup startup;
  yb::YoubotChain chain{startup.token(), {}};  // base and arm: 11 slaves
  rt::Time now = rt::time_from_ns(1'000'000'000);
  std::optional<FaultyTwin> twin;
};

TEST(TwinFaults, FramesMeetWhatWasAskedFor) {
  EXPECT_EQ(TwinRig({}).counter(), 11);
  EXPECT_EQ(TwinRig({"lose-out:1"}).counter(), -1);
  TwinRig back({"lose-back:1"});
  EXPECT_EQ(back.counter(), -1);
  EXPECT_EQ(back.chain.wire().frames(), 1U) << "the slaves had it";
  EXPECT_EQ(TwinRig({"duplicate:1"}).ask().size(), 2U);
  EXPECT_EQ(TwinRig({"counter:1"}).counter(), 10);
  TwinRig late({"delay:1"});
  EXPECT_EQ(late.counter(), -1);
  EXPECT_EQ(late.twin->next(late.now + 1s), late.now + 2ms);
  late.now += 2ms;
  EXPECT_EQ(late.given().size(), 1U);
  EXPECT_NE(TwinRig({"corrupt:1"}).ask(), TwinRig({}).ask());
  // From then on, and by its share.
  TwinRig some({"lose-out:0.2@5"});
  int lost = 0;
  for (int k = 0; k < 1000; ++k) lost += some.counter() < 0 ? 1 : 0;
  EXPECT_EQ(lost, 0);
  some.now += 5s;
  for (int k = 0; k < 5000; ++k) lost += some.counter() < 0 ? 1 : 0;
  EXPECT_GT(lost, 850);
  EXPECT_LT(lost, 1150);
}

TEST(TwinFaults, TheChainDoesWhatWasAskedFor) {
  TwinRig rig({"cut:3@1", "fall:2@2", "i2t:2@3", "stick:8@4"});
  EXPECT_EQ(rig.counter(), 11);
  EXPECT_EQ(rig.twin->next(rig.now + 10s), rig.now + 1s);
  rig.twin->act(rig.now += 1s);
  EXPECT_EQ(rig.counter(), 3);
  EXPECT_FALSE(rig.chain.wire().slave(1).al_status().error());
  rig.twin->act(rig.now += 1s);
  EXPECT_TRUE(rig.chain.wire().slave(1).al_status().error());
  rig.twin->act(rig.now += 1s);
  EXPECT_NE(rig.chain.drive(1)->flags(rig.now) & 1U << 17U, 0U);
  // Once: mended by hand, it stays mended.
  rig.chain.wire().cut_behind(11);
  rig.twin->act(rig.now += 1s);
  EXPECT_EQ(rig.counter(), 11);
  EXPECT_EQ(rig.twin->next(rig.now + 10s), rig.now + 10s) << "nothing is left to do";
  TwinRig stop({"estop"});
  stop.twin->act(stop.now);
  EXPECT_EQ(stop.counter(), 1);
}

TEST(TwinFaults, AnEndIsBehindItsBeginning) {
  const TwinFault cut = parse_twin_fault("cut:4@2.5-4");
  EXPECT_EQ(cut.from_s, 2.5);
  EXPECT_EQ(cut.to_s, 4);
  EXPECT_EQ(parse_twin_fault("estop@1e-3-2e-3").to_s, 2e-3);
  EXPECT_TRUE(std::isinf(parse_twin_fault("estop@1").to_s));
  for (const char* text : {"estop@2-2", "estop@2-1", "cut:1@1-", "cut:1@1-x", "cut:1@1-2-3",
                           "lose-out:1@1-1e9", "estop@1--2", "silence@1-nan"})
    EXPECT_THAT(refusal_of(text), testing::HasSubstr("the end is after the beginning")) << text;
  EXPECT_THAT(refusal_of("fall:2@1-2"), testing::HasSubstr("by the master's recovery"));
  EXPECT_THAT(refusal_of("i2t:2@1-2"), testing::HasSubstr("by the motor's own clear"));
  EXPECT_THAT(refusal_of("silence:1"), testing::HasSubstr("takes no value"));
  EXPECT_THAT(refusal_of("link:1"), testing::HasSubstr("takes no value"));
}

TEST(TwinFaults, WhatWasAskedForIsTakenBackAtItsEnd) {
  TwinRig rig({"cut:3@1-2", "cut:6@1.5-3", "lose-out:1@4-5", "silence@6-7", "link@8-9"});
  const rt::Time start = rig.now;
  const auto at = [&](double seconds) {
    rig.now = start + rt::Nanos{static_cast<std::int64_t>(1e9 * seconds)};
    rig.twin->act(rig.now);
    return rig.counter();
  };
  EXPECT_EQ(at(0.9), 11);
  EXPECT_EQ(rig.twin->next(rig.now + 10s), start + 1s);
  EXPECT_EQ(at(1), 3);
  EXPECT_EQ(at(1.6), 3) << "cut before the other cut";
  EXPECT_EQ(rig.twin->next(rig.now + 10s), start + 2s) << "an end is something to do";
  EXPECT_EQ(at(2), 6) << "the other one is still cut";
  EXPECT_EQ(at(3), 11);
  EXPECT_EQ(at(4), -1);
  EXPECT_EQ(at(5), 11);
  const auto frames = rig.chain.wire().frames();
  EXPECT_EQ(at(6), -1);
  EXPECT_EQ(at(6.9), -1);
  EXPECT_EQ(rig.chain.wire().frames(), frames) << "nothing reaches the slaves";
  EXPECT_EQ(at(7), 11);
  EXPECT_EQ(at(8), -1);
  EXPECT_TRUE(rig.twin->link_down());
  EXPECT_EQ(rig.chain.wire().slave(0).memory()[0x0310], 1) << "a lost link";
  EXPECT_EQ(at(9), 11);
  EXPECT_FALSE(rig.twin->link_down());
  EXPECT_EQ(rig.twin->next(rig.now + 10s), rig.now + 10s) << "nothing is left to do";
}

// Released, the boards come back as from power that was off; a cut that is still there stays.
TEST(TwinFaults, AReleasedEmergencyStopGivesPowerBack) {
  TwinRig rig({"estop@1-2", "cut:8@0-3", "stick:2@1-2"});
  rig.twin->act(rig.now);
  EXPECT_EQ(rig.counter(), 8);
  rig.chain.wire().slave(1).fall(ec::al_code::kUnspecified, rig.now);
  rig.twin->act(rig.now += 1s);
  EXPECT_EQ(rig.counter(), 1);
  rig.twin->act(rig.now += 1s);
  EXPECT_EQ(rig.counter(), 8);
  EXPECT_EQ(rig.chain.wire().slave(1).al_status(),
            (ec::AlStatus{static_cast<std::uint8_t>(ec::AlState::kInit), 0}));
  rig.twin->act(rig.now += 1s);
  EXPECT_EQ(rig.counter(), 11);
}

// What is damaged is counted by a slave, as on a real cable (register 0x0302).
TEST(TwinFaults, ADamagedFrameIsCountedByASlave) {
  TwinRig rig({"corrupt:1"});
  for (int i = 0; i < 3; ++i) (void)rig.ask();
  EXPECT_EQ(rig.chain.wire().slave(0).memory()[0x0302], 3);
}

TEST(TwinFaults, SlavesThatTheChainDoesNotHave) {
  for (const auto& [text, why] :
       {std::pair{"cut:12", "slaves 1 to 11"}, {"i2t:1", "no motor"}, {"stick:6", "no motor"}}) {
    try {
      const TwinRig rig({text});
      ADD_FAILURE() << text;
    } catch (const std::runtime_error& e) {
      EXPECT_THAT(e.what(), testing::HasSubstr(why)) << text;
    }
    // The program says so before it looks for the network card.
    TwinOptions o;
    o.iface = "no_such_card";
    o.faults = {text};
    try {
      (void)run_youbot_twin(o);
      ADD_FAILURE() << text;
    } catch (const std::runtime_error& e) {
      EXPECT_THAT(e.what(), testing::HasSubstr(why)) << text;
    }
  }
}

}  // namespace
