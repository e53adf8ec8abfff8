#include "tools/measure/bench/other_load.hpp"

#include <algorithm>
#include <ctime>
#include <fstream>
#include <string>

#include <sys/resource.h>
#include <unistd.h>

namespace teletact {

namespace {

double clock_s(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double seconds(const timeval& t) {
  return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
}

double ended_children_s() {
  rusage use{};
  if (getrusage(RUSAGE_CHILDREN, &use) != 0) return 0;
  return seconds(use.ru_utime) + seconds(use.ru_stime);
}

}  // namespace

void OtherLoad::restart() { begin_ = now(); }

OtherLoad::Sample OtherLoad::now() {
  Sample s;
  std::ifstream in("/proc/stat");
  std::string cpu;
  // user, nice, system, idle, iowait, irq, softirq, steal: ticks since boot, all cores
  double ticks[8] = {};
  in >> cpu;
  for (double& t : ticks) in >> t;
  if (in && cpu == "cpu") {
    const double busy = ticks[0] + ticks[1] + ticks[2] + ticks[5] + ticks[6] + ticks[7];
    s.busy_s = busy / static_cast<double>(sysconf(_SC_CLK_TCK));
  }
  s.own_s = clock_s(CLOCK_PROCESS_CPUTIME_ID) + ended_children_s();
  s.wall_s = clock_s(CLOCK_MONOTONIC);
  return s;
}

double OtherLoad::cores() const {
  const Sample end = now();
  const double wall = end.wall_s - begin_.wall_s;
  if (!(wall > 0) || begin_.busy_s <= 0) return 0;
  return std::max(0.0, (end.busy_s - begin_.busy_s - (end.own_s - begin_.own_s)) / wall);
}

}  // namespace teletact
