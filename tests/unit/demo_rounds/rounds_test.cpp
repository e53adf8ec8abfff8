// One seed of each; tests/unit/demo_rounds_full has twenty.
#include "tests/unit/demo_rounds/rounds.hpp"

namespace tests {
namespace {

TEST(Rounds, EveryMarkIsReachedInTheWorldByTheCamerasPose) {
  const Round r = go_round(1, kRounds_s);
  expect_all_reached(r, 1);
  EXPECT_GT(r.ate_mm, 0);
  EXPECT_LT(r.ate_mm, 30);
}

// The check can fail: without the images nothing says that the wheels slip.
TEST(Rounds, WithoutImagesTheyAreMissed) {
  const Round stood = go_round(1, 20, 2.0);
  EXPECT_EQ(stood.arrivals, 0) << "it stands, and says why";
  expect_stands(stood, 1);
}

// Who takes the wheels for the world arrives by his own word, far from where he should be.
TEST(Rounds, ByTheWheelsAloneTheyAreMissed) {
  const Round r = go_round(1, kRounds_s, 2.0, {"prediction.map_correction=false"});
  EXPECT_TRUE(r.worst_m > 0.030 || r.arrivals < 4) << r.worst_m;
}

TEST(Rounds, ACameraThatGoesDarkUnderWayStopsTheBase) { expect_stands(go_round(2, 16, 7.0), 2); }

}  // namespace
}  // namespace tests
