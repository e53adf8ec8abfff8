#include "tools/robot/floor_seen.hpp"

#include <vector>

#include "perception/ground/ground_plane.hpp"

namespace teletact {

std::optional<FloorSeen> floor_seen(const perception::RgbdFrame& frame,
                                    const perception::Pose& X_BC, std::uint64_t stream) {
  constexpr int kStep = 5;  // pixels
  constexpr double kFar_m = 3;
  const auto& k = frame.intrinsics;
  std::vector<perception::Vec3f> points;
  for (int v = 0; v < k.height; v += kStep) {
    for (int u = 0; u < k.width; u += kStep) {
      const std::uint16_t mm = frame.depth_mm[static_cast<std::size_t>(v * k.width + u)];
      if (mm == 0 || mm == 65535 || 1e-3 * mm > kFar_m) continue;
      points.push_back(k.unproject(u, v, 1e-3 * mm).cast<float>());
    }
  }
  perception::GroundPlaneConfig config;
  config.up_tolerance_deg = 20;
  config.height_tolerance_m = 0.3;
  config.max_camera_height_m = 4;
  config.min_camera_height_m = 0.05;
  perception::GroundHint hint;
  hint.up = X_BC.linear().transpose() * perception::Vec3::UnitZ();
  hint.up_known = true;
  hint.camera_height_m = X_BC.translation().z();
  const auto plane =
      perception::find_ground(points, perception::Vec3::Zero(), hint, config, stream);
  if (!plane) return std::nullopt;
  return FloorSeen{plane->normal, -plane->offset};
}

}  // namespace teletact
