// The answer to "may this mode be entered from that one?", worked out before the start
// (mode_table.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace rt {

inline constexpr std::size_t kMaxModes = 8;

// What is asked at run time: plain data, copied into the task that changes modes.
class ModeGate {
 public:
  // All open: for a set-up without a table.
  ModeGate() noexcept { open_.fill(0xff); }
  // `from == to` asks for the mode itself. Modes beyond the table are closed.
  [[nodiscard]] bool may_enter(std::size_t from, std::size_t to) const noexcept {
    return from < kMaxModes && to < kMaxModes && (open_[from] >> to & 1U) != 0;
  }
  void set(std::size_t from, std::size_t to, bool open) noexcept {
    const auto bit = static_cast<std::uint8_t>(1U << to);
    open_[from] = static_cast<std::uint8_t>(open ? open_[from] | bit : open_[from] & ~bit);
  }

 private:
  std::array<std::uint8_t, kMaxModes> open_{};  // bit `to` of word `from`
};

}  // namespace rt
