// The fork-join pool itself: each part once, on the member that the rule names, results visible
// after the join, nobody awake between forks.
#include <gtest/gtest.h>

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <thread>
#include <vector>

#include "rt/random.hpp"
#include "rt/sched/worker_pool.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

// A pool with its threads.
class Crew {
 public:
  explicit Crew(int workers) : pool(startup_.token(), workers) { start(); }
  ~Crew() {
    if (!threads_.empty()) stop();
  }
  void start() {
    pool.restart();
    for (int w = 0; w + 1 < pool.width(); ++w) threads_.emplace_back([this, w] { pool.serve(w); });
  }
  void stop() {
    pool.stop();
    for (auto& t : threads_) t.join();
    threads_.clear();
  }

 private:
  rt::Startup startup_;

 public:
  rt::WorkerPool pool;

 private:
  std::vector<std::thread> threads_;
};

std::int64_t process_cpu_ns() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return t.tv_sec * 1'000'000'000LL + t.tv_nsec;
}

TEST(WorkerPool, EachPartOnceOnItsMember) {
  for (int workers = 0; workers <= 4; ++workers) {
    Crew crew(workers);
    for (int parts = 0; parts <= 12; ++parts) {
      std::vector<int> times(static_cast<std::size_t>(parts), 0);
      std::vector<std::thread::id> who(static_cast<std::size_t>(parts));
      crew.pool.for_parts(parts, [&](int p) {
        ++times[static_cast<std::size_t>(p)];
        who[static_cast<std::size_t>(p)] = std::this_thread::get_id();
      });
      for (int p = 0; p < parts; ++p) {
        const auto i = static_cast<std::size_t>(p);
        EXPECT_EQ(times[i], 1) << workers << " workers, part " << p << " of " << parts;
        EXPECT_EQ(who[i], who[static_cast<std::size_t>(p % crew.pool.width())]);
        if (p % crew.pool.width() == 0) {
          EXPECT_EQ(who[i], std::this_thread::get_id());
        }
      }
    }
  }
}

// What a fork writes is read by the next one, on other members: only the joins order them.
TEST(WorkerPool, AChainOfForksOverPlainMemory) {
  rt::Random random(5);
  for (const int workers : {1, 2, 3}) {
    Crew crew(workers);
    std::vector<std::uint64_t> a(97, 1), b(97, 0), oracle(97, 1), next(97, 0);
    for (int n = 0; n < 4000; ++n) {
      const auto shift = static_cast<std::size_t>(1 + random() % 96);
      const int parts = 1 + static_cast<int>(random() % 9);
      crew.pool.for_parts(parts, [&](int p) {
        for (auto i = static_cast<std::size_t>(p); i < a.size();
             i += static_cast<std::size_t>(parts))
          b[i] = a[i] * 3 + a[(i + shift) % a.size()];
      });
      a.swap(b);
      for (std::size_t i = 0; i < oracle.size(); ++i)
        next[i] = oracle[i] * 3 + oracle[(i + shift) % oracle.size()];
      oracle.swap(next);
    }
    EXPECT_EQ(a, oracle) << workers << " workers";
    EXPECT_LE(crew.pool.forks(), 4000U);
    EXPECT_GT(crew.pool.forks(), 3000U);
  }
}

