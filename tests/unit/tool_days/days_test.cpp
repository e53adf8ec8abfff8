#include "tools/measure/days.hpp"

#include <gtest/gtest.h>

#include <sstream>

namespace {

using teletact::DaysOptions;
using teletact::DaysResult;

DaysResult minutes(double n, bool in_memory) {
  DaysOptions o;
  o.hours = n / 60;
  o.cap_bytes = std::uint64_t{32} << 20U;
  o.in_memory = in_memory;
  std::ostringstream progress;
  return teletact::bench_days(progress, o);
}

TEST(Days, MemoryIsFlatDiskBelowItsCapAndEveryJobCounted) {
  const DaysResult r = minutes(5, false);
  std::ostringstream text;
  r.print(text);
  EXPECT_EQ(r.missed(), 0) << text.str();
  EXPECT_GE(r.minutes_MiB.size(), 4U);
  EXPECT_GT(r.jobs, 500000U);
  EXPECT_LT(r.whole, r.jobs) << "it was long enough for the cap";
  EXPECT_GT(r.disk_MiB, 40) << "and made use of it";
}

// That a run without bounds would be seen: five minutes of records in memory are above the limit.
TEST(Days, RecordsInMemoryAreSeen) {
  const DaysResult r = minutes(3, true);
  EXPECT_GE(r.missed(), 1);
  EXPECT_GT(r.last_MiB, 1.05 * r.first_MiB) << "far above the 2 % that are allowed";
}

TEST(Days, EachLimitCanBeMissed) {
  DaysResult good;
  good.first_MiB = 100;
  good.last_MiB = 101.9;
  good.cap_MiB = 512;
  good.disk_MiB = 511;
  good.report_s = 29;
  EXPECT_EQ(good.missed(), 0);
  for (auto spoil :
       {+[](DaysResult& r) { r.last_MiB = 102.1; }, +[](DaysResult& r) { r.disk_MiB = 513; },
        +[](DaysResult& r) { r.lost = 1; }, +[](DaysResult& r) { r.report_s = 31; }}) {
    DaysResult bad = good;
    spoil(bad);
    EXPECT_EQ(bad.missed(), 1);
  }
}

}  // namespace
