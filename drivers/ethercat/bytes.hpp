// Little-endian numbers in bytes: EtherCAT's order (ETG.1000.4, 5.1). The caller has looked at the
// length.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace drivers::ethercat {

[[nodiscard]] inline std::uint16_t load_u16(std::span<const std::uint8_t> b,
                                            std::size_t at = 0) noexcept {
  return static_cast<std::uint16_t>(b[at] | b[at + 1] << 8U);
}
[[nodiscard]] inline std::uint32_t load_u32(std::span<const std::uint8_t> b,
                                            std::size_t at = 0) noexcept {
  return load_u16(b, at) | static_cast<std::uint32_t>(load_u16(b, at + 2)) << 16U;
}
inline void store_u16(std::span<std::uint8_t> b, std::size_t at, unsigned v) noexcept {
  b[at] = static_cast<std::uint8_t>(v);
  b[at + 1] = static_cast<std::uint8_t>(v >> 8U);
}
inline void store_u32(std::span<std::uint8_t> b, std::size_t at, std::uint32_t v) noexcept {
  store_u16(b, at, v & 0xFFFFU);
  store_u16(b, at + 2, v >> 16U);
}

}  // namespace drivers::ethercat
