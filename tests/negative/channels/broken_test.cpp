// Each broken protocol must fail the check that the product's passes in tests/unit/rt_channel.
#include <gtest/gtest.h>

#include <string>

#include "tests/support/channel_checks.hpp"

namespace {

using channel_checks::explore_latest;
using channel_checks::explore_ring;
using testing::AssertionFailure;
using testing::AssertionSuccess;

struct WriterDoesNotHelp : rt::LatestProtocol {
  static constexpr bool kHelpReaders = false;
};
struct ReaderStoresInsteadOfSwapping : rt::LatestProtocol {
  static constexpr bool kReaderSwaps = false;
};
struct OneSlotLess : rt::LatestProtocol {
  static constexpr int kSpareSlots = 1;
};

testing::AssertionResult rejected(const interleave::Explorer::Outcome& outcome,
                                  const std::string& reason) {
  if (outcome.failure.empty()) {
    return AssertionFailure() << "not caught in " << outcome.states << " states";
  }
  if (outcome.failure.find(reason) == std::string::npos) {
    return AssertionFailure() << "caught for another reason: " << outcome.failure;
  }
  return AssertionSuccess();
}

class Broken : public testing::Test {
 protected:
  void SetUp() override {
#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
    GTEST_SKIP() << "fibers and sanitizers do not mix; the plain build runs this";
#endif
  }
};

TEST_F(Broken, TheProductsProtocolPassesTheSameCheck) {
  EXPECT_EQ(explore_latest<rt::LatestProtocol>({1}, 4, 3).failure, "");
  EXPECT_EQ(explore_latest<rt::LatestProtocol>({2}, 4, 3).failure, "");
}

// Without either compare-and-swap a reader ends up with a slot that the writer reaches.
TEST_F(Broken, LatestWithoutTheWritersSwapIsCaught) {
  for (const auto& retained : {std::vector<int>{1}, {2}, {1, 2}}) {
    EXPECT_TRUE(rejected(explore_latest<WriterDoesNotHelp>(retained, 4, 3), "a reader gets"));
  }
}
TEST_F(Broken, LatestWithoutTheReadersSwapIsCaught) {
  for (const auto& retained : {std::vector<int>{1}, {2}}) {
    EXPECT_TRUE(
        rejected(explore_latest<ReaderStoresInsteadOfSwapping>(retained, 4, 3), "a reader gets"));
  }
}
TEST_F(Broken, LatestWithOneSlotLessIsCaught) {
  for (const auto& retained : {std::vector<int>{1}, {2}}) {
    EXPECT_TRUE(rejected(explore_latest<OneSlotLess>(retained, 5, 3), "finds no free slot"));
  }
}

}  // namespace
