// A run on the real clock that goes on for half an hour: the memory of both boxes is flat after the
// first minute (2 %), their job records stay below their cap. The report of it is made by the run
// itself. TELETACT_MINUTES: another length, at least two.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <vector>

#include "demo_process.hpp"
#include "rt/store/run_store.hpp"

namespace {

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

TEST(HalfHour, MemoryIsFlatAndTheDiskBelowItsCap) {
  const double length_s = 60 * minutes();
  life_cycle::DemoProcess demo("half-hour", length_s);
  while (demo.boxes().second == 0 && !demo.ended()) ::usleep(100000);
  if (demo.no_room()) GTEST_SKIP() << "the cores are taken";
  ASSERT_FALSE(demo.ended()) << demo.output();
  const auto [op, robot] = demo.boxes();
  // Each 10 s; the first value that counts is that after a minute.
  std::vector<double> of_op, of_robot;
  std::uint64_t most_bytes = 0;
  while (!demo.ended()) {
    const double a = resident_MiB(op), b = resident_MiB(robot);
    if (a > 0) of_op.push_back(a);
    if (b > 0) of_robot.push_back(b);
    most_bytes = std::max({most_bytes, rt::store_bytes(demo.raw() + "/operator.run"),
                           rt::store_bytes(demo.raw() + "/robot.run")});
    for (int i = 0; i < 100 && !demo.ended(); ++i) ::usleep(100000);
  }
  ASSERT_GT(of_op.size(), 9U) << demo.output();
  for (const auto* box : {&of_op, &of_robot}) {
    // The last one may be of a box that is writing its report.
    const double first = (*box)[6], last = (*box)[box->size() - 2];
    std::printf("%s: %.1f MiB after a minute, %.1f at the end\n",
                box == &of_op ? "operator" : "robot", first, last);
    EXPECT_LE(last, 1.02 * first);
  }
  std::printf("job records of a box: %.1f MiB at most\n",
              1e-6 * static_cast<double>(most_bytes) / 1.048576);
  EXPECT_LE(most_bytes, rt::StoreOptions{}.cap_bytes);
}

}  // namespace
