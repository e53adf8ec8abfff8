// What the stages cost on this machine (thread CPU time), printed; the limits are loose on purpose.
#include <gtest/gtest.h>

#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "perception/tsdf/patch/patch_copy.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

TEST(Cost, OfEachStageInARoom) {
  rt::Startup startup;
  const Scene scene = room();
  const Intrinsics k = kinect2();
  constexpr int kFrames = 6;
  std::vector<Pose> poses;
  std::vector<Frame> frames;
  for (int n = 0; n < kFrames; ++n) {
    poses.push_back(look_at(Vec3(-1.6 + 0.01 * n, 0.1, 1.2), Vec3(1.5, 0.2 + 0.02 * n, 0.7)));
    frames.push_back(
        render(scene, k, poses.back(), 0.0008, 0.01, rt::Random(7, static_cast<std::uint64_t>(n))));
  }
  auto patch = std::make_unique<SurfacePatch>();
  for (const double voxel : {0.01, 0.02}) {
    for (const int step : {1, 2}) {
      TsdfConfig config;
      config.voxel_size_m = voxel;
      TsdfMap map(startup.token(), config);
      RaycastMaps maps(startup.token(), k.width, k.height);
      std::vector<double> fuse, fuse_colour, cast, hinted, copy, sum;
      IntegrateStats last;
      RaycastStats ray, ray_hint;
      Image<float> hint(k.width, k.height);
      for (int n = 0; n < kFrames; ++n) {
        double t = thread_cpu_ms();
        last = map.integrate(frames[static_cast<std::size_t>(n)].view(n % 2 == 1),
                             poses[static_cast<std::size_t>(n)], step);
        ASSERT_FALSE(last.refused);
        ASSERT_EQ(last.blocks_refused, 0);
        (n % 2 == 1 ? fuse_colour : fuse).push_back(thread_cpu_ms() - t);
        t = thread_cpu_ms();
        RaycastOptions o;
        o.pixel_step = step;
        ray = raycast(map, k, poses[static_cast<std::size_t>(n)], o, maps);
        cast.push_back(thread_cpu_ms() - t);
        for (int i = 0; i < k.width * k.height; ++i)
          hint.data()[i] =
              static_cast<float>(frames[static_cast<std::size_t>(n)].depth.data()[i]) * 1e-3F;
        o.hint_depth_m = hint.view();
        t = thread_cpu_ms();
        ray_hint = raycast(map, k, poses[static_cast<std::size_t>(n)], o, maps);
        hinted.push_back(thread_cpu_ms() - t);
        t = thread_cpu_ms();
        ASSERT_TRUE(copy_patch(map, Vec3(1.0, 0.3, 0.9), 64, *patch));
        copy.push_back(thread_cpu_ms() - t);
        t = thread_cpu_ms();
        patch->checksum = patch_checksum(*patch);
        sum.push_back(thread_cpu_ms() - t);
      }
      std::printf(
          "voxel %.0f mm step %d: integrate %.2f (first %.2f), with colour %.2f, raycast %.2f, "
          "hinted "
          "%.2f, patch %.3f, checksum %.3f ms\n"
          "    blocks %d chunks %d, updated %d, fused %lld carved %lld free tests %lld, pixels %d; "
          "rays %d "
          "hits %d steps/ray %.1f, hinted %.1f; memory %.0f MiB\n",
          voxel * 1e3, step, quantile(fuse, 0.5), fuse[0], quantile(fuse_colour, 0.5),
          quantile(cast, 0.5), quantile(hinted, 0.5), quantile(copy, 0.5), quantile(sum, 0.5),
          map.block_count(), map.chunk_count(), last.blocks_updated,
          static_cast<long long>(last.voxels_fused), static_cast<long long>(last.voxels_carved),
          static_cast<long long>(last.free_tests), last.pixels, ray.rays, ray.hits,
          static_cast<double>(ray.steps) / ray.rays,
          static_cast<double>(ray_hint.steps) / ray_hint.rays,
          static_cast<double>(map.memory_bytes()) / 1048576.0);
      EXPECT_GT(ray.hits, ray.rays * 9 / 10);
      EXPECT_LT(quantile(fuse, 0.5), 200);
      EXPECT_LT(quantile(copy, 0.5), 20);
    }
  }
}

}  // namespace
}  // namespace tests
