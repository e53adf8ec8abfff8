// How much of the machine was used by programs that this one did not start. A browser's processes
// come and go below each other, and what they used is lost with some of them; so what is counted
// here is everybody else, process by process, once a second.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <thread>

namespace teletact {

class ForeignLoad {
 public:
  ForeignLoad();
  ~ForeignLoad();
  ForeignLoad(const ForeignLoad&) = delete;
  ForeignLoad& operator=(const ForeignLoad&) = delete;
  // Cores' worth of work by others so far; kernel threads are no others.
  [[nodiscard]] double cores();

 private:
  struct Seen {
    std::uint64_t born = 0;   // ticks since boot: a pid may come again
    std::uint64_t ticks = 0;  // of CPU
  };
  void look();
  std::mutex mutex_;
  std::map<pid_t, Seen> others_;
  std::uint64_t ticks_ = 0;
  std::chrono::steady_clock::time_point since_;
  std::jthread thread_;
};

// A line of /proc/PID/stat.
struct ProcessStat {
  pid_t pid = 0, parent = 0;
  std::uint64_t ticks = 0, born = 0;
};
[[nodiscard]] bool read_process_stat(const std::string& line, ProcessStat& out);

// Of `all`, those that are neither `self` nor below it, nor the kernel's.
[[nodiscard]] std::map<pid_t, ProcessStat> foreign(const std::map<pid_t, ProcessStat>& all,
                                                   pid_t self);

}  // namespace teletact
