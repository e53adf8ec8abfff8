#include "drivers/tmcl/motor_faults.hpp"

#include "drivers/tmcl/youbot_parameters.hpp"

namespace drivers::tmcl {

namespace {

constexpr std::array<MotorFlag, kMotorFlags> kFlagTable{{
    {0, FlagKind::kFault, 0, "over-current"},
    {1, FlagKind::kFault, 0, "under-voltage"},
    {2, FlagKind::kFault, 0, "over-voltage"},
    {3, FlagKind::kFault, 0, "over-temperature"},
    {4, FlagKind::kStatus, 0, "motor halted"},
    {5, FlagKind::kFault, 0, "hall sensor error"},
    {6, FlagKind::kFault, 0, "encoder error"},
    {7, FlagKind::kFault, 0, "commutation not found"},
    {8, FlagKind::kStatus, 0, "PWM mode"},
    {9, FlagKind::kStatus, 0, "velocity mode"},
    {10, FlagKind::kStatus, 0, "position mode"},
    {11, FlagKind::kStatus, 0, "current mode"},
    {12, FlagKind::kFault, 0, "emergency stop"},
    {13, FlagKind::kStatus, 0, "free-running"},
    {14, FlagKind::kStatus, 0, "position reached"},
    {15, FlagKind::kStatus, 0, "initialised"},
    {16, FlagKind::kLatched, axis::kClearTimeout, "EtherCAT timeout"},
    {17, FlagKind::kLatched, axis::kClearI2t, "I2t exceeded"},
}};

}  // namespace

std::span<const MotorFlag, kMotorFlags> motor_flags() noexcept { return kFlagTable; }

std::uint32_t fault_bits(std::uint32_t word) noexcept {
  std::uint32_t bits = 0;
  for (const MotorFlag& f : kFlagTable) {
    if (f.kind != FlagKind::kStatus) bits |= word & 1U << f.bit;
  }
  return bits;
}

MotorFaults faults_of(std::uint32_t word) noexcept {
  MotorFaults out;
  for (const MotorFlag& f : kFlagTable) {
    if (f.kind == FlagKind::kStatus || (word >> f.bit & 1U) == 0) continue;
    out.entry[static_cast<std::size_t>(out.count++)] = &f;
  }
  return out;
}

}  // namespace drivers::tmcl
