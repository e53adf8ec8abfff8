// One frame, its camera and the map, for the parts of ObjectMap.
#pragma once

#include <cmath>

#include "perception/objects/object_map.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"

namespace perception {

[[nodiscard]] constexpr bool reads(std::uint16_t mm) noexcept { return mm != 0 && mm != 65535; }

// As integration has it: such a reading is not fused.
[[nodiscard]] inline bool on_edge(const FrameView& frame, const TsdfConfig& c, int u,
                                  int v) noexcept {
  const auto& depth = frame.depth_mm;
  const double here = depth.at(u, v), gate = 1e3 * c.edge_base_m + c.edge_per_m * here;
  const auto apart = [&](int a, int b) {
    return depth.contains(a, b) && reads(depth.at(a, b)) && std::abs(depth.at(a, b) - here) > gate;
  };
  return apart(u - 1, v) || apart(u + 1, v) || apart(u, v - 1) || apart(u, v + 1);
}

struct ObjectMap::Look {
  const FrameView& frame;
  const MapView& map;
  const Pose& X_WC;
  Pose X_CW;
  CameraBoxes boxes;
  mutable MapReader reader;

  [[nodiscard]] LabelVoxel voted(int u, int v) const noexcept {
    const std::uint16_t mm = frame.depth_mm.at(u, v);
    if (!reads(mm)) return {};
    return reader.voted(X_WC * frame.intrinsics.unproject(u, v, 1e-3 * mm));
  }
  [[nodiscard]] std::uint8_t label(int u, int v) const noexcept { return voted(u, v).label; }
};

}  // namespace perception
