// Truth beside a recording is asked by stamp: files with another rate, another start and holes.
#include "tools/files/pose_file.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "rt/random.hpp"
#include "tests/unit/drivers_camera/tum_folder.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {
namespace {

using camera_test::TumFolder;
using perception::Pose;
using perception::Vec3;

// Even speed, turning about one axis: what lies between two lines is known exactly.
Pose on_the_way(double t_s) {
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(0.4 + 0.7 * t_s, Vec3(1, -2, 0.5).normalized()).toRotationMatrix();
  X.translation() = Vec3(0.2, -1, 0.3) + t_s * Vec3(0.4, 0.1, -0.3);
  return X;
}

std::string line_of(double t_s, const Pose& X) {
  const Eigen::Quaterniond q(X.linear());
  const Vec3 p = X.translation();
  char line[256];
  std::snprintf(line, sizeof line, "%.4f %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n", t_s, p.x(), p.y(),
                p.z(), q.x(), q.y(), q.z(), q.w());
  return line;
}

TEST(PoseFile, BetweenTwoLinesLiesWhatWasThere) {
  const std::uint64_t seed = 77;
  rt::Random random(seed);
  std::vector<StampedPose> poses;
  for (double t = 3; t < 5; t += random.uniform(0.002, 0.038)) poses.push_back({t, on_the_way(t)});
  for (int n = 0; n < 1000; ++n) {
    const double t = random.uniform(3, poses.back().t_s);
    const auto X = pose_at(poses, t);
    ASSERT_TRUE(X) << "t " << t << ", seed " << seed;
    // A line within 10 us is taken as it is: 0.5 m/s and 0.7 rad/s for so long.
    const bool line = std::any_of(poses.begin(), poses.end(), [&](const StampedPose& p) {
      return std::abs(p.t_s - t) <= 1e-5;
    });
    EXPECT_LT((X->matrix() - on_the_way(t).matrix()).norm(), line ? 2e-5 : 1e-9)
        << "t " << t << ", seed " << seed;
  }
}

TEST(PoseFile, HolesAndEndsTellNothing) {
  std::vector<StampedPose> poses;
  for (const double t : {1.0, 1.03, 1.08, 1.1}) poses.push_back({t, on_the_way(t)});
  EXPECT_TRUE(pose_at(poses, 1.015));
  EXPECT_FALSE(pose_at(poses, 1.035)) << "a hole of 50 ms, 20 ms from a line at most";
  EXPECT_FALSE(pose_at(poses, 1.055));
  EXPECT_TRUE(pose_at(poses, 1.055, 0.03));
  EXPECT_TRUE(pose_at(poses, 1.08)) << "a line itself";
  EXPECT_TRUE(pose_at(poses, 1.080005)) << "its stamp, rounded";
  EXPECT_TRUE(pose_at(poses, 0.999995));
  EXPECT_FALSE(pose_at(poses, 0.999));
  EXPECT_FALSE(pose_at(poses, 1.101));
  EXPECT_FALSE(pose_at({}, 1));
}

TEST(PoseFile, TruthOfARecordingIsThatOfItsStamps) {
  const TumFolder folder(5);  // from 100 s on, 30 Hz
  std::string text = "# motion capture: 100 Hz, an earlier start, a hole over the fourth frame\n";
  for (double t = 98.7312; t < 101; t += 0.01)
    if (!(t > 100.06 && t < 100.12)) text += line_of(t, on_the_way(t));
  folder.write("groundtruth.txt", text);
  std::ostringstream said;
  const FusionSequence sequence = recorded_sequence(said, folder.path(), {});
  ASSERT_EQ(sequence.size(), 5);
  ClaimedError error;
  for (int i = 0; i < 5; ++i) {
    const double t = 100 + i / 30.0;
    if (i == 2 || i == 3) {
      EXPECT_EQ(sequence.truth(i), nullptr) << i;
      continue;
    }
    ASSERT_NE(sequence.truth(i), nullptr) << i;
    error.add(on_the_way(t), *sequence.truth(i));
  }
  EXPECT_LT(error.worst_mm(), 0.1) << "stamps of 0.1 ms at half a metre a second";
  EXPECT_EQ(sequence.known_truth().size(), 3u);
  EXPECT_EQ(sequence.truth(5), nullptr);
}

TEST(PoseFile, ASpoiltTruthIsNamed) {
  const TumFolder folder(5);
  folder.write("groundtruth.txt", "100 0 0 0 0 0 0 1\n100.1 0 0 zero 0 0 0 1\n");
  try {
    std::ostringstream said;
    static_cast<void>(recorded_sequence(said, folder.path(), {}));
    FAIL() << "no error";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("groundtruth.txt:2: tz is not a finite number: 'zero'"),
              std::string::npos)
        << e.what();
  }
}

TEST(RecordedSequence, HasTheFramesThereAre) {
  const TumFolder folder(5);
  std::ostringstream said;
  EXPECT_EQ(recorded_sequence(said, folder.path(), {150, 5, {}}).size(), 5);
  EXPECT_NE(said.str().find("5 of 5 frames, true poses of 0\n"), std::string::npos) << said.str();
  EXPECT_EQ(recorded_sequence(said, folder.path(), {3, 2, {}}).size(), 3);
  try {
    static_cast<void>(recorded_sequence(said, folder.path(), {150, 12, {}}));
    FAIL() << "no error";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("5 frames; at least 12 are needed"), std::string::npos)
        << e.what();
  }
}

// The files of 7-Scenes as they are downloaded.
TEST(PoseFile, PosesOf7ScenesBelongToTheirFrames) {
  const TumFolder folder(4);
  std::filesystem::remove(folder.file("associations.txt"));
  std::filesystem::remove(folder.file("intrinsics.txt"));
  for (int i = 0; i < 4; ++i) {
    const std::string from = std::to_string(i) + ".png",
                      frame = folder.file("frame-00020" + std::to_string(i));
    std::filesystem::copy(folder.file("depth/" + from), frame + ".depth.png");
    std::filesystem::copy(folder.file("rgb/" + from), frame + ".color.png");
    if (i == 2) continue;
    std::ofstream pose(frame + ".pose.txt");
    pose.precision(8);
    pose << on_the_way(i).matrix() << "\n";
  }
  std::ostringstream said;
  RecordingOptions options;
  options.pinhole = {30, 31, 15.5, 11.5, 0};
  const FusionSequence sequence = recorded_sequence(said, folder.path(), options);
  ASSERT_EQ(sequence.size(), 4);
  for (int i = 0; i < 4; ++i) {
    ASSERT_EQ(sequence.truth(i) != nullptr, i != 2) << i;
    if (i == 2) continue;
    EXPECT_LT((sequence.truth(i)->matrix() - on_the_way(i).matrix()).norm(), 1e-6);
  }
  folder.write("frame-000201.pose.txt", "1 0 0 0\n0 1 0 0\n0 0 2 0\n0 0 0 1\n");
  EXPECT_THROW(static_cast<void>(recorded_sequence(said, folder.path(), options)),
               std::runtime_error);
}

}  // namespace
}  // namespace teletact
