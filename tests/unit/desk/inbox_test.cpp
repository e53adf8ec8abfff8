// Who waits at the inbox comes back when something is put in, and not before.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tools/desk/desk_inbox.hpp"

namespace {

using std::chrono::milliseconds;
using teletact::Act;
using teletact::DeskInbox;
using teletact::DeskItem;
using Clock = std::chrono::steady_clock;

DeskItem item(Act act) {
  DeskItem i;
  i.intent.act = act;
  return i;
}

TEST(DeskInbox, WhoWaitsIsWokenByAnAct) {
  for (const Act act : {Act::kDraw, Act::kDrive, Act::kHand}) {
    DeskInbox inbox;
    std::thread puts([&] {
      std::this_thread::sleep_for(milliseconds{20});
      EXPECT_TRUE(inbox.put(item(act)));
    });
    const auto from = Clock::now();
    EXPECT_TRUE(inbox.await(std::chrono::minutes{1}));
    EXPECT_LT(Clock::now() - from, std::chrono::seconds{30});
    puts.join();
    const auto taken = inbox.take();
    EXPECT_EQ(taken.acts.size() + (taken.drive ? 1 : 0) + (taken.hand ? 1 : 0), 1U);
    EXPECT_FALSE(inbox.await(milliseconds{1})) << "it was taken";
  }
}

TEST(DeskInbox, WhatWaitsAlreadyIsNotWaitedFor) {
  DeskInbox inbox;
  EXPECT_TRUE(inbox.put(item(Act::kHold)));
  EXPECT_TRUE(inbox.await(std::chrono::minutes{1}));
}

TEST(DeskInbox, NothingComesAfterAsLongAsWasSaid) {
  DeskInbox inbox;
  const auto from = Clock::now();
  EXPECT_FALSE(inbox.await(milliseconds{5}));
  EXPECT_GE(Clock::now() - from, milliseconds{5});
}

}  // namespace
