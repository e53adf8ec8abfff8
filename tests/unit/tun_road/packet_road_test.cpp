// The road for packets, without a device: what happens to each packet, counted.
#include "tools/measure/tun_road/packet_road.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

namespace {

using drivers::Way;
using teletact::PacketRoad;
using teletact::RoadConfig;

constexpr std::int64_t kMs = 1'000'000;

std::vector<std::uint8_t> packet_of(std::uint32_t number, std::size_t bytes = 1000) {
  std::vector<std::uint8_t> p(bytes);
  std::memcpy(p.data(), &number, sizeof number);
  return p;
}

struct Arrived {
  std::uint32_t number;
  double delay_ms;
};

// `count` packets of 1000 bytes, one every `every_ns`; all that arrives, in order.
std::vector<Arrived> pass(PacketRoad& road, std::uint32_t count, std::int64_t every_ns) {
  std::vector<Arrived> out;
  std::map<std::uint32_t, std::int64_t> sent;
  std::vector<std::uint8_t> p;
  const auto collect = [&](std::int64_t until) {
    for (std::int64_t t = road.next_arrival_ns(); t <= until && t != drivers::kNever;
         t = road.next_arrival_ns()) {
      EXPECT_FALSE(road.take(t - 1, p)) << "not before its instant";
      ASSERT_TRUE(road.take(t, p));
      std::uint32_t number = 0;
      std::memcpy(&number, p.data(), sizeof number);
      out.push_back({number, 1e-6 * static_cast<double>(t - sent[number])});
    }
  };
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::int64_t now = i * every_ns;
    collect(now);
    sent[i] = now;
    road.offer(now, packet_of(i));
  }
  collect(drivers::kNever - 1);
  return out;
}

TEST(PacketRoad, WithoutAKeyEachPacketPassesAtOnce) {
  PacketRoad road(RoadConfig{}, Way::kToRobot, 0);
  const auto got = pass(road, 1000, kMs);
  ASSERT_EQ(got.size(), 1000U);
  for (std::uint32_t i = 0; i < 1000; ++i) {
    EXPECT_EQ(got[i].number, i);
    EXPECT_EQ(got[i].delay_ms, 0);
  }
}

// 12 Mbit/s offered on 10: the queue fills, then each packet waits for all of it, and a sixth is
// dropped.
TEST(PacketRoad, ABottleneckCarriesItsRateAndDropsWhatDoesNotFit) {
  RoadConfig c;
  c.network.rate_Mbit_per_s = 10;
  c.network.queue_kB = 100;
  c.network.delay_ms = 75;
  PacketRoad road(c, Way::kToRobot, 0);
  const auto got = pass(road, 15000, 8 * kMs / 12);
  const auto& s = road.stats();
  EXPECT_NEAR(s.busy_Mbit_per_s(), 10, 0.001);
  EXPECT_NEAR(static_cast<double>(s.dropped), 15000 / 6.0 - 100, 15);
  EXPECT_EQ(s.packets_out + s.dropped, 15000U);
  EXPECT_LE(s.most_waiting, 100000U);
  EXPECT_NEAR(got.back().delay_ms, 75 + 80, 1.6);
  EXPECT_NEAR(1e-6 * static_cast<double>(s.least_delay_ns), 75.8, 0.001) << "its own 0.8 ms";
  EXPECT_NEAR(1e-6 * static_cast<double>(s.most_delay_ns), 155, 1.6);
}

TEST(PacketRoad, LossIsItsShareAndTakesTheLine) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    RoadConfig c;
    c.network.rate_Mbit_per_s = 10;
    c.network.seed = seed;
    c.loss = 0.005;
    PacketRoad road(c, Way::kToRobot, 0);
    const auto got = pass(road, 40000, kMs);
    EXPECT_EQ(got.size() + road.stats().lost, 40000U);
    EXPECT_NEAR(static_cast<double>(road.stats().lost), 200, 5 * std::sqrt(200.0));
    EXPECT_EQ(road.stats().bytes_carried, 40000000U);
  }
}

