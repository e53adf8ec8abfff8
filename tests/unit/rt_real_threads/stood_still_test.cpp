// A process that stood still as a whole (SIGSTOP, a paused or robbed virtual machine, a laptop that
// slept) while one of its jobs was at work.
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <ctime>

#include "tests/unit/rt_real_threads/rig.hpp"

namespace {

using namespace rig;

constexpr std::int64_t kStill = 1500 * kMs, kPatience = 20 * kSecond;

std::int64_t thread_cpu_ns() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec * kSecond + t.tv_nsec;
}

// Its third job computes for long enough to be stopped in the middle.
class Long final : public Body {
 public:
  explicit Long(std::atomic<int>& at_work) : at_work_(at_work) {}
  void work(const rt::Tick& tick) noexcept override {
    if (tick.k < 2 || took_ns != 0) return;
    const std::int64_t begin = rt::monotonic_ns(), cpu = thread_cpu_ns();
    at_work_ = 1;
    while (thread_cpu_ns() - cpu < 60 * kMs) {
    }
    took_ns = rt::monotonic_ns() - begin;
  }
  std::int64_t took_ns = 0;

 private:
  std::atomic<int>& at_work_;
};

// Another process that stops this one as soon as `at_work` says so.
pid_t stopper(const std::atomic<int>& at_work) {
  const pid_t us = ::getpid();
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  const std::int64_t end = rt::monotonic_ns() + kPatience;
  while (at_work == 0 && rt::monotonic_ns() < end) ::usleep(1000);
  if (at_work != 0) {
    ::kill(us, SIGSTOP);
    ::usleep(kStill / 1000);
    ::kill(us, SIGCONT);
  }
  ::_exit(0);
}

TEST(RealThreads, AJobOfAProcessThatStoodStillIsNotHung) {
  void* shared = ::mmap(nullptr, sizeof(std::atomic<int>), PROT_READ | PROT_WRITE,
                        MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(shared, MAP_FAILED);
  auto& at_work = *new (shared) std::atomic<int>(0);
  const pid_t other = stopper(at_work);
  ASSERT_GT(other, 0);
  Long body(at_work);
  Body quick;
  std::vector<rt::PlacedTask> tasks{spread("long", 10, body, 0), spread("quick", 100, quick, 1)};
  rt::RealOptions options = ordinary();
  options.hang_limit = rt::Nanos{kSecond};
  const Outcome o = run(tasks, 4 * kSecond, options);
  int status = 0;
  EXPECT_EQ(::waitpid(other, &status, 0), other);
  expect_balanced(o, tasks);
  EXPECT_GE(body.took_ns, kStill / 2) << "it was not stopped in the middle";
  EXPECT_EQ(o.hangs, 0U);
  EXPECT_EQ(body.safe, 0);
  ::munmap(shared, sizeof(std::atomic<int>));
}

}  // namespace
