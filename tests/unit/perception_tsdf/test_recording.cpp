// A real recording with its given poses: the field must agree with the images it was made of.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include <opencv2/imgcodecs.hpp>

#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "perception/tsdf/patch/patch_copy.hpp"
#include "tests/support/paths.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

TEST(Recording, FusedKitchenAgreesWithItsFrames) {
  const std::filesystem::path dir = tests::in_tree("../shared/data/rgbd/7scenes_redkitchen");
  if (!std::filesystem::exists(dir / "groundtruth.txt")) GTEST_SKIP() << "no recording at " << dir;
  std::vector<std::pair<std::string, Pose>> frames;
  std::ifstream list(dir / "groundtruth.txt");
  for (std::string line; std::getline(list, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream in(line);
    std::string stamp;
    double t[3], q[4];
    in >> stamp >> t[0] >> t[1] >> t[2] >> q[0] >> q[1] >> q[2] >> q[3];
    Pose X = Pose::Identity();
    X.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized().toRotationMatrix();
    X.translation() = Vec3(t[0], t[1], t[2]);
    frames.emplace_back(stamp, X);
  }
  ASSERT_EQ(frames.size(), 150U);
  // 640 x 480 to 512 x 424 by nearest pixel, as the product does.
  const double scale = 424.0 / 480.0;
  const Intrinsics k{585 * scale, 585 * scale, 256.61, 211.94, 512, 424};
  rt::Startup startup;
  TsdfConfig config;
  config.max_blocks = 20000;
  TsdfMap map(startup.token(), config);
  RaycastMaps maps(startup.token(), k.width, k.height);
  auto patch = std::make_unique<SurfacePatch>();
  Image<std::uint16_t> depth(k.width, k.height);
  Image<float> hint(k.width, k.height);
  std::vector<double> fuse_ms, cast_ms, hint_ms, half_ms, copy_ms, gap_mm;
  std::vector<double> blocks;
  IntegrateStats last;
  for (int n = 0; n < 24; ++n) {
    const auto& [stamp, X] = frames[static_cast<std::size_t>(n)];
    const cv::Mat image =
        cv::imread((dir / "depth" / (stamp + ".png")).string(), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(image.type(), CV_16UC1) << stamp;
    for (int v = 0; v < k.height; ++v)
      for (int u = 0; u < k.width; ++u) {
        const int x = static_cast<int>(std::lround((u - k.cx) / k.fx * 585 + 320));
        const int y = static_cast<int>(std::lround((v - k.cy) / k.fy * 585 + 240));
        const bool in = x >= 0 && y >= 0 && x < 640 && y < 480;
        depth.at(u, v) = in ? image.at<std::uint16_t>(y, x) : std::uint16_t{0};
        hint.at(u, v) = static_cast<float>(depth.at(u, v)) * 1e-3F;
      }
    double t = thread_cpu_ms();
    last = map.integrate({k, depth.view(), {}}, X, 2);
    fuse_ms.push_back(thread_cpu_ms() - t);
    ASSERT_FALSE(last.refused);
    ASSERT_EQ(last.blocks_refused, 0);
    blocks.push_back(last.blocks_updated);
    if (n < 10) continue;
    RaycastOptions o;
    t = thread_cpu_ms();
    raycast(map, k, X, o, maps);
    cast_ms.push_back(thread_cpu_ms() - t);
    if (n == 23)
      for (int v = 0; v < k.height; ++v)
        for (int u = 0; u < k.width; ++u)
          if (depth.at(u, v) != 0 && depth.at(u, v) < 4000 && maps.hit(u, v))
            gap_mm.push_back(
                std::fabs(static_cast<double>(maps.at(u, v)[3]) * 1e3 - depth.at(u, v)));
    o.hint_depth_m = hint.view();
    t = thread_cpu_ms();
    raycast(map, k, X, o, maps);
    hint_ms.push_back(thread_cpu_ms() - t);
    o.pixel_step = 2;
    t = thread_cpu_ms();
    raycast(map, k, X, o, maps);
    half_ms.push_back(thread_cpu_ms() - t);
    t = thread_cpu_ms();
    ASSERT_TRUE(copy_patch(map, X * Vec3(0, 0, 1.5), 64, *patch));
    copy_ms.push_back(thread_cpu_ms() - t);
  }
  const Mesh mesh = extract_mesh(startup.token(), map);
  std::printf(
      "512x424, 10 mm, thread CPU median: integrate %.2f (p95 %.2f), ray cast %.2f, hinted %.2f, "
      "hinted every "
      "2nd pixel %.2f, patch %.3f ms\n",
      quantile(fuse_ms, 0.5), quantile(fuse_ms, 0.95), quantile(cast_ms, 0.5),
      quantile(hint_ms, 0.5), quantile(half_ms, 0.5), quantile(copy_ms, 0.5));
  std::printf(
      "blocks updated %.0f a frame, %d in the map, %lld voxels fused, %lld carved, %lld free "
      "tests; |cast - image| median %.1f p95 %.1f mm; "
      "mesh %zu vertices\n",
      quantile(blocks, 0.5), map.block_count(), static_cast<long long>(last.voxels_fused),
      static_cast<long long>(last.voxels_carved), static_cast<long long>(last.free_tests),
      quantile(gap_mm, 0.5), quantile(gap_mm, 0.95), mesh.vertices_W.size());
  EXPECT_GT(gap_mm.size(), 120000U);
  EXPECT_LT(quantile(gap_mm, 0.5), 8);  // the sensor's noise and the poses' own disagreement
  EXPECT_LT(quantile(gap_mm, 0.95), 60);
  EXPECT_GT(mesh.vertices_W.size(), 40000U);
}

}  // namespace
}  // namespace tests
