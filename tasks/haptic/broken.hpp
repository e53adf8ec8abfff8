// Faults on purpose, for tests/negative/haptic: the judges of the hard cases have to see each of them. In the product,
// which is built without TELETACT_HAPTIC_BROKEN, all are a constant false.
#pragma once

#include <cstdint>

namespace tasks {

enum class Broken : std::uint8_t {
  kNone,
  kTouchesOutOfTheUnknown,  // a contact begins without seen-free space before it
  kClutchCutsForce,         // at once, behind the guard
  kClutchKeepsForce,
  kClutchMovesHand,   // the hand in the scene goes with the device
  kAnchorLeaks,       // friction: 0.1 % of the way a tick
  kBreaksLooseEarly,  // friction: at the dynamic rim
  kBumpsTooLow,       // 80 % of their height
  kReachFollowsSpeed,  // the bumps as they were: K D n at any depth, the part along the surface up to a reach of the pace
  kBumpsTurnTheNormal,  // the published perturbed normal, no height
  kTipWithoutRadius,    // in contact
};

#if defined(TELETACT_HAPTIC_BROKEN) && TELETACT_HAPTIC_BROKEN
inline Broken broken_now = Broken::kNone;
[[nodiscard]] inline bool broken(Broken b) noexcept { return broken_now == b; }
#else
[[nodiscard]] constexpr bool broken(Broken) noexcept { return false; }
#endif

}  // namespace tasks
