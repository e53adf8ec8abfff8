// The voxel vote and what it promises; the summary of an object.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <vector>

#include "perception/segmentation/label_vote.hpp"
#include "perception/segmentation/object_summary.hpp"
#include "rt/random.hpp"

namespace {

using namespace perception;

TEST(LabelVote, RuleWordForWord) {
  LabelVoxel x;
  vote(x, 3);
  EXPECT_EQ(x.label, 3);
  EXPECT_EQ(x.weight, 1);
  for (int i = 0; i < 100; ++i) vote(x, 3);
  EXPECT_EQ(x.weight, 32);
  vote(x, 0);  // background votes too
  EXPECT_EQ(x.label, 3);
  EXPECT_EQ(x.weight, 31);
  for (int i = 0; i < 30; ++i) vote(x, 7);
  EXPECT_EQ(x.label, 3);
  EXPECT_EQ(x.weight, 1);
  vote(x, 7);
  EXPECT_EQ(x.label, 7);
  EXPECT_EQ(x.weight, 1);
}

TEST(LabelVote, OnlyNearTheSurfaceAndInsideTheImage) {
  Image<std::uint8_t> image(4, 3, 9);
  image.at(2, 1) = kNoVote;
  LabelVoxel x;
  vote_at(x, image.view(), 1, 1, 0.0201F);
  vote_at(x, image.view(), 1, 1, -0.0201F);
  vote_at(x, image.view(), 4, 1, 0);
  vote_at(x, image.view(), -1, 0, 0);
  vote_at(x, image.view(), 2, 1, 0);
  EXPECT_EQ(x.weight, 0);
  vote_at(x, image.view(), 1, 1, 0.0199F);
  EXPECT_EQ(x.label, 9);
}

// A strip of voxels, each seen by one pixel: object 1 in the middle, a neighbour 2 beside it.
struct Strip {
  static constexpr int kVoxels = 400, kFirst = 100, kLast = 300;
  std::vector<LabelVoxel> voxels = std::vector<LabelVoxel>(kVoxels);
  rt::Random random{77};

  static std::uint8_t truth(int i) { return i >= kFirst && i < kLast ? 1 : i >= kLast ? 2 : 0; }
  // Empty, dilated by 12, or the neighbour's mask, at random.
  std::uint8_t wrong(int kind, int i) const {
    if (kind == 0) return truth(i) == 1 ? 0 : truth(i);
    if (kind == 1) return i >= kFirst - 12 && i < kLast + 12 ? 1 : truth(i);
    return truth(i) == 2 ? 1 : truth(i) == 1 ? 0 : truth(i);
  }
  void good() {
    for (int i = 0; i < kVoxels; ++i) vote(voxels[static_cast<std::size_t>(i)], truth(i));
  }
  void bad() {
    const int kind = static_cast<int>(random.integer(0, 2));
    for (int i = 0; i < kVoxels; ++i) vote(voxels[static_cast<std::size_t>(i)], wrong(kind, i));
  }
  [[nodiscard]] double iou() const {
    double both = 0, either = 0;
    for (int i = 0; i < kVoxels; ++i) {
      const bool a = voxels[static_cast<std::size_t>(i)].label == 1, b = truth(i) == 1;
      both += a && b ? 1 : 0;
      either += a || b ? 1 : 0;
    }
    return both / either;
  }
};

TEST(LabelVote, OneFrameInFiveWrongChangesNothing) {
  Strip s;
  for (int i = 0; i < 5; ++i) s.good();
  for (int frame = 0; frame < 300; ++frame) {
    if (s.random.uniform() < 0.2) {
      s.bad();
    } else {
      s.good();
    }
    if (frame > 30) {
      ASSERT_GE(s.iou(), 0.98) << frame;
    }
  }
}

TEST(LabelVote, FiveWrongFramesFirstAreOvercomeWithinFifteen) {
  Strip s;
  for (int i = 0; i < 5; ++i) s.bad();
  for (int i = 0; i < 15; ++i) s.good();
  EXPECT_GE(s.iou(), 0.9);
}

TEST(LabelVote, WhatHasGoneIsVotedOutAfterItsWeight) {
  Strip s;
  for (int i = 0; i < 28; ++i) s.good();
  for (int i = 0; i < 30; ++i) {
    for (auto& x : s.voxels) vote(x, 0);
  }
  for (const auto& x : s.voxels) EXPECT_EQ(x.label, 0);
}

TEST(ObjectSummary, BoxOfKnownPose) {
  const std::uint64_t seed = 9;
  rt::Random random(seed);
  for (int round = 0; round < 10; ++round) {
    const Eigen::Matrix3d R =
        Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
            .normalized()
            .toRotationMatrix();
    const Vec3 centre(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(0.5, 2));
    const Vec3 size(0.30, 0.16, 0.06);
    std::vector<Vec3f> points;
    std::vector<Rgb> colours;
    for (int i = 0; i < 4000; ++i) {
      const Vec3 p(size.x() * (random.uniform() - 0.5), size.y() * (random.uniform() - 0.5),
                   size.z() * (random.uniform() - 0.5));
      points.push_back((centre + R * p).cast<float>());
      colours.push_back({10, 200, static_cast<std::uint8_t>(i % 2 ? 100 : 110)});
    }
    std::vector<float> scratch(points.size());
    const ObjectSummary s = summarise(points, colours, scratch);
    EXPECT_EQ(s.points, 4000);
    EXPECT_LT((s.X_FO.translation() - centre).norm(), 0.005);
    EXPECT_NEAR(s.X_FO.linear().determinant(), 1, 1e-9);
    for (int k = 0; k < 3; ++k) {
      EXPECT_GT(std::abs(s.X_FO.linear().col(k).dot(R.col(k))), 0.99) << "seed " << seed;
      EXPECT_NEAR(s.extent_m[k], 0.98 * size[k], 0.02 * size[k]);  // 1 % is cut at each end
    }
    EXPECT_EQ(s.colour, (Rgb{10, 200, 105}));
  }
  std::vector<float> scratch(2);
  EXPECT_EQ(summarise(std::vector<Vec3f>(2), {}, scratch).points, 0);
}

}  // namespace
