// Counts how often each effect was built and executed in this process. A test reads the counters to
// show that an effect which no scene asks for is neither built nor executed. An effect that is not
// built costs nothing.
//
// An effect is executed by one thread. Counts may be lost if two threads execute it, but never the
// first one.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace rt {

enum class Effect : std::uint8_t {
  kAxial,
  kLateral,
  kEdgeDropout,
  kFlying,
  kTrueMount,
  kMovers,
  kArm,
  kJointsLate,
  kJointsWrong,
  kMotorDynamics,
  kSlip,
  kWheelSlip,
  kWheelRadius,
  kEncoder,
  kDeadTime,
  kGearFriction,
  kDeviceFriction,
  kQuantum,
  kDeviceDelay,
  kTimeGuard,
  kGravity,
  kHand,
  kLinkShape,
  kLinkNetwork,
  kFriction,
  kTexture,
  kViscosity,
  kMaterials,
  kForceShading,
  kObjects,
  kMesh,
};
inline constexpr std::size_t kEffects = 31;
// In the order of the catalogue of effects (tools/scene/effect_catalogue.hpp).
inline constexpr std::array<std::string_view, kEffects> kEffectNames{
    "camera noise: axial",
    "camera noise: lateral_px",
    "camera noise: edge_dropout",
    "camera noise: flying",
    "camera: true_mount",
    "world: things that move",
    "robot: an arm before the camera",
    "robot: joints reported late",
    "robot: joints reported wrong",
    "robot: motor_dynamics",
    "robot: slip",
    "robot: wheel_slip",
    "robot: wheel_radius",
    "robot: encoder_quantisation",
    "robot: dead_time",
    "robot: gear_friction",
    "device: device_friction",
    "device: position_quantum",
    "device: device_delay",
    "device: time_guard",
    "device: gravity",
    "device: hand",
    "link shape",
    "link network",
    "touch: friction",
    "touch: texture",
    "touch: viscosity",
    "touch: materials",
    "touch: force shading",
    "objects in the map",
    "mesh for the console"};

struct EffectCount {
  std::atomic<std::uint64_t> built{0}, ran{0};
};
inline constinit std::array<EffectCount, kEffects> effect_counts{};

inline void count_one(std::atomic<std::uint64_t>& n) noexcept {
  n.store(n.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
}
inline void effect_built(Effect e) noexcept {
  count_one(effect_counts[static_cast<std::size_t>(e)].built);
}
inline void effect_ran(Effect e) noexcept {
  count_one(effect_counts[static_cast<std::size_t>(e)].ran);
}

}  // namespace rt
