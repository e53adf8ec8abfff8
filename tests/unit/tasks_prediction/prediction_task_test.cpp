// The task on the wheels alone: what the delay of the link makes of a drive.
#include "tasks/prediction/prediction_task.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "rt/hash.hpp"
#include "tests/unit/tasks_prediction/prediction_loop.hpp"

namespace tests {
namespace {

TEST(PredictionTask, DrivesAPathRoundCornersAcrossDelays) {
  drivers::RobotPlantConfig plant;
  plant.encoder_ticks_per_motor_turn = 4000;
  plant.gear_friction_Nm = 0.3;
  for (const rt::Nanos delay : {rt::Nanos{0}, rt::Nanos{20ms}, rt::Nanos{100ms}}) {
    Loop l(delay, wheels_alone(), plant);
    l.path = make_path(7, {{0, 0, 0}, {1.2, 0, 0.3}, {1.2, 1.0, 1.5}, {0.4, 1.4, 2.5}});
    l.run(300);
    EXPECT_EQ(l.truth().path_m, 0);  // no path, no motion
    l.pin.path = &l.path;
    int arrived_at = 0;
    for (int i = 0; i < 15000; ++i) {
      l.tick();
      if (arrived_at == 0 && l.pout.telemetry.arrived) arrived_at = i;
    }
    const Pose2& x = l.truth().X_WB;
    const double end = std::hypot(x.x - 0.4, x.y - 1.4);
    std::printf(
        "one way %3lld ms: arrived after %.1f s, end error %.1f mm, off the path %.1f mm, "
        "tracking %.1f mm\n",
        static_cast<long long>(delay.count() / 1000000), arrived_at * 1e-3, 1e3 * end,
        1e3 * l.worst_off_path, 1e3 * l.worst_tracking);
    EXPECT_GT(arrived_at, 0);
    EXPECT_LT(arrived_at, 12000);
    EXPECT_LT(end, 0.010);
    EXPECT_LT(std::abs(perception::wrap_angle(x.yaw - 2.5)), 0.05);
    EXPECT_LT(l.worst_off_path, 0.06);
    EXPECT_LT(l.worst_tracking, 0.030);
    EXPECT_EQ(l.pout.telemetry.path_seq, 7U);
  }
}

// The way from where the newest state was measured to where the base stands, when no goal comes any
// more in full drive.
double blind_way(rt::Nanos one_way, const PredictionConfig& c, double* speed = nullptr) {
  Loop l(one_way, c);
  l.pin.round_trip_uncertainty = l.pin.robot_unsure = l.rin.goal_unsure = one_way;
  l.path = make_path(1, {{0, 0, 0}, {8, 0, 0}});
  l.pin.path = &l.path;
  while (l.ms < 6000 || l.ms % 100 != 51) l.tick();
  EXPECT_EQ(l.pout.goal.engaged, 1);
  if (speed != nullptr) *speed = l.truth().v_B.vx;
  const double measured_at = l.state.x_m;
  l.desk_hangs = true;
  l.run(3000);
  EXPECT_NEAR(l.truth().v_B.vx, 0, 1e-3);
  return l.truth().X_WB.x - measured_at;
}

TEST(PredictionTask, TheWayDrivenOnOneStateIsBounded) {
  const PredictionConfig c = wheels_alone();
  double before = 1;
  for (const rt::Nanos one_way :
       {rt::Nanos{5ms}, rt::Nanos{30ms}, rt::Nanos{100ms}, rt::Nanos{150ms}, rt::Nanos{200ms}}) {
    double v = 0;
    const double way = blind_way(one_way, c, &v);
    std::printf("one way %3lld ms: %.3f m/s, stands %.3f m after the last state\n",
                static_cast<long long>(one_way.count() / 1000000), v, way);
    EXPECT_LE(way, c.blind_way_m + v * v / 8 + 0.07 * v) << "and its ramp";
    EXPECT_GT(v, 0.2) << "borne";
    EXPECT_LE(v, before + 1e-3) << "a later link is never faster";
    before = v;
  }
  // Without the bounds it would be passed.
  PredictionConfig bold = c;
  bold.blind_way_m = bold.uncertainty_share_m = 1;
  EXPECT_GT(blind_way(200ms, bold), c.blind_way_m + 0.5 * 0.5 / 8 + 0.07 * 0.5);
}

TEST(PredictionTask, AStateThatWasTooOldHoldsTheBaseForAWhileAndItSaysWhy) {
  using tasks::Held;
  const PredictionConfig c = wheels_alone();
  Loop l;
  l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
  l.pin.path = &l.path;
  l.run(500);
  EXPECT_EQ(l.pout.goal.engaged, 1);
  EXPECT_EQ(l.pout.frame.held, Held::kNo);
  l.pin.robot_unsure = std::chrono::milliseconds{c.state_liveness_ms};  // nothing else is wrong
  l.run(100);
  EXPECT_EQ(l.pout.goal.engaged, 0);
  EXPECT_EQ(l.health.fault, fault::kStateStale);
  EXPECT_EQ(l.pout.frame.held, Held::kStateOld);
  EXPECT_EQ(l.pout.frame.held_limit_ms, c.state_liveness_ms);
  EXPECT_GT(l.pout.frame.held_ms, c.state_liveness_ms);
  EXPECT_LE(l.pout.frame.held_ms, c.state_liveness_ms + 60);
  l.pin.robot_unsure = 0ms;
  for (int job = 1; job < 10; ++job) {
    l.run(100);
    EXPECT_EQ(l.pout.goal.engaged, 0) << job;
    EXPECT_EQ(l.pout.frame.held, Held::kSettling) << job;
    EXPECT_EQ(l.health.fault, rt::kNoFault) << "it is in time again";
  }
  l.run(100);
  EXPECT_EQ(l.pout.goal.engaged, 1);
  EXPECT_EQ(l.pout.frame.held, Held::kNo);
  l.pin.robot_live = false;
  l.run(100);
  EXPECT_EQ(l.pout.frame.held, Held::kStateSilent);
  l.pin.robot_live = true;
  l.pin.delay_known = false;
  l.run(1100);
  EXPECT_EQ(l.pout.frame.held, Held::kDelayUnknown);
}

// A lost packet: one silence, after a long time without. The next one soon after is no single one.
TEST(PredictionTask, ASingleSilenceHoldsTheBaseForAQuarterOfThat) {
  using tasks::Held;
  Loop l;
  l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
  l.pin.path = &l.path;
  const auto jobs_held = [&](int silent_ms) {
    l.pin.robot_live = false;
    l.run(silent_ms);
    EXPECT_EQ(l.pout.frame.held, Held::kStateSilent);
    l.pin.robot_live = true;
    int jobs = 0;
    for (; jobs < 30; ++jobs) {
      l.run(100);
      if (l.pout.goal.engaged == 1) break;
      EXPECT_EQ(l.pout.frame.held, Held::kSettling);
    }
    return jobs;
  };
  l.run(2500);
  EXPECT_EQ(l.pout.goal.engaged, 1);
  EXPECT_EQ(jobs_held(300), 2);
  l.run(500);
  EXPECT_EQ(jobs_held(300), 9) << "so soon again";
  l.run(2500);
  EXPECT_EQ(jobs_held(100), 2);
  // Late again while it settles.
  l.run(2500);
  l.pin.robot_live = false;
  l.run(100);
  l.pin.robot_live = true;
  l.run(100);
  EXPECT_EQ(l.pout.frame.held, Held::kSettling);
  EXPECT_EQ(jobs_held(100), 9);
}

// Long enough for the goal after the next, and no longer than its own limit.
TEST(PredictionTask, AGoalLivesForTheRoundTripAndAHold) {
  PredictionConfig c = wheels_alone();
  for (const auto& [one_way, life] :
       {std::pair{rt::Nanos{10ms}, rt::Nanos{270ms}}, std::pair{rt::Nanos{150ms}, rt::Nanos{550ms}},
        std::pair{rt::Nanos{240ms}, rt::Nanos{700ms}}}) {
    Loop l(one_way, c);
    l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
    l.pin.path = &l.path;
    l.run(1000);
    EXPECT_EQ(l.pout.goal.engaged, 1);
    EXPECT_EQ(l.pout.goal.valid_until - l.pout.goal.made, life);
  }
}

TEST(PredictionTask, GoalIsAheadByTheRoundTrip) {
  // A bend far away keeps the path point in force; constant speed along x.
  for (const int trip_ms : {0, 100, 300}) {
    rt::Startup startup;
    PredictionConfig c;
    PredictionTask task(startup.token(), c);
    const Path path = make_path(1, {{0, 0, 0}, {4, 0, 0}, {4, 4, 0}});
    ModeMsg mode;
    mode.mode = Mode::kEngaged;
    PredictionTask::In in;
    in.path = &path;
    in.mode = &mode;
    in.delay_known = true;
    in.round_trip = std::chrono::milliseconds{trip_ms};
    RobotState s;
    in.robot = &s;
    PredictionTask::Out out;
    for (int k = 0; k < 20; ++k) {
      rt::Tick t;
      t.start = rt::time_from_ns(1'000'000'000LL + k * 100'000'000LL);
      s.seq = static_cast<std::uint64_t>(k + 1);
      s.taken = t.start - std::chrono::milliseconds{trip_ms / 2};
      s.x_m = 0.04 * k;
      s.vx = 0.4;
      ASSERT_TRUE(task.step(t, in, out) == rt::Health::ok());
    }
    EXPECT_EQ(out.goal.engaged, 1);
    EXPECT_NEAR(out.telemetry.lead_s, trip_ms * 1e-3, 1e-9);
    EXPECT_NEAR(out.goal.x_m, s.x_m + 0.4 * trip_ms * 1e-3 + c.path.look_ahead_m, 1e-6);
    EXPECT_EQ(out.goal.valid_until - out.goal.made, (trip_ms + 250) * 1ms);
  }
}

TEST(PredictionTask, HoldsWhenSomethingIsMissing) {
  Loop l;
  l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
  l.pin.path = &l.path;
  l.run(1500);
  ASSERT_EQ(l.pout.goal.engaged, 1);
  l.pin.delay_known = false;
  l.run(100);
  EXPECT_EQ(l.pout.goal.engaged, 0);
  EXPECT_EQ(l.health.fault, fault::kDelayUnknown);
  l.pin.delay_known = true;
  l.run(100);
  EXPECT_EQ(l.pout.goal.engaged, 1);
  for (const Mode m : {Mode::kInit, Mode::kHold, Mode::kRampDown, Mode::kSafeStop}) {
    l.mode.mode = m;
    l.run(100);
    EXPECT_EQ(l.pout.goal.engaged, 0);
  }
  l.mode.mode = Mode::kEngaged;
  l.run(100);
  EXPECT_EQ(l.pout.goal.engaged, 1);
  l.pin.path = nullptr;  // the mark was taken back
  l.run(100);
  EXPECT_EQ(l.pout.goal.engaged, 0);
  l.run(1000);
  EXPECT_NEAR(l.truth().v_B.vx, 0, 1e-3);
  l.pin.path = &l.path;
  l.one_way = 10s;  // states stop coming
  l.run(700);
  EXPECT_EQ(l.pout.goal.engaged, 0);
  EXPECT_EQ(l.health.fault, fault::kStateStale);
}

TEST(PredictionTask, BadPathAndBadStateAreRefused) {
  Loop l;
  l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
  l.pin.path = &l.path;
  l.run(1000);
  Path bad = l.path;
  bad.seq = 2;
  bad.points[1][0] = std::nan("");
  l.pin.path = &bad;
  l.run(100);
  EXPECT_EQ(l.health.fault, fault::kPathRefused);
  EXPECT_EQ(l.pout.goal.engaged, 0);
  EXPECT_TRUE(std::isfinite(l.pout.goal.x_m));
  RobotState nan_state = l.state;
  nan_state.seq += 1000;
  nan_state.x_m = std::nan("");
  rt::Tick t;
  t.start = l.now;
  l.pin.robot = &nan_state;
  l.pin.path = &l.path;
  EXPECT_EQ(l.prediction.step(t, l.pin, l.pout).fault, fault::kStateRefused);
  EXPECT_TRUE(std::isfinite(l.pout.goal.x_m));
}

TEST(PredictionTask, UncertainDelaySlowsDown) {
  Loop l;
  l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
  l.pin.path = &l.path;
  l.pin.round_trip_uncertainty = 250ms;
  l.run(2500);
  EXPECT_NEAR(l.pout.goal.speed_limit_m_per_s, 0.2, 1e-9);
  EXPECT_NEAR(l.truth().v_B.vx, 0.2, 0.01);
}

TEST(PredictionTask, NewPathOnTheWayIsTaken) {
  Loop l;
  l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
  l.pin.path = &l.path;
  l.run(2500);
  const Pose2 here = l.truth().X_WB;
  l.path = make_path(2, {here, {here.x, 1.0, 0}});
  l.run(8000);
  EXPECT_TRUE(l.pout.telemetry.arrived);
  EXPECT_LT(std::hypot(l.truth().X_WB.x - here.x, l.truth().X_WB.y - 1.0), 0.02);
}

TEST(PredictionTask, SameInputSameBytes) {
  std::uint64_t digest[2];
  for (std::uint64_t& d : digest) {
    rt::Hash64 h;
    Loop l;
    l.path = make_path(1, {{0, 0, 0}, {1, 0, 0}, {1, 1, 1}});
    l.pin.path = &l.path;
    for (int i = 0; i < 4000; ++i) {
      l.tick();
      h.value(l.pout.goal.x_m);
      h.value(l.pout.goal.yaw_rad);
    }
    d = h.digest();
  }
  EXPECT_EQ(digest[0], digest[1]);
}

}  // namespace
}  // namespace tests
