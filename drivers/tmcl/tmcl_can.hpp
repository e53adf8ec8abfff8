// TMCL on a CAN bus (TMCL reference manual 2.1; TMCM-3230 firmware manual, "Binary command format
// for CAN"): no checksum, and the identifier is the address of the request.
//
//   request, 7 bytes, identifier of the module      reply, 7 bytes, identifier shared by many
//   0 command                                       0 module address
//   1 type                                          1 status
//   2 motor or bank                                 2 command
//   3..6 value, most significant byte first         3..6 value, most significant byte first
//
// Command 136 type 0 (firmware version) sent with eight bytes answers with eight bytes of text.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "drivers/tmcl/tmcl_frame.hpp"

namespace drivers::tmcl {

inline constexpr std::size_t kCanBytes = 7;
using CanPayload = std::array<std::uint8_t, kCanBytes>;

// Request::module is not in it.
[[nodiscard]] CanPayload to_can(const Request&) noexcept;
[[nodiscard]] CanPayload to_can(const Reply&) noexcept;
// False: not seven bytes; `out` is then untouched. Module and host address are 0 where the payload
// has none.
[[nodiscard]] bool from_can(std::span<const std::uint8_t>, Request& out) noexcept;
[[nodiscard]] bool from_can(std::span<const std::uint8_t>, Reply& out) noexcept;

// Bit rate of global parameter 69, in kbit/s; 0: not a rate.
[[nodiscard]] int can_rate_kbit_per_s(std::int32_t parameter_69) noexcept;

namespace global {
inline constexpr std::uint8_t kCanRate = 69, kCanReplyId = 70, kCanId = 71;
}  // namespace global

}  // namespace drivers::tmcl
