#include "tests/unit/demo_rounds/rounds.hpp"

namespace tests {
namespace {

class RoundsOf : public testing::TestWithParam<int> {};

TEST_P(RoundsOf, EveryMarkIsReachedInTheWorld) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  expect_all_reached(go_round(seed, kRounds_s), seed);
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
