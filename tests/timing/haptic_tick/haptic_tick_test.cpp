#include <gtest/gtest.h>

#include <iostream>

#include "tools/haptic/bench_haptic.hpp"

namespace {

TEST(HapticTick, CountsAreWithinTheirLimits) {
  teletact::HapticBenchOptions options;
  options.passes = 1;
  options.count_ticks = 600;
  options.programs = TELETACT_BINARY_DIR;
  const auto r = teletact::bench_haptic(std::cout, options);
  r.print(std::cout);
  ASSERT_EQ(r.not_counted, "");
  EXPECT_GT(r.methods.front().contact, 3000U) << "the hand misses the table";
  EXPECT_GT(r.blocks_512, 4 * r.blocks_64) << "the small map is not small";
  // Independent of the size of the map.
  EXPECT_NEAR(r.instructions_512 / r.instructions_64, 1, 0.1);
  // Effects that nobody asked for cost nothing; those asked for cost something.
  EXPECT_LE(std::abs(r.none_over_plain), 8);
  for (const auto& [name, more] : r.effects) EXPECT_GT(more, 8) << name;
  ASSERT_TRUE(r.guarded);
  EXPECT_EQ(r.allocations, 0);
  EXPECT_EQ(r.locks, 0);
}

}  // namespace
