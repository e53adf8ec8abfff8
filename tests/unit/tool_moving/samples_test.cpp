// Twenty-four fixed samples of a thing that moves, at 20 mm: no limit of `teletact accuracy moving`
// is missed but those listed. Every fourth has whole images and is run at the first and the last
// level; the others have half ones, for time, and the first level alone: the last one of those
// would track 64 x 53 pixels. Six of them, one of each kind of mover, in every run, all where
// TELETACT_WHOLE is set.
#include <gtest/gtest.h>

#include <cstdio>
#include <map>
#include <numeric>
#include <string>
#include <tuple>
#include <vector>

#include "tests/support/whole.hpp"
#include "tests/unit/tool_moving/place.hpp"

namespace teletact {
namespace {

// What is missed today, by name: a miss that is not listed fails, and so does one that is listed
// and not there any more.
struct Missed {
  int sample, level;
  const char* check;
};
constexpr Missed kMissed[] = {
    // A drawer of 4 % of the image, 6.5 mm a frame from the first one on: learned as it goes at a
    // fourth of the pixels.
    {16, 2, "mask_iou.share5"},
    // An arm at 0.9 m that turns by .65 degrees a frame from the first one on: 5.2 mm above the
    // plain run (5 allowed).
    {23, 0, "ate_mm.share30"},
    {23, 0, "ghost_cells"},
    {23, 0, "ghost_nodes"},
    // One cell: the cost map is written every third frame.
    {12, 0, "ghost_cells"},
    {12, 2, "ghost_cells"},
    // Single nodes, two at most, of 20 mm; 18 at level 2 of sample 8.
    {5, 0, "ghost_nodes"},
    {8, 0, "ghost_nodes"},
    {8, 2, "ghost_nodes"},
    {20, 0, "ghost_nodes"},
    {20, 2, "ghost_nodes"},
    {21, 0, "ghost_nodes"},
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

std::vector<int> twenty_four() {
  std::vector<int> all(24);
  std::iota(all.begin(), all.end(), 0);
  return tests::whole_or(all, {0, 1, 2, 3, 5, 16});
}

INSTANTIATE_TEST_SUITE_P(Samples, TwentyFour, ::testing::ValuesIn(twenty_four()));

// Samples of other seeds that once carried the camera, or lost it, whole images. Poses alone are
// judged.
struct Found {
  std::uint64_t seed;
  int sample;
  MovingVariant variant;
  double most_mm;
  MovingSetting setting{20, 0, false};
  double least_claimed = 0.95;
};
class FoundOnce : public ::testing::TestWithParam<Found> {};

TEST_P(FoundOnce, CarriesTheCameraNoMore) {
  const MovingSample sample =
      draw_moving_sample(moving_test::startup.token(), GetParam().seed, GetParam().sample);
  std::printf("  %s\n", sample.text().c_str());
  const MovingFilm film = film_moving(moving_test::startup.token(), sample, false);
  const MovingRun run = run_moving(moving_test::startup.token(), sample, film, GetParam().variant,
                                   GetParam().setting, nullptr);
  std::printf("  %s: claimed %.3f, at most %.1f mm off\n", name_of(GetParam().variant), run.claimed,
              run.worst_mm);
  EXPECT_GE(run.claimed, GetParam().least_claimed);
  EXPECT_LE(run.worst_mm, GetParam().most_mm);
}

const std::vector<Found> kFoundOnce{
    // A box of half of the image that creeps by 2 mm a frame: no frame contradicts odometry, ten
    // do. 127 mm.
    Found{7, 6, MovingVariant::kOdometry, 20},
    // A door that is most of the image, and leaps beside what is expected of the camera. 550 mm.
    Found{51, 3, MovingVariant::kAlone, 20},
    // A drawer of 29 % that faces the camera; of the rest little more than a tenth does. 450 mm.
    Found{51, 22, MovingVariant::kAlone, 20},
    // An arm at half a metre that has come to rest: its leverage left one direction to chance. 246
    // mm.
    Found{53, 5, MovingVariant::kOdometry, 20},
    // A box of half of the image leaps by 75 mm from one frame to the next: a mean of both motions
    // fitted all of it loosely, and nothing asked. 500 mm.
    Found{54, 6, MovingVariant::kAlone, 20},
    // A ball of 42 % that has come to rest: lost at 1.4 mm off, and not found again.
    Found{54, 1, MovingVariant::kOdometry, 20},
    // A person of 40 % leaps by 98 mm a frame: what came into view met no surface, the camera was
    // lost with its place known to half a millimetre, and not found again (claimed .341).
    Found{101, 116, MovingVariant::kAlone, 10, {10, 0, false}},
    // An arm of 39 % that came to rest, and was not in the map yet: lost 2.2 mm off, and not found
    // again (.854).
    Found{101, 245, MovingVariant::kOdometry, 10, {20, 2, false}},
    // A drawer of 37 % goes out and in by 91 mm a frame: back in its place it was forgotten, and
    // then carried the camera 466 mm. Without it one direction is hardly constrained: some frames
    // are not claimed.
    Found{101, 106, MovingVariant::kAlone, 20, {20, 2, false}, 0.5},
    // Things of .4 and more from the first frame on: the map began with them, and their motion
    // passed for the camera's (103 and 128 frames claimed more than 50 mm off). Unclaimed is right.
    Found{404, 54, MovingVariant::kAlone, 50, {20, 0, false}, 0.03},
    Found{101, 202, MovingVariant::kAlone, 50, {20, 0, false}, 0.8}};
// Of each sort of fault one in every run: what creeps, what leaps, what came to rest at the last
// level, what moves from the first frame on.
INSTANTIATE_TEST_SUITE_P(Seeds, FoundOnce,
                         ::testing::ValuesIn(tests::whole_or(kFoundOnce, {0, 4, 7, 9})));

// Things that the mask once missed.
struct Unseen {
  std::uint64_t seed;
  int sample, level;
  double least_iou;
};
class FoundUnmasked : public ::testing::TestWithParam<Unseen> {};

TEST_P(FoundUnmasked, IsMasked) {
  const Unseen& p = GetParam();
  const MovingSample sample = draw_moving_sample(moving_test::startup.token(), p.seed, p.sample);
  std::printf("  %s\n", sample.text().c_str());
  const MovingFilm film = film_moving(moving_test::startup.token(), sample, false);
  const MovingRun run = run_moving(moving_test::startup.token(), sample, film,
                                   MovingVariant::kAlone, {20, p.level, false}, nullptr);
  std::printf("  IoU %.3f, still pixels %.4f\n", run.mask_iou, run.masked_still);
  EXPECT_GE(run.mask_iou, p.least_iou);
  EXPECT_LE(run.masked_still, 0.01);
}

INSTANTIATE_TEST_SUITE_P(
    Seeds, FoundUnmasked,
    ::testing::Values(
        // An arm at 0.9 m that turns round: back over places that it had filled, and taken to
        // stand.
        Unseen{101, 239, 1, 0.8},
        // An arm at 1.6 m, a few coarse pixels thick: nothing of it has an inside.
        Unseen{101, 227, 0, 0.6}));

// An arm of 27 % that rests before a camera that drives: its top is met at a flat angle, in other
// points each time, and it was taken to move for ever (.020 of all still pixels, .25 of those of a
// frame).
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
