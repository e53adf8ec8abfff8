// Three periodic threads on one processor; a job of the middle one takes 40 ms more than it said.
//
//   vm_deadline --class deadline|fifo
//
// Under SCHED_DEADLINE the kernel gives it no more than its runtime a period: only its own jobs are
// late. Under SCHED_FIFO, rate-monotonic, the thread below it is late too, so the load is one that
// tells the two apart.
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <thread>

#include "tests/vm/guest/burn.hpp"
#include "tests/vm/guest/say.hpp"

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr int kSchedDeadline = 6;  // sched(7)

// As sched_setattr(2) has it; the kernel's own header clashes with the C library's.
struct Attributes {
  std::uint32_t size, policy;
  std::uint64_t flags;
  std::int32_t nice;
  std::uint32_t priority;
  std::uint64_t runtime, deadline, period;
};

struct Periodic {
  const char* name;
  std::int64_t period, runtime, cost;
  int overruns_at;  // job; -1: none
  int late = 0, jobs = 0;
};

bool take_class(const Periodic& p, bool deadline, int priority) {
  if (!deadline) {
    vm::become_real_time(priority);
    return true;
  }
  Attributes attr{};
  attr.size = sizeof attr;
  attr.policy = kSchedDeadline;
  attr.runtime = static_cast<std::uint64_t>(p.runtime);
  attr.deadline = attr.period = static_cast<std::uint64_t>(p.period);
  return ::syscall(SYS_sched_setattr, 0, &attr, 0) == 0;
}

void sleep_until(std::int64_t ns) {
  timespec at{};
  at.tv_sec = ns / 1'000'000'000;
  at.tv_nsec = ns % 1'000'000'000;
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) != 0) {
  }
}

void work(Periodic& p, const vm::Burner& burner, std::int64_t epoch, std::int64_t end) {
  std::int64_t release = epoch;
  for (int job = 0; release < end; ++job) {
    sleep_until(release);
    const bool overrun = job == p.overruns_at;
    burner.burn(rt::Nanos{p.cost + (overrun ? 40 * kMs : 0)});
    const std::int64_t now = rt::monotonic_ns();
    ++p.jobs;
    if (now > release + p.period) ++p.late;
    // What has arrived meanwhile is dropped.
    release += p.period;
    while (release < now) release += p.period;
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool deadline = vm::option(argc, argv, "class", std::string("deadline")) == "deadline";
  const vm::Burner burner;
  std::array<Periodic, 3> threads{{{"fast", 10 * kMs, 2 * kMs, kMs, -1},
                                   {"middle", 20 * kMs, 5 * kMs, 4 * kMs, 5},
                                   {"slow", 50 * kMs, 10 * kMs, 8 * kMs, -1}}};
  const std::int64_t epoch = rt::monotonic_ns() + 300 * kMs;
  std::array<std::thread, 3> running;
  std::array<bool, 3> granted{};
  for (std::size_t i = 0; i < threads.size(); ++i) {
    running[i] = std::thread([&, i] {
      granted[i] = take_class(threads[i], deadline, 60 - static_cast<int>(i));
      work(threads[i], burner, epoch, epoch + 1000 * kMs);
    });
  }
  for (auto& t : running) t.join();
  const std::string prefix = deadline ? "SCHED_DEADLINE: " : "SCHED_FIFO: ";
  for (std::size_t i = 0; i < threads.size(); ++i) {
    const Periodic& p = threads[i];
    vm::check(prefix + p.name + " has its class", granted[i], "");
    const std::string said = std::to_string(p.late) + " of " + std::to_string(p.jobs) + " late";
    const bool late = p.overruns_at >= 0 || (!deadline && i == 2);
    vm::check(prefix + p.name + (late ? " is late" : " is never late"), late == (p.late > 0), said);
  }
  return 0;
}
