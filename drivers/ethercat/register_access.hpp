// Registers of the slaves, one datagram a frame, with repeats: for set-up and for a person at the
// bench. Waits, so it has no place in a cycle.
//
// A frame that does not come back, or comes back damaged, is sent again; so is one with another
// working counter than it should have, where one is known. Each is bounded by kTries: 24 ms on a
// silent wire, the way of so many frames on a good one. Registers take the same value twice.
#pragma once

#include <optional>

#include "drivers/ethercat/exchange.hpp"

namespace drivers::ethercat {

class RegisterAccess {
 public:
  explicit RegisterAccess(Port& port) noexcept : frames_(port) {}

  // Working counter of the frame that came back, nullopt: none did, of kTries. What was read stands
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

  // By position, for slaves without an address; as read() and write().
  [[nodiscard]] bool read_at(int position, std::uint16_t reg,
                             std::span<std::uint8_t> data) noexcept;
  [[nodiscard]] bool write_at(int position, std::uint16_t reg,
                              std::span<const std::uint8_t> data) noexcept;
  // How many slaves answer: the number that was counted three times, since one counter may be
  // wrong. nullopt: no frame came back. Changes nothing.
  [[nodiscard]] std::optional<int> count_slaves() noexcept;
  // Why the last call was not done: "no frame came back", or that no slave took it.
  [[nodiscard]] const char* why() const noexcept;

  // For a frame of several datagrams. False: none came back, of kTries; each time it is built anew.
  template <class Build>
  [[nodiscard]] bool exchange(Build&& build) noexcept {
    for (int attempt = 0; attempt < kTries; ++attempt) {
      frames_.begin();
      build(frames_);
      if (frames_.count() == 0 || frames_.run(frames_.port().now() + timeout_)) return true;
    }
    frame_came_ = false;
    return false;
  }
  [[nodiscard]] const DatagramView& reply(std::size_t i) const noexcept { return frames_.reply(i); }
  void count_wrong_counter() noexcept { ++wrong_counters_; }
  // Frames whose working counter was not the one that it should be.
  [[nodiscard]] std::uint64_t wrong_counters() const noexcept { return wrong_counters_; }

  [[nodiscard]] Port& port() noexcept { return frames_.port(); }
  [[nodiscard]] const ExchangeCounters& counters() const noexcept { return frames_.counters(); }
  void set_timeout(rt::Nanos t) noexcept { timeout_ = t; }

 private:
  // True: exactly one slave took it.
  [[nodiscard]] bool run_for_one(Command command, std::uint32_t address,
                                 std::span<std::uint8_t> data) noexcept;
  static constexpr int kTries = 12;
  FrameExchange frames_;
  std::uint64_t wrong_counters_ = 0;
  bool frame_came_ = true;
  // A frame of 1500 bytes takes 120 us at 100 Mbit/s; the rest is the card's and the kernel's.
  rt::Nanos timeout_ = std::chrono::milliseconds{2};
};

}  // namespace drivers::ethercat
