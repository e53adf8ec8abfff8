// Ring and Latest under every interleaving of their atomic operations, for small numbers of
// operations. The broken twins that the same checks must reject are in tests/negative/channels.
#include <gtest/gtest.h>

#include "tests/support/channel_checks.hpp"

namespace {

using channel_checks::explore_latest;
using channel_checks::explore_ring;

class Exhaustive : public testing::Test {
 protected:
  void SetUp() override {
#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
    GTEST_SKIP() << "fibers and sanitizers do not mix; the plain build runs this";
#endif
  }
  static void expect_clean(const interleave::Explorer::Outcome& outcome, std::uint64_t least) {
    EXPECT_EQ(outcome.failure, "");
    EXPECT_TRUE(outcome.complete);
    EXPECT_GT(outcome.states, least);  // it did explore
    RecordProperty("states", static_cast<int>(outcome.states));
  }
};

TEST_F(Exhaustive, LatestTripleBuffer) {
  expect_clean(explore_latest<rt::LatestProtocol>({1}, 5, 5), 10'000);
}
TEST_F(Exhaustive, LatestRetainingTwo) {
  expect_clean(explore_latest<rt::LatestProtocol>({2}, 5, 4), 20'000);
}
TEST_F(Exhaustive, LatestTwoReaders) {
  expect_clean(explore_latest<rt::LatestProtocol>({1, 1}, 2, 2), 20'000);
}
TEST_F(Exhaustive, LatestTwoReadersOneRetainingTwo) {
  expect_clean(explore_latest<rt::LatestProtocol>({1, 2}, 3, 2), 50'000);
}
TEST_F(Exhaustive, Ring) { expect_clean(explore_ring<rt::RingProtocol>(0, 6, 6, false), 5'000); }
TEST_F(Exhaustive, RingAcrossTheWrap) {
  expect_clean(explore_ring<rt::RingProtocol>(~std::uint64_t{0} - 1, 6, 6, false), 5'000);
}
TEST_F(Exhaustive, RingInBatches) {
  expect_clean(explore_ring<rt::RingProtocol>(~std::uint64_t{0} - 1, 6, 5, true), 5'000);
}

}  // namespace
