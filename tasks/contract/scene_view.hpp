// A picture of the fused scene for the console and the report. Each pixel has a colour and its
// surface point, so that proxy, marks and robot can be drawn in at the right depth.
#pragma once

#include <array>
#include <cstdint>

#include "perception/geometry/rgbd_frame.hpp"
#include "rt/time.hpp"

namespace tasks {

struct SceneView {
  static constexpr int kMaxWidth = 320, kMaxHeight = 240;
  static constexpr std::size_t kMaxPixels = static_cast<std::size_t>(kMaxWidth) * kMaxHeight;
  struct Point {
    float x = 0, y = 0, z = 0;  // of the surface, W, m; meaningless where depth is 0
    float depth = 0;            // along the eye's optical axis, m; 0 = nothing seen
  };

  std::uint64_t seq = 0;  // 0 = never published
  rt::Time fused{}, exposure{};
  perception::Pose X_WV = perception::Pose::Identity();  // the eye, optical frame
  perception::Intrinsics intrinsics{};
  std::array<perception::Rgb, kMaxPixels> colour{};  // shaded; row-major, width x height
  std::array<Point, kMaxPixels> points{};
  // Id of the object (ObjectList) at each pixel, 0: none. Outlines come from the camera's pixels,
  // points and depths from the map. So beside an outline a point may belong to the surface behind
  // the object.
  std::array<std::uint8_t, kMaxPixels> object{};
  // Pixels that move or show the robot's own body (perception::PixelOf), in the camera's newest
  // image. Colour and points come from the map and do not contain them. `masked` false: there are
  // none, and this is not filled in.
  bool masked = false;
  std::array<std::uint8_t, kMaxPixels> what{};
};

}  // namespace tasks
