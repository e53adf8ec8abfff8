// Registers of the slaves, one datagram a frame, with repeats: for set-up and for a person at the
// bench. Waits, so it has no place in a cycle.
#pragma once

#include <optional>

#include "drivers/ethercat/exchange.hpp"

namespace drivers::ethercat {

class RegisterAccess {
 public:
  explicit RegisterAccess(Port& port) noexcept : frames_(port) {}

  // Working counter of the frame that came back, nullopt: none did, of three. What was read stands
  // in `data` when the counter is not 0.
  std::optional<std::uint16_t> run(Command command, std::uint32_t address,
                                   std::span<std::uint8_t> data) noexcept;

  // True: exactly one slave, the one with this station address, answered.
  [[nodiscard]] bool read(std::uint16_t station, std::uint16_t reg,
                          std::span<std::uint8_t> data) noexcept;
  [[nodiscard]] bool write(std::uint16_t station, std::uint16_t reg,
                           std::span<const std::uint8_t> data) noexcept;
  [[nodiscard]] std::optional<std::uint16_t> read_u16(std::uint16_t station,
                                                      std::uint16_t reg) noexcept;
  [[nodiscard]] bool write_u16(std::uint16_t station, std::uint16_t reg, unsigned value) noexcept;
  [[nodiscard]] bool write_u8(std::uint16_t station, std::uint16_t reg, unsigned value) noexcept;
  // To all; the number of slaves that took it, nullopt: no frame came back.
  std::optional<std::uint16_t> write_all(std::uint16_t reg,
                                         std::span<const std::uint8_t> data) noexcept;
  // `bytes` zero bytes.
  std::optional<std::uint16_t> clear_all(std::uint16_t reg, std::size_t bytes) noexcept;

  [[nodiscard]] Port& port() noexcept { return frames_.port(); }
  [[nodiscard]] const ExchangeCounters& counters() const noexcept { return frames_.counters(); }
  void set_timeout(rt::Nanos t) noexcept { timeout_ = t; }

 private:
  static constexpr int kTries = 3;
  FrameExchange frames_;
  // A frame of 1500 bytes takes 120 us at 100 Mbit/s; the rest is the card's and the kernel's.
  rt::Nanos timeout_ = std::chrono::milliseconds{2};
};

}  // namespace drivers::ethercat
