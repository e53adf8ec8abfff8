#include "drivers/link/endpoint.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cinttypes>

#include "drivers/link/clock_sync.hpp"
#include "drivers/link/shaper.hpp"
#include "tests/unit/drivers_link/support.hpp"

namespace {

using namespace link_test;
using drivers::ClockSync;
using drivers::LinkShapeConfig;
using drivers::LinkShaper;
using drivers::MessageId;
using testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1'000'000'000;

std::string hex(std::uint64_t v) {
  char text[20];
  std::snprintf(text, sizeof text, "%016" PRIx64, v);
  return text;
}

// ---- clock synchronisation ----

// One exchange between two clocks with the given one-way times; host advances.
bool exchange(ClockSync& sync, const rt::BoxTime& local, const rt::BoxTime& remote,
              std::int64_t& host, std::int64_t there, std::int64_t held, std::int64_t back) {
  const auto t0 = rt::ns_of(local.from_host(host));
  host += there;
  const auto t1 = rt::ns_of(remote.from_host(host));
  host += held;
  const auto t2 = rt::ns_of(remote.from_host(host));
  host += back;
  return sync.add(t0, t1, t2, rt::ns_of(local.from_host(host)));
}

std::int64_t true_offset(const rt::BoxTime& local, const rt::BoxTime& remote, std::int64_t host) {
  return (remote.from_host(host) - local.from_host(host)).count();
}

TEST(ClockSync, OffsetWithinHalfTheRoundTrip) {
  constexpr std::uint64_t kSeed = 501;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 3000; ++n) {
    const rt::BoxTime local{r.integer(-kSecond, kSecond), 0};
    const rt::BoxTime remote{r.integer(-1000, 1000) * kSecond, 0};
    ClockSync sync;
    std::int64_t host = 2000 * kSecond, best = std::numeric_limits<std::int64_t>::max();
    for (std::int64_t i = r.integer(1, 16); i > 0; --i) {
      const std::int64_t there = r.integer(0, 100 * kMs), back = r.integer(0, 100 * kMs);
      ASSERT_TRUE(exchange(sync, local, remote, host, there, r.integer(0, 5 * kMs), back));
      best = std::min(best, there + back);
    }
    const std::int64_t error = sync.offset().count() - true_offset(local, remote, host);
    const std::int64_t u = sync.uncertainty(local.from_host(host)).count();
    ASSERT_LE(std::abs(error), u + 1) << "case " << n;
    // Of the samples the one with the small round trip was taken: at most its half plus what 16
    // exchanges of 0.2 s may drift.
    ASSERT_LE(std::abs(error), best / 2 + static_cast<std::int64_t>(3.3e9 * ClockSync::kDriftBound))
        << n;
  }
}

TEST(ClockSync, ExtremeAsymmetryErrsByExactlyHalfTheRoundTrip) {
  ClockSync sync;
  std::int64_t host = kSecond;
  ASSERT_TRUE(exchange(sync, {}, {1000 * kSecond, 0}, host, 40 * kMs, 3 * kMs, 0));
  EXPECT_EQ(sync.offset().count(), 1000 * kSecond + 20 * kMs);
  EXPECT_EQ(sync.round_trip().count(), 40 * kMs) << "time the other side held it does not count";
}

