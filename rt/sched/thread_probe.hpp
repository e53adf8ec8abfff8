// What the kernel counts for the calling thread, read around each job for its record.
#pragma once

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdint>

namespace rt {

// Deltas of these go into the job's record.
struct ThreadCounters {
  std::int64_t run_delay_ns = 0;
  long minor_faults = 0;
  long major_faults = 0;  // pages that came from disk
  long involuntary = 0;
  long voluntary = 0;
};

// /proc/thread-self/schedstat, held open: the second number is the time spent runnable but waiting.
class SchedStat {
 public:
  void open_here() noexcept { fd_ = ::open("/proc/thread-self/schedstat", O_RDONLY | O_CLOEXEC); }
  ~SchedStat() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] std::int64_t run_delay_ns() const noexcept {
    char text[96];
    const ssize_t n = fd_ < 0 ? -1 : ::pread(fd_, text, sizeof text - 1, 0);
    if (n <= 0) return 0;
    text[n] = '\0';
    const char* p = text;
    while (*p != ' ' && *p != '\0') ++p;
    std::int64_t value = 0;
    for (++p; *p >= '0' && *p <= '9'; ++p) value = value * 10 + (*p - '0');
    return value;
  }

 private:
  int fd_ = -1;
};

[[nodiscard]] inline ThreadCounters counters(const SchedStat& stat) noexcept {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return {stat.run_delay_ns(), usage.ru_minflt, usage.ru_majflt, usage.ru_nivcsw, usage.ru_nvcsw};
}

}  // namespace rt
