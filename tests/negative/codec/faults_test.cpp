// The depth codec with false rules leaves pixels between two surfaces, and the check of
// tests/unit/drivers_depth_stream/occluder_test.cpp sees it.
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/support/moving_occluder.hpp"

namespace {

TEST(CodecFaults, ALaggingFilterIsSeen) {
  rt::Startup startup;
  long flying = 0;
  double strict = 0, lenient = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const auto a = test_support::watch_occluder(startup.token(), drivers::DepthNoiseLaw::kStrict,
                                                drivers::DepthMode::kQuiet, seed);
    const auto b = test_support::watch_occluder(startup.token(), drivers::DepthNoiseLaw::kLenient,
                                                drivers::DepthMode::kQuiet, seed);
    flying += a.flying + b.flying;
    strict = std::max(strict, a.lag()), lenient = std::max(lenient, b.lag());
  }
  std::printf("  seeds 1 to 8: %ld flying, error over sensor %.2f and %.2f\n", flying, strict,
              lenient);
  EXPECT_GT(flying, 0);
  EXPECT_GT(strict, test_support::most_lag(drivers::DepthNoiseLaw::kStrict));
  EXPECT_GT(lenient, test_support::most_lag(drivers::DepthNoiseLaw::kLenient));
}

}  // namespace
