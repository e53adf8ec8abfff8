// Who may come in, and how much may be under way: the pure parts of a road.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "drivers/road/arrivals.hpp"
#include "drivers/road/door.hpp"
#include "drivers/road/pace.hpp"
#include "rt/random.hpp"

namespace {

using drivers::RoadDoor;
using drivers::RoadPace;
using drivers::RoadPeer;
using drivers::RoadToken;
using testing::HasSubstr;

constexpr std::int64_t kSecond = 1'000'000'000;

RoadPeer box(const char* name, const char* serial) {
  return {name, rt::Box::kOperator, serial, std::string("key of ") + serial, 0};
}
RoadToken token(std::uint8_t v) {
  RoadToken t{};
  t.fill(v);
  return t;
}

TEST(RoadDoor, TwoConnectionsOfOnePeerMakeASession) {
  RoadDoor d(rt::Box::kRobot);
  EXPECT_EQ(d.ask_control(box("ada", "1"), 0, token(1)), "");
  EXPECT_FALSE(d.taken());
  EXPECT_EQ(d.ask_bulk(box("ada", "1"), kSecond, token(1)), "");
  EXPECT_TRUE(d.taken());
  EXPECT_FALSE(d.overdue(100 * kSecond));
  d.leave(2 * kSecond, RoadDoor::End::kOver);
  EXPECT_EQ(d.ask_control(box("bob", "2"), 2 * kSecond, token(2)), "") << "the place is free again";
}

TEST(RoadDoor, ASecondOneIsRefusedWithAReason) {
  RoadDoor d(rt::Box::kRobot);
  ASSERT_EQ(d.ask_control(box("ada", "1"), 0, token(1)), "");
  for (const bool taken : {false, true}) {
    if (taken) {
      ASSERT_EQ(d.ask_bulk(box("ada", "1"), 1, token(1)), "");
    }
    const std::string why = d.ask_control(box("bob", "2"), 1, token(2));
    EXPECT_EQ(why, "busy: operator 'ada' is connected; one operator at a time");
    EXPECT_EQ(d.ask_control(box("ada", "1"), 1, token(3)), why) << "nor the same one twice";
  }
  RoadDoor desk(rt::Box::kOperator);
  ASSERT_EQ(desk.ask_control(box("r1", "1"), 0, token(1)), "");
  EXPECT_THAT(desk.ask_control(box("r2", "2"), 0, token(2)), HasSubstr("robot 'r1' is connected"));
}

TEST(RoadDoor, ATokenIsGoodOnceForItsPeerAndForAWhile) {
  const auto promised = [] {
    RoadDoor d(rt::Box::kRobot);
    EXPECT_EQ(d.ask_control(box("ada", "1"), 0, token(1)), "");
    return d;
  };
  RoadDoor d = promised();
  EXPECT_THAT(d.ask_bulk(box("ada", "1"), 1, token(2)), HasSubstr("does not belong"));
  EXPECT_THAT(d.ask_bulk(box("bob", "2"), 1, token(1)), HasSubstr("does not belong"));
  RoadPeer thief = box("ada", "1");
  thief.key_sha256 = "another";
  EXPECT_THAT(d.ask_bulk(thief, 1, token(1)), HasSubstr("does not belong"));
  EXPECT_EQ(d.ask_bulk(box("ada", "1"), 1, token(1)), "") << "the right one can still come";
  EXPECT_NE(d.ask_bulk(box("ada", "1"), 1, token(1)), "") << "once";
  d.leave(2, RoadDoor::End::kOver);
  EXPECT_NE(d.ask_bulk(box("ada", "1"), 1, token(0)), "") << "an empty place has no token of zeros";
  RoadDoor late = promised();
  const std::int64_t end = RoadDoor::kTokenLife.count();
  EXPECT_FALSE(late.overdue(end));
  EXPECT_TRUE(late.overdue(end + 1));
  EXPECT_NE(late.ask_bulk(box("ada", "1"), end + 1, token(1)), "");
  EXPECT_EQ(late.ask_control(box("bob", "2"), end + 1, token(2)), "")
      << "who never came does not hold the place";
}

// The robot's door as bob sees it who only ever greets: ada, who dials in earnest each half second,
// is let in within two seconds, and bob then waits.
TEST(RoadDoor, AskingAloneKeepsNobodyOut) {
  RoadDoor d(rt::Box::kRobot);
  std::int64_t ada_in = 0;
  int bob_promised = 0;
  for (std::int64_t t = 0; t < 20 * kSecond && ada_in == 0; t += kSecond / 10) {
    bob_promised += d.ask_control(box("bob", "2"), t, token(2)).empty() ? 1 : 0;
    if (t % (kSecond / 2) == 0 && d.ask_control(box("ada", "1"), t + 1, token(1)).empty())
      ada_in = t + 1;
  }
  EXPECT_GT(ada_in, 0);
  EXPECT_LE(ada_in, 2 * kSecond);
  EXPECT_EQ(bob_promised, 1);
  EXPECT_TRUE(d.displaced()) << "bob's connection is to be closed";
  EXPECT_EQ(d.ask_bulk(box("ada", "1"), ada_in + kSecond, token(1)), "");
}

TEST(RoadDoor, AnUnkeptPromiseCountsOnlyWhereAnotherWaits) {
  RoadDoor alone(rt::Box::kRobot);
  for (std::int64_t t = 0; t < 10 * kSecond; t += kSecond) {
    EXPECT_EQ(alone.ask_control(box("ada", "1"), t, token(1)), "")
        << "a lossy road: it tries again";
    alone.leave(t + kSecond / 2, RoadDoor::End::kOver);
  }
  RoadDoor d(rt::Box::kRobot);
  EXPECT_EQ(d.ask_control(box("bob", "2"), 0, token(2)), "");
  EXPECT_NE(d.ask_control(box("ada", "1"), 1, token(1)), "");
  d.leave(2, RoadDoor::End::kOver);  // bob closes and greets again at once
  EXPECT_THAT(d.ask_control(box("bob", "2"), 3, token(2)), HasSubstr("sits out"));
  EXPECT_EQ(d.ask_control(box("ada", "1"), 4, token(1)), "");
  d.leave(5, RoadDoor::End::kForgotten);
  EXPECT_EQ(d.ask_control(box("bob", "2"), 6 * kSecond, token(2)), "") << "not for ever";
}

TEST(RoadDoor, WhoWasCutOffHasTheFirstWord) {
  const auto session = [] {
    RoadDoor d(rt::Box::kRobot);
    EXPECT_EQ(d.ask_control(box("ada", "1"), 0, token(1)), "");
    EXPECT_EQ(d.ask_bulk(box("ada", "1"), 1, token(1)), "");
    return d;
  };
  RoadDoor cut = session();
  cut.leave(10 * kSecond, RoadDoor::End::kCut);
  EXPECT_THAT(cut.ask_control(box("bob", "2"), 11 * kSecond, token(2)),
              HasSubstr("the first word"));
  RoadDoor later = cut;
  EXPECT_EQ(cut.ask_control(box("ada", "1"), 12 * kSecond, token(1)), "");
  EXPECT_EQ(
      later.ask_control(box("bob", "2"), 10 * kSecond + RoadDoor::kFirstWord.count(), token(2)),
      "");
  RoadDoor bye = session();
  bye.leave(10 * kSecond, RoadDoor::End::kOver);
  EXPECT_EQ(bye.ask_control(box("bob", "2"), 10 * kSecond, token(2)), "");
}

using Places = std::vector<std::string>;

TEST(Arrivals, TheOldestOfTheLargestCrowdGoesAndAKnownPlaceLast) {
  drivers::ArrivalTurns turns;
  EXPECT_EQ(turns.to_drop(Places{"a"}), 0U);
  EXPECT_EQ(turns.to_drop(Places{"a", "b", "c", "b"}), 1U);
  EXPECT_EQ(turns.to_drop(Places{"friend", "x", "x", "x"}), 1U);
  EXPECT_EQ(turns.to_drop(Places{"a", "b"}), 0U);
  turns.had_session("friend");
  EXPECT_EQ(turns.to_drop(Places{"friend", "friend", "friend", "x"}), 3U);
  EXPECT_EQ(turns.to_drop(Places{"friend", "friend"}), 0U);
}

TEST(Arrivals, BeginAtARate) {
  drivers::ArrivalTurns turns;
  const auto begun = [&](std::int64_t from, std::int64_t to) {
    int n = 0;
    for (std::int64_t t = from; t < to; t += kSecond / 1000) {
      while (turns.next(Places{"x"}, t)) ++n;
    }
    return n;
  };
  EXPECT_EQ(begun(0, 1), 20) << "at once";
  EXPECT_NEAR(begun(1, 10 * kSecond), 10 * 20, 2);
  EXPECT_FALSE(turns.next(Places{}, 100 * kSecond));
}

// A crowd from one place holds up a stranger from another by one turn, a known place not at all.
TEST(Arrivals, ACrowdOfOnePlaceHoldsUpNobodyElse) {
  drivers::ArrivalTurns turns;
  const Places crowd(8, "crowd");
  std::int64_t t = 0;
  while (turns.next(crowd, t)) {
  }
  Places with_friend = crowd;
  with_friend.push_back("friend");
  std::int64_t served = 0;
  for (; served == 0 && t < kSecond; t += kSecond / 1000) {
    if (const auto who = turns.next(with_friend, t); who && *who == 8) served = t;
  }
  EXPECT_GT(served, 0);
  EXPECT_LE(served, 60'000'000);
  turns.had_session("friend");
  while (turns.next(crowd, t)) {
  }
  // Ever new places at once use up the turns of strangers, and none of a known place's.
  for (int i = 0; i < 200; ++i) (void)turns.next(Places{"place " + std::to_string(i)}, t);
  const auto known = turns.next(with_friend, t);
  ASSERT_TRUE(known);
  EXPECT_EQ(*known, 8U);
}

TEST(Arrivals, PlacesAreAddressesAndOfIPv6TheirNetwork) {
  using drivers::place_of;
  EXPECT_EQ(place_of("10.0.0.3"), "10.0.0.3");
  EXPECT_EQ(place_of("::ffff:10.0.0.3"), "10.0.0.3");
  EXPECT_EQ(place_of("2001:db8:1:2::7"), place_of("2001:db8:1:2:ffff::1"));
  EXPECT_NE(place_of("2001:db8:1:2::7"), place_of("2001:db8:1:3::7"));
  EXPECT_EQ(place_of("fe80::1%eth0"), place_of("fe80::2"));
}

// ---- pace ----

constexpr rt::Nanos kBase = std::chrono::milliseconds{170};
rt::Nanos ms(double v) { return rt::Nanos{static_cast<std::int64_t>(1e6 * v)}; }

TEST(RoadPace, TheKernelsPaceIsBelowTheRate) {
  EXPECT_EQ(RoadPace(10).pacing_rate(), 1'100'000U);
  EXPECT_EQ(RoadPace(0).pacing_rate(), 0U);
  EXPECT_GT(RoadPace(0).allowance(), 1'000'000U) << "nothing known: nothing held back";
}

// A bottleneck with a queue, stepped at 50 ms: what is under way beyond rate x round trip waits in
// it. The oracle is that queue; the pace sees its round trip only.
struct Bottleneck {
  double rate_bytes_per_s;
  double queue_bytes = 0;
  rt::Nanos step(RoadPace& p, double offered_bytes_per_s) {
    const double base_s = rt::seconds(kBase);
    const double room = static_cast<double>(p.allowance()) - rate_bytes_per_s * base_s;
    queue_bytes = std::clamp(queue_bytes + 0.05 * (offered_bytes_per_s - rate_bytes_per_s), 0.0,
                             std::max(0.0, room));
    const rt::Nanos rtt = kBase + ms(1e3 * queue_bytes / rate_bytes_per_s);
    const double used =
        std::min(static_cast<double>(p.allowance()),
                 queue_bytes + std::min(offered_bytes_per_s, rate_bytes_per_s) * base_s);
    p.look(rtt, kBase, static_cast<std::size_t>(used));
    return rtt - kBase;
  }
};

TEST(RoadPace, AFallOfTheRateIsAnsweredWithinTwoSecondsAndUndone) {
  RoadPace p(10);
  Bottleneck road{1.25e6};
  for (int i = 0; i < 100; ++i) road.step(p, 1.1e6);
  EXPECT_EQ(p.wish(), 0) << "what fits is left alone";
  road.rate_bytes_per_s = 0.5e6;  // 4 Mbit/s, unannounced
  int steps = 0;
  rt::Nanos queue = ms(1000);
  while (queue > RoadPace::kTooLong || steps < 10) {
    queue = road.step(p, 1.1e6);
    ASSERT_LT(++steps, 40) << "2 s";
  }
  EXPECT_LT(static_cast<double>(p.allowance()), 0.5e6 * rt::seconds(kBase) + 0.5e6 * 0.04);
  for (int i = 0; i < 200; ++i) {
    queue = road.step(p, 1.1e6);
    ASSERT_LT(queue, ms(80)) << "and it stays short";
  }
  road.rate_bytes_per_s = 1.25e6;
  for (int i = 0; i < 60 * 6 + 10; ++i) road.step(p, 1.1e6);
  EXPECT_EQ(p.wish(), 0);
  EXPECT_GT(static_cast<double>(p.allowance()), 1.1e6 * rt::seconds(kBase))
      << "it carries all again";
}

TEST(RoadPace, WishesRiseStepByStepAndNoFurtherThanFive) {
  RoadPace p(10);
  std::vector<int> wishes;
  for (int i = 0; i < 40; ++i) p.look(kBase, kBase, 100'000);
  for (int i = 0; i < 60; ++i) {
    p.look(kBase + ms(60), kBase, 100'000);
    wishes.push_back(p.wish());
  }
  EXPECT_EQ(wishes[2], 0);
  EXPECT_EQ(wishes[3], 1) << "after 200 ms";
  EXPECT_EQ(wishes[10], 1);
  EXPECT_EQ(wishes[11], 2) << "400 ms later";
  EXPECT_EQ(wishes.back(), RoadPace::kMostWish);
  EXPECT_GE(p.allowance(), RoadPace::kLeast);
  // Between the two limits nothing changes.
  const std::size_t before = p.allowance();
  for (int i = 0; i < 500; ++i) p.look(kBase + ms(30), kBase, before);
  EXPECT_EQ(p.wish(), RoadPace::kMostWish);
  EXPECT_EQ(p.allowance(), before);
}

// 20 ms of jitter each way: 15 to 33 ms above the kernel's least, and no queue.
TEST(RoadPace, JitterIsNoQueue) {
  constexpr std::uint64_t kSeed = 7104;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  RoadPace p(10);
  for (int i = 0; i < 40; ++i) p.look(kBase + ms(r.uniform(15, 33)), kBase, 200'000);
  const std::size_t before = p.allowance();
  for (int i = 0; i < 5; ++i) p.look(kBase + ms(90), kBase, 200'000);
  ASSERT_EQ(p.wish(), 1) << "a queue of 60 ms and more is one";
  for (int i = 0; i < 150; ++i) p.look(kBase + ms(r.uniform(15, 33)), kBase, 200'000);
  EXPECT_EQ(p.wish(), 0) << "and the step comes back";
  EXPECT_GE(p.allowance(), before / 2);
  // A queue that was there from the beginning is seen all the same.
  RoadPace full(10);
  for (int i = 0; i < 60; ++i) full.look(kBase + ms(90), kBase, 200'000);
  EXPECT_GT(full.wish(), 1);
}

// The smoothed round trip of the hand-shake holds a late acknowledgement (40 ms) and jitter, and
// stays while nothing is under way; then the first pictures bring it down. There is no queue in any
// of it.
TEST(RoadPace, TheStartIsNoQueue) {
  constexpr std::uint64_t kSeed = 7105;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  for (std::uint64_t run = 0; run < 50; ++run) {
    rt::Random r(kSeed, run);
    RoadPace p(10);
    const std::size_t first = p.allowance();
    double above = r.uniform(45, 100);
    const auto idle = r.integer(0, 40);
    for (std::int64_t i = 0; i < idle; ++i) p.look(kBase + ms(above), kBase, 0);
    for (int i = 0; i < 100; ++i) {
      above += 0.15 * (r.uniform(15, 33) - above);
      p.look(kBase + ms(above), kBase, 100'000);
      ASSERT_EQ(p.wish(), 0) << "run " << run << ", look " << i;
      ASSERT_GE(p.allowance(), first);
    }
  }
  // A road that drowns from the beginning is relieved at once.
  RoadPace full(10);
  for (int i = 0; i < 10; ++i) full.look(kBase + ms(200), kBase, 100'000);
  EXPECT_LT(full.allowance(), 60'000U);
}

TEST(RoadPace, OneLateLookIsNoReasonToWish) {
  RoadPace p(10);
  for (int i = 0; i < 1000; ++i) p.look(i % 4 == 0 ? kBase + ms(300) : kBase, kBase, 200'000);
  EXPECT_EQ(p.wish(), 0);
}

TEST(RoadPace, AnyInputKeepsTheBounds) {
  constexpr std::uint64_t kSeed = 7103;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 200; ++n) {
    RoadPace p(r.uniform(0, 1000));
    const std::size_t most = 4 * p.allowance();
    for (int i = 0; i < 500; ++i) {
      p.look(rt::Nanos{r.integer(0, 10 * kSecond)}, rt::Nanos{r.integer(0, 10 * kSecond)},
             static_cast<std::size_t>(r.integer(0, 1LL << 40)));
      ASSERT_GE(p.allowance(), RoadPace::kLeast);
      ASSERT_LE(p.allowance(), most);
      ASSERT_GE(p.wish(), 0);
      ASSERT_LE(p.wish(), RoadPace::kMostWish);
    }
  }
}

}  // namespace
