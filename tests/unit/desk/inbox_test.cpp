// Who waits at the inbox comes back when something is put in, and not before.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>
#include <vector>

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
    EXPECT_EQ(inbox.take().size(), 1U);
    EXPECT_FALSE(inbox.await(milliseconds{1})) << "it was taken";
  }
}

TEST(DeskInbox, WhatWaitsAlreadyIsNotWaitedFor) {
  DeskInbox inbox;
  EXPECT_TRUE(inbox.put(item(Act::kHold)));
  EXPECT_TRUE(inbox.await(std::chrono::minutes{1}));
}

std::vector<Act> acts_of(DeskInbox& inbox) {
  std::vector<Act> acts;
  for (const DeskItem& i : inbox.take()) acts.push_back(i.intent.act);
  return acts;
}

// A quick tap: the token that lets go does not overtake what was held.
TEST(DeskInbox, TheOrderIsThatOfTheirComing) {
  DeskInbox inbox;
  for (const Act act :
       {Act::kToken, Act::kHand, Act::kHand, Act::kDrive, Act::kHand, Act::kToken, Act::kDrive})
    EXPECT_TRUE(inbox.put(item(act)));
  EXPECT_EQ(acts_of(inbox),
            (std::vector{Act::kToken, Act::kHand, Act::kDrive, Act::kToken, Act::kDrive}));
}

TEST(DeskInbox, OfHandAndDriveTheNewestIsKeptAndTheyTakeNoRoom) {
  DeskInbox inbox;
  for (std::size_t i = 0; i < DeskInbox::kMost; ++i) {
    ASSERT_TRUE(inbox.put(item(Act::kNote)));
    for (int n = 0; n < 3; ++n) {
      DeskItem hand = item(Act::kHand);
      hand.id = n;
      ASSERT_TRUE(inbox.put(std::move(hand)));
    }
  }
  EXPECT_FALSE(inbox.put(item(Act::kNote)));
  EXPECT_TRUE(inbox.put(item(Act::kHand)));
  const auto taken = inbox.take();
  ASSERT_EQ(taken.size(), 2 * DeskInbox::kMost);
  EXPECT_EQ(taken[1].id, 2);
  EXPECT_TRUE(inbox.put(item(Act::kNote)));
}

TEST(DeskInbox, NothingComesAfterAsLongAsWasSaid) {
  DeskInbox inbox;
  const auto from = Clock::now();
  EXPECT_FALSE(inbox.await(milliseconds{5}));
  EXPECT_GE(Clock::now() - from, milliseconds{5});
}

}  // namespace
