// Start, end and sudden end of the demo on the real clock, judged by what the surviving box
// recorded, in its own clock. The limits are those of docs/faults.md and nothing is added to them.
// What keeps them is done by real-time jobs; only where a limit is missed *and* the sentinels say
// that the machine itself held these jobs back in that very time, is the try not measured and made
// again. A story begins with a robot that drives or a hand that presses; where other work leaves the
// ordinary threads (link, codecs) no time for that, nothing is measured either. On a free machine
// it is a failure.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "rt/clock/box_time.hpp"
#include "rt/sched/admission.hpp"
#include "tests/fault/life_cycle/demo_process.hpp"
#include "tools/host/run_options.hpp"
#include "tools/measure/bench/other_load.hpp"

namespace {

using life_cycle::DemoProcess;
using tasks::Mode;

constexpr std::int64_t kMs = 1000000;
constexpr int kTries = 4;
// Cores' worth of other work: from here on a demo may never come to driving.
constexpr double kOthersWork_cores = 0.25;
constexpr double kPatience_s = 50;
// A sentinel that wakes this late was held back by the machine: it does nothing and outranks all.
constexpr std::int64_t kHeldBack = 5 * kMs;

double ms_between(std::int64_t from, std::int64_t to) {
  return static_cast<double>(to - from) / kMs;
}

// Last job of all tasks, or of the 1 kHz tasks alone: those that have an actuator.
std::int64_t last_job_end(const rt::RunLog& log, bool actuators_only) {
  std::int64_t last = 0;
  for (const auto& t : log.tasks) {
    if (actuators_only && t.spec.name != "haptic" && t.spec.name != "robot_io") continue;
    for (const auto& j : t.jobs) last = std::max(last, j.end_ns);
  }
  return last;
}

// How long the machine held back the survivor's cores between two instants: the time that at least
// one of its sentinels overslept.
double held_back_ms(const rt::RunLog& log, std::int64_t from, std::int64_t to) {
  std::vector<std::pair<std::int64_t, std::int64_t>> spans;
  for (const auto& s : log.sentinels) {
    const std::int64_t begin = std::max(s.release_ns, from),
                       end = std::min(s.release_ns + s.late_ns, to);
    if (s.late_ns >= kHeldBack && begin < end) spans.emplace_back(begin, end);
  }
  std::sort(spans.begin(), spans.end());
  std::int64_t sum = 0, until = from;
  for (const auto& [begin, end] : spans) {
    sum += std::max<std::int64_t>(0, end - std::max(begin, until));
    until = std::max(until, end);
  }
  return static_cast<double>(sum) / kMs;
}

// One try of a story: what it took and what the machine took of it.
struct Try {
  double ms = 0;
  double held_back = 0;  // ms, by the machine
  bool skipped = false;
  std::string not_measured;  // why; empty: it was
};

// The limit holds, or what is beyond it was taken by the machine and the story is told again.
template <class Story>
void expect_within(double limit_ms, const Story& story) {
  for (int n = 1; n <= kTries; ++n) {
    const Try t = story();
    if (t.skipped) GTEST_SKIP() << "the cores are taken";
    if (testing::Test::HasFailure()) return;
    if (!t.not_measured.empty()) {
      std::printf("try %d: %s: not measured\n", n, t.not_measured.c_str());
      continue;
    }
    if (t.ms <= limit_ms) return;
    if (t.ms - t.held_back > limit_ms) {
      ADD_FAILURE() << t.ms << " ms where " << limit_ms << " are allowed; the machine took "
                    << t.held_back;
      return;
    }
    std::printf("try %d: %.0f ms, but the machine held the cores back for %.0f ms: not measured\n",
                n, t.ms, t.held_back);
  }
  GTEST_SKIP() << "not measured: the machine was too busy in each of " << kTries << " tries";
}

// Waits for what a story begins with; false: it did not come, and `result` says why, or the test has
// failed.
template <class Condition>
bool begins(DemoProcess& demo, Try& result, const Condition& condition) {
  const teletact::OtherLoad others;
  const bool there = demo.until(condition, kPatience_s);
  result.skipped = demo.no_room();
  if (there || result.skipped) return there;
  demo.signal(SIGTERM);
  (void)demo.wait(30);  // an ended child is none of the others
  if (others.cores() < kOthersWork_cores) {
    ADD_FAILURE() << "it never began\n" << demo.output() << demo.log();
  }
  result.not_measured = "it never began, others used " + std::to_string(others.cores()) + " cores";
  return false;
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

// Newest instant at which a force was on the hand.
std::int64_t last_force_ns(const teletact::OperatorHalf& half) {
  std::int64_t last = 0;
  for (const auto& s : half.view.haptic) {
    if (s.force_N > 0.0F) last = rt::ns_of(s.stamp);
  }
  return last;
}

void interrupt(int signal, Try& result) {
  DemoProcess demo("int", kPatience_s);
  if (!begins(demo, result, driving)) return;
  const std::int64_t asked = rt::monotonic_ns();
  demo.signal(signal);
  EXPECT_EQ(demo.wait(kPatience_s), 0) << demo.output();
  EXPECT_TRUE(demo.report_written());
  const auto op = demo.op();
  const auto robot = demo.robot();
  ASSERT_TRUE(op.complete && robot.complete);
  const std::int64_t op_asked = rt::ns_of(teletact::kOperatorClock.from_host(asked));
  const std::int64_t robot_asked = rt::ns_of(teletact::kRobotClock.from_host(asked));
  const double op_ms = ms_between(op_asked, last_job_end(op.log, true));
  const double robot_ms = ms_between(robot_asked, last_job_end(robot.log, true));
  const double force_ms = std::max(0.0, ms_between(op_asked, last_force_ns(op)));
  std::printf(
      "after the signal: asked for in the boxes after %.1f and %.1f ms, last force %.1f ms, last "
      "job "
      "with an actuator %.1f and %.1f ms, last of any %.1f ms\n",
      ms_between(op_asked, demo.stop_request_ns("operator")),
      ms_between(robot_asked, demo.stop_request_ns("robot")), force_ms, op_ms, robot_ms,
      std::max(ms_between(op_asked, last_job_end(op.log, false)),
               ms_between(robot_asked, last_job_end(robot.log, false))));
  result.ms = std::max({op_ms, robot_ms, force_ms});
  result.held_back = std::max(held_back_ms(op.log, op_asked, op_asked + 200 * kMs),
                              held_back_ms(robot.log, robot_asked, robot_asked + 200 * kMs));
  EXPECT_GT(std::min(op_ms, robot_ms), 100) << "a ramp, not a cut";
  EXPECT_NE(op.view.mode.mode, Mode::kEngaged);
  ASSERT_FALSE(op.view.haptic.empty());
  EXPECT_EQ(op.view.haptic.back().force_N, 0.0F);
  EXPECT_NE(robot.view.robot.back().mode, static_cast<std::uint8_t>(Mode::kEngaged));
  // The setpoints are zero; what is left is the tail of the speed loop.
  EXPECT_LT(robot.view.robot.back().speed_m_per_s, 0.05F);
  expect_zero_before_input(op, robot);
}

TEST(LifeCycle, InterruptAndTerminateRampDownWithinTwoHundredMilliseconds) {
  for (const int signal : {SIGINT, SIGTERM}) {
    SCOPED_TRACE(signal == SIGINT ? "SIGINT" : "SIGTERM");
    expect_within(200, [signal] {
      Try t;
      interrupt(signal, t);
      return t;
    });
  }
}

void kill_operator(Try& result) {
  DemoProcess demo("kop", kPatience_s);
  if (!begins(demo, result, driving)) return;
  ASSERT_GT(demo.boxes().first, 0);
  const std::int64_t killed = rt::ns_of(teletact::kRobotClock.from_host(rt::monotonic_ns()));
  ::kill(demo.boxes().first, SIGKILL);
  const int code = demo.wait(kPatience_s);
  EXPECT_GT(code, 0) << "a run with a killed process is no good run";
  EXPECT_LT(code, 128);
  EXPECT_TRUE(demo.report_written());
  EXPECT_NE(demo.output().find("operator process was killed by signal 9"), std::string::npos)
      << demo.output();
  const auto robot = demo.robot();
  ASSERT_TRUE(robot.complete);
  ASSERT_GT(rt::ns_of(robot.view.robot.back().stamp), killed + 400 * kMs) << "it went on";
  double speed = 0;
  std::int64_t slowing = 0;
  for (const auto& s : robot.view.robot) {
    if (rt::ns_of(s.stamp) <= killed) speed = static_cast<double>(s.speed_m_per_s);
    if (rt::ns_of(s.stamp) > killed && !s.driving && slowing == 0) slowing = rt::ns_of(s.stamp);
  }
  // The halves on disk are up to a second old, longer where others write too.
  if (speed <= 0.05) return void(result.not_measured = "it had arrived before the kill");
  result.ms = ms_between(killed, last_motion_ns(robot));
  result.held_back = held_back_ms(robot.log, killed, killed + 300 * kMs);
  std::printf("killed at %.2f m/s: ramp begins after %.0f ms, stands after %.0f ms\n", speed,
              ms_between(killed, slowing), result.ms);
  EXPECT_LT(robot.view.robot.back().speed_m_per_s, 0.005F);
  EXPECT_NE(robot.view.mode.mode, Mode::kEngaged);
}

TEST(LifeCycle, KilledOperatorLeavesTheRobotStanding) {
  expect_within(300, [] {
    Try t;
    kill_operator(t);
    return t;
  });
}

void kill_robot(Try& result) {
  DemoProcess demo("krob", kPatience_s);
  const auto pressing = [](const DemoProcess& d) {
    const auto half = d.op();
    const auto& h = half.view.haptic;
    return h.size() > 400 && h.back().force_N > 1.0F && h[h.size() - 300].force_N > 0.5F;
  };
  if (!begins(demo, result, pressing)) return;
  const std::int64_t killed = rt::monotonic_ns();  // the operator box's clock
  ::kill(demo.boxes().second, SIGKILL);
  const int code = demo.wait(kPatience_s);
  EXPECT_GT(code, 0);
  EXPECT_LT(code, 128);
  EXPECT_TRUE(demo.report_written());
  EXPECT_NE(demo.output().find("robot process was killed by signal 9"), std::string::npos)
      << demo.output();
  const auto op = demo.op();
  ASSERT_TRUE(op.complete);
  double before = 0;
  std::size_t after = 0;
  for (const auto& s : op.view.haptic) {
    const std::int64_t t = rt::ns_of(s.stamp);
    if (t <= killed) before = static_cast<double>(s.force_N);
    if (t > killed + 500 * kMs) ++after;
  }
  if (before <= 0.2) return void(result.not_measured = "the hand had let go before the kill");
  ASSERT_GT(after, 100U) << "the operator's box went on after the kill";
  result.ms = ms_between(killed, last_force_ns(op));
  result.held_back = held_back_ms(op.log, killed, killed + 300 * kMs);
  std::printf("force %.2f N at the kill, gone after %.0f ms\n", before, result.ms);
  EXPECT_NE(op.view.mode.mode, Mode::kEngaged);
}

TEST(LifeCycle, KilledRobotLeavesTheHandLimp) {
  expect_within(300, [] {
    Try t;
    kill_robot(t);
    return t;
  });
}

// The general case: nobody is told, there is only silence. Both boxes live on, and both are safe.
void cut_link(Try& result) {
  const teletact::OtherLoad others;
  DemoProcess demo("cut", 9, {"--cut-link", "7"});
  const int code = demo.wait(kPatience_s);
  result.skipped = demo.no_room();
  if (result.skipped) return;
  EXPECT_EQ(code, 0) << demo.output();
  const auto op = demo.op();
  const auto robot = demo.robot();
  ASSERT_TRUE(op.complete && robot.complete);
  const std::int64_t cut = demo.cut_ns();
  ASSERT_GT(cut, 0);
  const std::int64_t op_cut = rt::ns_of(teletact::kOperatorClock.from_host(cut));
  const std::int64_t robot_cut = rt::ns_of(teletact::kRobotClock.from_host(cut));
  double speed = 0, force = 0;
  for (const auto& s : robot.view.robot) {
    if (rt::ns_of(s.stamp) <= robot_cut) speed = static_cast<double>(s.speed_m_per_s);
  }
  for (const auto& s : op.view.haptic) {
    if (rt::ns_of(s.stamp) <= op_cut) force = static_cast<double>(s.force_N);
  }
  const double stands = std::max(0.0, ms_between(robot_cut, last_motion_ns(robot)));
  const double limp = std::max(0.0, ms_between(op_cut, last_force_ns(op)));
  std::printf("cut at %.2f m/s and %.1f N: stands after %.0f ms, limp after %.0f ms\n", speed,
              force, stands, limp);
  if (speed <= 0.05 && force <= 0.2) {
    EXPECT_GE(others.cores(), kOthersWork_cores) << "nothing moved and nothing was felt";
    result.not_measured = "nothing moved and nothing was felt at the cut";
  }
  EXPECT_NE(op.view.mode.mode, Mode::kEngaged);
  EXPECT_NE(robot.view.mode.mode, Mode::kEngaged);
  result.ms = std::max(stands, limp);
  result.held_back = std::max(held_back_ms(op.log, op_cut, op_cut + 300 * kMs),
                              held_back_ms(robot.log, robot_cut, robot_cut + 300 * kMs));
}

TEST(LifeCycle, ACutCableLeavesBothBoxesSafe) {
  expect_within(300, [] {
    Try t;
    cut_link(t);
    return t;
  });
}

TEST(LifeCycle, ASecondStartIsRefusedOrFits) {
  DemoProcess first("one", 6);
  const bool up =
      first.until([](const DemoProcess& d) { return !d.op().view.haptic.empty(); }, kPatience_s);
  if (first.no_room()) GTEST_SKIP() << "the cores are taken: " << first.output();
  ASSERT_TRUE(up) << first.output();
  DemoProcess second("two", 1);
  const int code = second.wait(kPatience_s);
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
  EXPECT_EQ(first.wait(kPatience_s), 0) << "the first one runs on: " << first.output();
}

// Three runs at most: on a machine that others use the person may press where nothing is fused yet.
TEST(LifeCycle, WithoutAnEngageTheRobotNeverMoves) {
  unsigned marks = 0;
  const teletact::OtherLoad others;
  for (int n = 0; n < 3 && marks == 0; ++n) {
    DemoProcess demo("hold" + std::to_string(n), 8, {"--set", "operator.engage_after_s=3600"});
    const int code = demo.wait(kPatience_s);
    if (demo.no_room()) GTEST_SKIP() << "the cores are taken: " << demo.output();
    EXPECT_EQ(code, 0) << demo.output();
    const auto op = demo.op();
    const auto robot = demo.robot();
    ASSERT_TRUE(robot.complete);
    marks = op.view.task.marks;
    for (const auto& s : robot.view.robot) {
      ASSERT_NE(s.mode, static_cast<std::uint8_t>(Mode::kEngaged));
      ASSERT_FALSE(s.driving);
    }
    EXPECT_LT(robot.view.truth.back().path_m, 1e-9);
    expect_zero_before_input(op, robot);
  }
  if (marks == 0 && others.cores() >= kOthersWork_cores)
    GTEST_SKIP() << "not measured: the person never came to a mark, others worked too";
  EXPECT_GE(marks, 1U) << "a mark was made all the same";
}

}  // namespace
