#include "drivers/ethercat/register_access.hpp"

#include <algorithm>
#include <array>

#include "drivers/ethercat/registers.hpp"

namespace drivers::ethercat {

std::optional<std::uint16_t> RegisterAccess::run(Command command, std::uint32_t address,
                                                 std::span<std::uint8_t> data) noexcept {
  for (int attempt = 0; attempt < kTries; ++attempt) {
    frames_.begin();
    const auto sent =
        writes(command) ? std::span<const std::uint8_t>(data) : std::span<const std::uint8_t>();
    if (!frames_.add(command, address, data.size(), sent)) return std::nullopt;
    if (!frames_.run(frames_.port().now() + timeout_)) continue;
    frame_came_ = true;
    const DatagramView& d = frames_.reply(0);
    if (reads(command) && d.counter > 0) std::copy(d.data.begin(), d.data.end(), data.begin());
    return d.counter;
  }
  frame_came_ = false;
  return std::nullopt;
}

bool RegisterAccess::run_for_one(Command command, std::uint32_t address,
                                 std::span<std::uint8_t> data) noexcept {
  for (int attempt = 0; attempt < kTries; ++attempt) {
    const auto counter = run(command, address, data);
    if (!counter) return false;
    if (*counter == 1) return true;
    ++wrong_counters_;
  }
  return false;
}

bool RegisterAccess::read(std::uint16_t station, std::uint16_t reg,
                          std::span<std::uint8_t> data) noexcept {
  return run_for_one(Command::kFprd, station_address(station, reg), data);
}

bool RegisterAccess::read_at(int position, std::uint16_t reg,
                             std::span<std::uint8_t> data) noexcept {
  return run_for_one(Command::kAprd, position_address(position, reg), data);
}

bool RegisterAccess::write(std::uint16_t station, std::uint16_t reg,
                           std::span<const std::uint8_t> data) noexcept {
  std::array<std::uint8_t, kMaxData> copy{};
  const std::size_t n = std::min(data.size(), copy.size());
  std::copy_n(data.begin(), n, copy.begin());
  return run_for_one(Command::kFpwr, station_address(station, reg), std::span(copy).first(n));
}

bool RegisterAccess::write_at(int position, std::uint16_t reg,
                              std::span<const std::uint8_t> data) noexcept {
  std::array<std::uint8_t, 64> copy{};
  const std::size_t n = std::min(data.size(), copy.size());
  std::copy_n(data.begin(), n, copy.begin());
  return run_for_one(Command::kApwr, position_address(position, reg), std::span(copy).first(n));
}

std::optional<int> RegisterAccess::count_slaves() noexcept {
  constexpr int kEnough = 3, kMostLooks = 30;
  std::array<std::uint8_t, kMostLooks> seen{};  // counts, as they came
  for (int look = 0; look < kMostLooks; ++look) {
    std::array<std::uint8_t, 1> type{};
    const auto n = run(Command::kBrd, broadcast_address(reg::kType), type);
    if (!n) return std::nullopt;
    const auto count = static_cast<std::uint8_t>(std::min<unsigned>(*n, 255));
    seen[static_cast<std::size_t>(look)] = count;
    if (std::count(seen.begin(), seen.begin() + look + 1, count) >= kEnough) return *n;
  }
  return *std::max_element(seen.begin(), seen.end());
}

const char* RegisterAccess::why() const noexcept {
  return frame_came_ ? "does not answer: frames come back, and it took none"
                     : "frames are lost: none came back of 12";
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
