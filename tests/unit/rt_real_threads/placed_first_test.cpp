// No thread of the executor works before it has its core and its priority. The call that gives the
// priority is replaced in this program by one that first waits, so that a thread which does not
// wait is always too early.
#include <dlfcn.h>

#include <array>
#include <atomic>

#include "tests/unit/rt_real_threads/rig.hpp"

namespace {

std::atomic<bool> slow_hand{false};
std::atomic<std::size_t> given{0};                       // threads that were asked a priority for
std::array<std::atomic<pthread_t>, 64> given_threads{};  // which

bool was_given(pthread_t thread) {
  for (std::size_t i = 0; i < given.load(); ++i) {
    if (given_threads[i].load() == thread) return true;
  }
  return false;
}

}  // namespace

// NOLINTNEXTLINE(readability-inconsistent-declaration-parameter-name)
extern "C" int pthread_setschedparam(pthread_t thread, int policy,
                                     const sched_param* param) noexcept {
  using Call = int (*)(pthread_t, int, const sched_param*);
  static const auto real = reinterpret_cast<Call>(::dlsym(RTLD_NEXT, "pthread_setschedparam"));
  if (!slow_hand.load()) return real(thread, policy, param);
  timespec pause{0, 10'000'000};
  ::nanosleep(&pause, nullptr);
  const int result = real(thread, policy, param);
  const std::size_t at = given.load();
  if (at < given_threads.size()) {
    given_threads[at].store(thread);
    given.store(at + 1);
  }
  return result;
}

namespace {

using namespace rig;

// The first job of each task notes whether its thread, and how many threads in all, had been given
// a priority.
class Notes final : public Body {
 public:
  void work(const rt::Tick&) noexcept override {
    if (jobs++ > 0) return;
    mine = was_given(::pthread_self());
    all = given.load();
  }
  int jobs = 0;
  bool mine = false;
  std::size_t all = 0;
};

TEST(RealExecutorStart, NoJobBeforeEveryThreadHasItsPriority) {
  Notes a, b, c;
  std::vector<rt::PlacedTask> tasks{spread("first", 1000, a, 0), spread("second", 100, b, 1),
                                    spread("third", 100, c, 2)};
  rt::RealOptions options = ordinary();
  options.fifo = true;  // a refusal changes nothing here
  options.sentinel = true;
  given = 0;
  slow_hand = true;
  // The rig's epoch is near: it has passed when the last thread is placed.
  run(tasks, 600 * kMs, options);
  slow_hand = false;
  ASSERT_GE(given.load(), 3U + 1U + 1U) << "three tasks, a sentinel at least, the watchdog";
  for (const Notes* n : {&a, &b, &c}) {
    ASSERT_GT(n->jobs, 0);
    EXPECT_TRUE(n->mine) << "a job ran on a thread that had no priority yet";
    EXPECT_EQ(n->all, given.load()) << "a job ran before the other threads were placed";
  }
}

}  // namespace
