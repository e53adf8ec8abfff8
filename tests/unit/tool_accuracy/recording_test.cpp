// teletact accuracy recording, small: which images an order holds, and that a wrong claim and a
// lost frame are counted.
#include "tools/measure/accuracy/recording_study.hpp"

#include <gtest/gtest.h>

#include <sstream>

#include "tools/record/scenes.hpp"

namespace teletact {
namespace {

TEST(RecordingStudy, AnOrderHoldsItsImages) {
  EXPECT_EQ(images_of(Order::kForwards, 3, 5), (std::vector<int>{2, 3, 4}));
  EXPECT_EQ(images_of(Order::kBackwards, 1, 4), (std::vector<int>{3, 2, 1, 0}));
  EXPECT_EQ(images_of(Order::kBackwards, 3, 4), (std::vector<int>{1, 0}));
  EXPECT_EQ(images_of(Order::kEverySecond, 2, 7), (std::vector<int>{1, 3, 5}));
  EXPECT_EQ(images_of(Order::kEverySecond, 7, 7), (std::vector<int>{6}));
}

FusionSequence some_room(int frames) {
  rt::Startup startup;
  return synthetic_sequence(startup.token(), scene_named("room"), frames);
}

RecordingStudyOptions small() {
  RecordingStudyOptions o;
  o.voxels_mm = {40};
  o.level_voxels_mm = {40};
  o.levels = {0, 1};
  o.start_step = 8;
  o.least_frames = 8;
  return o;
}

TEST(RecordingStudy, EveryOrderAndStartIsHeldAgainstItsOwnPoses) {
  std::ostringstream progress, out;
  const RecordingStudy study = study_recording(progress, some_room(16), small());
  ASSERT_EQ(study.starts.size(), 6U);  // of each order: from 1, from 9
  ASSERT_EQ(study.levels.size(), 2U);
  for (const RecordingRow& r : study.starts) {
    SCOPED_TRACE(std::string(name_of(r.order)) + " from " + std::to_string(r.start));
    const int left = 17 - r.start;
    EXPECT_EQ(r.frames, r.order == Order::kEverySecond ? (left + 1) / 2 : left);
    EXPECT_EQ(r.claimed, r.frames);
    EXPECT_EQ(r.wrong, 0);
    EXPECT_LT(r.worst_mm, 15);  // voxels of 40 mm
    EXPECT_GT(r.worst_mm, 0.01);
  }
  EXPECT_NE(study.levels[0].ate_mm, study.levels[1].ate_mm) << "the level reaches the task";
  EXPECT_EQ(missed(study.limits().all()), 0);
  study.print(out);
  EXPECT_NE(out.str().find("backwards"), std::string::npos);
}

TEST(RecordingStudy, AClaimFarFromTheTruthIsWrong) {
  FusionSequence room = some_room(10);
  room.truth_WC[6]->translation().x() += 0.1;
  RecordingStudyOptions o = small();
  o.levels = {0};
  std::ostringstream progress;
  const RecordingStudy study = study_recording(progress, room, o);
  EXPECT_EQ(study.starts.front().wrong, 1);
  EXPECT_NEAR(study.starts.front().worst_mm, 100, 15);
  EXPECT_EQ(missed(study.limits().all()), 1);
  o.wrong_mm = 150;
  EXPECT_EQ(missed(study_recording(progress, room, o).limits().all()), 0);
}

TEST(RecordingStudy, AFrameThatIsNotClaimedIsMissedAndNotWrong) {
  FusionSequence room = some_room(6), broken;
  broken.name = "broken";
  broken.truth_WC = room.truth_WC;
  auto image = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < room.size(); ++i) {
    room.frame(i, *image);
    if (i == 3) std::fill(image->depth_mm.begin(), image->depth_mm.end(), std::uint16_t{0});
    broken.append(*image);
  }
  RecordingStudyOptions o = small();
  o.levels = {0};
  std::ostringstream progress;
  const RecordingStudy study = study_recording(progress, broken, o);
  ASSERT_EQ(study.levels.size(), 1U);
  EXPECT_EQ(study.levels[0].frames - study.levels[0].claimed, 1);
  EXPECT_EQ(study.levels[0].lost, 1);
  EXPECT_EQ(study.levels[0].wrong, 0);
  EXPECT_EQ(missed(study.limits().all()), 1);
}

TEST(RecordingStudy, WithoutTruthItIsRefused) {
  FusionSequence room = some_room(5);
  room.truth_WC.clear();
  std::ostringstream progress;
  EXPECT_THROW(static_cast<void>(study_recording(progress, room, small())), std::runtime_error);
}

}  // namespace
}  // namespace teletact
