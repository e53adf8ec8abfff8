// What a user of the installed perception does: fuse one frame of a flat wall, look at the field.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "perception/tsdf/tsdf_map.hpp"

int main() {
  rt::Startup startup;
  perception::TsdfConfig config;
  config.max_blocks = 2048;
  config.max_chunks = 256;
  perception::TsdfMap map(startup.token(), config);
  constexpr int kWidth = 64, kHeight = 48;
  const std::vector<std::uint16_t> depth(static_cast<std::size_t>(kWidth) * kHeight, 1000);  // mm
  perception::FrameView frame;
  frame.intrinsics.width = kWidth;
  frame.intrinsics.height = kHeight;
  frame.intrinsics.fx = frame.intrinsics.fy = 60.0;
  frame.intrinsics.cx = 31.5;
  frame.intrinsics.cy = 23.5;
  frame.depth_mm = {depth.data(), kWidth, kHeight, kWidth};
  perception::IntegrateStats stats;
  for (int i = 0; i < 3; ++i) stats = map.integrate(frame, perception::Pose::Identity(), 1);
  // On the axis, 20 mm before the wall: +20 mm.
  const int k = static_cast<int>(std::lround(0.98 / map.voxel_size()));
  const auto word = map.word_at(0, 0, k);
  const double d_m =
      perception::TsdfMap::word_distance(word) * static_cast<double>(map.metres_per_unit());
  std::printf("blocks %d, distance 20 mm before the wall: %.4f m\n", map.block_count(), d_m);
  const bool ok = !stats.refused && map.block_count() > 0 && std::abs(d_m - 0.02) < 1e-3;
  return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}
