#include "tools/host/run_results.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "tasks/contract/table.hpp"
#include "tools/host/run_options.hpp"
#include "tools/host/run_truth.hpp"

namespace {

using teletact::Metrics;
using teletact::OperatorHalf;
using teletact::RobotHalf;
using teletact::RunInfo;

constexpr std::int64_t kUs = 1000;
constexpr std::int64_t kMs = 1'000'000;

double value(const Metrics& m, const std::string& name) {
  for (const auto& row : m.rows()) {
    if (row.name == name) return row.value;
  }
  ADD_FAILURE() << name << " is missing";
  return std::nan("");
}

rt::TaskLog haptic_log() {
  rt::TaskLog t;
  t.id = static_cast<std::uint16_t>(tasks::TaskId::kHaptic);
  t.spec.name = "haptic";
  t.spec.rate = {1000, 1};
  t.spec.budget = rt::Nanos{100 * kUs};
  t.work_max = 1000;
  return t;
}

rt::JobRecord& add_job(rt::TaskLog& t, std::uint64_t k, std::int64_t wait, std::int64_t cpu) {
  rt::JobRecord r;
  r.task = t.id;
  r.k = k;
  r.release_ns = static_cast<std::int64_t>(k) * kMs;
  r.deadline_ns = r.release_ns + kMs;
  r.start_ns = r.release_ns + wait;
  r.end_ns = r.start_ns + cpu;
  r.cpu_ns = cpu;
  r.voluntary = 1;
  t.jobs.push_back(r);
  return t.jobs.back();
}

// 100 jobs; job 10 overruns by itself over 11 and 12, the platform delays job 50, and after the
// last record the totals know of three more dropped releases.
OperatorHalf known_run() {
  OperatorHalf op;
  rt::TaskLog t = haptic_log();
  std::uint64_t k = 0;
  for (; k < 10; ++k) add_job(t, k, 10 * kUs, 40 * kUs);
  add_job(t, k, 10 * kUs, 2500 * kUs).work = 5000;
  add_job(t, 13, 10 * kUs, 40 * kUs).skipped = 2;
  for (k = 14; k < 50; ++k) add_job(t, k, 10 * kUs, 40 * kUs);
  op.log.sentinels.push_back({50 * kMs, 970 * kUs, 0});
  add_job(t, 50, 980 * kUs, 40 * kUs);
  for (k = 51; k < 97; ++k) add_job(t, k, 10 * kUs, 40 * kUs);
  op.log.sentinels.push_back({60 * kMs, 4 * kUs, 0});
  op.totals.push_back({t.id, {t.jobs.size(), 2, 0, 5, 0}});
  op.log.tasks.push_back(std::move(t));
  return op;
}

TEST(RunResults, CausesAddUpToTheMissesIncludingTheTail) {
  const OperatorHalf op = known_run();
  Metrics m("demo");
  teletact::add_metrics({}, op, {}, m);
  EXPECT_EQ(value(m, "haptic.releases"), 100);
  EXPECT_EQ(value(m, "haptic.completed") + value(m, "haptic.skipped") + value(m, "haptic.aborted"),
            value(m, "haptic.releases"));
  EXPECT_EQ(value(m, "haptic.skipped"), 5);
  EXPECT_EQ(value(m, "haptic.miss_own"), 3) << "job 10 and the two it ran over";
  EXPECT_EQ(value(m, "haptic.miss_platform"), 1);
  EXPECT_EQ(value(m, "haptic.miss_unknown"), 3) << "the tail has no record to blame it on";
  double sum = 0;
  for (const char* cause : {"own", "platform", "charged", "queued", "carried", "unknown"}) {
    sum += value(m, std::string("haptic.miss_") + cause);
  }
  EXPECT_EQ(sum, value(m, "haptic.miss_total"));
  EXPECT_EQ(value(m, "haptic.miss_total"), 7);
  EXPECT_DOUBLE_EQ(value(m, "haptic.cpu_p50_us"), 40);
  EXPECT_DOUBLE_EQ(value(m, "haptic.late_minus_sentinel_p999_us"), 10);
}

TEST(RunResults, MeasuredOnlyWhileThePlatformIsOnTime) {
  OperatorHalf op = known_run();
  Metrics good("demo"), bad("demo"), simulated("demo");
  teletact::add_metrics({}, op, {}, good);
  EXPECT_EQ(value(good, "run.measured"), 1);
  EXPECT_EQ(value(good, "run.realtime"), 1);
  for (auto& r : op.log.tasks[0].jobs) {
    if (r.k < 60 || r.k > 70) continue;
    r.start_ns += 400 * kUs;
    r.end_ns += 400 * kUs;
    op.log.sentinels.push_back({r.release_ns, 400 * kUs, 0});
  }
  op.log.not_realtime = {"SCHED_FIFO"};
  teletact::add_metrics({}, op, {}, bad);
  EXPECT_GT(value(bad, "platform.late_share"), 0.05);
  EXPECT_EQ(value(bad, "run.measured"), 0);
  EXPECT_EQ(value(bad, "run.realtime"), 0);
  const std::string why = teletact::not_measured({}, op, {}, bad);
  EXPECT_NE(why.find("right"), std::string::npos) << why;
  EXPECT_NE(why.find("late by the platform"), std::string::npos) << why;
  // The reason is the real one: only a right missing says nothing of late starts.
  OperatorHalf no_right = known_run();
  no_right.log.not_realtime = {"SCHED_FIFO"};
  Metrics unprivileged("demo");
  teletact::add_metrics({}, no_right, {}, unprivileged);
  EXPECT_EQ(value(unprivileged, "run.measured"), 0);
  const std::string only = teletact::not_measured({}, no_right, {}, unprivileged);
  EXPECT_NE(only.find("right"), std::string::npos) << only;
  EXPECT_EQ(only.find("late"), std::string::npos) << only;
  EXPECT_EQ(teletact::not_measured({}, known_run(), {}, good), "");
  RunInfo info;
  info.virtual_clock = true;
  teletact::add_metrics(info, known_run(), {}, simulated);
  EXPECT_EQ(value(simulated, "run.measured"), 0) << "a simulation measures no machine";
}

TEST(RunResults, TouchFigures) {
  OperatorHalf op;
  for (int i = 0; i < 100; ++i) {
    tasks::HapticSample s;
    s.in_contact = i % 50 >= 40;
    s.force_N = s.in_contact ? static_cast<float>(i % 50 - 39) : 0.0F;
    s.step_N = 0.25F;
    s.step_raw_N = i == 70 ? 3.0F : 0.25F;
    s.guard_use = i == 41 || i == 5;
    s.finite = i != 99;
    op.view.haptic.push_back(s);
  }
  Metrics m("demo");
  teletact::add_metrics({}, op, {}, m);
  EXPECT_DOUBLE_EQ(value(m, "haptic.force_max_N"), 10);
  EXPECT_DOUBLE_EQ(value(m, "haptic.force_step_max_N"), 0.25);
  EXPECT_DOUBLE_EQ(value(m, "haptic.force_step_raw_max_N"), 3);
  EXPECT_DOUBLE_EQ(value(m, "haptic.contact_share"), 0.2);
  EXPECT_DOUBLE_EQ(value(m, "haptic.contacts"), 2);
  EXPECT_DOUBLE_EQ(value(m, "haptic.guard_share"), 0.05) << "guard use counts in contact only";
  EXPECT_DOUBLE_EQ(value(m, "haptic.not_finite"), 1);
}

// Both boxes ended in order: link .04, console .01, camera_twin .25 of a core.
struct OrdinaryRun {
  OperatorHalf op = known_run();
  RobotHalf robot;
  OrdinaryRun() {
    op.ordinary = {400 * kMs, 100 * kMs, 0, 20000 * kMs};
    robot.ordinary = {200 * kMs, 50 * kMs, 2500 * kMs, 10000 * kMs};
  }
};

TEST(RunResults, OrdinaryThreadsStandBesideWhatWasDeclared) {
  RunInfo info;
  info.best_effort = {{"link", 0.06, {}}, {"console", 0.04, {}}, {"camera_twin", 0.3, {}}};
  auto [op, robot] = OrdinaryRun();
  Metrics m("demo");
  teletact::add_metrics(info, op, robot, m);
  EXPECT_DOUBLE_EQ(value(m, "best_effort.link_share"), 0.04);
  EXPECT_DOUBLE_EQ(value(m, "best_effort.link_declared"), 0.06);
  EXPECT_DOUBLE_EQ(value(m, "best_effort.console_share"), 0.01);
  EXPECT_DOUBLE_EQ(value(m, "best_effort.camera_twin_share"), 0.25);
  EXPECT_DOUBLE_EQ(value(m, "best_effort.camera_twin_declared"), 0.3);
  EXPECT_EQ(teletact::beyond_admission(info, op, robot), "");
  robot.ordinary = {};  // it ended early: no sum of one box passes for both
  EXPECT_TRUE(teletact::ordinary_shares(info, op, robot).empty());
}

// Declared .03 and .2: what the admitted cores have to spare covers the rest or not.
TEST(RunResults, OrdinaryThreadsBeyondWhatAdmissionCanSpareAreAProblem) {
  RunInfo info;
  info.best_effort = {{"link", 0.03, {}}, {"console", 0.04, {}}, {"camera_twin", 0.2, {}}};
  auto [op, robot] = OrdinaryRun();
  EXPECT_EQ(teletact::beyond_admission(info, op, robot), "") << "nothing was admitted";
  info.admission.tasks.emplace_back();
  info.admission.spare = 0.061;
  EXPECT_EQ(teletact::beyond_admission(info, op, robot), "") << ".01 and .05 are covered";
  info.admission.spare = 0.059;
  const std::string said = teletact::beyond_admission(info, op, robot);
  EXPECT_NE(
      said.find(
          "link 0.040 of a core, declared 0.030, camera_twin 0.250 of a core, declared 0.200"),
      std::string::npos)
      << said;
  EXPECT_NE(said.find("0.060 of a core beyond what was declared; the admitted cores have 0.059"),
            std::string::npos)
      << said;
  info.admission.spare = -0.5;  // refused and run all the same: nothing is covered
  info.best_effort[2].share = 0.3;
  EXPECT_NE(teletact::beyond_admission(info, op, robot), "");
  info.virtual_clock = true;
  EXPECT_EQ(teletact::beyond_admission(info, op, robot), "") << "nothing was measured";
}

TEST(RunResults, AllocationsOfFirmTasksAreCountedAJobAndThoseOfHardOnesTogether) {
  OperatorHalf op = known_run();
  rt::TaskLog firm;
  firm.id = static_cast<std::uint16_t>(tasks::TaskId::kPlanning);
  firm.spec.name = "planning";
  firm.spec.task_class = rt::TaskClass::kFirm;
  firm.spec.rate = {10, 1};
  for (std::uint64_t k = 0; k < 100; ++k)
    add_job(firm, k, 10 * kUs, 40 * kUs).allocations = k == 40 ? 755 : k < 60 ? 0 : 3;
  op.log.tasks.push_back(firm);
  {
    Metrics m("demo");
    teletact::add_metrics({}, op, {}, m);
    EXPECT_EQ(value(m, "planning.allocations_p50"), 0);
    EXPECT_EQ(value(m, "planning.allocations_p99"), 3);
    EXPECT_EQ(value(m, "planning.allocations_max"), 755);
    for (const auto& row : m.rows()) EXPECT_NE(row.name, "hard.allocations") << "none counted";
  }
  for (auto& job : op.log.tasks[0].jobs) job.allocations = job.k == 20 || job.k == 21 ? 2 : 0;
  Metrics m("demo");
  teletact::add_metrics({}, op, {}, m);
  EXPECT_EQ(value(m, "hard.allocations"), 4);
}

// Three of the dropped releases came when the haptic thread had ended; seven records found a full
// ring.
TEST(RunResults, WhatAThreadThatEndedLostIsItsOwnAndLostRecordsAreCounted) {
  OperatorHalf op = known_run();
  RobotHalf robot;
  op.log.tasks[0].totals = op.totals[0].totals;
  op.log.tasks[0].totals->lost = 3;
  op.dropped_records = 3;
  robot.dropped_records = 4;
  Metrics m("demo");
  teletact::add_metrics({}, op, robot, m);
  EXPECT_EQ(value(m, "haptic.releases"), 100);
  EXPECT_EQ(value(m, "haptic.miss_total"), 7);
  EXPECT_EQ(value(m, "haptic.miss_own"), 6);
  EXPECT_EQ(value(m, "haptic.miss_unknown"), 0);
  EXPECT_EQ(value(m, "audit.dropped"), 7);
}

// A base that creeps along x at 0.1 m/s by the twin and at 0.11 by its wheels: two arrivals,
// between two looks of the console, on a clock that is 1000 s ahead and fast.
TEST(RunResults, ArrivalsAreJudgedByTheTwinAtTheirInstant) {
  OperatorHalf op;
  RobotHalf robot;
  for (int i = 0; i <= 200; ++i) {
    const double t = 0.1 * i;
    const rt::Time stamp = teletact::kRobotClock.from_host(100'000'000LL * i);
    robot.view.truth.push_back({stamp, 0.1 * t, 0, 0, 0.1 * t, 0});
    tasks::RobotSample s;
    s.stamp = stamp;
    s.x_m = static_cast<float>(0.11 * t);
    robot.view.robot.push_back(s);
  }
  op.view.world.follows_camera = true;
  op.view.error_max_m = 0.04;
  op.view.unsure_s = 1.5;
  op.view.arrivals = 2;
  op.view.arrived = {{rt::time_from_ns(5'030'000'000), 1, 0.503, 0.02, 0.01},
                     {rt::time_from_ns(15'050'000'000), 2, 1.5, 0, 0.01}};
  Metrics m("demo");
  teletact::add_metrics({}, op, robot, m);
  EXPECT_EQ(value(m, "robot.arrivals"), 2);
  EXPECT_NEAR(value(m, "robot.arrival_error_max_m"), 0.02, 1e-6);
  EXPECT_NEAR(value(m, "robot.goal_error_uncorrected_m"), 0.1505, 1e-5);
  EXPECT_EQ(value(m, "robot.stated_error_max_m"), 0.04);
  EXPECT_EQ(value(m, "robot.unsure_s"), 1.5);
  EXPECT_FALSE(teletact::true_base_at(robot, rt::time_from_ns(20'100'000'000))) << "after the run";
  EXPECT_FALSE(teletact::true_base_at(robot, rt::time_from_ns(-1))) << "before it";
}

// What a method does that a surface does not: a step of the force that the hand did not make, and a
// proxy on the other side.
TEST(RunResults, JumpsAndFlipsAreCountedInContactOnly) {
  OperatorHalf op;
  const auto tick = [&](bool contact, float hand_z, float proxy_z, float step_raw_N) {
    auto& s = op.view.haptic.emplace_back();
    s.in_contact = contact;
    s.p_WH = {0, 0, hand_z};
    s.p_WP = {0, 0, proxy_z};
    s.step_raw_N = step_raw_N;
  };
  tick(false, 0.01F, 0.01F, 0);
  tick(true, -0.001F, 0, 3);          // a contact begins: no jump
  tick(true, -0.002F, 0, 1.49F);      // the hand made 1 N of it
  tick(true, -0.002F, 0, 0.51F);      // a jump
  tick(true, -0.002F, -0.004F, 0);    // through it
  tick(true, -0.002F, -0.0041F, 0);   // counted once
  tick(true, -0.002F, -0.00201F, 0);  // less than 0.1 mm says nothing
  tick(false, -0.002F, -0.002F, 5);
  tick(true, -0.002F, -0.004F, 9);  // another contact, with a side of its own
  RunInfo info;
  Metrics without("demo");
  teletact::add_metrics(info, op, {}, without);
  for (const auto& row : without.rows()) EXPECT_NE(row.name, "haptic.method");
  info.touch_method = "nearest";
  info.touch_N_per_m = 1000;
  Metrics m("demo");
  teletact::add_metrics(info, op, {}, m);
  EXPECT_EQ(value(m, "haptic.jumps"), 1);
  EXPECT_EQ(value(m, "haptic.flips"), 1);
  for (const auto& row : m.rows()) {
    if (row.name == "haptic.method") {
      EXPECT_EQ(row.text, "nearest");
    }
  }
}

TEST(RunResults, AnEmptyRunHasFiguresAndNoNaN) {
  Metrics m("demo");
  teletact::add_metrics({}, {}, {}, m);
  for (const auto& row : m.rows()) {
    if (!row.is_text) {
      EXPECT_TRUE(std::isfinite(row.value)) << row.name;
    }
  }
}

TEST(RunResults, HalvesComeBackAndTornOnesAreIncomplete) {
  const auto folder =
      std::filesystem::temp_directory_path() / ("teletact_halves_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  OperatorHalf op = known_run();
  op.epoch_ns = 77;
  op.hangs = 3;
  op.complete = true;
  op.view.haptic.resize(10);
  op.view.haptic[3].force_N = 4.5F;
  RobotHalf robot;
  robot.view.truth.push_back({{}, 1, 2, 3, 4, 5});
  robot.view.tracking_error_max_m = 0.01;
  robot.complete = true;
  EXPECT_TRUE(teletact::save_half(folder.string(), op));
  EXPECT_TRUE(teletact::save_half(folder.string(), robot));
  OperatorHalf op2;
  RobotHalf robot2;
  teletact::load_half(folder.string(), op2);
  teletact::load_half(folder.string(), robot2);
  EXPECT_TRUE(op2.complete);
  EXPECT_EQ(op2.epoch_ns, 77);
  EXPECT_EQ(op2.hangs, 3U);
  ASSERT_EQ(op2.view.haptic.size(), 10U);
  EXPECT_EQ(op2.view.haptic[3].force_N, 4.5F);
  ASSERT_EQ(op2.totals.size(), 1U);
  EXPECT_EQ(op2.totals[0].totals.skipped, 5U);
  EXPECT_TRUE(robot2.complete);
  ASSERT_EQ(robot2.view.truth.size(), 1U);
  EXPECT_EQ(robot2.view.truth[0].path_m, 4);
  EXPECT_EQ(robot2.view.tracking_error_max_m, 0.01);

  // A file that may not grow, as on a full disk: the one that was saved before stays.
  ::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  const rlimit limit{300, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
  op.epoch_ns = 78;
  const bool saved = teletact::save_half(folder.string(), op);
  ::setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_FALSE(saved);
  teletact::load_half(folder.string(), op2);
  EXPECT_TRUE(op2.complete);
  EXPECT_EQ(op2.epoch_ns, 77);
  EXPECT_TRUE(teletact::save_half(folder.string(), op));
  teletact::load_half(folder.string(), op2);
  EXPECT_EQ(op2.epoch_ns, 78);

  const auto path = folder / "robot.view";
  std::ifstream in(path, std::ios::binary);
  const std::string all{std::istreambuf_iterator<char>(in), {}};
  for (std::size_t n = 0; n < all.size(); ++n) {
    std::ofstream(path, std::ios::binary) << all.substr(0, n);
    RobotHalf torn;
    torn.complete = true;
    teletact::load_half(folder.string(), torn);
    EXPECT_FALSE(torn.complete) << n;
  }
  std::filesystem::remove(path);
  RobotHalf absent;
  absent.complete = true;
  teletact::load_half(folder.string(), absent);
  EXPECT_FALSE(absent.complete);
  std::filesystem::remove_all(folder);
}

}  // namespace
