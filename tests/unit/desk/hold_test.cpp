// A held key is as good as its newest token.
#include <gtest/gtest.h>

#include "tools/desk/hold.hpp"

namespace {

using std::chrono::milliseconds;
using teletact::Hold;

rt::Time at(int ms) { return rt::time_from_ns(1'000'000'000 + std::int64_t{1'000'000} * ms); }

TEST(Hold, LivesAsLongAsItsTokens) {
  Hold h;
  EXPECT_FALSE(h.held(at(0)));
  for (int ms = 0; ms <= 1000; ms += 50) {
    h.say(true, at(ms));
    EXPECT_TRUE(h.held(at(ms)));
  }
  EXPECT_TRUE(h.held(at(1200)));
  EXPECT_FALSE(h.held(at(1201)));
  EXPECT_TRUE(h.lost());
  EXPECT_EQ(h.presses(), 1U);
}

// A browser that froze and goes on says that it still holds: nobody pressed.
TEST(Hold, OnceLostOnlyANewPressHoldsAgain) {
  Hold h;
  h.say(true, at(0));
  EXPECT_FALSE(h.held(at(300)));
  for (int ms = 310; ms < 600; ms += 50) {
    h.say(true, at(ms));
    EXPECT_FALSE(h.held(at(ms)));
  }
  h.say(false, at(610));
  EXPECT_FALSE(h.held(at(610)));
  h.say(true, at(620));
  EXPECT_TRUE(h.held(at(620)));
  EXPECT_EQ(h.presses(), 2U);
}

// The gap alone counts, looked at or not in between.
TEST(Hold, AGapThatNobodyLookedIntoEndsItToo) {
  Hold h;
  h.say(true, at(0));
  h.say(true, at(201));
  EXPECT_FALSE(h.held(at(202)));
}

TEST(Hold, AnOlderTokenDoesNotShortenIt) {
  Hold h;
  h.say(true, at(100));
  h.say(true, at(40));  // came late
  EXPECT_TRUE(h.held(at(300)));
}

TEST(Hold, WhoeverHeldItIsGone) {
  Hold h;
  h.say(true, at(0));
  h.lose();
  h.say(true, at(10));
  EXPECT_FALSE(h.held(at(10)));
  h.renew();
  h.say(true, at(20));
  EXPECT_TRUE(h.held(at(20)));
}

}  // namespace
