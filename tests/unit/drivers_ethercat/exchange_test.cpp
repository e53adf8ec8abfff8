// The reply to a frame among frames that are none.
#include "drivers/ethercat/exchange.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <functional>
#include <vector>

namespace {

using namespace drivers::ethercat;
using Bytes = std::vector<std::uint8_t>;

// Gives what the test puts there; keeps what was sent.
class ScriptedPort final : public Port {
 public:
  std::deque<Bytes> incoming;
  std::vector<Bytes> sent;
  bool up = true, answers = true;
  bool send(std::span<const std::uint8_t> f) noexcept override {
    if (!up) return false;
    sent.emplace_back(f.begin(), f.end());
    for (auto& b : before_reply) incoming.push_back(b);
    if (answers) incoming.push_back(change(sent.back()));
    return true;
  }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time) noexcept override {
    if (incoming.empty()) return 0;
    const Bytes f = incoming.front();
    incoming.pop_front();
    std::copy_n(f.begin(), std::min(f.size(), into.size()), into.begin());
    return std::min(f.size(), into.size());
  }
  rt::Time now() const noexcept override { return rt::time_from_ns(5); }
  void sleep_until(rt::Time) noexcept override {}
  std::vector<Bytes> before_reply;
  std::function<Bytes(Bytes)> change = [](Bytes b) { return b; };
};

bool one(FrameExchange& x) {
  x.begin();
  EXPECT_TRUE(x.add(Command::kFprd, station_address(0x1001, 0x0130), 6));
  EXPECT_TRUE(x.add(Command::kBrd, broadcast_address(0x0130), 2));
  return x.run(rt::time_from_ns(1000));
}

TEST(FrameExchange, TheIndexTellsTheReply) {
  ScriptedPort port;
  FrameExchange x(port);
  ASSERT_TRUE(one(x));
  Bytes late = port.sent.back();
  port.before_reply = {late, Bytes(60, 0x11), Bytes(3, 0)};
  ASSERT_TRUE(one(x));
  EXPECT_EQ(x.counters().foreign, 1U) << "the last one, late";
  EXPECT_EQ(x.counters().damaged, 2U);
  EXPECT_EQ(x.counters().lost, 0U);
}

TEST(FrameExchange, WhatWasSentMustComeBack) {
  const std::vector<std::function<Bytes(Bytes)>> changes{
      [](Bytes b) { return b[16] = 5, b; },      // another command
      [](Bytes b) { return b[18] ^= 1, b; },     // another station
      [](Bytes b) { return b[20] ^= 1, b; },     // another register
      [](Bytes b) { return b[38] ^= 1, b; },     // of the broadcast: its register
      [](Bytes b) { return b[23] |= 0x40, b; },  // circulating
      [](Bytes b) { return b[14] -= 1, b; },     // cut
      [](Bytes b) { return b.resize(30), b; }};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    ScriptedPort port;
    FrameExchange x(port);
    port.change = changes[i];
    EXPECT_FALSE(one(x)) << i;
    EXPECT_EQ(x.counters().damaged, 1U) << i;
    EXPECT_EQ(x.counters().lost, 1U) << i;
  }
  ScriptedPort port;
  FrameExchange x(port);
  port.change = [](Bytes b) { return b[36] = 7, b; };  // position of the broadcast: slaves count it
  EXPECT_TRUE(one(x));
  port.change = [](Bytes b) { return b.insert(b.end(), 4, 0xAA), b; };  // check sequence left on
  EXPECT_TRUE(one(x));
}

// A neighbour that never stops must not hold a cycle.
TEST(FrameExchange, ABabblingNeighbour) {
  ScriptedPort port;
  FrameExchange x(port);
  port.before_reply.assign(1000, Bytes(60, 0x11));
  EXPECT_FALSE(one(x));
  EXPECT_LE(x.counters().damaged, 100U);
  port.before_reply.clear();
  for (int i = 0; i < 20 && !port.incoming.empty(); ++i) (void)one(x);
  EXPECT_TRUE(one(x));
}

TEST(FrameExchange, DownAndSilent) {
  ScriptedPort port;
  FrameExchange x(port);
  port.up = false;
  EXPECT_FALSE(one(x));
  EXPECT_EQ(x.counters().refused, 1U);
  EXPECT_EQ(x.counters().sent, 0U);
  port.up = true;
  port.answers = false;
  EXPECT_FALSE(one(x));
  EXPECT_EQ(x.counters().lost, 1U);
}

}  // namespace
