// A connection over a bad network: what goes in, what comes out, when, and what does not.
#include "drivers/emulator/stream_emulator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <numeric>

namespace {

using drivers::kNever;
using drivers::NetworkConfig;
using drivers::StreamEmulator;
using drivers::Way;
using Bytes = std::vector<std::uint8_t>;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1'000'000'000;

Bytes numbered(std::size_t n, std::uint64_t seed = 1) {
  rt::Random random(seed, 99);
  Bytes b(n);
  for (auto& v : b) v = static_cast<std::uint8_t>(random());
  return b;
}

// Offers `bytes` and, every millisecond, what was not taken; reads every millisecond.
struct Talk {
  StreamEmulator road;
  Bytes waits, out;
  std::size_t most_waits = 0;
  explicit Talk(const NetworkConfig& c, Way way = Way::kToRobot) : road(c, way, 0) {}
  void offer(const Bytes& bytes) { waits.insert(waits.end(), bytes.begin(), bytes.end()); }
  void tick(std::int64_t t) {
    const std::size_t n = road.write(t, waits);
    waits.erase(waits.begin(), waits.begin() + static_cast<std::ptrdiff_t>(n));
    most_waits = std::max(most_waits, waits.size());
    road.read(t, out);
  }
};

TEST(StreamEmulator, WithoutAKeyBytesComeOutAtOnceAndAsTheyAre) {
  Talk talk{NetworkConfig{}};
  const Bytes sent = numbered(300000);
  talk.offer(sent);
  talk.tick(5 * kMs);
  EXPECT_EQ(talk.out, sent);
  EXPECT_FALSE(talk.road.busy(5 * kMs));
  EXPECT_EQ(talk.road.busy_for(5 * kMs).count(), 0);
  EXPECT_EQ(talk.road.next_arrival_ns(), kNever);
}

// Random traffic over random networks without loss: every byte, in order, none too early, and no
// more than the line carries.
TEST(StreamEmulator, RandomTrafficArrivesWholeInOrderAndNotTooEarly) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    rt::Random random(seed);
    NetworkConfig c;
    c.rate_Mbit_per_s = random.uniform(1, 50);
    c.queue_kB = random.uniform(2, 100);
    c.delay_ms = random.uniform(0, 100);
    c.jitter_ms = random.uniform(0, 20);
    c.seed = seed;
    if (seed % 3 == 0) c.stalls.push_back({random.uniform(0, 1), 300, 1});
    Talk talk(c);
    Bytes sent, got;
    for (std::int64_t t = 0; t < 3000; ++t) {
      if (t < 1000 && random.integer(0, 9) == 0) {
        const Bytes b = numbered(static_cast<std::size_t>(random.integer(1, 20000)), random());
        sent.insert(sent.end(), b.begin(), b.end());
        talk.offer(b);
      }
      talk.tick(t * kMs);
      const double carried =
          125e-3 * c.rate_Mbit_per_s * 1e3 * (static_cast<double>(t) - c.delay_ms);
      EXPECT_LE(static_cast<double>(talk.out.size()), std::max(0.0, carried) + 1) << t;
    }
    for (std::int64_t t = 3000; talk.out.size() < sent.size() && t < 60000; ++t) talk.tick(t * kMs);
    EXPECT_TRUE(talk.out == sent) << talk.out.size() << " of " << sent.size();
    EXPECT_LE(talk.road.stats().most_waiting, static_cast<std::size_t>(c.queue_kB * 1000));
    EXPECT_EQ(talk.road.stats().bytes_lost, 0U);
    EXPECT_EQ(talk.road.on_the_way(), 0U);
  }
}

TEST(StreamEmulator, AFullLineCarriesItsRateAndFollowsItsChanges) {
  NetworkConfig c;
  c.rate_Mbit_per_s = 10;
  c.rate_changes.push_back({2, 4});
  c.rate_changes.push_back({4, 10});
  c.delay_ms = 80;
  Talk talk(c);
  const Bytes more = numbered(10000);
  std::array<std::size_t, 7> arrived{};
  for (std::int64_t t = 0; t < 6080; ++t) {
    if (talk.waits.size() < 10000) talk.offer(more);
    const std::size_t before = talk.out.size();
    talk.tick(t * kMs);
    if (t >= 80) arrived[static_cast<std::size_t>((t - 80) / 1000)] += talk.out.size() - before;
  }
  for (const auto& [second, mbit] : {std::pair{1, 10.0}, {2, 4.0}, {3, 4.0}, {4, 10.0}, {5, 10.0}})
    EXPECT_NEAR(8e-6 * static_cast<double>(arrived[static_cast<std::size_t>(second)]), mbit, 0.03)
        << "second " << second;
}

