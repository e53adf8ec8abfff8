// What the benches of fusion say of their own figures.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

#include "tools/measure/accuracy/fusion_study.hpp"
#include "tools/measure/bench/drift.hpp"
#include "tools/measure/bench/fusion_peer.hpp"

namespace teletact {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <class Result>
std::string printed(const Result& r) {
  std::ostringstream text;
  r.print(text);
  return text.str();
}

TEST(Verdict, DriftNamesEachLimit) {
  DriftResult good;
  good.frames = good.claimed = 500;
  good.worst_mm = 1.5, good.first_mm = 0.4, good.last_mm = 0.69, good.orthonormal = 1e-12;
  EXPECT_EQ(good.missed(), 0);
  EXPECT_THAT(printed(good), HasSubstr("4 met, 0 MISSED"));
  for (const auto spoil : std::initializer_list<void (*)(DriftResult&)>{
           [](DriftResult& r) { r.claimed = 499; }, [](DriftResult& r) { r.worst_mm = 2.1; },
           [](DriftResult& r) { r.last_mm = 0.71; }, [](DriftResult& r) { r.orthonormal = 2e-9; },
           [](DriftResult& r) { r.worst_mm = kNaN; }}) {
    DriftResult bad = good;
    spoil(bad);
    EXPECT_EQ(bad.missed(), 1);
    EXPECT_THAT(printed(bad), HasSubstr(" MISSED\n"));
  }
}

TEST(Verdict, TenthsOfAShortRunAreNotCompared) {
  DriftResult brief;
  brief.frames = brief.claimed = 40;
  brief.worst_mm = 1, brief.first_mm = 0, brief.last_mm = 0.8;
  EXPECT_EQ(brief.missed(), 0);
  EXPECT_THAT(printed(brief), HasSubstr("not measured: fewer than 200 frames"));
}

bool met(const FusionPeerRow& row) {
  FusionPeerResult r;
  r.rows.push_back(row);
  return r.missed() == 0;
}

TEST(Verdict, PeersHaveTargets) {
  FusionPeerRow row;
  row.name = "opencv hashtsdf";
  row.ratio = 30.1, row.ate_mm = 31, row.ours_ate_mm = 30;
  EXPECT_EQ(row.least_ratio(), 30);
  EXPECT_TRUE(met(row));
  row.ratio = 29.9;
  EXPECT_FALSE(met(row));
  row.ratio = 31, row.ate_mm = 29;
  EXPECT_FALSE(met(row)) << "less precise than the peer";
  row.ours_ate_mm = kNaN;
  EXPECT_FALSE(met(row)) << "ours was lost";
  row.ate_mm = kNaN;
  EXPECT_TRUE(met(row)) << "no truth";
  row.name = "open3d", row.ratio = 9.5;
  EXPECT_TRUE(met(row));
  row.ratio = 8.5;
  EXPECT_FALSE(met(row));
  row.name = "teletact", row.ratio = 1;
  EXPECT_EQ(row.least_ratio(), 0);
  FusionPeerResult result;
  result.rows.push_back(row);
  EXPECT_THAT(printed(result), Not(HasSubstr("met")));
  row.name = "open3d";
  result.rows.push_back(row);
  EXPECT_THAT(printed(result), HasSubstr(">= 9, our ATE"));
  EXPECT_THAT(printed(result), HasSubstr(" MISSED\n"));
}

TEST(Verdict, MissedPeersAreCountedWhereTheyWereMeasured) {
  FusionPeerRow met, missed, absent, ours;
  met.name = missed.name = absent.name = "open3d";
  met.ratio = 10, missed.ratio = 8;
  absent.absent = "not installed";
  ours.name = "teletact";
  FusionPeerResult result;
  result.rows = {ours, met, absent};
  EXPECT_EQ(result.missed(), 0);
  result.rows.push_back(missed);
  EXPECT_EQ(result.missed(), 1);
  result.other_load = 0.2;
  EXPECT_EQ(result.missed(), 0) << "not measured";
}

TEST(Verdict, ARecordingThatIsNotThereIsSaidBeforeTheScenes) {
  std::ostringstream progress;
  FusionStudyOptions options;
  options.scenes = {"room"};
  options.frames = 2;
  options.voxels_mm = {80};
  options.rgbd = "/nonexistent";
  EXPECT_THROW((void)study_fusion(progress, options), std::runtime_error);
  EXPECT_THAT(progress.str(), Not(HasSubstr("rendering")));
}

TEST(Verdict, AnErrorCountsOnlyWhereEnoughWasClaimed) {
  const auto names = [](double claimed) {
    StudyRow row;
    row.figures = {{"cpu_ms", 9, "ms"},
                   {"ate_mm", 2, "mm"},
                   {"surface_rmse_mm", kNaN, "mm"},
                   {"claimed", claimed, "1"}};
    std::string all;
    for (const auto& m : counted_figures(row)) all += m.name + " ";
    return all;
  };
  EXPECT_EQ(names(0.98), "cpu_ms ate_mm claimed ");
  EXPECT_EQ(names(0.975), "cpu_ms claimed ");
}

}  // namespace
}  // namespace teletact
