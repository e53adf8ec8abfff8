// A page that comes from disk is a major fault, and the probe sees it as the kernel counts it.
#include "rt/sched/thread_probe.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace {

TEST(ThreadProbe, APageFromDiskIsAMajorFault) {
  std::string path = "thread_probe_XXXXXX";  // where the test runs: /tmp may be memory
  const int fd = ::mkstemp(path.data());
  ASSERT_GE(fd, 0);
  ::unlink(path.c_str());
  constexpr std::size_t kPage = 4096, kPages = 64;
  const std::vector<char> bytes(kPage * kPages, 'x');
  ASSERT_EQ(::write(fd, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  ASSERT_EQ(::fsync(fd), 0);
  void* memory = ::mmap(nullptr, bytes.size(), PROT_READ, MAP_SHARED, fd, 0);
  ASSERT_NE(memory, MAP_FAILED);
  ::madvise(memory, bytes.size(), MADV_RANDOM);
  ::posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
  std::vector<unsigned char> in_memory(kPages);
  ASSERT_EQ(::mincore(memory, bytes.size(), in_memory.data()), 0);
  long absent = 0;
  for (const unsigned char p : in_memory) absent += (p & 1U) == 0 ? 1 : 0;
  rt::SchedStat stat;
  stat.open_here();
  const rt::ThreadCounters before = rt::counters(stat);
  for (std::size_t p = 0; p < kPages; ++p)
    ASSERT_EQ(static_cast<volatile char*>(memory)[p * kPage], 'x');
  const rt::ThreadCounters after = rt::counters(stat);
  ::munmap(memory, bytes.size());
  ::close(fd);
  if (absent == 0) GTEST_SKIP() << "this file system keeps its files in memory";
  EXPECT_GE(after.major_faults - before.major_faults, 1);
  EXPECT_LE(after.major_faults - before.major_faults, absent);
  // None without disk.
  const rt::ThreadCounters again = rt::counters(stat);
  EXPECT_EQ(again.major_faults, after.major_faults);
}

}  // namespace
