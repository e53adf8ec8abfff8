// What segmentation must reach with the setting that the product has, on real images: one touch an
// object, several clicks, and whole images against people; on drawn clutter: several clicks.
// Skipped where the images are not. Figures are those of `teletact bench segmentation`, `teletact
// accuracy clicks` and `teletact bench table2`.
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <sstream>

#include "tests/support/paths.hpp"
#include "tools/measure/accuracy/clicks_study.hpp"
#include "tools/measure/bench/table2/table2.hpp"
#include "tools/measure/bench/table2/touches.hpp"

namespace teletact {
namespace {

const std::string kData = tests::in_tree("../shared/data");

double touch_iou(const char* folder) {
  std::ostringstream silent;
  const auto result = bench_touches(silent, kData + "/rgbd_objects/" + folder, 1, {}, true);
  EXPECT_EQ(result.rows.size(), 1u);
  const TouchRow& row = result.rows.front();
  std::printf("  %s: %d frames, %d objects, %d touches, seed 1: IoU %.4f\n", folder, row.frames,
              row.objects, row.touches, row.iou_default);
  EXPECT_EQ(row.touches, 10 * row.objects);
  return row.iou_default;
}

TEST(SegmentationLimits, OneTouchOnMosd) {
  if (!std::filesystem::exists(kData + "/rgbd_objects/mosd_learn"))
    GTEST_SKIP() << "no images at " << kData << "/rgbd_objects/mosd_learn";
  EXPECT_GE(touch_iou("mosd_learn"), 0.85);
}

TEST(SegmentationLimits, OneTouchOnTabletop) {
  if (!std::filesystem::exists(kData + "/rgbd_objects/tabletop"))
    GTEST_SKIP() << "no images at " << kData << "/rgbd_objects/tabletop";
  EXPECT_GE(touch_iou("tabletop"), 0.80);
}

double iou_of_clicks(const StudyRow& row, int clicks) {
  const double iou = 1 - row.figure("error_" + std::to_string(clicks));
  std::printf("  %s: IoU %.4f after %d clicks\n", row.data.c_str(), iou, clicks);
  return iou;
}

TEST(SegmentationLimits, ClicksOnRealImages) {
  ClicksStudyOptions options;
  options.data = kData + "/rgbd_objects";
  if (!std::filesystem::exists(options.data)) GTEST_SKIP() << "no images at " << options.data;
  options.clutter = 0;
  options.knobs = false;
  std::ostringstream silent;
  const Study study = study_clicks(silent, options);
  ASSERT_EQ(study.rows.size(), 3u);
  for (const StudyRow& row : study.rows) EXPECT_GE(iou_of_clicks(row, 3), 0.90) << row.data;
}

// The aim on harder scenes is .85 after three. Constants were chosen on seeds 200 to 211; here .886
// without levels of joining, .778 without a support of two colours as well.
TEST(SegmentationLimits, ClicksOnDrawnClutter) {
  ClicksStudyOptions options;
  options.clutter = 10;
  options.seed = 100;
  options.knobs = false;
  std::ostringstream silent;
  const Study study = study_clicks(silent, options);
  ASSERT_EQ(study.rows.size(), 1u);
  EXPECT_GE(iou_of_clicks(study.rows.front(), 3), 0.90);
  EXPECT_GE(iou_of_clicks(study.rows.front(), 5), 0.90);
}

TEST(SegmentationLimits, WholeImagesAgainstPeople) {
  const std::string folder = kData + "/bsds500";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no images at " << folder;
  std::ostringstream silent;
  const Table2Result result = bench_table2(silent, folder, true);
  const Table2Row& ours = result.ours;
  std::printf("  %d images: PRI %.4f, BDE %.3f px, GCE %.4f, VOI %.3f bit, regions %.2f\n",
              result.images, ours.mean.pri, ours.mean.bde_px, ours.mean.gce, ours.mean.voi_bits,
              ours.region_ratio);
  EXPECT_GE(result.images, 20);
  EXPECT_GE(ours.mean.pri, 0.80);
  EXPECT_LE(ours.mean.bde_px, 12.5);
  EXPECT_LE(ours.mean.gce, 0.22);
  EXPECT_LE(ours.mean.voi_bits, 2.2);
  EXPECT_GE(ours.region_ratio, 0.5);
  EXPECT_LE(ours.region_ratio, 2.0);
}

}  // namespace
}  // namespace teletact
