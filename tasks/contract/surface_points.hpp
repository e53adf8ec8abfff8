// Surface points of one full ray cast of the map. The published touch method (force shading)
// searches them for the nearest point. fusion -> haptic, only if a scene asks for that method.
//
// One ray and one point a pixel, row-major, from minimum depth to the first crossing from outside
// to inside. A ray that meets nothing gives a far point, which is never nearest. Structure of
// arrays, padded to kLanes with far points. Memory is allocated at set-up; a message is filled in
// place and read in place.
// Frames: points and normals in W (= map); normals unit, towards the camera.  SI.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "rt/time.hpp"

namespace tasks {

struct SurfacePoints {
  static constexpr std::size_t kLanes = 16;
  static constexpr float kFar = 1e9F;
  std::uint64_t seq = 0;         // 0 = never published
  rt::Time fused{}, exposure{};  // the writer's job; the newest image in the map
  perception::Pose X_WC =
      perception::Pose::Identity();  // camera that cast it: the last one claimed
  std::size_t count = 0;             // pixels
  std::vector<float> x, y, z, nx, ny, nz;

  // Set-up: room for n points, all far.
  void resize(std::size_t n) {
    count = n;
    const std::size_t padded = (n + kLanes - 1) / kLanes * kLanes;
    for (auto* v : {&x, &y, &z}) v->assign(padded, kFar);
    for (auto* v : {&nx, &ny, &nz}) v->assign(padded, 0.0F);
  }
  void set(std::size_t i, const perception::Vec3& p, const perception::Vec3& n) noexcept {
    x[i] = static_cast<float>(p.x());
    y[i] = static_cast<float>(p.y());
    z[i] = static_cast<float>(p.z());
    nx[i] = static_cast<float>(n.x());
    ny[i] = static_cast<float>(n.y());
    nz[i] = static_cast<float>(n.z());
  }
  [[nodiscard]] perception::Vec3 point(std::size_t i) const noexcept {
    return {static_cast<double>(x[i]), static_cast<double>(y[i]), static_cast<double>(z[i])};
  }
  [[nodiscard]] perception::Vec3 normal(std::size_t i) const noexcept {
    return {static_cast<double>(nx[i]), static_cast<double>(ny[i]), static_cast<double>(nz[i])};
  }
};

}  // namespace tasks
