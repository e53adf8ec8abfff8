// When the console's address is printed again.
#include <gtest/gtest.h>

#include "tools/desk/code_offer.hpp"

namespace {

using teletact::CodeOffer;
constexpr std::int64_t kS = 1'000'000'000, kMin = 60 * kS;

TEST(CodeOffer, AfterTheOperatorsBrowserWasClosed) {
  CodeOffer offer(0);
  EXPECT_FALSE(offer.due(false, 5 * kMin)) << "the first code is good for an hour";
  EXPECT_FALSE(offer.due(true, 6 * kMin));
  EXPECT_FALSE(offer.due(false, 6 * kMin + 10 * kS)) << "a reload";
  EXPECT_FALSE(offer.due(true, 6 * kMin + 12 * kS));
  EXPECT_FALSE(offer.due(false, 6 * kMin + 26 * kS));
  EXPECT_TRUE(offer.due(false, 6 * kMin + 27 * kS));
  EXPECT_FALSE(offer.due(false, 6 * kMin + 60 * kS)) << "once";
}

TEST(CodeOffer, BeforeACodeThatNobodyUsedEnds) {
  CodeOffer offer(0);
  EXPECT_FALSE(offer.due(false, 49 * kMin));
  EXPECT_TRUE(offer.due(false, 50 * kMin));
  EXPECT_FALSE(offer.due(false, 99 * kMin));
  EXPECT_TRUE(offer.due(false, 100 * kMin));
}

// An operator who stays needs none, however long.
TEST(CodeOffer, NoneWhileSomebodyOperates) {
  CodeOffer offer(0);
  for (std::int64_t t = 0; t < 300 * kMin; t += kMin) EXPECT_FALSE(offer.due(true, t));
}

}  // namespace
