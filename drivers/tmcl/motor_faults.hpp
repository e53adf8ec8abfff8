// The error and status word of the youBot's motor controllers (process data; axis parameter 156) as
// names, and which of its bits are faults.
// Source: youbot_driver YouBotJointParameterReadOnly.hpp; the bits that it leaves out, from two
// other drivers of the same boards. Bits 0 to 15 clear themselves; 16 and 17 are latched (TMCM-1630
// manual, parameter 156): 16 clears by SAP 158 = 1, 17 by SAP 29 after the winding has cooled.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace drivers::tmcl {

enum class FlagKind : std::uint8_t {
  kStatus,  // says how it is
  kFault,   // clears with its cause
  kLatched  // stays until cleared by a parameter
};

struct MotorFlag {
  std::uint8_t bit;
  FlagKind kind;
  std::uint8_t clear_parameter;  // 0: none
  const char* name;
};

inline constexpr int kMotorFlags = 18;
// By bit.
[[nodiscard]] std::span<const MotorFlag, kMotorFlags> motor_flags() noexcept;

// The bits of `word` that are faults. Bits from 18 on have no meaning that is known: they are none.
[[nodiscard]] std::uint32_t fault_bits(std::uint32_t word) noexcept;

// The faults of a word, in order of their bits; the first `count` entries count.
struct MotorFaults {
  std::array<const MotorFlag*, kMotorFlags> entry{};
  int count = 0;
};
[[nodiscard]] MotorFaults faults_of(std::uint32_t word) noexcept;

}  // namespace drivers::tmcl
