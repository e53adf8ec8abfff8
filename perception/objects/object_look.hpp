// One frame, its camera and the map, for the parts of ObjectMap.
#pragma once

#include "perception/objects/object_map.hpp"
#include "perception/tsdf/frame_view.hpp"
#include "perception/tsdf/map_reader.hpp"

namespace perception {

[[nodiscard]] constexpr bool reads(std::uint16_t mm) noexcept { return mm != 0 && mm != 65535; }

struct ObjectMap::Look {
  const FrameView& frame;
  const TsdfMap& map;
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
