// A fault that lasts: one line when it begins, one a minute, one when it is over.
#include "tasks/robot_io/lasting_faults.hpp"

#include <gtest/gtest.h>

namespace {

using tasks::LastingFaults;
using namespace std::chrono_literals;

struct Clock {
  rt::Time now = rt::time_from_ns(1'000'000'000);
  LastingFaults faults;
  int said = 0, ended = 0;
  LastingFaults::Ended last;
  // A job of 1 ms with these faults, each of one slave.
  void job(const std::vector<rt::FaultId>& ids, int who = 0) {
    while (faults.take_ended(now, last)) ++ended;
    for (const rt::FaultId id : ids) said += faults.is_there(id, who, now) ? 1 : 0;
    now += 1ms;
  }
};

TEST(LastingFaults, OneLineAtItsBeginningOneAMinuteOneAtItsEnd) {
  Clock c;
  for (int k = 0; k < 150'000; ++k) c.job({511});
  EXPECT_EQ(c.said, 3) << "0, 60 and 120 s";
  EXPECT_EQ(c.ended, 0);
  for (int k = 0; k < 1100; ++k) c.job({});
  EXPECT_EQ(c.ended, 1);
  EXPECT_EQ(c.last.fault, 511);
  EXPECT_NEAR(c.last.lasted_s, 150, 0.01);
  EXPECT_EQ(c.last.jobs, 150'000U);
  c.job({511});
  EXPECT_EQ(c.said, 4) << "it begins anew";
}

// What comes and goes within a second is one, and two that take turns are two.
TEST(LastingFaults, ComingAndGoingIsOneFaultAndTwoThatTakeTurnsAreTwo) {
  Clock c;
  for (int k = 0; k < 10'000; ++k)
    c.job(k % 8 == 0 ? std::vector<rt::FaultId>{510} : std::vector<rt::FaultId>{});
  EXPECT_EQ(c.said, 1);
  Clock turns;
  for (int k = 0; k < 10'000; ++k) turns.job({k % 2 == 0 ? rt::FaultId{511} : rt::FaultId{512}});
  EXPECT_EQ(turns.said, 2);
  for (int k = 0; k < 1100; ++k) turns.job({});
  EXPECT_EQ(turns.ended, 2);
}

TEST(LastingFaults, OfAMomentTheBeginningIsAll) {
  Clock c;
  c.job({516}, 2);
  c.job({516}, 3);
  for (int k = 0; k < 3000; ++k) c.job({});
  EXPECT_EQ(c.said, 2) << "of two wheels";
  EXPECT_EQ(c.ended, 0);
}

// More faults than there is room for: the oldest one makes room, and none is silent.
TEST(LastingFaults, MoreThanThereIsRoomFor) {
  Clock c;
  for (int who = 0; who < 40; ++who) c.job({516}, who);
  EXPECT_EQ(c.said, 40);
}

}  // namespace
