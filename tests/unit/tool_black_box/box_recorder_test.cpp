// What a stop of the demo leaves, on the virtual clock, and a box recorder by itself. The real
// clock's: tests/fault/life_cycle.
#include "tools/record/box_recorder.hpp"
#include "tests/support/paths.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>

namespace {

namespace fs = std::filesystem;
using teletact::BoxRecorder;
using testing::AnyOf;
using testing::Contains;
using testing::HasSubstr;

struct Folder {
  std::string path =
      (fs::temp_directory_path() / ("teletact_bb_" + std::to_string(::getpid()) + "_" +
                                    testing::UnitTest::GetInstance()->current_test_info()->name()))
          .string();
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
};

std::pair<int, std::string> run(const std::string& words) {
  std::FILE* pipe = ::popen((tests::in_build("teletact") + " " + words + " 2>&1").c_str(), "r");
  std::string text;
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
  const int status = ::pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

rt::RunLog header() {
  rt::RunLog log;
  rt::TaskLog t;
  t.spec.name = "haptic";
  t.spec.rate = {1000, 1};
  t.spec.budget = rt::Nanos{100000};
  log.tasks = {t};
  return log;
}

void fill(BoxRecorder& box, std::uint64_t from, std::uint64_t to) {
  for (std::uint64_t k = from; k < to; ++k) {
    rt::JobRecord r;
    r.k = k;
    r.release_ns = static_cast<std::int64_t>(k) * 1000000;
    r.start_ns = r.release_ns + 1000;
    r.end_ns = r.start_ns + 1000;
    r.deadline_ns = r.release_ns + 1000000;
    if (k >= 2500) r.severity = rt::Severity::kDegraded, r.fault = 102;
    box.add(r);
    teletact::JobOp op;
    op.k = k;
    box.add(op);
  }
}

TEST(BlackBoxOfARun, ACutLinkLeavesTheSecondsRoundTheStop) {
  const Folder f;
  const std::string demo = "demo --clock virtual --quiet --black-box 2 --report " + f.path;
  const auto [code, text] = run(demo + " --seconds 4 --cut-link 2.5");
  ASSERT_NE(code, 2) << text;
  const std::string file = f.path + "/raw/operator.stop1.blackbox";
  ASSERT_TRUE(fs::exists(file)) << text;
  EXPECT_THAT(text, HasSubstr("black box " + file));
  EXPECT_FALSE(fs::exists(f.path + "/raw/operator.blackbox")) << "the run reached its end";
  const auto b = rt::read_black_box(file);
  ASSERT_TRUE(b.has_value()) << b.error();
  EXPECT_THAT(b.value().stop, HasSubstr("F-SUP-02"));
  EXPECT_EQ(b.value().missing, 0U);
  // Two seconds and no less, up to half a second after the stop; not the whole run.
  const double s = teletact::seconds_of(b.value());
  EXPECT_GE(s, 2.0);
  EXPECT_LE(s, 3.9);
  const rt::TaskLog& haptic = b.value().log.tasks.at(0);
  ASSERT_EQ(haptic.spec.name, "haptic");
  EXPECT_GE(haptic.jobs.size(), 2000U);
  EXPECT_GT(haptic.jobs.back().k, 2900U);
  EXPECT_LT(haptic.jobs.back().k, 3600U);
  const auto events = teletact::events_of(b.value());
  EXPECT_THAT(events, Contains(HasSubstr("supervision: mode")));
  // The program says the same.
  const auto [audited, printed] = run("audit " + file);
  EXPECT_THAT(audited, AnyOf(0, 1)) << printed;
  EXPECT_THAT(printed, HasSubstr("F-SUP-02"));
  EXPECT_THAT(printed, HasSubstr("haptic"));
  // A normal end leaves none, and those of the run before are gone.
  const auto [good, quiet] = run(demo + " --seconds 1");
  EXPECT_EQ(good, 0) << quiet;
  EXPECT_TRUE(teletact::black_boxes_in(f.path + "/raw").empty());
  const auto [bad, refused] = run("audit " + f.path + "/nothing.blackbox");
  EXPECT_EQ(bad, 2) << refused;
}

TEST(BlackBoxOfARun, StopsAreCopiedEndsAreKept) {
  const Folder f;
  tasks::ModeMsg mode;
  mode.mode = tasks::Mode::kEngaged;
  {
    BoxRecorder box(f.path, rt::Box::kRobot, header(), 1);
    fill(box, 0, 3000);
    box.line("2.9 haptic: contact begins");
    box.watch(mode, rt::Time{std::chrono::seconds{3}});
    mode.mode = tasks::Mode::kSafeStop;
    mode.cause = 506;
    box.watch(mode, rt::Time{std::chrono::seconds{3}});
    EXPECT_TRUE(teletact::black_boxes_in(f.path).size() == 1U) << "the ring alone: not due yet";
    fill(box, 3000, 3600);
    box.watch(mode, rt::Time{std::chrono::milliseconds{3600}});
    box.watch(mode, rt::Time{std::chrono::milliseconds{5000}});
    box.end("asked to end");
  }
  const auto all = teletact::black_boxes_in(f.path);
  ASSERT_EQ(all.size(), 2U) << "one stop, one end";
  EXPECT_THAT(all[0], AllOf(HasSubstr("robot.blackbox"), HasSubstr("asked to end")));
  EXPECT_THAT(all[1], AllOf(HasSubstr("robot.stop1.blackbox"), HasSubstr("safe stop: F-RIO-06")));
  const auto b = rt::read_black_box(f.path + "/robot.stop1.blackbox").value();
  EXPECT_EQ(b.log.tasks[0].jobs.back().k, 3599U) << "half a second after it";
  const auto events = teletact::events_of(b);
  ASSERT_EQ(events.size(), 2U);
  EXPECT_THAT(events[0], HasSubstr("health degrade, F-HAP-02"));
  EXPECT_THAT(events[1], HasSubstr("contact begins"));
  teletact::remove_black_boxes(f.path);
  EXPECT_TRUE(teletact::black_boxes_in(f.path).empty());
}

TEST(BlackBoxOfARun, EndlessStopsLeaveABoundedNumber) {
  const Folder f;
  BoxRecorder box(f.path, rt::Box::kRobot, header(), 0.5);
  tasks::ModeMsg mode;
  rt::Time now{};
  for (int i = 0; i < 40; ++i) {
    mode.mode = tasks::Mode::kRampDown;
    box.watch(mode, now += std::chrono::seconds{1});
    mode.mode = tasks::Mode::kHold;
    box.watch(mode, now += std::chrono::seconds{1});
  }
  box.end("");
  EXPECT_EQ(teletact::black_boxes_in(f.path).size(), BoxRecorder::kMaxStops);
  EXPECT_TRUE(fs::exists(f.path + "/robot.stop40.blackbox")) << "the newest is there";
  EXPECT_FALSE(fs::exists(f.path + "/robot.stop1.blackbox"));
}

// A ramp down is an everyday thing, a safe stop is not: a hundred of the one take no place of the
// other. A safe stop that follows a ramp down at once is in its copy.
TEST(BlackBoxOfARun, SafeStopsOutliveRampDowns) {
  const Folder f;
  BoxRecorder box(f.path, rt::Box::kRobot, header(), 0.5);
  tasks::ModeMsg mode;
  rt::Time now{};
  const auto stop = [&](tasks::Mode first, tasks::Mode then) {
    mode.mode = first;
    box.watch(mode, now += std::chrono::seconds{1});
    mode.mode = then;
    box.watch(mode, now += std::chrono::milliseconds{20});
    mode.mode = tasks::Mode::kHold;
    box.watch(mode, now += std::chrono::seconds{1});
  };
  stop(tasks::Mode::kSafeStop, tasks::Mode::kSafeStop);
  stop(tasks::Mode::kRampDown, tasks::Mode::kSafeStop);
  for (int i = 0; i < 20; ++i) stop(tasks::Mode::kRampDown, tasks::Mode::kRampDown);
  box.end("");
  const auto all = teletact::black_boxes_in(f.path);
  EXPECT_EQ(all.size(), BoxRecorder::kMaxStops);
  EXPECT_THAT(all, Contains(AllOf(HasSubstr("robot.stop1.blackbox"), HasSubstr("safe stop: "))));
  EXPECT_THAT(all, Contains(AllOf(HasSubstr("robot.stop2.blackbox"), HasSubstr("ramp down: "),
                                  HasSubstr("; then safe stop: "))));
  EXPECT_THAT(all, Contains(HasSubstr("robot.stop22.blackbox")));
  EXPECT_FALSE(fs::exists(f.path + "/robot.stop3.blackbox"));
}

// Each way to crash leaves its number; the process still dies of it.
TEST(BlackBoxOfARun, ACrashSaysItsSignal) {
  for (const int number : {SIGSEGV, SIGABRT, SIGFPE}) {
    const Folder f;
    const pid_t child = ::fork();
    if (child == 0) {
      BoxRecorder box(f.path, rt::Box::kOperator, header(), 1);
      box.catch_crashes();
      fill(box, 0, 2000);
      if (number == SIGABRT) std::abort();
      ::raise(number);
      ::_exit(0);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    EXPECT_EQ(WTERMSIG(status), number);
    const auto b = rt::read_black_box(f.path + "/operator.blackbox").value();
    char text[32];
    std::snprintf(text, sizeof text, "crash, signal %02d", number);
    EXPECT_EQ(b.stop, text);
    EXPECT_EQ(b.missing, 0U);
    EXPECT_GE(b.log.tasks[0].jobs.size(), 1000U);
  }
}

}  // namespace