// Bufferbloat is the queue's: what a byte waits is the queue over the rate.
TEST(StreamEmulator, TheQueueIsTheLimitOfWhatIsTakenAndOfTheWait) {
  NetworkConfig c;
  c.rate_Mbit_per_s = 8;  // a byte a microsecond
  c.queue_kB = 50;
  StreamEmulator road(c, Way::kToRobot, 0);
  const Bytes sent = numbered(80000);
  EXPECT_EQ(road.write(0, sent), 50000U);
  EXPECT_EQ(road.write(0, sent), 0U) << "full";
  EXPECT_TRUE(road.busy(0));
  EXPECT_EQ(road.busy_for(0).count(), 50 * kMs);
  // Room comes as segments leave.
  const std::size_t later = road.write(20 * kMs, sent);
  EXPECT_NEAR(static_cast<double>(later), 20000, 1448);
  EXPECT_FALSE(road.busy(50 * kMs + 25 * kMs));
  Bytes out;
  road.read(49 * kMs, out);
  EXPECT_NEAR(static_cast<double>(out.size()), 49000, 1448);
}

TEST(StreamEmulator, AStallHoldsAndLosesNothing) {
  NetworkConfig c;
  c.rate_Mbit_per_s = 10;
  c.delay_ms = 75;
  c.stalls.push_back({1, 400, 4});
  Talk talk(c);
  std::int64_t last = 0, longest = 0, at = 0;
  std::size_t offered = 0, seen = 0;
  for (std::int64_t t = 0; t < 12000; ++t) {
    if (t < 11000) talk.offer(numbered(500)), offered += 500;
    talk.tick(t * kMs);
    if (talk.out.size() != seen) {
      if (t - last > longest) longest = t - last, at = last;
      last = t;
      seen = talk.out.size();
    }
    // The sender sees a line that is busy; it can not see for how long.
    if (t == 1200) {
      EXPECT_TRUE(talk.road.busy(t * kMs));
      EXPECT_EQ(talk.road.busy_for(t * kMs), rt::Nanos::max());
    }
    if (t == 999) {
      EXPECT_LT(talk.road.busy_for(t * kMs).count(), 2 * kMs);
    }
  }
  EXPECT_EQ(talk.out.size(), offered);
  EXPECT_NEAR(static_cast<double>(longest), 400, 3);
  EXPECT_NEAR(static_cast<double>(at % 4000), 1075, 3) << "what had left arrives";
}

TEST(StreamEmulator, AfterACutNothingArrivesAndNothingPilesUp) {
  NetworkConfig c;
  c.rate_Mbit_per_s = 10;
  c.delay_ms = 75;
  c.cuts.push_back({2, "both"});
  for (const Way way : {Way::kToRobot, Way::kToOperator}) {
    Talk talk(c, way);
    std::size_t before = 0;
    for (std::int64_t t = 0; t < 60000; ++t) {
      talk.offer(numbered(1000));
      talk.tick(t * kMs);
      if (t == 2000) before = talk.out.size();
    }
    EXPECT_GT(before, 1900000U) << "about all that was offered 75 ms before";
    EXPECT_EQ(talk.out.size(), before);
    EXPECT_EQ(talk.road.on_the_way(), 0U);
    EXPECT_LE(talk.most_waits, 2000U) << "taken, and lost";
    EXPECT_TRUE(talk.road.busy(60 * kSecond)) << "no picture is coded for a dead line";
    EXPECT_EQ(talk.road.busy_for(60 * kSecond), rt::Nanos::max());
    EXPECT_FALSE(talk.road.passable(2 * kSecond));
    EXPECT_EQ(talk.road.ends(60 * kSecond), 0U) << "nobody is told";
    EXPECT_EQ(talk.road.stats().bytes_lost + talk.road.stats().bytes_arrived,
              talk.road.stats().bytes_taken);
  }
}

TEST(StreamEmulator, AHalfOpenConnectionIsDeadOneWay) {
  NetworkConfig c;
  c.delay_ms = 10;
  c.cuts.push_back({1, "to_robot"});
  Talk there(c, Way::kToRobot), back(c, Way::kToOperator);
  for (std::int64_t t = 0; t < 3000; ++t) {
    for (Talk* talk : {&there, &back}) {
      talk->offer(numbered(10));
      talk->tick(t * kMs);
    }
  }
  EXPECT_EQ(there.out.size(), 9900U);
  EXPECT_EQ(back.out.size(), 29900U);
}

