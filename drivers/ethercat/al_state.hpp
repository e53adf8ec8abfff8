// States of a slave and the codes with which it refuses or leaves one.
// Source: ETG.1000.6, 5.3 (AL control, AL status, AL status code) and table "AL status codes".
#pragma once

#include <cstdint>

namespace drivers::ethercat {

enum class AlState : std::uint8_t {
  kNone = 0,
  kInit = 1,
  kPreOp = 2,
  kBoot = 3,
  kSafeOp = 4,
  kOp = 8
};

inline constexpr std::uint8_t kAlStateMask = 0x0F, kAlError = 0x10, kAlAcknowledge = 0x10;

namespace al_code {
inline constexpr std::uint16_t kNone = 0x0000, kUnspecified = 0x0001, kInvalidChange = 0x0011,
                               kUnknownState = 0x0012, kNoBootstrap = 0x0013, kMailbox = 0x0016,
                               kNoInputs = 0x0018, kNoOutputs = 0x0019, kWatchdog = 0x001B,
                               kOutputs = 0x001D, kInputs = 0x001E;
}

struct AlStatus {
  std::uint8_t state = 0;  // register 0x0130, low byte: state and error bit
  std::uint16_t code = 0;  // register 0x0134
  [[nodiscard]] bool error() const noexcept { return (state & kAlError) != 0; }
  [[nodiscard]] AlState is() const noexcept { return static_cast<AlState>(state & kAlStateMask); }
  friend bool operator==(const AlStatus&, const AlStatus&) = default;
};

// "SAFEOP"; "?" for what is no state.
[[nodiscard]] const char* state_text(AlState) noexcept;
[[nodiscard]] const char* code_text(std::uint16_t al_status_code) noexcept;

}  // namespace drivers::ethercat
