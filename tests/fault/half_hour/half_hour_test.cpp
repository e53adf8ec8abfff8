// Runs on the real clock that go on for half an hour, of the demo, and of the two boxes that know
// each other by TLS alone: the memory of both boxes is flat after the first minute (2 %), their job
// records stay below their cap, and the report of each is made and can be made again in 30 s of one
// core. TELETACT_MINUTES: another length, at least two.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cstdio>
#include <cstdlib>
#include <vector>

#include "demo_process.hpp"
#include "rt/store/run_store.hpp"
#include "tests/fault/two_boxes/boxes.hpp"
#include "tests/support/paths.hpp"

namespace {

namespace fs = std::filesystem;

double minutes() {
  const char* asked = std::getenv("TELETACT_MINUTES");
  return asked != nullptr ? std::max(2.0, std::atof(asked)) : 30;
}

// 0: it does not run any more.
double resident_MiB(pid_t pid) {
  std::ifstream statm("/proc/" + std::to_string(pid) + "/statm");
  double size = 0, resident = 0;
  statm >> size >> resident;
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / (1 << 20);
}

double seconds(const timeval& t) {
  return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
}

// Makes the report again from what the run left. CPU time, for others may have the cores.
void make_report_again(const fs::path& raw) {
  const fs::path out = raw.parent_path().string() + "-again";
  rusage before{}, after{};
  ::getrusage(RUSAGE_CHILDREN, &before);
  const std::string command = tests::in_build("teletact") + " report " + raw.string() +
                              " --report " + out.string() + " > " + out.string() + ".txt 2>&1";
  EXPECT_EQ(std::system(command.c_str()), 0) << std::ifstream(out.string() + ".txt").rdbuf();
  ::getrusage(RUSAGE_CHILDREN, &after);
  const double cpu_s = seconds(after.ru_utime) + seconds(after.ru_stime) -
                       seconds(before.ru_utime) - seconds(before.ru_stime);
  std::printf("%s: its report again in %.1f s of CPU time\n", raw.c_str(), cpu_s);
  EXPECT_TRUE(fs::exists(out / "report.html"));
  EXPECT_LE(cpu_s, 30);
}

// One box, looked at each 10 s.
struct Watched {
  const char* name;
  pid_t pid;
  fs::path raw;
  std::vector<double> resident{};
  std::uint64_t most_bytes = 0;

  void look() {
    if (const double now = resident_MiB(pid); now > 0) resident.push_back(now);
    most_bytes = std::max(most_bytes, rt::store_bytes((raw / name).string() + ".run"));
  }
  // The first value that counts is that after a minute; the last one may be of a box that is
  // writing its report.
  void judge() const {
    ASSERT_GT(resident.size(), 9U) << name;
    const double first = resident[6], last = resident[resident.size() - 2];
    std::printf("%s: %.1f MiB after a minute, %.1f at the end; job records %.1f MiB at most\n",
                name, first, last, static_cast<double>(most_bytes) / (1 << 20));
    EXPECT_LE(last, 1.02 * first) << name;
    EXPECT_GT(most_bytes, 0U) << name;
    EXPECT_LE(most_bytes, rt::StoreOptions{}.cap_bytes) << name;
  }
};

TEST(HalfHour, MemoryIsFlatAndTheDiskBelowItsCap) {
  const double length_s = 60 * minutes();
  life_cycle::DemoProcess demo("half-hour", length_s);
  while (demo.boxes().second == 0 && !demo.ended()) ::usleep(100000);
  if (demo.no_room()) GTEST_SKIP() << "the cores are taken";
  ASSERT_FALSE(demo.ended()) << demo.output();
  Watched op{"operator", demo.boxes().first, demo.raw()},
      robot{"robot", demo.boxes().second, demo.raw()};
  while (!demo.ended()) {
    op.look();
    robot.look();
    for (int i = 0; i < 100 && !demo.ended(); ++i) ::usleep(100000);
  }
  ASSERT_GT(op.resident.size(), 9U) << demo.output();
  op.judge();
  robot.judge();
  EXPECT_TRUE(demo.report_written()) << demo.output();
  make_report_again(demo.raw());
}

TEST(HalfHour, TwoBoxesOverTlsStayFlatBelowTheirCapsAndConnected) {
  two_boxes::Boxes b("half-hour", false);
  b.use_keys();
  b.robot.start();
  b.op.start();
  const bool engaged = b.until([](const two_boxes::Json& r, const two_boxes::Json& o) {
    return two_boxes::engaged(r) && two_boxes::engaged(o);
  });
  if (b.ending == two_boxes::Ending::kNoRoom) GTEST_SKIP() << "the cores are taken";
  if (!engaged && !HasFailure()) std::printf("the machine disturbed the tasks at the start\n");
  Watched op{"operator", b.op.pid(), b.op.report().parent_path() / "raw"},
      robot{"robot", b.robot.pid(), b.robot.report().parent_path() / "raw"};
  const int looks = static_cast<int>(6 * minutes());
  for (int i = 0; i < looks && !b.op.ended() && !b.robot.ended(); ++i) {
    op.look();
    robot.look();
    ::sleep(10);
  }
  ASSERT_FALSE(b.op.ended() || b.robot.ended()) << b.said();
  const auto status = b.robot.status();
  EXPECT_TRUE(two_boxes::connected(status)) << status;
  EXPECT_EQ(status.value("connections", 0), 1) << "one session all the time\n" << b.said();
  for (two_boxes::BoxProgram* box : {&b.op, &b.robot}) {
    const int code = box->stop();
    EXPECT_TRUE(code == 0 || code == 1) << code << ", 1: late on this machine\n" << box->output();
    EXPECT_TRUE(fs::exists(box->report())) << box->output();
    make_report_again(box->report().parent_path() / "raw");
  }
  op.judge();
  robot.judge();
}

}  // namespace
