// One seed of each; tests/unit/demo_rounds_full has twenty.
#include "tests/unit/demo_rounds/rounds.hpp"

namespace tests {
namespace {

TEST(Rounds, EveryMarkIsReachedInTheWorldByTheCamerasPose) {
  const Round r = go_round(1, kRounds_s);
  expect_all_reached(r, 1);
  EXPECT_GE(r.uncorrected_m, kUncorrected_m);
  EXPECT_GT(r.ate_mm, 0);
  EXPECT_LT(r.ate_mm, 30);
}

// The check can fail: without the images nothing says that the wheels slip.
TEST(Rounds, WithoutImagesTheyAreMissed) {
  const Round stood = go_round(1, 20, 2.0);
  EXPECT_EQ(stood.arrivals, 0) << "a cost map that old plans no way";
  expect_stands(stood, 1);
}

// Who takes the wheels for the world arrives by his own word, far from where he should be.
TEST(Rounds, ByTheWheelsAloneTheyAreMissed) {
  const Round r = go_round(1, kRounds_s, -1, {"prediction.map_correction=false"});
  EXPECT_GE(r.arrivals, 1) << "by his own word";
  EXPECT_GT(r.worst_m, 0.030);
}

TEST(Rounds, ACameraThatGoesDarkUnderWayStopsTheBase) {
  const Round r = go_round(2, 16, 7.0);
  expect_stands(r, 2);
  EXPECT_GT(r.way_m, 0.5) << "it was under way";
  EXPECT_GT(r.unsure_s, 1);
}

}  // namespace
}  // namespace tests
