// Start, end and sudden end of the demo on the real clock, judged by what the run recorded, not by
// this process's own clock. Bounds are those of docs/faults.md plus `kLoaded`: a machine that also
// does other work may keep an ordinary thread (the console, the parent) waiting that long.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "rt/clock/box_time.hpp"
#include "rt/sched/admission.hpp"
#include "tests/fault/life_cycle/demo_process.hpp"
#include "tools/teletact/run_demo.hpp"

namespace {

using life_cycle::DemoProcess;
using tasks::Mode;

constexpr std::int64_t kMs = 1000000;
constexpr std::int64_t kLoaded = 100 * kMs;

// Another program may hold the cores for a while: then this test can say nothing.
#define SKIP_IF_NO_ROOM(demo)                                                        \
  if ((demo).ended() && (demo).output().find("not registered") != std::string::npos) \
  GTEST_SKIP() << "the cores are taken: " << (demo).output()

double last_job_end_ms(const rt::RunLog& log, std::int64_t from) {
  std::int64_t last = 0;
  for (const auto& t : log.tasks) {
    for (const auto& j : t.jobs) last = std::max(last, j.end_ns);
  }
  return static_cast<double>(last - from) / kMs;
}

bool driving(const DemoProcess& d) {
  const auto half = d.robot();
  return !half.view.robot.empty() && half.view.robot.back().driving &&
         half.view.robot.back().speed_m_per_s > 0.1F;
}

// Newest instant at which the base moved faster than encoder noise allows.
std::int64_t last_motion_ns(const teletact::RobotHalf& half) {
  std::int64_t last = 0;
  for (const auto& s : half.view.robot) {
    if (s.speed_m_per_s > 0.01F) last = rt::ns_of(s.stamp);
  }
  return last;
}

// Before the first valid input of every hard port the output is zero.
void expect_zero_before_input(const teletact::OperatorHalf& op, const teletact::RobotHalf& robot) {
  ASSERT_FALSE(op.view.haptic.empty());
  ASSERT_FALSE(robot.view.robot.empty());
  bool seen = false;
  int before = 0;
  for (const auto& s : op.view.haptic) {
    // Age 0 with no work: no patch has been taken yet.
    seen = seen || s.patch_age_s != 0.0F;
    if (seen) break;
    ++before;
    ASSERT_EQ(s.force_N, 0.0F);
  }
  EXPECT_GT(before, 0) << "the first tick can not have had a patch";
  double path_m = 0;
  std::int64_t engaged = 0;
  for (const auto& s : robot.view.robot) {
    if (s.mode == static_cast<std::uint8_t>(Mode::kEngaged)) {
      engaged = rt::ns_of(s.stamp);
      break;
    }
    ASSERT_FALSE(s.driving);
    ASSERT_LT(s.speed_m_per_s, 1e-6F);
  }
  for (const auto& s : robot.view.truth) {
    if (engaged == 0 || rt::ns_of(s.stamp) < engaged) path_m = s.path_m;
  }
  EXPECT_LT(path_m, 1e-9);
}

TEST(LifeCycle, InterruptRampsDownWithinTwoHundredMilliseconds) {
  DemoProcess demo("int", 20);
  const bool drove = demo.until(driving, 20);
  SKIP_IF_NO_ROOM(demo);
  ASSERT_TRUE(drove) << demo.output() << demo.log();
  const std::int64_t asked = rt::monotonic_ns();  // the operator box's clock
  demo.signal(SIGINT);
  EXPECT_EQ(demo.wait(20), 0) << demo.output();
  EXPECT_TRUE(demo.report_written());
  const auto op = demo.op();
  const auto robot = demo.robot();
  EXPECT_TRUE(op.complete);
  EXPECT_TRUE(robot.complete);
  const double op_ms = last_job_end_ms(op.log, demo.stop_request_ns("operator"));
  const double robot_ms = last_job_end_ms(robot.log, demo.stop_request_ns("robot"));
  std::printf(
      "last job after the request: operator %.1f ms, robot %.1f ms; seen %.1f ms after the "
      "signal\n",
      op_ms, robot_ms, static_cast<double>(demo.stop_request_ns("operator") - asked) / kMs);
  EXPECT_LE(op_ms, 200 + static_cast<double>(kLoaded) / kMs);
  EXPECT_LE(robot_ms, 200 + static_cast<double>(kLoaded) / kMs);
  EXPECT_GT(op_ms, 50) << "a ramp, not a cut";
  EXPECT_LE(demo.stop_request_ns("operator") - asked, kLoaded);
  // The ramp is a ramp: the mode was left in order and the force ended at zero.
  EXPECT_EQ(op.view.mode.mode == Mode::kEngaged, false);
  ASSERT_FALSE(op.view.haptic.empty());
  EXPECT_LT(op.view.haptic.back().force_N, 0.05F);
  EXPECT_NE(robot.view.robot.back().mode, static_cast<std::uint8_t>(Mode::kEngaged));
  expect_zero_before_input(op, robot);
}

TEST(LifeCycle, KilledOperatorLeavesTheRobotStanding) {
  DemoProcess demo("kop", 20);
  const bool drove = demo.until(driving, 20);
  SKIP_IF_NO_ROOM(demo);
  ASSERT_TRUE(drove) << demo.output() << demo.log();
  ASSERT_GT(demo.boxes().first, 0);
  const std::int64_t killed = rt::ns_of(teletact::kRobotClock.from_host(rt::monotonic_ns()));
  ::kill(demo.boxes().first, SIGKILL);
  const int code = demo.wait(20);
  EXPECT_GT(code, 0) << "a run with a killed process is no good run";
  EXPECT_LT(code, 128);
  EXPECT_TRUE(demo.report_written());
  EXPECT_NE(demo.output().find("operator process was killed by signal 9"), std::string::npos)
      << demo.output();
  const auto robot = demo.robot();
  ASSERT_TRUE(robot.complete);
  ASSERT_GT(rt::ns_of(robot.view.robot.back().stamp), killed);
  double speed = 0;
  std::int64_t slowing = 0;
  for (const auto& s : robot.view.robot) {
    if (rt::ns_of(s.stamp) <= killed) speed = static_cast<double>(s.speed_m_per_s);
    if (rt::ns_of(s.stamp) > killed && !s.driving && slowing == 0) slowing = rt::ns_of(s.stamp);
  }
  ASSERT_GT(speed, 0.05) << "it was driving";
  const double ramp_ms = 1e3 * speed / 1.0;  // robot_io.trajectory.acceleration_m_per_s2
  const double slow_ms = static_cast<double>(slowing - killed) / kMs;
  const double stand_ms = static_cast<double>(last_motion_ns(robot) - killed) / kMs;
  std::printf("killed at %.2f m/s: ramp begins after %.0f ms, stands after %.0f ms\n", speed,
              slow_ms, stand_ms);
  ASSERT_GT(slowing, 0);
  EXPECT_LE(slow_ms, 300 + static_cast<double>(kLoaded) / kMs);
  EXPECT_LE(stand_ms, 300 + ramp_ms + static_cast<double>(kLoaded) / kMs);
  EXPECT_LT(robot.view.robot.back().speed_m_per_s, 0.005F);
}

TEST(LifeCycle, KilledRobotLeavesTheHandLimp) {
  DemoProcess demo("krob", 20);
  const bool pressed = demo.until(
      [](const DemoProcess& d) {
        const auto half = d.op();
        const auto& h = half.view.haptic;
        return h.size() > 400 && h.back().force_N > 1.0F && h[h.size() - 300].force_N > 0.5F;
      },
      25);
  SKIP_IF_NO_ROOM(demo);
  ASSERT_TRUE(pressed) << demo.output() << demo.log();
  const std::int64_t killed = rt::monotonic_ns();
  ::kill(demo.boxes().second, SIGKILL);
  const int code = demo.wait(20);
  EXPECT_GT(code, 0);
  EXPECT_LT(code, 128);
  EXPECT_TRUE(demo.report_written());
  EXPECT_NE(demo.output().find("robot process was killed by signal 9"), std::string::npos)
      << demo.output();
  const auto op = demo.op();
  ASSERT_TRUE(op.complete);
  double before = 0;
  std::int64_t last_force = 0;
  std::size_t after = 0;
  for (const auto& s : op.view.haptic) {
    const std::int64_t t = rt::ns_of(s.stamp);
    if (t <= killed) before = static_cast<double>(s.force_N);
    if (t > killed && s.force_N > 0.05F) last_force = t;
    if (t > killed + 500 * kMs) ++after;
  }
  ASSERT_GT(before, 0.2) << "the hand pressed";
  ASSERT_GT(after, 100U) << "the operator's box went on after the kill";
  const double ms = static_cast<double>(last_force - killed) / kMs;
  std::printf("force %.2f N at the kill, gone after %.0f ms\n", before, ms);
  EXPECT_LE(ms, 300 + static_cast<double>(kLoaded) / kMs);
  EXPECT_NE(op.view.mode.mode, Mode::kEngaged);
}

TEST(LifeCycle, ASecondStartIsRefusedOrFits) {
  DemoProcess first("one", 6);
  const bool up = first.until([](const DemoProcess& d) { return !d.op().view.haptic.empty(); }, 15);
  SKIP_IF_NO_ROOM(first);
  ASSERT_TRUE(up) << first.output();
  DemoProcess second("two", 1);
  const int code = second.wait(20);
  const std::string text = second.output();
  std::printf("second start: code %d: %s", code, text.substr(0, text.find('\n') + 1).c_str());
  if (rt::affinity_cpus().size() <= 2) {
    EXPECT_EQ(code, 3) << "two cores hold one demo";
  }
  if (code != 0) {
    EXPECT_EQ(code, 3);
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << "one message: " << text;
    EXPECT_FALSE(second.report_written());
  }
  EXPECT_EQ(first.wait(20), 0) << "the first one runs on: " << first.output();
}

TEST(LifeCycle, WithoutAnEngageTheRobotNeverMoves) {
  DemoProcess demo("hold", 8, {"--set", "operator.engage_after_s=3600"});
  const int code = demo.wait(40);
  SKIP_IF_NO_ROOM(demo);
  EXPECT_EQ(code, 0) << demo.output();
  const auto op = demo.op();
  const auto robot = demo.robot();
  ASSERT_TRUE(robot.complete);
  EXPECT_GE(op.view.task.marks, 1U) << "a mark was made all the same";
  for (const auto& s : robot.view.robot) {
    ASSERT_NE(s.mode, static_cast<std::uint8_t>(Mode::kEngaged));
    ASSERT_FALSE(s.driving);
  }
  EXPECT_LT(robot.view.truth.back().path_m, 1e-9);
  expect_zero_before_input(op, robot);
}

}  // namespace
