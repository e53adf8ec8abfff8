// Faults of the road between the boxes, on the virtual clock: whatever the network does, the base
// stands and the hand is limp within the limits of docs/faults.md, and the link holds no more
// memory than before.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/host/sim_link.hpp"

namespace {

using teletact::DemoOptions;
using teletact::SimLink;
using teletact::VirtualRun;

constexpr double kLimit_ms = 300;
// What has left the bottleneck still arrives: delay and jitter of kRoad.
constexpr double kWay_ms = 35;
// Of a half-open connection, the box that still hears: the other one's silence limit (180 ms), a
// period of its supervision, the way of the news, and what the stop takes here (docs/faults.md).
// To the robot it comes with a goal, one a period of prediction.
constexpr double kOtherStands_ms = 180 + 10 + 100 + kWay_ms + 2 + 125 + 70;
constexpr double kOtherLimp_ms = 180 + 10 + 10 + kWay_ms + 11 + 100;
// The base drives and the hand presses then.
constexpr double kAt_s = 6.6;

// The default scene over the road that its shape describes, as a network.
std::vector<std::string> road(std::vector<std::string> more = {}) {
  std::vector<std::string> keys{"link.shape.delay_ms=0",        "link.shape.jitter_ms=0",
                                "link.shape.rate_Mbit_per_s=0", "link.network.delay_ms=30",
                                "link.network.jitter_ms=5",     "link.network.rate_Mbit_per_s=60"};
  keys.insert(keys.end(), more.begin(), more.end());
  return keys;
}

// Looks what the link holds whenever it acts.
struct Watched final : rt::Actor {
  explicit Watched(rt::Actor& link) : link_(dynamic_cast<SimLink&>(link)) {}
  [[nodiscard]] std::int64_t next_host_ns() const noexcept override { return link_.next_host_ns(); }
  void act(std::int64_t host_ns) override {
    link_.act(host_ns);
    most_held = std::max(most_held, link_.held_bytes());
    if (const auto* r = link_.road(drivers::Way::kToRobot)) to_robot = r->stats();
    if (const auto* r = link_.road(drivers::Way::kToOperator)) to_operator = r->stats();
  }
  std::size_t most_held = 0;
  drivers::StreamEmulator::Stats to_robot, to_operator;

 private:
  SimLink& link_;
};

struct RoadRun {
  VirtualRun run;
  std::size_t most_held = 0;
  drivers::StreamEmulator::Stats to_robot, to_operator;
};

RoadRun drive(double seconds, const std::vector<std::string>& overrides) {
  static rt::Startup startup;
  const auto scene =
      teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
  DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;  // the smaller variants: faster
  std::unique_ptr<Watched> watched;
  options.wrap_link = [&](rt::Actor& link) -> rt::Actor* {
    watched = std::make_unique<Watched>(link);
    return watched.get();
  };
  RoadRun out{
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration()),
      0,
      {},
      {}};
  out.most_held = watched->most_held;
  out.to_robot = watched->to_robot;
  out.to_operator = watched->to_operator;
  return out;
}

// What base and hand did from an instant on, until another.
struct After {
  double speed = 0, force = 0;        // right before
  double stands_ms = 0, limp_ms = 0;  // the last instant at which it moved, or there was force
  tasks::Mode op{}, robot{};          // at the end of the run
};