TEST(StreamEmulator, AFlapEndsTheConnectionUntilANewOneIsMade) {
  NetworkConfig c;
  c.delay_ms = 50;
  c.flaps_per_minute = 6;
  c.flap_down_ms = 1000;
  Talk talk(c);
  StreamEmulator other(c, Way::kToOperator, 0);
  std::uint64_t ends = 0, lost = 0;
  std::size_t at_end = 0;
  for (std::int64_t t = 0; t < 60000; ++t) {
    const std::int64_t now = t * kMs;
    EXPECT_EQ(talk.road.ends(now), other.ends(now)) << "both ends see the same";
    talk.offer(numbered(100));
    talk.tick(now);
    if (talk.road.ends(now) != ends) {
      ++ends;
      at_end = talk.out.size();
      EXPECT_FALSE(talk.road.passable(now));
      EXPECT_GE(talk.road.stats().bytes_lost - lost, 5000U) << "50 ms of it were on the way";
    }
    if (ends > 0 && !talk.road.passable(now)) {
      EXPECT_EQ(talk.out.size(), at_end);
    }
    if (ends == 1) {
      EXPECT_EQ(talk.out.size(), at_end) << "also when it is up again: the connection is gone";
    } else if (talk.road.passable(now) && talk.road.busy(now)) {
      talk.road.renew(now);
      lost = talk.road.stats().bytes_lost;
    }
  }
  EXPECT_EQ(ends, 6U);
  EXPECT_GT(talk.out.size(), 200000U);
  EXPECT_EQ(talk.road.stats().bytes_lost + talk.road.stats().bytes_arrived + talk.road.on_the_way(),
            talk.road.stats().bytes_taken);
}

TEST(StreamEmulator, DamageChangesBytesAtItsRateAndNothingElse) {
  NetworkConfig c;
  c.corrupt_per_MB = 50;
  c.corrupt_from_s = 1;
  Talk talk(c), again(c);
  Bytes sent;
  for (std::int64_t t = 0; t < 5000; ++t) {
    const Bytes b = numbered(2000, static_cast<std::uint64_t>(t));
    sent.insert(sent.end(), b.begin(), b.end());
    for (Talk* one : {&talk, &again}) {
      one->offer(b);
      one->tick(t * kMs);
    }
  }
  ASSERT_EQ(talk.out.size(), sent.size());
  EXPECT_EQ(talk.out, again.out);
  std::size_t changed = 0, first = sent.size();
  for (std::size_t i = 0; i < sent.size(); ++i) {
    if (sent[i] == talk.out[i]) continue;
    ++changed;
    first = std::min(first, i);
  }
  EXPECT_EQ(changed, talk.road.stats().bytes_changed);
  EXPECT_NEAR(static_cast<double>(changed), 400, 5 * 20) << "8 MB; a Poisson count, five sigma";
  EXPECT_GE(first, 2000000U);
  c.seed = 2;
  Talk seed(c);
  seed.offer(sent);
  seed.tick(2 * kSecond);
  EXPECT_NE(seed.out, talk.out);
}

TEST(StreamEmulator, JitterSpreadsMessagesAndKeepsTheirOrder) {
  NetworkConfig c;
  c.delay_ms = 20;
  c.jitter_ms = 10;
  StreamEmulator a(c, Way::kToRobot, 0), b(c, Way::kToOperator, 0);
  double low = 1e9, high = 0, sum = 0;
  int differ = 0;
  for (std::int64_t i = 0; i < 1000; ++i) {
    const std::int64_t now = i * 50 * kMs;
    const Bytes one{static_cast<std::uint8_t>(i)};
    ASSERT_EQ(a.write(now, one), 1U);
    ASSERT_EQ(b.write(now, one), 1U);
    const double ms = 1e-6 * static_cast<double>(a.next_arrival_ns() - now);
    differ += a.next_arrival_ns() != b.next_arrival_ns();
    low = std::min(low, ms), high = std::max(high, ms), sum += ms;
    Bytes out;
    a.read(a.next_arrival_ns(), out);
    b.read(now + 49 * kMs, out);
  }
  EXPECT_GE(low, 20);
  EXPECT_LE(high, 30);
  EXPECT_LT(low, 20.2);
  EXPECT_GT(high, 29.8);
  EXPECT_NEAR(sum / 1000, 25, 5 * 10 / std::sqrt(12.0 * 1000));
  EXPECT_GT(differ, 990) << "each way draws its own";
}

}  // namespace
