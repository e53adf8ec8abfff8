// Status codes of TMCL replies (TMCL reference manual, "Status codes"; 8 is the youBot boards'
// own).
#pragma once

#include <cstdint>

namespace drivers::tmcl {

namespace status {
inline constexpr std::uint8_t kWrongChecksum = 1, kInvalidCommand = 2, kWrongType = 3,
                              kInvalidValue = 4, kEepromLocked = 5, kNotAvailable = 6,
                              kPasswordProtected = 8, kOk = 100, kLoaded = 101;
}  // namespace status

[[nodiscard]] const char* status_text(std::uint8_t code) noexcept;

}  // namespace drivers::tmcl
