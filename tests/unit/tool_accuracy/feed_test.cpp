// What the tools share: how images reach the task, and how far off its claims are.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {
namespace {

using perception::Pose;
using perception::Vec3;

TEST(ClaimedError, IsWhatIsLeftWhenTheFirstClaimIsAligned) {
  const std::uint64_t seed = 61;
  rt::Random random(seed);
  ClaimedError none, same, off;
  EXPECT_TRUE(std::isnan(none.ate_mm()));
  EXPECT_TRUE(std::isnan(none.worst_mm()));
  // The map's frame is any frame; errors of 3, 4 and 12 mm after a first claim without one.
  const Pose X_MT = looking(Vec3(0.3, -2, 1), 0.7, 0.2, -0.4);
  const double error_mm[] = {0, 3, 4, 12};
  for (const double e : error_mm) {
    const Vec3 eye(random.uniform(), random.uniform(), random.uniform());
    const Pose truth = looking(eye, 6 * random.uniform(), random.uniform());
    const Vec3 way = Vec3(random.normal(), random.normal(), random.normal()).normalized();
    same.add(X_MT * truth, truth);
    off.add(X_MT * Eigen::Translation3d(1e-3 * e * way) * truth, truth);
  }
  EXPECT_LT(same.worst_mm(), 1e-9) << "seed " << seed;
  EXPECT_NEAR(off.worst_mm(), 12, 1e-9);
  EXPECT_NEAR(off.ate_mm(), 6.5, 1e-9) << "sqrt((9 + 16 + 144) / 4)";
}

TEST(FusionFeed, HandsInWhatItsFrameHolds) {
  rt::Startup startup;
  const FusionSequence sequence = synthetic_sequence(startup.token(), furnished_room(), 3);
  tasks::FusionConfig config;
  config.tsdf.voxel_size_m = 0.04;
  config.view_period_frames = 0;
  tasks::FusionSetup setup;
  setup.camera = sequence.intrinsics;
  tasks::FusionTask task(startup.token(), config, setup);
  FusionFeed feed(task);
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, feed.frame());
    const auto& out = feed.step();
    EXPECT_TRUE(out.camera_written && out.camera.claimed && out.patch_written) << i;
    EXPECT_FALSE(out.view_written);
    EXPECT_EQ(out.camera.exposure, feed.frame().exposure);
    EXPECT_EQ(task.frames(), static_cast<std::uint64_t>(i) + 1);
    EXPECT_GT(feed.cpu_ms(), 0);
    EXPECT_EQ(&feed.out(), &out);
  }
  // Windows at other hands, of the same map and the same instant.
  auto there = std::make_unique<perception::SurfacePatch>();
  auto here = std::make_unique<perception::SurfacePatch>();
  feed.in.hand.seq = 1;
  feed.in.hand.p_WH = Vec3(0, 0, 1);
  feed.look(*here);
  feed.in.hand.p_WH = Vec3(0.8, 0, 1);
  feed.look(*there);
  EXPECT_FALSE(feed.out().camera_written);
  EXPECT_EQ(task.frames(), static_cast<std::uint64_t>(sequence.size()));
  EXPECT_EQ(there->fused, feed.frame().exposure);
  EXPECT_EQ(there->seq, here->seq + 1);
  EXPECT_EQ(there->origin_node[0] - here->origin_node[0], 20);
}

}  // namespace
}  // namespace teletact