After after(const RoadRun& r, double from_s, double to_s) {
  After out;
  const auto ms = [&](rt::Time t, std::int64_t epoch_ns) {
    return 1e-6 * static_cast<double>(rt::ns_of(t) - epoch_ns) - 1e3 * from_s;
  };
  for (const auto& s : r.run.robot.view.robot) {
    const double t = ms(s.stamp, r.run.robot.epoch_ns);
    const auto v = static_cast<double>(s.speed_m_per_s);
    if (t <= 0) out.speed = v;
    if (t > 0 && t < 1e3 * (to_s - from_s) && v > 0.01) out.stands_ms = t;
  }
  for (const auto& s : r.run.op.view.haptic) {
    const double t = ms(s.stamp, r.run.op.epoch_ns);
    if (t <= 0) out.force = static_cast<double>(s.force_N);
    if (t > 0 && t < 1e3 * (to_s - from_s) && s.force_N > 0.0F) out.limp_ms = t;
  }
  out.op = r.run.op.view.mode.mode;
  out.robot = r.run.robot.view.mode.mode;
  std::printf(
      "at %.2f s: %.2f m/s, %.1f N; stands after %.0f ms, limp after %.0f ms; modes %d, %d; "
      "link held at most %zu bytes\n",
      from_s, out.speed, out.force, out.stands_ms, out.limp_ms, static_cast<int>(out.op),
      static_cast<int>(out.robot), r.most_held);
  return out;
}

// A frame, and what fits on the way: nothing that grows with the length of a run.
constexpr std::size_t kMostHeld = 900000;
// The operator does not engage again by himself.
const std::string kNoAct = "operator.re_engage_after_s=0";

TEST(RoadFaults, ARunOverABadRoadIsTheSameTwice) {
  const std::string stall = "link.network.stall=[{at_s=1, for_ms=400}]";
  const RoadRun a = drive(2.5, road({stall})), b = drive(2.5, road({stall}));
  EXPECT_EQ(a.run.log_hash, b.run.log_hash);
  EXPECT_EQ(a.run.sched_hash, b.run.sched_hash);
  const RoadRun seed = drive(2.5, road({stall, "link.network.seed=2"}));
  EXPECT_NE(seed.run.log_hash, a.run.log_hash) << "other jitter, other arrivals";
  EXPECT_EQ(a.to_operator.bytes_lost + a.to_robot.bytes_lost, 0U);
  EXPECT_GT(a.to_operator.bytes_arrived, 1000000U);
  EXPECT_LE(a.most_held, kMostHeld);
}

TEST(RoadFaults, ACutStopsBothWithinTheLimit) {
  const RoadRun r = drive(kAt_s + 1.5, road({kNoAct, "link.network.cut=[{at_s=6.6}]"}));
  const After a = after(r, kAt_s, kAt_s + 1.5);
  EXPECT_GT(a.speed, 0.2) << "it was driving";
  EXPECT_GT(a.stands_ms, 0);
  EXPECT_LE(a.stands_ms, kLimit_ms);
  EXPECT_LE(a.limp_ms, kLimit_ms);
  EXPECT_EQ(a.robot, tasks::Mode::kHold);
  EXPECT_EQ(a.op, tasks::Mode::kHold);
  EXPECT_LE(r.most_held, kMostHeld);
}

// The box that hears nothing stops within the limit; the other one when it hears of that.
TEST(RoadFaults, AHalfOpenConnectionStopsBoth) {
  for (const bool to_robot : {true, false}) {
    const std::string way = to_robot ? "to_robot" : "to_operator";
    SCOPED_TRACE(way);
    const RoadRun r =
        drive(kAt_s + 1.5, road({kNoAct, "link.network.cut=[{at_s=6.6, way=\"" + way + "\"}]"}));
    const After a = after(r, kAt_s, kAt_s + 1.5);
    EXPECT_GT(a.speed, 0.2) << "it was driving";
    EXPECT_GT(a.stands_ms, 0);
    EXPECT_LE(a.stands_ms, to_robot ? kLimit_ms : kOtherStands_ms);
    EXPECT_LE(a.limp_ms, to_robot ? kOtherLimp_ms : kLimit_ms);
    EXPECT_NE(a.op, tasks::Mode::kEngaged);
    EXPECT_NE(a.robot, tasks::Mode::kEngaged);
    EXPECT_LE(r.most_held, kMostHeld);
  }
}

