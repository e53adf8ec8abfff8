// Twenty-four fixed samples of a thing that moves, at 20 mm: no limit of `teletact accuracy moving` is missed but those
// listed. Every fourth has whole images and is run at the first and the last level; the others have half ones, for time,
// and the first level alone: the last one of those would track 64 x 53 pixels.
#include <gtest/gtest.h>

#include <cstdio>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "tests/unit/tool_moving/place.hpp"

namespace teletact {
namespace {

// What is missed today, by name: a miss that is not listed fails, and so does one that is listed and not there any more.
struct Missed {
  int sample, level;
  const char* check;
};
constexpr Missed kMissed[] = {
    // A drawer of 4 % of the image, 6.5 mm a frame from the first one on: learned as it goes at a fourth of the pixels.
    {16, 2, "mask_iou.share5"},
    // An arm at 0.9 m that turns by .65 degrees a frame from the first one on: 5.2 mm above the plain run (5 allowed).
    {23, 0, "ate_mm.share30"},
    {23, 0, "ghost_cells"},
};

std::vector<std::string> listed(int sample, int level) {
  std::vector<std::string> out;
  for (const Missed& m : kMissed) {
    if (m.sample == sample && m.level == level) out.emplace_back(m.check);
  }
  return out;
}

class TwentyFour : public ::testing::TestWithParam<int> {};

TEST_P(TwentyFour, MissesNoLimitButThoseListed) {
  MovingSample sample = draw_moving_sample(moving_test::startup.token(), 1, GetParam());
  sample.half_images = GetParam() % 4 != 0;
  std::printf("  %s\n", sample.text().c_str());
  MovingOptions options;
  options.voxels_mm = {20};
  options.levels = {0};
  if (!sample.half_images) options.levels.push_back(tasks::FusionConfig{}.level_count - 1);
  for (const MovingRow& row : run_sample(moving_test::startup.token(), sample, options, nullptr)) {
    const std::string said = line_of(row);
    std::printf("%s", said.c_str());
    const auto expected = row.variant == MovingVariant::kAlone
                              ? listed(GetParam(), row.setting.level)
                              : std::vector<std::string>{};
    EXPECT_EQ(failed_checks(row), expected) << said;
  }
}

INSTANTIATE_TEST_SUITE_P(Samples, TwentyFour, ::testing::Range(0, 24));

// Samples of other seeds that once carried the camera, whole images at the first level. Poses alone are judged.
struct Found {
  std::uint64_t seed;
  int sample;
  MovingVariant variant;
  double most_mm;
};
class FoundOnce : public ::testing::TestWithParam<Found> {};

TEST_P(FoundOnce, CarriesTheCameraNoMore) {
  const MovingSample sample =
      draw_moving_sample(moving_test::startup.token(), GetParam().seed, GetParam().sample);
  std::printf("  %s\n", sample.text().c_str());
  const MovingFilm film = film_moving(moving_test::startup.token(), sample, false);
  const MovingRun run = run_moving(moving_test::startup.token(), sample, film, GetParam().variant,
                                   {20, 0, false}, nullptr);
  std::printf("  %s: claimed %.3f, at most %.1f mm off\n", name_of(GetParam().variant), run.claimed,
              run.worst_mm);
  EXPECT_GE(run.claimed, 0.95);
  EXPECT_LE(run.worst_mm, GetParam().most_mm);
}

INSTANTIATE_TEST_SUITE_P(
    Seeds, FoundOnce,
    ::testing::Values(
        // A box of half of the image that creeps by 2 mm a frame: no frame contradicts odometry, ten do. 127 mm.
        Found{7, 6, MovingVariant::kOdometry, 20},
        // A door that is most of the image, and leaps beside what is expected of the camera. 550 mm.
        Found{51, 3, MovingVariant::kAlone, 20},
        // A drawer of 29 % that faces the camera; of the rest little more than a tenth does. 450 mm.
        Found{51, 22, MovingVariant::kAlone, 20},
        // An arm at half a metre that has come to rest: its leverage left one direction to chance. 246 mm.
        Found{53, 5, MovingVariant::kOdometry, 20},
        // A box of half of the image leaps by 75 mm from one frame to the next: a mean of both motions fitted all of it
        // loosely, and nothing asked. 500 mm.
        Found{54, 6, MovingVariant::kAlone, 20},
        // A ball of 42 % that has come to rest: lost at 1.4 mm off, and not found again.
        Found{54, 1, MovingVariant::kOdometry, 20}));

// An arm of 27 % that rests before a camera that drives: its top is met at a flat angle, in other points each time, and
// it was taken to move for ever (.020 of all still pixels, .25 of those of a frame).
TEST(FoundOnceAtRest, IsLetGo) {
  const MovingSample sample = draw_moving_sample(moving_test::startup.token(), 54, 17);
  const MovingFilm film = film_moving(moving_test::startup.token(), sample, false);
  const MovingRun run = run_moving(moving_test::startup.token(), sample, film,
                                   MovingVariant::kAlone, {20, 0, false}, nullptr);
  EXPECT_LE(run.masked_still, 0.01);
  EXPECT_LE(run.masked_still_p95, 0.03);
}

TEST(MovingSettings, SpreadTakesThemInTurnAndNoneIsLeftOut) {
  MovingOptions o;
  o.voxels_mm = {20, 10};
  o.levels = {0, 1, 2};
  MovingSample sample;
  EXPECT_EQ(settings_of(sample, o).size(), 6U);
  o.spread = true;
  std::map<std::tuple<double, int, int, bool>, int> seen;
  for (sample.index = 0; sample.index < 144; ++sample.index) {
    const std::vector<MovingSetting> one = settings_of(sample, o);
    ASSERT_EQ(one.size(), 1U);
    const int kind = sample.index % 6;
    ++seen[{one[0].voxel_mm, one[0].level, kind, (sample.index / 6 + sample.index) % 2 == 0}];
  }
  EXPECT_EQ(seen.size(), 72U);  // settings, movers, halves of the shares
  for (const auto& [key, n] : seen) EXPECT_EQ(n, 2);
}

}  // namespace
}  // namespace teletact
