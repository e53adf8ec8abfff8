// Who asks for frames: one demand at a time, each answered by one frame that is sent, keys when
// they are needed and only then; and a line that is too slow gets coarser, then fewer frames.
#include "drivers/link/frame_asker.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "rt/random.hpp"

namespace {

using drivers::FrameAsker;
using drivers::FrameDemand;
using drivers::FrameReport;
using rt::Nanos;
using rt::Time;

constexpr std::int64_t kMs = 1'000'000;
constexpr Nanos kFree{0}, kBusy = Nanos::max();
Time at(std::int64_t ms) { return rt::time_from_ns(1'000 * kMs + ms * kMs); }
FrameReport says(std::uint64_t arrived, bool key) {
  return {arrived, static_cast<std::uint8_t>(key ? 1 : 0)};
}

TEST(FrameAsker, AsksForOneFrameAtATimeAndFirstForAKey) {
  FrameAsker asker;
  const auto first = asker.poll(at(0), kFree, at(0));
  ASSERT_TRUE(first);
  EXPECT_EQ(first->seq, 1U);
  EXPECT_EQ(first->key, 1);
  EXPECT_EQ(first->made, at(0));
  EXPECT_TRUE(asker.out());
  EXPECT_FALSE(asker.poll(at(40), kFree, at(40))) << "it is out, and not old yet";
  ASSERT_TRUE(asker.sent(at(45), 1, true, 1000));
  EXPECT_FALSE(asker.out());
  const auto second = asker.poll(at(46), kFree, at(46));
  ASSERT_TRUE(second);
  EXPECT_EQ(second->seq, 2U);
  EXPECT_EQ(second->key, 0) << "a key was sent";
}

TEST(FrameAsker, ADemandIsMadeAgainUnderTheSameNumber) {
  FrameAsker asker;
  ASSERT_TRUE(asker.poll(at(0), kFree, at(0)));
  EXPECT_FALSE(asker.poll(at(49), kFree, at(49)));
  const auto again = asker.poll(at(50), kFree, at(50));
  ASSERT_TRUE(again);
  EXPECT_EQ(again->seq, 1U);
  EXPECT_EQ(again->made, at(50));
  // Also one that was answered, while the line is busy: its reader is to hear that the link lives.
  ASSERT_TRUE(asker.sent(at(51), 1, true, 1000));
  EXPECT_FALSE(asker.poll(at(60), kBusy, at(60)));
  const auto alive = asker.poll(at(100), kBusy, at(100));
  ASSERT_TRUE(alive);
  EXPECT_EQ(alive->seq, 1U) << "no new frame";
}

TEST(FrameAsker, NothingNewIsAskedWhileTheLineIsBusyForLong) {
  FrameAsker asker;
  ASSERT_TRUE(asker.poll(at(0), kFree, at(0)));
  ASSERT_TRUE(asker.sent(at(10), 1, true, 1000));
  for (int ms = 11; ms < 60; ++ms) {
    const auto d = asker.poll(at(ms), Nanos{35 * kMs}, at(ms));
    EXPECT_TRUE(!d || d->seq == 1) << ms;
  }
  // A camera's period before it is free.
  const auto d = asker.poll(at(61), Nanos{33 * kMs}, at(61));
  ASSERT_TRUE(d);
  EXPECT_EQ(d->seq, 2U);
}

// The road wishes to be spared: coarser frames, then fewer, whatever the line shows; and back at
// once.
TEST(FrameAsker, AWishOfTheRoadIsAtLeastTheRung) {
  FrameAsker asker;
  auto demand = [&, ms = std::int64_t{0}, seq = std::uint64_t{0}](int wish) mutable {
    asker.wish(wish);
    const std::int64_t asked = ms;
    std::optional<drivers::FrameDemand> d;
    for (; !d || d->seq == seq; ++ms) d = asker.poll(at(ms), kFree, at(ms));
    seq = d->seq;
    EXPECT_TRUE(asker.sent(at(ms), seq, true, 1000));
    return std::pair(static_cast<int>(d->coarser), ms - asked);
  };
  demand(0);
  EXPECT_EQ(demand(0).first, 0);
  EXPECT_EQ(demand(2).first, 2);
  EXPECT_EQ(demand(5).first, FrameAsker::kCoarsest);
  EXPECT_EQ(demand(5).second, 50) << "20 a second";
  EXPECT_EQ(asker.stats().rung, 5);
  EXPECT_EQ(asker.spared(), (drivers::Spared{5, drivers::Spared::Why::kLate}));
  EXPECT_EQ(demand(99).second, 50) << "no further";
  demand(0);
  EXPECT_EQ(demand(0), std::pair(0, std::int64_t{30}));
  EXPECT_EQ(demand(-3).first, 0);
  EXPECT_EQ(asker.spared(), drivers::Spared{});
}

TEST(FrameAsker, AFrameThatAnswersNoDemandIsNotSent) {
  FrameAsker asker;
  EXPECT_FALSE(asker.sent(at(0), 1, true, 1)) << "nothing was asked";
  ASSERT_TRUE(asker.poll(at(1), kFree, at(1)));
  EXPECT_FALSE(asker.sent(at(2), 2, true, 1));
  EXPECT_TRUE(asker.sent(at(3), 1, true, 1));
  EXPECT_FALSE(asker.sent(at(4), 1, true, 1)) << "twice";
  const auto d = asker.poll(at(40), kFree, at(40));
  ASSERT_TRUE(d);
  EXPECT_EQ(d->key, 1) << "one was thrown away: the decoder must not need it";
}

TEST(FrameAsker, AfterASilenceAKeyIsWanted) {
  FrameAsker asker;
  ASSERT_TRUE(asker.poll(at(0), kFree, at(0)));
  ASSERT_TRUE(asker.sent(at(1), 1, true, 1));
  ASSERT_TRUE(asker.poll(at(40), kFree, at(40)));
  ASSERT_TRUE(asker.sent(at(41), 2, false, 1));
  EXPECT_EQ(asker.poll(at(80), kFree, at(40))->seq, 3U) << "silent for 40 ms is alive";
  for (int ms = 221; ms < 900; ms += 7) EXPECT_FALSE(asker.poll(at(ms), kFree, at(40))) << ms;
  EXPECT_EQ(asker.stats().silences, 1U);
  // Asked for before the silence, encoded since: it goes, and the next is a key.
  EXPECT_TRUE(asker.sent(at(900), 3, false, 1));
  const auto d = asker.poll(at(901), kFree, at(901));
  ASSERT_TRUE(d);
  EXPECT_EQ(d->seq, 4U);
  EXPECT_EQ(d->key, 1);
  ASSERT_TRUE(asker.sent(at(940), 4, true, 1));
  EXPECT_EQ(asker.poll(at(941), kFree, at(941))->key, 0);
}

TEST(FrameAsker, ADecoderThatLostTheThreadGetsOneKeyForEachTime) {
  FrameAsker asker;
  std::int64_t ms = 0;
  const auto frame = [&](bool key) {
    ms += 40;
    const auto d = asker.poll(at(ms), kFree, at(ms));
    EXPECT_TRUE(d);
    EXPECT_EQ(d->key != 0, key) << "demand " << d->seq;
    EXPECT_TRUE(asker.sent(at(ms), d->seq, d->key != 0, 1));
  };
  frame(true);
  // The decoder at its beginning needs a key, and says so: it is on its way.
  asker.report(says(0, true));
  frame(false);
  asker.report(says(2, false));
  frame(false);
  asker.report(says(3, true));
  asker.report(says(3, true));
  frame(true);  // number 4
  asker.report(says(3, true));
  frame(false);
  EXPECT_EQ(asker.stats().keys_asked, 1U);
  // The key itself arrived and could not be used.
  asker.report(says(4, true));
  frame(true);
  EXPECT_EQ(asker.stats().keys, 3U);
}

// A line, a camera and capture beside the asker, in steps of a millisecond.
struct Road {
  explicit Road(double kbit) : kbit_per_s(kbit) {}
  double kbit_per_s;
  std::size_t key_bytes = 60'000, delta_bytes = 20'000;
  double smaller_per_step = 0.75;
  FrameAsker asker;
  std::int64_t ms = 0;
  double busy_until_ms = 0;
  bool stalled = false, cut = false;
  std::int64_t heard_ms = 0;
  FrameDemand cell;
  std::uint64_t answered = 0;
  struct Frame {
    std::uint64_t number = 0, demand = 0;
    bool key = false;
  };
  std::vector<Frame> slot;  // encoded, not sent
  std::vector<Frame> sent;
  std::uint64_t encoded = 0, coarsest = 0;
  std::int64_t last_sent_ms = 0;

  void step() {
    ++ms;
    if (!cut) heard_ms = ms;
    if (stalled) busy_until_ms = std::max(busy_until_ms, static_cast<double>(ms) + 1);
    const double left = std::max(0.0, busy_until_ms - static_cast<double>(ms));
    if (const auto d =
            asker.poll(at(ms), Nanos{static_cast<std::int64_t>(left * 1e6)}, at(heard_ms)))
      cell = *d;
    if (left <= 0 && !slot.empty()) {
      const Frame f = slot.front();
      const auto bytes =
          static_cast<std::size_t>(static_cast<double>(f.key ? key_bytes : delta_bytes) *
                                   std::pow(smaller_per_step, cell.coarser));
      ASSERT_TRUE(asker.sent(at(ms), f.demand, f.key, bytes));
      slot.erase(slot.begin());
      sent.push_back(f);
      last_sent_ms = ms;
      busy_until_ms = static_cast<double>(ms) + static_cast<double>(bytes) * 8 / kbit_per_s;
    }
    if (ms * 30 / 1000 != (ms - 1) * 30 / 1000) camera();
    coarsest = std::max<std::uint64_t>(coarsest, cell.coarser);
  }
  void camera() {
    if (cell.seq <= answered || ms - (rt::ns_of(cell.made) / kMs - 1000) > 500) return;
    answered = cell.seq;
    slot.push_back({++encoded, cell.seq, cell.key != 0});
    ASSERT_LE(slot.size(), 1U) << "a queue of one";
  }
};

TEST(FrameAsker, EveryEncodedFrameIsSentInOrderOnAnyRoad) {
  constexpr std::uint64_t kSeed = 190201;
  for (std::uint64_t run = 0; run < 40; ++run) {
    rt::Random random(kSeed, run);
    SCOPED_TRACE("seed " + std::to_string(kSeed) + ", run " + std::to_string(run));
    Road road(std::pow(10.0, random.uniform(2.7, 5)));
    std::int64_t stall_until = 0, cut_until = 0;
    std::size_t resumed_at = 0;
    for (int i = 0; i < 12'000; ++i) {
      if (random.uniform() < 0.0005) stall_until = i + random.integer(1, 900);
      if (random.uniform() < 0.0002) cut_until = i + random.integer(200, 1500);
      road.stalled = i < stall_until;
      const bool cut = i < cut_until;
      if (road.cut && !cut) resumed_at = road.sent.size();
      road.cut = cut;
      road.step();
      if (HasFatalFailure()) return;
    }
    ASSERT_GT(road.sent.size(), 20U);
    ASSERT_LE(road.encoded - road.sent.size(), 1U) << "one may wait";
    for (std::size_t i = 0; i < road.sent.size(); ++i) ASSERT_EQ(road.sent[i].number, i + 1);
    EXPECT_TRUE(road.sent.front().key);
    // After the last cut a key came, at the latest as the second frame: one may have waited.
    if (resumed_at > 0 && resumed_at + 2 < road.sent.size()) {
      EXPECT_TRUE(road.sent[resumed_at].key || road.sent[resumed_at + 1].key);
    }
  }
}

TEST(FrameAsker, AFastRoadGetsEveryFrameAndNoCoarserOne) {
  Road road(50'000);
  for (int i = 0; i < 10'000; ++i) road.step();
  EXPECT_GE(road.sent.size(), 298U);  // of 300
  EXPECT_EQ(road.coarsest, 0U);
  EXPECT_EQ(road.asker.stats().rung, 0);
  EXPECT_EQ(road.asker.stats().keys, 1U);
}

TEST(FrameAsker, ASlowRoadGetsCoarserThenFewerFramesAndFinerOnesAgain) {
  Road road(3'600);  // 20 kB take 44 ms
  for (int i = 0; i < 10'000; ++i) road.step();
  EXPECT_EQ(road.asker.stats().rung, 2) << "15 kB take 33 ms, 11 kB 25 ms";
  road.kbit_per_s = 900;  // 8.4 kB, the coarsest, take 75 ms
  for (int i = 0; i < 10'000; ++i) road.step();
  EXPECT_EQ(road.asker.stats().rung, FrameAsker::kRungs);
  const std::size_t before = road.sent.size();
  for (int i = 0; i < 10'000; ++i) road.step();
  // The line is never idle for long: a frame takes 75 ms, so 133 of them.
  EXPECT_GE(road.sent.size() - before, 115U);
  road.kbit_per_s = 50'000;
  for (int i = 0; i < 15'000; ++i) road.step();
  EXPECT_EQ(road.asker.stats().rung, 0);
  const std::size_t fast = road.sent.size();
  for (int i = 0; i < 10'000; ++i) road.step();
  EXPECT_GE(road.sent.size() - fast, 298U);
}

// TCP feels its way up from ten packets a round trip: the first frames of a connection take round
// trips of a long road each, whatever the road carries. 55 % of a camera period is the most at
// which a rung would come back, so what was lowered then would stay for long.
TEST(FrameAsker, TheFirstFramesOfAConnectionSayNothingOfTheLine) {
  Road road(8'800);
  road.delta_bytes = 24'000;  // 22 ms, .65 of a camera period
  for (int connection = 0; connection < 3; ++connection) {
    road.asker.renew();
    road.slot.clear();
    const std::size_t before = road.sent.size();
    std::size_t seen = before;
    for (int i = 0; i < 8'000; ++i) {
      road.step();
      if (HasFatalFailure()) return;
      // Of the round trips that the first 200 kB take.
      if (road.sent.size() == seen) continue;
      seen = road.sent.size();
      const double slow_ms = 340.0 - 40.0 * static_cast<double>(seen - before);
      road.busy_until_ms = std::max(road.busy_until_ms, static_cast<double>(road.ms) + slow_ms);
    }
    EXPECT_GT(road.sent.size() - before, 200U);
    EXPECT_EQ(road.coarsest, 0U) << "connection " << connection;
    EXPECT_EQ(road.asker.stats().rung, 0);
  }
}

TEST(FrameAsker, ARoadThatIsSlowFromTheBeginningIsSeenSoonAfter) {
  Road road(3'600);
  for (int i = 0; i < 1'500; ++i) road.step();
  EXPECT_EQ(road.asker.stats().rung, 0);
  for (int i = 0; i < 1'500; ++i) road.step();
  EXPECT_GE(road.asker.stats().rung, 1);
}

}  // namespace