// Nothing moves in a stall beyond the limit, and the act that was held goes on behind it.
TEST(RoadFaults, AStallEveryFourSecondsStopsTheBaseEachTime) {
  const RoadRun r =
      drive(11.5, road({kNoAct, "link.network.stall=[{at_s=6.6, for_ms=400, every_s=4}]"}));
  for (const double at : {6.6, 10.6}) {
    const After a = after(r, at, at + 0.4);
    EXPECT_LE(a.stands_ms, kLimit_ms + kWay_ms) << at;
    EXPECT_LE(a.limp_ms, kLimit_ms + kWay_ms) << at;
    if (at < 7) {
      EXPECT_GT(a.speed, 0.2);
    }
  }
  EXPECT_GT(after(r, 7.6, 11.5).stands_ms, 500) << "it drives on";
  EXPECT_EQ(r.run.op.view.mode.mode, tasks::Mode::kEngaged) << "without another act";
  EXPECT_LE(r.most_held, kMostHeld);
  EXPECT_EQ(r.to_robot.bytes_lost + r.to_operator.bytes_lost, 0U) << "a stall loses nothing";
}

// The operator engages at 1 s, once. Behind a stall that takes the news of it, or the answer, both
// boxes are engaged; the console presses again only where its own box has refused.
TEST(RoadFaults, AnActThatFallsIntoAStallIsFollowed) {  // F-SUP-04
  for (const char* stall :
       {"{at_s=0.85, for_ms=250}", "{at_s=0.95, for_ms=400}", "{at_s=1.1, for_ms=400}"}) {
    SCOPED_TRACE(stall);
    const RoadRun r = drive(3.2, road({kNoAct, "link.network.delay_ms=80",
                                       std::string("link.network.stall=[") + stall + "]"}));
    EXPECT_EQ(r.run.op.view.mode.mode, tasks::Mode::kEngaged);
    EXPECT_EQ(r.run.robot.view.mode.mode, tasks::Mode::kEngaged);
    EXPECT_EQ(r.run.op.view.engages, 1U) << "the act was taken";
  }
}

TEST(RoadFaults, AFlapIsToldAtOnceAndTheNextConnectionIsEngagedByAnAct) {
  drivers::NetworkConfig c;
  c.flaps_per_minute = 10;
  c.flap_from_s = 6;
  const double at =
      1e-9 * static_cast<double>(drivers::LineSchedule(c, 0).flap_at(6000000000).next_begin_ns);
  for (const bool act : {false, true}) {
    auto keys = road({"link.network.flaps_per_minute=10", "link.network.flap_from_s=6"});
    if (!act) keys.push_back(kNoAct);
    const RoadRun r = drive(act ? at + 2.8 : at + 1.5, keys);
    const After a = after(r, at, at + 1.2);
    EXPECT_GT(a.speed, 0.2);
    EXPECT_LE(a.stands_ms, kLimit_ms - 90) << "nobody waits for the silence";
    EXPECT_LE(a.limp_ms, kLimit_ms - 180);
    EXPECT_EQ(a.op, act ? tasks::Mode::kEngaged : tasks::Mode::kHold);
    EXPECT_EQ(a.robot, a.op);
    EXPECT_GT(r.to_operator.bytes_lost, 0U);
    EXPECT_LE(r.most_held, kMostHeld);
  }
}

TEST(RoadFaults, DamagedBytesEndTheConnectionAndStopBoth) {
  const RoadRun r =
      drive(kAt_s + 1.5,
            road({kNoAct, "link.network.corrupt_per_MB=30", "link.network.corrupt_from_s=6.6"}));
  ASSERT_GT(r.to_operator.bytes_changed + r.to_robot.bytes_changed, 0U);
  const After a = after(r, kAt_s, kAt_s + 1.5);
  EXPECT_GT(a.speed, 0.2);
  // The first damaged byte comes within 100 ms, at 3 MB/s.
  EXPECT_LE(a.stands_ms, kLimit_ms + 100);
  EXPECT_LE(a.limp_ms, kLimit_ms + 100);
  EXPECT_EQ(a.op, tasks::Mode::kHold) << "also where another connection was made";
  EXPECT_EQ(a.robot, tasks::Mode::kHold);
  EXPECT_LE(r.most_held, kMostHeld);
}

}  // namespace
