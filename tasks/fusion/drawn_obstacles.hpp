// The no-go areas of the cost map, and what an edit does to them.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "perception/ground/ground_map.hpp"
#include "tasks/contract/scene_edit.hpp"

namespace tasks {

// The no-go areas: the scene's own, which stay, then the operator's.
class DrawnObstacles {
 public:
  DrawnObstacles() = default;
  // At most GroundMap::kMaxVirtual of the scene.
  explicit DrawnObstacles(const perception::GroundConfig& scene);
  // False, and nothing changed: no room, no such id, numbers that are none, or an edit of another
  // kind.
  bool apply(const SceneEdit& edit) noexcept;
  [[nodiscard]] std::span<const perception::VirtualObstacle> all() const noexcept {
    return {obstacles_.data(), static_cast<std::size_t>(count_)};
  }

 private:
  std::array<perception::VirtualObstacle, perception::GroundMap::kMaxVirtual> obstacles_{};
  std::array<std::uint16_t, perception::GroundMap::kMaxVirtual> ids_{};  // 0: the scene's
  int count_ = 0;
};

// Of a kClear edit.
[[nodiscard]] Eigen::AlignedBox3d box_of(const SceneEdit& edit) noexcept;

}  // namespace tasks