// The demo's clocks for a minute: 1000 s ahead and 50 ppm fast, with jittery delays.
TEST(ClockSync, FollowsDriftOfFiftyPpmForAMinute) {
  constexpr std::uint64_t kSeed = 502;
  rt::Random r(kSeed);
  const rt::BoxTime local{}, remote{1000 * kSecond, 50};
  ClockSync sync;
  std::int64_t host = kSecond, worst = 0;
  while (host < 61 * kSecond) {
    const std::int64_t next = host + 200 * kMs;
    const auto delay = [&] {
      return kMs + static_cast<std::int64_t>(20e6 * r.uniform() * r.uniform());
    };
    ASSERT_TRUE(exchange(sync, local, remote, host, delay(), 50'000, delay()));
    // Right after the exchange, and just before the next one.
    for (const std::int64_t at : {host, next - kMs}) {
      const std::int64_t error = sync.offset().count() - true_offset(local, remote, at);
      ASSERT_LE(std::abs(error), sync.uncertainty(local.from_host(at)).count() + 1) << at;
      worst = std::max(worst, std::abs(error));
    }
    host = std::max(host, next);
  }
  std::printf("largest offset error over 60 s at 50 ppm: %.3f ms\n",
              static_cast<double>(worst) * 1e-6);
  EXPECT_LT(worst, 11 * kMs) << "3 ms would be the drift alone, had it not been followed";
  EXPECT_GT(true_offset(local, remote, host) - 1000 * kSecond, 3 * kMs);
}

TEST(ClockSync, ImplausibleExchangesAreRefused) {
  ClockSync sync;
  EXPECT_FALSE(sync.add(0, 20, 10, 100)) << "sent before received";
  EXPECT_FALSE(sync.add(100, 0, 0, 50)) << "negative round trip";
  EXPECT_FALSE(sync.add(0, 0, 200, 100)) << "held longer than the whole exchange took";
  EXPECT_FALSE(sync.add(0, 0, 0, 10 * kSecond + 1));
  EXPECT_FALSE(sync.valid());
  EXPECT_TRUE(sync.add(0, 0, 0, 10 * kSecond));
  EXPECT_TRUE(sync.valid());
}

TEST(ClockSync, AnOldSampleGivesWayToANewerSlowerOne) {
  ClockSync sync;
  std::int64_t host = kSecond;
  ASSERT_TRUE(exchange(sync, {}, {}, host, 0, 0, 0));
  host += 20 * kSecond;  // 200 ppm of it: 4 ms
  const rt::BoxTime moved{500'000, 0};
  ASSERT_TRUE(exchange(sync, {}, moved, host, kMs, 0, kMs));
  EXPECT_EQ(sync.offset().count(), 500'000);
}

// ---- shaper ----

TEST(Shaper, RateDelayAndOrder) {
  LinkShapeConfig c;
  c.delay_ms = 25;
  c.rate_Mbit_per_s = 8;  // one byte a microsecond
  LinkShaper s(c, 0);
  EXPECT_FALSE(s.busy(0));
  EXPECT_EQ(s.deliver_at(1000, 1000), 1000 + 1'000'000 + 25 * kMs);
  EXPECT_TRUE(s.busy(1000 + 999'999));
  EXPECT_FALSE(s.busy(1000 + 1'000'000));
  // The second one queues behind the first at the bottleneck, the third finds it idle.
  EXPECT_EQ(s.deliver_at(2000, 500), 1000 + 1'500'000 + 25 * kMs);
  EXPECT_EQ(s.deliver_at(10 * kMs, 1), 10 * kMs + 1000 + 25 * kMs);
  EXPECT_FALSE(LinkShapeConfig{}.any());
  EXPECT_TRUE(c.any());
}

TEST(Shaper, OnlyWhatIsAskedForHappens) {
  LinkShapeConfig c;
  c.delay_ms = 3;
  LinkShaper s(c, 0);
  for (std::int64_t t = 0; t < 100; ++t) {
    EXPECT_EQ(s.deliver_at(t, 1 << 20), t + 3 * kMs) << "no bottleneck: size does not matter";
    EXPECT_FALSE(s.busy(t));
  }
}

TEST(Shaper, ThroughputJitterAndMonotonicityOnRandomTraffic) {
  constexpr std::uint64_t kSeed = 503;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 200; ++n) {
    LinkShapeConfig c;
    c.delay_ms = r.uniform(0, 50);
    c.jitter_ms = r.uniform(0, 20);
    c.rate_Mbit_per_s = r.uniform(0.5, 100);
    c.seed = r();
    LinkShaper s(c, 1), again(c, 1);
    // A line of one's own: free instants by the textbook recursion, in floating point.
    double free_ns = 0;
    std::int64_t now = 0, last = 0;
    for (int i = 0; i < 300; ++i) {
      now += r.integer(0, 2 * kMs);
      const auto bytes = static_cast<std::size_t>(r.integer(1, 5000));
      const std::int64_t out = s.deliver_at(now, bytes);
      ASSERT_EQ(out, again.deliver_at(now, bytes)) << "same seed, same delays";
      free_ns = std::max(free_ns, static_cast<double>(now)) +
                static_cast<double>(bytes) * 8 / (c.rate_Mbit_per_s * 1e-3);
      const double earliest = free_ns + c.delay_ms * 1e6;
      ASSERT_GE(static_cast<double>(out), earliest - 400);
      // Order may hold it back to the one before, never further.
      ASSERT_LE(static_cast<double>(out),
                std::max(earliest + c.jitter_ms * 1e6 + 400, static_cast<double>(last)));
      ASSERT_GE(out, last) << "in order";
      last = out;
    }
  }
}

TEST(Shaper, JitterIsSpreadAndDirectionsDiffer) {
  LinkShapeConfig c;
  c.jitter_ms = 10;
  LinkShaper a(c, 0), b(c, 1);
  double sum = 0;
  int same = 0;
  for (int i = 0; i < 2000; ++i) {
    const std::int64_t now = i * 100 * kMs;  // far apart: order never holds one back
    const std::int64_t da = a.deliver_at(now, 1) - now;
    same += da == b.deliver_at(now, 1) - now ? 1 : 0;
    ASSERT_GE(da, 0);
    ASSERT_LE(da, 10 * kMs);
    sum += static_cast<double>(da);
  }
  EXPECT_NEAR(sum / 2000, 5e6, 4 * 10e6 / std::sqrt(12.0 * 2000));
  EXPECT_LT(same, 5);
}

// ---- handshake ----

TEST(Endpoint, EqualSchemasBecomeReady) {
  Pair p;
  p.robot_clock = {1000 * kSecond, 50};
  EXPECT_FALSE(p.op.ready());
  p.run(300 * kMs);
  EXPECT_TRUE(p.op.ready());
  EXPECT_TRUE(p.robot.ready());
  EXPECT_FALSE(p.broken);
  EXPECT_TRUE(p.op.fault().empty());
  EXPECT_EQ(p.op.stats().sent[1], 1U) << "one Hello a connection";
}

void expect_refusal(drivers::LinkEndpoint& e, Bytes hello, unsigned version, std::uint64_t hash) {
  set_field<std::uint16_t>(hello, 4, static_cast<std::uint16_t>(version));
  set_field<std::uint64_t>(hello, 32, hash);
  EXPECT_FALSE(e.receive(hello, rt::time_from_ns(5),
                         [](auto) { ADD_FAILURE() << "no answer to a stranger"; }));
  EXPECT_FALSE(e.hello_ok());
  EXPECT_FALSE(e.ready());
  EXPECT_THAT(e.fault(), HasSubstr("version " + std::to_string(version) + " "));
  EXPECT_THAT(e.fault(), HasSubstr("this side " + std::to_string(drivers::kSchemaVersion)));
  EXPECT_THAT(e.fault(), HasSubstr(hex(hash)));
  EXPECT_THAT(e.fault(), HasSubstr(hex(drivers::schema_hash())));
  EXPECT_EQ(e.fault().find('\n'), std::string::npos);
}

// Both sides of a pair of different programs: each gets the other's Hello and names both schemas.
TEST(Endpoint, OtherSchemaIsRefusedByBothSidesNamingBoth) {
  for (const bool version_differs : {true, false}) {
    Pair p;
    Bytes from_op, from_robot;
    p.op.poll(rt::time_from_ns(1), true, [&](auto m) { from_op.assign(m.begin(), m.end()); });
    p.robot.poll(rt::time_from_ns(1), true, [&](auto m) { from_robot.assign(m.begin(), m.end()); });
    const unsigned version =
        version_differs ? drivers::kSchemaVersion + 1 : drivers::kSchemaVersion;
    const std::uint64_t hash = drivers::schema_hash() ^ (version_differs ? 0 : 1);
    expect_refusal(p.op, from_robot, version, hash);
    expect_refusal(p.robot, from_op, version, hash);
    // Nothing but the Hello went out, so nothing of another schema was ever interpreted.
    EXPECT_EQ(p.op.stats().sent[1], 1U);
    int more = 0;
    p.op.poll(rt::time_from_ns(kSecond), true, [&](auto) { ++more; });
    EXPECT_EQ(more, 0);
  }
}

TEST(Endpoint, AMessageBeforeTheHandshakeCloses) {
  Pair p;
  const Bytes request = whole(MessageId::kClockRequest, body_of(drivers::ClockRequest{1}));
  EXPECT_FALSE(p.op.receive(request, rt::time_from_ns(1), [](auto) {}));
  EXPECT_THAT(p.op.fault(), HasSubstr("before the handshake"));
}

TEST(Endpoint, BeforeTheClocksAreKnownStatesAreRefusedNotMisread) {
  Pair p;
  rt::Random r(5);
  ASSERT_TRUE(p.op.receive(whole(MessageId::kHello, {}), rt::time_from_ns(1), [](auto) {}));
  p.op.add_incoming(MessageId::kRobotState, [](auto, rt::Time) -> bool {
    ADD_FAILURE() << "its stamps can not be converted yet";
    return true;
  });
  EXPECT_TRUE(p.op.receive(whole(MessageId::kRobotState, body_of(random_state(r))),
                           rt::time_from_ns(2), [](auto) {}));
  EXPECT_EQ(p.op.stats().refused[static_cast<std::size_t>(MessageId::kRobotState)], 1U);
  EXPECT_FALSE(p.op.ever_heard());
}

// ---- traffic ----

TEST(Endpoint, StampsArriveInLocalTime) {
  Pair p;
  p.robot_clock = {1000 * kSecond, 50};
  p.to_robot_ns = 3 * kMs;
  p.to_op_ns = 7 * kMs;
  rt::Random r(6);
  std::int64_t made_host = 0;
  std::uint64_t seq = 0, seen = 0;
  std::int64_t worst = 0;
  p.robot.add_outgoing(MessageId::kRobotState, rt::Nanos{10 * kMs}, false,
                       [&](std::span<std::uint8_t> out) {
                         drivers::RobotState s = random_state(r);
                         s.seq = ++seq;
                         made_host = p.host;
                         s.taken = p.robot_clock.from_host(p.host);
                         return encode(s, out);
                       });
  p.op.add_incoming(MessageId::kRobotState, [&](std::span<const std::uint8_t> body, rt::Time sent) {
    drivers::RobotState s;
    EXPECT_TRUE(decode(body, s));
    // What was sent before this side knew the clocks was refused; from then on none is lost.
    if (seen == 0) {
      EXPECT_EQ(s.seq, 1 + p.op.stats().refused[static_cast<std::size_t>(MessageId::kRobotState)]);
      seen = s.seq - 1;
    }
    EXPECT_EQ(s.seq, ++seen) << "in order, none lost";
    const auto truth = p.op_clock.from_host(made_host);
    // Unconverted, either stamp would be off by 1000 s.
    for (const rt::Time t : {sent, p.op.to_local(rt::ns_of(s.taken))}) {
      worst = std::max(worst, std::abs((t - truth).count()));
      EXPECT_LE(std::abs((t - truth).count()),
                p.op.clock().uncertainty(p.op_clock.from_host(p.host)).count() + 1);
    }
    return true;
  });
  p.run(10 * kSecond);
  EXPECT_FALSE(p.broken);
  EXPECT_GT(seen, 950U);
  EXPECT_LT(worst, 6 * kMs) << "half the round trip is 5 ms";
  EXPECT_EQ(p.op.round_trip().count() / kMs, 10);
}

TEST(Endpoint, RatesAreKeptAndBulkWaitsForAFreeLine) {
  Pair p;
  int goals = 0, frames = 0, available = 1000000;
  p.op.add_outgoing(MessageId::kFrame, rt::Nanos{33'333'333}, true,
                    [&](std::span<std::uint8_t> out) {
                      EXPECT_EQ(out.size(), drivers::kMaxBody);
                      ++frames;
                      std::fill_n(out.begin(), 100, std::uint8_t{9});
                      return std::size_t{100};
                    });
  p.op.add_outgoing(MessageId::kRobotGoal, rt::Nanos{100 * kMs}, false,
                    [&](std::span<std::uint8_t> out) -> std::size_t {
                      if (available-- <= 0) return 0;
                      ++goals;
                      rt::Random r(static_cast<std::uint64_t>(goals));
                      return encode(random_goal(r), out);
                    });
  std::vector<MessageId> order;
  p.line_free = false;
  p.run(2 * kSecond);
  EXPECT_EQ(frames, 0) << "nothing large while the line is taken";
  EXPECT_NEAR(goals, 20, 2);
  p.line_free = true;
  frames = goals = 0;
  p.run(3 * kSecond);
  EXPECT_NEAR(frames, 90, 4);
  EXPECT_NEAR(goals, 30, 2);
  EXPECT_GE(p.robot.stats().received[static_cast<std::size_t>(MessageId::kFrame)] + 1,
            static_cast<std::uint64_t>(frames));
  // Small before large in one poll, and one large message a poll.
  p.op.poll(p.op_clock.from_host(p.host + kSecond), true, [&](auto m) {
    drivers::Header h;
    ASSERT_EQ(drivers::read_header(m, h), drivers::WireStatus::kOk);
    order.push_back(h.id);
  });
  EXPECT_EQ(order, (std::vector<MessageId>{MessageId::kClockRequest, MessageId::kRobotGoal,
                                           MessageId::kFrame}));
  // Nothing new: nothing is sent, and the next one goes out at once.
  available = 0;
  goals = 0;
  p.run(2 * kSecond);
  EXPECT_EQ(goals, 0);
  available = 1;
  p.run(2 * kMs);
  EXPECT_EQ(goals, 1);
}

// An end with nothing to say is heard every 10 ms all the same; one with much to say adds nothing.
TEST(Endpoint, SaysThatItIsAliveWhenItHasNothingElseToSay) {
  Pair p;
  p.run(500 * kMs);
  ASSERT_TRUE(p.op.ready());
  const auto alive = static_cast<std::size_t>(MessageId::kAlive);
  auto before = p.op.stats().sent[alive];
  std::int64_t worst = 0;
  for (int ms = 0; ms < 2000; ++ms) {
    p.run(kMs);
    worst = std::max(worst, (p.robot_clock.from_host(p.host) - p.robot.last_heard()).count());
  }
  EXPECT_NEAR(static_cast<double>(p.op.stats().sent[alive] - before), 190, 20);
  EXPECT_LE(worst, 10 * kMs + 2 * kMs) << "longest silence at the other end";
  std::uint64_t seq = 0;
  p.op.add_outgoing(MessageId::kRobotGoal, rt::Nanos{5 * kMs}, false, [&](auto out) {
    rt::Random r(++seq);
    return encode(random_goal(r), out);
  });
  before = p.op.stats().sent[alive];
  p.run(kSecond);
  EXPECT_EQ(p.op.stats().sent[alive], before);
}

TEST(Endpoint, AStampBeyondAnyClockIsRefused) {
  Pair p;
  p.robot_clock = {1000 * kSecond, 50};
  p.run(300 * kMs);
  ASSERT_TRUE(p.op.ready());
  p.op.add_incoming(MessageId::kRobotState, [](auto, rt::Time) -> bool {
    ADD_FAILURE() << "its stamp can not be converted";
    return true;
  });
  rt::Random r(8);
  for (const std::int64_t stamp :
       {std::numeric_limits<std::int64_t>::max(), std::numeric_limits<std::int64_t>::min()}) {
    EXPECT_TRUE(p.op.receive(whole(MessageId::kRobotState, body_of(random_state(r)), 1, stamp),
                             rt::time_from_ns(1), [](auto) {}));
  }
  EXPECT_EQ(p.op.stats().refused[static_cast<std::size_t>(MessageId::kRobotState)], 2U);
}

TEST(Endpoint, ByeIsSeenAndOnlySentAfterAHandshake) {
  Pair p;
  int sent = 0;
  p.op.send_bye(rt::time_from_ns(1), [&](auto) { ++sent; });
  EXPECT_EQ(sent, 0);
  p.run(300 * kMs);
  p.op.send_bye(p.op_clock.from_host(p.host), p.to_robot());
  p.run(10 * kMs);
  EXPECT_TRUE(p.robot.bye_received());
  EXPECT_FALSE(p.op.bye_received());
}

}  // namespace
