// A surface that moves before another: no pixel shows neither, in any mode and under either law.
#include "tests/support/moving_occluder.hpp"
#include "tests/unit/drivers_depth_stream/streams.hpp"

namespace {

using namespace depth_stream_test;

constexpr DepthNoiseLaw kLaws[] = {DepthNoiseLaw::kStrict, DepthNoiseLaw::kLenient};

TEST(DepthOccluder, NoPixelIsOfNeitherSurface) {
  for (const DepthNoiseLaw law : kLaws) {
    double worst = 0;
    for (const DepthMode mode : kModes) {
      for (std::uint64_t seed = 1; seed <= 8; ++seed) {
        const auto seen = test_support::watch_occluder(startup.token(), law, mode, seed);
        EXPECT_EQ(seen.flying, 0) << to_text(law) << ", " << to_text(mode) << ", seed " << seed;
        if (mode != DepthMode::kQuiet) continue;
        // A memory in time must not leave a surface that moves behind.
        EXPECT_LT(seen.lag(), test_support::most_lag(law)) << to_text(law) << ", seed " << seed;
        worst = std::max(worst, seen.lag());
      }
    }
    std::printf("  %s: seeds 1 to 8, quiet, error over sensor where it moves: %.2f at most\n",
                to_text(law), worst);
  }
}

// The same check sees a codec that lets a value stay too long: tests/negative/codec.

}  // namespace
