// Process data of the youBot's motor controllers.
// Source: youbot_driver YouBotSlaveMsg.hpp (its head and two earlier versions); checked against a
// second driver that writes the same bytes one by one. Little-endian, packed.
//
//   outputs, 5 bytes    int32 value, uint8 mode
//   inputs              by length, never by name:
//     16   int32 position, int32 current, int32 velocity, uint16 flags, uint16 temperature
//     18   int32 position, int32 current, int32 velocity, uint32 flags, uint16 temperature
//     20   int32 position, int32 current, int32 velocity, uint32 flags, int32 PWM (firmware 1.4x)
//     32   ... flags, int32 target position, current, velocity, ramp velocity (firmware 2.00)
//
// Units: position in encoder ticks (wraps at 32 bits), current in mA, velocity in rpm of the motor.
#pragma once

#include <cstdint>
#include <span>

namespace drivers::youbot_bus {

enum class ControllerMode : std::uint8_t {
  kStop = 0,
  kPosition = 1,  // ticks
  kVelocity = 2,  // rpm
  kNoAction = 3,
  kSetPosition = 4,  // the position that the encoder has now
  kPwm = 5,          // duty, -1799 to 1799
  kCurrent = 6,      // mA
  kInitialise = 7    // find the commutation
};

struct DriveOutputs {
  std::int32_t value = 0;
  ControllerMode mode = ControllerMode::kStop;
  friend bool operator==(const DriveOutputs&, const DriveOutputs&) = default;
};

struct DriveInputs {
  std::int32_t position_ticks = 0, current_mA = 0, velocity_rpm = 0;
  std::uint32_t flags = 0;
  // Only where the layout has them, else 0.
  std::int32_t pwm = 0, temperature_adc = 0;
  std::int32_t target_position_ticks = 0, target_current_mA = 0, target_velocity_rpm = 0,
               ramp_velocity_rpm = 0;
  friend bool operator==(const DriveInputs&, const DriveInputs&) = default;
};

inline constexpr std::size_t kOutputBytes = 5;
inline constexpr std::size_t kNarrowInputBytes = 16;  // flags 0 to 15 alone
[[nodiscard]] constexpr bool known_input_size(std::size_t bytes) noexcept {
  return bytes == 16 || bytes == 18 || bytes == 20 || bytes == 32;
}

// False: not of a known size, or an unknown mode; then nothing is written.
[[nodiscard]] bool encode(const DriveOutputs&, std::span<std::uint8_t> into) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t>, DriveOutputs& out) noexcept;
[[nodiscard]] bool encode(const DriveInputs&, std::span<std::uint8_t> into) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t>, DriveInputs& out) noexcept;

}  // namespace drivers::youbot_bus
