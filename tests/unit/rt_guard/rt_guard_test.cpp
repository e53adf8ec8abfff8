// The guard guards: what is done inside a section is counted, what is done outside is not.
#include "tools/measure/support/rt_guard.hpp"

#include <gtest/gtest.h>
#include <pthread.h>

#include <condition_variable>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "rt/memory/section.hpp"

namespace {

class RtGuard : public testing::Test {
 protected:
  void SetUp() override {
    if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in this build";
    rt_guard::reset();
  }
};

template <class F>
rt_guard::Counts counted(F&& work) {
  rt_guard::reset();
  {
    rt::Section s;
    work();
  }
  return rt_guard::counts();
}

// Keeps the compiler from removing a pair of new and delete.
template <class T>
void use(T* p) {
  asm volatile("" : : "g"(p) : "memory");
}

void lock_once(std::mutex& m) { std::lock_guard<std::mutex> hold(m); }

TEST_F(RtGuard, CountsEachKindOfAllocation) {
  const auto c_malloc = counted([] {
    void* p = std::malloc(24);
    use(p);
    std::free(p);
  });
  EXPECT_EQ(c_malloc.allocations, 1u);
  EXPECT_EQ(c_malloc.frees, 1u);
  EXPECT_EQ(c_malloc.total(), 2u);

  EXPECT_EQ(counted([] {
              void* p = std::calloc(3, 8);
              use(p);
              p = std::realloc(p, 4096);
              use(p);
              std::free(p);
            }).allocations,
            2u);
  EXPECT_EQ(counted([] {
              int* p = new int(3);
              use(p);
              delete p;
            }).allocations,
            1u);
  EXPECT_EQ(counted([] {
              struct alignas(128) Wide {
                char c[128];
              };
              Wide* p = new Wide;
              use(p);
              delete p;
            }).allocations,
            1u);
  EXPECT_EQ(counted([] {
              void* p = nullptr;
              ASSERT_EQ(posix_memalign(&p, 64, 640), 0);
              EXPECT_EQ(reinterpret_cast<std::uintptr_t>(p) % 64, 0u);
              std::free(p);
            }).allocations,
            1u);
  EXPECT_GE(counted([] {
              std::vector<int> v(1000);
              use(v.data());
            }).allocations,
            1u);
  EXPECT_GE(counted([] {
              std::string s(100, 'x');  // inside libstdc++.so
              s += std::string(1000, 'y');
              use(s.data());
            }).allocations,
            2u);
}

TEST_F(RtGuard, FreeOfNullIsNotAnOffence) {
  EXPECT_EQ(counted([] {
              std::free(nullptr);
              delete static_cast<int*>(nullptr);
            }).total(),
            0u);
}

TEST_F(RtGuard, CountsLocksAndWaits) {
  std::mutex m;
  EXPECT_EQ(counted([&] { lock_once(m); }).locks, 1u);
  std::shared_mutex rw;
  EXPECT_EQ(counted([&] {
              rw.lock_shared();
              rw.unlock_shared();
              rw.lock();
              rw.unlock();
            }).locks,
            2u);
  std::condition_variable cv;
  std::unique_lock<std::mutex> hold(m);
  EXPECT_EQ(counted([&] { cv.wait_for(hold, std::chrono::microseconds(10)); }).waits, 1u);
}

TEST_F(RtGuard, AConditionVariableStillWorks) {
  // The wrong symbol version of pthread_cond_wait would hang or corrupt here.
  std::mutex m;
  std::condition_variable cv;
  int turn = 0;
  std::thread other([&] {
    for (int i = 0; i < 200; ++i) {
      std::unique_lock<std::mutex> hold(m);
      cv.wait(hold, [&] { return turn % 2 == 1; });
      ++turn;
      cv.notify_one();
    }
  });
  for (int i = 0; i < 200; ++i) {
    std::unique_lock<std::mutex> hold(m);
    cv.wait(hold, [&] { return turn % 2 == 0; });
    ++turn;
    cv.notify_one();
  }
  other.join();
  EXPECT_EQ(turn, 400);
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

TEST_F(RtGuard, CountsThrowsFromUsAndFromTheLibrary) {
  const auto own = counted([] {
    try {
      throw std::runtime_error("deliberate");
    } catch (const std::runtime_error& e) {
      EXPECT_STREQ(e.what(), "deliberate");
    }
  });
  EXPECT_EQ(own.throws, 1u);
  EXPECT_GE(own.allocations, 1u);  // the message

  const std::vector<int> empty;
  const auto library = counted([&] {
    try {
      use(&empty.at(3));
    } catch (const std::out_of_range&) {
    }
  });
  EXPECT_EQ(library.throws, 1u);

  const auto again = counted([] {
    try {
      try {
        throw 3;
      } catch (...) {
        throw;
      }
    } catch (int) {
    }
  });
  EXPECT_EQ(again.throws, 2u);
}

TEST_F(RtGuard, OutsideASectionNothingCounts) {
  std::mutex m;
  lock_once(m);
  void* p = std::malloc(10);
  use(p);
  std::free(p);
  try {
    throw 1;
  } catch (int) {
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

TEST_F(RtGuard, ASectionIsOfOneThreadAndNests) {
  rt::Section outer;
  std::uint64_t before = rt_guard::counts().total();
  {
    rt::Section inner;
    void* p = std::malloc(1);
    use(p);
    std::free(p);
  }
  EXPECT_EQ(rt_guard::counts().total() - before, 2u);
  EXPECT_TRUE(rt::Section::active());
  bool active_elsewhere = true;
  std::thread other([&] { active_elsewhere = rt::Section::active(); });
  other.join();
  EXPECT_FALSE(active_elsewhere);
  {
    rt::Section unarmed(false);
    EXPECT_TRUE(rt::Section::active());
  }
}

using RtGuardDeath = RtGuard;
TEST_F(RtGuardDeath, AbortsAtTheFirstOffenceWhenAsked) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        rt_guard::abort_on_offence(true);
        rt::Section s;
        use(std::malloc(8));
      },
      testing::KilledBySignal(SIGABRT), "");
}

}  // namespace