TEST(PacketRoad, LossForAWhileIsOfThatWhileAlone) {
  RoadConfig c;
  c.loss = 0.3;
  c.loss_from_s = 10;
  c.loss_for_s = 5;
  PacketRoad road(c, Way::kToOperator, 0);
  const auto got = pass(road, 40000, kMs);
  std::uint32_t within = 0;
  for (const Arrived& a : got) within += a.number >= 10000 && a.number < 15000;
  EXPECT_EQ(got.size() - within, 35000U) << "before and behind it nothing is lost";
  EXPECT_NEAR(within, 3500, 5 * std::sqrt(5000 * 0.21));
}

TEST(PacketRoad, JitterKeepsTheOrderAndReorderDoesNot) {
  RoadConfig c;
  c.network.delay_ms = 20;
  c.network.jitter_ms = 10;
  PacketRoad in_order(c, Way::kToRobot, 0);
  auto got = pass(in_order, 5000, 3 * kMs);
  ASSERT_EQ(got.size(), 5000U);
  for (std::uint32_t i = 0; i < 5000; ++i) {
    EXPECT_EQ(got[i].number, i);
    EXPECT_GE(got[i].delay_ms, 20);
    EXPECT_LE(got[i].delay_ms, 30);
  }
  c.network.jitter_ms = 0;
  c.reorder = 0.02;
  c.reorder_ms = 5;
  PacketRoad mixed(c, Way::kToRobot, 0);
  got = pass(mixed, 20000, kMs);
  ASSERT_EQ(got.size(), 20000U) << "late, not lost";
  std::uint64_t late = 0, overtaken = 0;
  std::uint32_t newest = 0;
  for (const Arrived& a : got) {
    late += a.delay_ms > 20;
    overtaken += a.number < newest;
    newest = std::max(newest, a.number);
  }
  EXPECT_EQ(late, mixed.stats().reordered);
  EXPECT_EQ(overtaken, late);
  EXPECT_NEAR(static_cast<double>(late), 400, 100);
}

TEST(PacketRoad, StallsCutsAndFlapsAreThoseOfTheSchedule) {
  RoadConfig c;
  c.network.delay_ms = 50;
  c.network.queue_kB = 1000;
  c.network.stalls.push_back({1, 400, 0});
  c.network.cuts.push_back({4, "to_robot"});
  PacketRoad there(c, Way::kToRobot, 0), back(c, Way::kToOperator, 0);
  const auto a = pass(there, 6000, kMs), b = pass(back, 6000, kMs);
  EXPECT_EQ(a.size(), 3950U) << "what had not arrived at the cut is lost";
  EXPECT_EQ(there.stats().cut, 2050U);
  EXPECT_EQ(b.size(), 6000U);
  EXPECT_NEAR(a[1000].delay_ms, 450, 0.001);
  EXPECT_NEAR(a[1399].delay_ms, 51, 0.001);
  RoadConfig f;
  f.network.delay_ms = 10;
  f.network.flaps_per_minute = 60;
  f.network.flap_down_ms = 100;
  PacketRoad flapping(f, Way::kToRobot, 0);
  const auto got = pass(flapping, 60000, kMs);
  EXPECT_EQ(got.size() + flapping.stats().cut, 60000U);
  EXPECT_NEAR(static_cast<double>(flapping.stats().cut), 60 * 110, 60);
}

TEST(PacketRoad, DamageAndSeedsRepeat) {
  RoadConfig c;
  c.network.corrupt_per_MB = 20;
  c.network.jitter_ms = 4;
  c.loss = 0.01;
  PacketRoad a(c, Way::kToRobot, 0), b(c, Way::kToRobot, 0);
  (void)pass(a, 20000, kMs);
  (void)pass(b, 20000, kMs);
  EXPECT_EQ(a.stats().damaged, b.stats().damaged);
  EXPECT_EQ(a.stats().lost, b.stats().lost);
  EXPECT_NEAR(static_cast<double>(a.stats().damaged), 20000 * 0.99 * (1 - std::exp(-0.02)), 100);
  c.network.seed = 2;
  PacketRoad other(c, Way::kToRobot, 0);
  (void)pass(other, 20000, kMs);
  EXPECT_NE(other.stats().sum_delay_ns, a.stats().sum_delay_ns);
}

}  // namespace
