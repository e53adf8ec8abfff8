// teletact accuracy weighting, small: which runs there are, that a setting reaches the tracker, and
// what the watch is for.
#include "tools/measure/accuracy/weighting_study.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <sstream>

#include "tools/record/scenes.hpp"

namespace teletact {
namespace {

const StudyRow* find(const Study& study, const std::string& data, const std::string& setting) {
  for (const StudyRow& row : study.rows) {
    if (row.data == data && row.setting == setting) return &row;
  }
  return nullptr;
}

TEST(Weighting, EverySettingWithTheWatchAndWithout) {
  WeightingOptions o;
  o.scenes = {"room", "stairs"};
  o.frames = 12;
  o.samples = 1;
  std::ostringstream progress;
  const Study study = study_weighting(progress, o);
  ASSERT_EQ(study.rows.size(), 3U * 8U);
  EXPECT_EQ(std::count_if(study.rows.begin(), study.rows.end(),
                          [](const StudyRow& r) { return r.is_default; }),
            3);
  for (const char* data : {"chosen_room_20mm", "unseen_stairs_20mm"}) {
    for (const char* setting : {"uniform", "noise", "default", "steep"}) {
      for (const char* watch : {"_watch", "_plain"}) {
        const StudyRow* row = find(study, data, std::string(setting) + watch);
        ASSERT_NE(row, nullptr) << data << setting << watch;
        EXPECT_EQ(row->figure("claimed"), 1) << data << setting << watch;
        EXPECT_GT(row->figure("cpu_ms"), 0) << data << setting << watch;
        EXPECT_LT(row->figure("worst_mm"), 10) << data << setting << watch;
      }
    }
    // Another error each: the weights reach the tracker.
    EXPECT_NE(find(study, data, "uniform_watch")->figure("ate_mm"),
              find(study, data, "steep_watch")->figure("ate_mm"));
    EXPECT_NE(find(study, data, "noise_plain")->figure("ate_mm"),
              find(study, data, "default_plain")->figure("ate_mm"));
  }
  // A box of 9 % of the image, which carries a camera that nobody watches.
  const StudyRow* watched = find(study, "unseen_moving30_20mm", "default_watch");
  const StudyRow* plain = find(study, "unseen_moving30_20mm", "default_plain");
  ASSERT_NE(watched, nullptr);
  ASSERT_NE(plain, nullptr);
  EXPECT_EQ(watched->figure("samples"), 1);
  EXPECT_EQ(watched->figure("wrong"), 0);
  EXPECT_LT(watched->figure("worst_mm"), 20);
  EXPECT_EQ(plain->figure("wrong"), 1);
  EXPECT_GT(plain->figure("worst_mm"), 50);
}

TEST(Weighting, BackwardsIsTheSameImagesAndPosesTheOtherWay) {
  rt::Startup startup;
  const FusionSequence there = synthetic_sequence(startup.token(), scene_named("room"), 3);
  const FusionSequence back = backwards(there);
  ASSERT_EQ(back.size(), 3);
  auto a = std::make_unique<perception::RgbdFrame>(), b = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < 3; ++i) {
    there.frame(2 - i, *a);
    back.frame(i, *b);
    EXPECT_EQ(a->depth_mm, b->depth_mm) << i;
    ASSERT_NE(back.truth(i), nullptr);
    EXPECT_TRUE(back.truth(i)->isApprox(*there.truth(2 - i))) << i;
    there.frame(i, *a);
    EXPECT_EQ(a->exposure, b->exposure) << i;
  }
}

TEST(Weighting, AnUnknownSceneIsRefused) {
  WeightingOptions o;
  o.scenes = {"nowhere"};
  std::ostringstream progress;
  EXPECT_THROW((void)study_weighting(progress, o), std::runtime_error);
}

}  // namespace
}  // namespace teletact
