// Bits of MotorStates::flags: the error and status word of the youBot's motor controllers that this
// project reads (reference: bits 0 to 17 of axis parameter 156).
#pragma once

#include <cstdint>

namespace drivers {

namespace motor_flag {
// A motor's own faults, which clear with their cause: over-current, under- and over-voltage,
// over-temperature (0 to 3), hall sensor, encoder, commutation (5 to 7), emergency stop (12).
// Names: drivers/tmcl/motor_faults.hpp.
inline constexpr std::uint32_t kFaults = 0x10EF;
inline constexpr std::uint32_t kMotorHalted = 1U << 4U;
inline constexpr std::uint32_t kVelocityMode = 1U << 9U;
inline constexpr std::uint32_t kInitialised = 1U << 15U;
inline constexpr std::uint32_t kTimeout = 1U << 16U;
inline constexpr std::uint32_t kI2tExceeded = 1U << 17U;
}  // namespace motor_flag

}  // namespace drivers
