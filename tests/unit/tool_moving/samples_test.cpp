// Twenty-four fixed samples of a thing that moves, at 20 mm, with the first and the last level: no limit of `teletact
// accuracy moving` is missed. Every fourth has whole images, the others half ones.
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/unit/tool_moving/place.hpp"

namespace teletact {
namespace {

class TwentyFour : public ::testing::TestWithParam<int> {};

TEST_P(TwentyFour, KeepsEveryLimit) {
  MovingSample sample = draw_moving_sample(moving_test::startup.token(), 1, GetParam());
  sample.half_images = GetParam() % 4 != 0;
  std::printf("  %s\n", sample.text().c_str());
  MovingOptions options;
  options.voxels_mm = {20};
  options.levels = {0, tasks::FusionConfig{}.level_count - 1};
  for (const MovingRow& row : run_sample(moving_test::startup.token(), sample, options, nullptr)) {
    const std::string said = line_of(row);
    std::printf("%s", said.c_str());
    EXPECT_TRUE(failed_checks(row).empty()) << said;
  }
}

// Switched on: without DISABLED_.
INSTANTIATE_TEST_SUITE_P(DISABLED_Samples, TwentyFour, ::testing::Range(0, 24));
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(TwentyFour);

}  // namespace
}  // namespace teletact
