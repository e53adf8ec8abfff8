// What a program of the guest prints for the rig: one figure a line, `figure NAME VALUE UNIT`, or
// one judgement, `check NAME ok|FAILED DETAIL`. tests/vm/run reads both.
#pragma once

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

#include <cstdio>
#include <cstdlib>
#include <string>

namespace vm {

inline void figure(const std::string& name, double value, const char* unit) {
  std::printf("figure %s %.9g %s\n", name.c_str(), value, unit);
  std::fflush(stdout);
}

inline bool check(const std::string& name, bool ok, const std::string& detail) {
  std::printf("check %s %s %s\n", name.c_str(), ok ? "ok" : "FAILED", detail.c_str());
  std::fflush(stdout);
  return ok;
}

// Locked memory and SCHED_FIFO for the calling thread; the rig's guest refuses neither.
inline void become_real_time(int priority) {
  sched_param param{};
  param.sched_priority = priority;
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0 ||
      ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &param) != 0) {
    std::fprintf(stderr, "no right to SCHED_FIFO or to lock memory\n");
    std::exit(2);
  }
}

// The value behind --NAME; `otherwise` without it.
inline std::string option(int argc, char** argv, const std::string& name,
                          const std::string& otherwise) {
  for (int i = 1; i + 1 < argc; ++i) {
    if (argv[i] == "--" + name) return argv[i + 1];
  }
  return otherwise;
}

inline double option(int argc, char** argv, const std::string& name, double otherwise) {
  const std::string text = option(argc, argv, name, std::string());
  return text.empty() ? otherwise : std::atof(text.c_str());
}

}  // namespace vm