TEST(WorkerPool, SharesOfAJobAndOnlyOfIt) {
  Crew crew(2);
  const auto burn = [](int) {
    const std::int64_t until = rt::thread_cpu_ns() + 300'000;
    while (rt::thread_cpu_ns() < until) {
    }
  };
  crew.pool.begin_job();
  EXPECT_EQ(crew.pool.share(0).parts, 0U);
  EXPECT_EQ(crew.pool.share(0).cpu_ns, 0);
  const std::int64_t before = rt::monotonic_ns();
  crew.pool.for_parts(5, burn);  // members 0 1 2 0 1
  crew.pool.for_parts(2, burn);  // members 0 1
  const std::int64_t after = rt::monotonic_ns();
  EXPECT_EQ(crew.pool.share(0).parts, 3U);
  EXPECT_EQ(crew.pool.share(1).parts, 1U);
  EXPECT_GE(crew.pool.share(0).cpu_ns, 3 * 300'000);
  EXPECT_GE(crew.pool.share(1).cpu_ns, 300'000);
  for (int w = 0; w < 2; ++w) {
    const auto& s = crew.pool.share(w);
    EXPECT_LE(before, s.fork_ns);
    EXPECT_LE(s.fork_ns, s.start_ns);
    EXPECT_LT(s.start_ns, s.end_ns);
    EXPECT_LE(s.end_ns, after);
    EXPECT_LE(s.start_ns - s.fork_ns, s.longest_wait_ns);
  }
  crew.pool.begin_job();
  crew.pool.for_parts(1, burn);  // no fork
  EXPECT_EQ(crew.pool.share(0).parts, 0U);
  EXPECT_EQ(crew.pool.share(1).fork_ns, 0);
}

// The way through: the caller's CPU plus beyond_ns().
TEST(WorkerPool, BeyondIsWhatTheLongestTookLonger) {
  Crew crew(2);
  crew.pool.profile(true);
  const auto burn = [](std::int64_t ns) {
    const std::int64_t until = rt::thread_cpu_ns() + ns;
    while (rt::thread_cpu_ns() < until) {
    }
  };
  const auto beyond = [&](int longest, std::int64_t long_ns, std::int64_t short_ns) {
    const std::int64_t before = crew.pool.beyond_ns();
    crew.pool.for_parts(3, [&](int p) { burn(p == longest ? long_ns : short_ns); });
    return crew.pool.beyond_ns() - before;
  };
  // An interrupt is counted to whom it meets: one fork of five has to be undisturbed.
  std::int64_t of_caller = std::numeric_limits<std::int64_t>::max(), of_worker = 0;
  for (int n = 0; n < 5; ++n) {
    of_caller = std::min(of_caller, beyond(0, 2'000'000, 100'000));
    of_worker = std::max(of_worker, beyond(2, 3'000'000, 500'000));
  }
  EXPECT_LT(of_caller, 1'000'000);  // the caller was the longest
  EXPECT_GE(of_worker, 2'400'000);
}

TEST(WorkerPool, NobodySpinsBetweenForks) {
  Crew crew(3);
  crew.pool.for_parts(4, [](int) {});
  const std::int64_t before = process_cpu_ns();
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  const std::int64_t spent = process_cpu_ns() - before;
  std::printf("  CPU of 3 idle workers in 200 ms: %.3f ms\n", 1e-6 * static_cast<double>(spent));
  EXPECT_LT(spent, 10'000'000);
  // Nor while the caller is busy, or waits for a worker.
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  const long sleeps = usage.ru_nvcsw;
  const std::int64_t cpu = rt::thread_cpu_ns();
  crew.pool.for_parts(2, [](int p) {
    if (p == 1) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  });
  getrusage(RUSAGE_THREAD, &usage);
  EXPECT_GE(usage.ru_nvcsw - sleeps, 1);
  EXPECT_LT(rt::thread_cpu_ns() - cpu, 5'000'000);
}

TEST(WorkerPool, StopsAndStartsAgain) {
  Crew crew(2);
  for (int n = 0; n < 20; ++n) {
    std::array<int, 3> hits{};
    crew.pool.for_parts(3, [&](int p) { ++hits[static_cast<std::size_t>(p)]; });
    EXPECT_EQ(hits, (std::array<int, 3>{1, 1, 1}));
    crew.stop();
    crew.start();
  }
}

// The guard sees the parts of the workers too: each runs in a section of its own thread.
TEST(WorkerPool, NothingIsAllocatedOrLocked) {
  Crew crew(2);
  std::array<int, 3> in_section{};
  rt_guard::reset();
  {
    const rt::Section section;
    for (int n = 0; n < 50; ++n)
      crew.pool.for_parts(3, [&](int p) {
        in_section[static_cast<std::size_t>(p)] += rt::Section::active() ? 1 : 0;
      });
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
  EXPECT_EQ(in_section, (std::array<int, 3>{50, 50, 50}));
  if (!rt_guard::linked()) GTEST_SKIP() << "no guard in this build: nothing would be counted";
  crew.pool.for_parts(3, [](int p) {
    if (p != 2) return;
    void* volatile block = std::malloc(16);
    std::free(block);
  });
  EXPECT_GT(rt_guard::counts().allocations, 0U) << "the guard looks into workers";
}

TEST(InlineForkJoin, InOrderAndMeasured) {
  rt::InlineForkJoin plain(2, false), measured(2, true);
  std::vector<int> order;
  plain.for_parts(5, [&](int p) { order.push_back(p); });
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3, 4}));
  const auto burn = [](int p) {
    const std::int64_t until = rt::thread_cpu_ns() + 100'000 * (p + 1);
    while (rt::thread_cpu_ns() < until) {
    }
  };
  measured.begin_job();
  measured.for_parts(3, burn);  // worker 0: 0.2 ms, worker 1: 0.3 ms
  measured.for_parts(2, burn);  // worker 0: 0.2 ms
  EXPECT_EQ(measured.forks(), 2);
  EXPECT_GE(measured.cpu_ns(0), 400'000);
  EXPECT_GE(measured.cpu_ns(1), 300'000);
  EXPECT_GE(measured.largest_shares_ns(), 500'000);
  EXPECT_LE(measured.largest_shares_ns(), measured.cpu_ns(0) + measured.cpu_ns(1));
  measured.begin_job();
  EXPECT_EQ(measured.forks(), 0);
  EXPECT_EQ(measured.largest_shares_ns(), 0);
}

}  // namespace
