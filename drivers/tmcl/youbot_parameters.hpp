// Axis parameters of the youBot's motor controllers (TMCM-174/1632 of the wheels, TMCM-KR-841/1610
// of the arm): number, unit, range, what may be done with them.
// Source: youbot_driver, YouBotJointParameter*.hpp (numbers, units, which are protected) and the
// TMCM-1630 firmware manual, chapter "Axis parameters" (ranges). A range of {0, 0} is not
// published: nothing is checked then.
#pragma once

#include <cstdint>
#include <span>

namespace drivers::tmcl {

enum class Access : std::uint8_t {
  kRead,       // GAP alone
  kReadWrite,  // GAP and SAP
  kProtected,  // GAP; SAP only behind the password (parameter 248), else status 8
  kWrite       // SAP alone: clears or starts something
};

struct AxisParameter {
  std::uint8_t number;
  const char* name;
  const char* unit;
  Access access;
  std::int32_t lowest, highest;  // both 0: not published
};

// By number, ascending.
[[nodiscard]] std::span<const AxisParameter> axis_parameters() noexcept;
[[nodiscard]] const AxisParameter* find_axis_parameter(int number) noexcept;

// Of the numbers that code uses by name.
namespace axis {
inline constexpr std::uint8_t kTargetPosition = 0, kActualPosition = 1, kTargetSpeed = 2,
                              kActualSpeed = 3, kRampVelocity = 4, kMaxCurrent = 6,
                              kHaltedVelocity = 9, kReachedDistance = 10, kAcceleration = 11,
                              kInitialised = 15, kThermalTime = 25, kI2tLimit = 26, kI2tSum = 27,
                              kI2tExceeded = 28, kClearI2t = 29, kRampGenerator = 146,
                              kActualCurrent = 150, kTargetCurrent = 155, kSupplyVoltage = 151,
                              kTemperature = 152, kFlags = 156, kClearTimeout = 158,
                              kPassword = 248, kInitMode = 249, kEncoderSteps = 250;
}  // namespace axis

// Global parameters, bank and number.
namespace global {
inline constexpr std::uint8_t kTimeoutBank = 0, kTimeout_ms = 90, kUserBank = 2, kCalibrated = 16,
                              kLastUser = 55;
}  // namespace global

// Driver temperature in degrees Celsius of parameter 152 (youbot_driver; thermistor of 10 kOhm,
// B = 3434 K). NaN for a reading of which no resistance follows (0 and 4096 upward).
[[nodiscard]] double driver_temperature_C(std::int32_t adc) noexcept;

}  // namespace drivers::tmcl
