#include "tests/unit/demo_rounds/rounds.hpp"

namespace tests {
namespace {

class RoundsOf : public testing::TestWithParam<int> {
 public:
  // The slips cancelled with eight of twenty seeds when this was first measured; more is another
  // drive.
  static void TearDownTestSuite() {
    std::printf("odometry alone is less than %.0f mm off with %d of %d seeds\n",
                1e3 * kUncorrected_m, near_, ran_);
    if (ran_ == kSeeds) {
      EXPECT_LE(near_, 8);
    }
  }

 protected:
  static constexpr int kSeeds = 20;
  static inline int ran_ = 0, near_ = 0;
};

TEST_P(RoundsOf, EveryMarkIsReachedInTheWorld) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const Round r = go_round(seed, kRounds_s);
  expect_all_reached(r, seed);
  ++ran_;
  if (r.uncorrected_m < kUncorrected_m) ++near_;
}

// Dark at another instant of the first way with each seed.
TEST_P(RoundsOf, DarkUnderWay) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const Round r = go_round(seed, 16, 6.0 + 0.1 * static_cast<double>(seed));
  expect_stands(r, seed);
  EXPECT_GT(r.unsure_s, 1) << "seed " << seed;
}

INSTANTIATE_TEST_SUITE_P(Seeds, RoundsOf, testing::Range(1, 21));

}  // namespace
}  // namespace tests
