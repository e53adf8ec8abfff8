// What an eye sees of the fused scene, for the console and the report: a coloured picture with the
// surface point behind every pixel, so that proxy, marks and robot can be drawn in at the right depth.
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
  // Id of the object (ObjectList) that shows there, 0: none. Its outlines are those of the camera's pixels, points
  // and depths the map's: beside an outline they may be of what lies behind.
  std::array<std::uint8_t, kMaxPixels> object{};
  // What moves there, or is the robot's own (perception::PixelOf): it is in none of colour and points, which are the
  // map's. Of the camera's newest image; `masked` false: nothing, and what is not filled in.
  bool masked = false;
  std::array<std::uint8_t, kMaxPixels> what{};
};

}  // namespace tasks
