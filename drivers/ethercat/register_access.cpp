#include "drivers/ethercat/register_access.hpp"

#include <algorithm>

namespace drivers::ethercat {

std::optional<std::uint16_t> RegisterAccess::run(Command command, std::uint32_t address,
                                                 std::span<std::uint8_t> data) noexcept {
  for (int attempt = 0; attempt < kTries; ++attempt) {
    frames_.begin();
    const auto sent =
        writes(command) ? std::span<const std::uint8_t>(data) : std::span<const std::uint8_t>();
    if (!frames_.add(command, address, data.size(), sent)) return std::nullopt;
    if (!frames_.run(frames_.port().now() + timeout_)) continue;
    const DatagramView& d = frames_.reply(0);
    if (reads(command) && d.counter > 0) std::copy(d.data.begin(), d.data.end(), data.begin());
    return d.counter;
  }
  return std::nullopt;
}

bool RegisterAccess::read(std::uint16_t station, std::uint16_t reg,
                          std::span<std::uint8_t> data) noexcept {
  return run(Command::kFprd, station_address(station, reg), data) == 1;
}

bool RegisterAccess::write(std::uint16_t station, std::uint16_t reg,
                           std::span<const std::uint8_t> data) noexcept {
  for (int attempt = 0; attempt < kTries; ++attempt) {
    frames_.begin();
    if (!frames_.add(Command::kFpwr, station_address(station, reg), data.size(), data))
      return false;
    if (frames_.run(frames_.port().now() + timeout_)) return frames_.reply(0).counter == 1;
  }
  return false;
}

std::optional<std::uint16_t> RegisterAccess::read_u16(std::uint16_t station,
                                                      std::uint16_t reg) noexcept {
  std::array<std::uint8_t, 2> b{};
  if (!read(station, reg, b)) return std::nullopt;
  return load_u16(b);
}

bool RegisterAccess::write_u16(std::uint16_t station, std::uint16_t reg, unsigned value) noexcept {
  std::array<std::uint8_t, 2> b{};
  store_u16(b, 0, value);
  return write(station, reg, b);
}

bool RegisterAccess::write_u8(std::uint16_t station, std::uint16_t reg, unsigned value) noexcept {
  const std::array<std::uint8_t, 1> b{static_cast<std::uint8_t>(value)};
  return write(station, reg, b);
}

std::optional<std::uint16_t> RegisterAccess::write_all(
    std::uint16_t reg, std::span<const std::uint8_t> data) noexcept {
  std::array<std::uint8_t, 64> copy{};
  const std::size_t n = std::min(data.size(), copy.size());
  std::copy_n(data.begin(), n, copy.begin());
  return run(Command::kBwr, broadcast_address(reg), std::span(copy).first(n));
}

std::optional<std::uint16_t> RegisterAccess::clear_all(std::uint16_t reg,
                                                       std::size_t bytes) noexcept {
  const std::array<std::uint8_t, 64> zero{};
  return write_all(reg, std::span(zero).first(std::min(bytes, zero.size())));
}

}  // namespace drivers::ethercat
