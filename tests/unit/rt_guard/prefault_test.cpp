// Prefaulting leaves no first touch for later; what is missing is said.
#include "rt/memory/prefault.hpp"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <cstring>
#include <string>
#include <thread>
#include <vector>

namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kOtherAllocator = true;
#else
constexpr bool kOtherAllocator = false;
#endif

long minor_faults() {
  rusage u{};
  getrusage(RUSAGE_THREAD, &u);
  return u.ru_minflt;
}

[[gnu::noinline]] void use_stack(std::size_t bytes) {
  auto* p = static_cast<volatile char*>(__builtin_alloca(bytes));
  for (std::size_t i = 0; i < bytes; i += 1024) p[i] = 1;
}

TEST(Prefault, ARangeHasNoFirstTouchLeft) {
  rt::Startup startup;
  constexpr std::size_t kBytes = 8U << 20U;
  void* p = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(p, MAP_FAILED);
  (void)madvise(p, kBytes, MADV_NOHUGEPAGE);
  static_cast<char*>(p)[5] = 42;
  const long before = minor_faults();
  rt::prefault_range(startup.token(), p, kBytes);
  const long touched = minor_faults() - before;
  EXPECT_GT(touched, 1000);  // it had 2048 pages to meet
  EXPECT_EQ(static_cast<char*>(p)[5], 42);
  const long again = minor_faults();
  std::memset(p, 1, kBytes);
  EXPECT_EQ(minor_faults() - again, 0);
  munmap(p, kBytes);
}

TEST(Prefault, TheStackOfAThreadHasNoFirstTouchLeft) {
  std::string missing = "not run", too_much;
  long faults = -1;
  std::thread t([&] {
    rt::Startup startup;
    missing = rt::prefault_stack(startup.token(), 512 * 1024);
    const long before = minor_faults();
    use_stack(480 * 1024);
    faults = minor_faults() - before;
    too_much = rt::prefault_stack(startup.token(), std::size_t{1} << 32U);  // must not crash
  });
  t.join();
  EXPECT_EQ(missing, "");
  EXPECT_EQ(faults, 0);
  EXPECT_NE(too_much.find("it is not larger"), std::string::npos) << too_much;
}

TEST(Prefault, ProcessMemoryEitherIsLockedOrSaysWhy) {
  rt::Startup startup;
  const std::string missing = rt::prepare_process_memory(startup.token(), 1U << 20U, 64 * 1024);
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  if (limit.rlim_cur == RLIM_INFINITY) {
    // A sanitizer's own allocator has no settings to keep its memory, which is said.
    if (!kOtherAllocator) {
      EXPECT_EQ(missing, "");
    }
  } else if (!missing.empty()) {
    EXPECT_NE(missing.find(kOtherAllocator ? "heap" : "memlock"), std::string::npos) << missing;
  }
  munlockall();
}

}  // namespace
