// The object in the gripper: part of the robot's body from grasp to release. It is made of
// capsules, so all code that handles the arm handles it too.
#pragma once

#include <cstdint>
#include <span>

#include "perception/geometry/articulated_body.hpp"

namespace perception {

struct HeldObject {
  enum class Kind : std::uint8_t { kCapsule, kBox };
  std::uint64_t id = 0;  // of the grasp; a new grasp has a new id
  Kind kind = Kind::kBox;
  Pose X_GO = Pose::Identity();  // in the gripper's link
  Vec3 half = Vec3::Zero();      // m: of a box; of a capsule along z_O: radius x, half the axis z

  [[nodiscard]] bool plausible() const noexcept;
};

inline constexpr int kCapsulesOfHeld = 4;

// Capsules in G that contain the whole object. A box is cut across its second longest edge into
// pieces about as wide as they are thick. Returns the number of capsules.
int capsules_of(const HeldObject& o, std::span<Capsule, kCapsulesOfHeld> out) noexcept;

}  // namespace perception
