// Faults that only a new start of the program ends.
#include "tests/unit/tasks_supervision/story.hpp"

namespace tests {
namespace {

TEST(Supervision, LinkRefusedNeedsARestart) {  // F-SUP-03
  Story s;
  s.run(50ms);
  s.in.link_refused = true;
  s.run(50ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkRefused);
  s.in.link_refused = false;
  s.clear().clear();
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
}

TEST(Supervision, WatchdogNeedsARestart) {  // F-SUP-09
  Story s;
  s.engaged();
  s.in.watchdog_bit = true;
  s.run(10ms);
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
  s.in.watchdog_bit = false;
  s.clear();
  EXPECT_EQ(s.mode(), Mode::kSafeStop);
}

// Else a clear, which the first cause names, is tried in vain.
TEST(Supervision, WhatWantsARestartIsToldWhateverCameFirst) {
  Story s;
  s.engaged();
  s.in.requests.stop = true;
  s.run(10ms);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultStopRequested);
  s.in.requests.stop = false;
  s.in.watchdog_bit = true;
  s.run(10ms);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultWatchdog);
  s.in.requests.stop = true;
  s.run(10ms);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultWatchdog);
}

// Nor does it matter which of two that are as bad comes first in the table.
TEST(Supervision, WhatWantsARestartIsToldBesideWhatIsAsBad) {
  Story s;
  s.run(50ms);
  s.in.requests.stop = true;
  s.in.link_refused = true;
  s.run(10ms);
  EXPECT_EQ(s.out.mode.cause, tasks::kFaultLinkRefused) << "both at once";
  Story before;
  before.run(50ms);
  before.in.estop_fitted = true;
  before.in.estop_closed = false;
  before.run(10ms);
  EXPECT_EQ(before.out.mode.cause, tasks::kFaultEstop);
  before.in.link_refused = true;
  before.run(10ms);
  EXPECT_EQ(before.out.mode.cause, tasks::kFaultLinkRefused) << "the e-stop is still pressed";
  before.in.link_refused = false;
  before.run(10ms);
  EXPECT_EQ(before.out.mode.cause, tasks::kFaultLinkRefused) << "gone, and still held back";
}

}  // namespace
}  // namespace tests
