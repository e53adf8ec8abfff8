// A line of virtual slaves: what a frame meets between leaving the master's card and coming back to
// it. Source: ESC data sheet section I, 2 and 3: every slave works on the frame as it passes, in
// the order of the line; the first one sets bit 1 of the source address.
#pragma once

#include <memory>
#include <vector>

#include "drivers/ethercat/twin/esc.hpp"

namespace drivers::ethercat {

class TwinChain {
 public:
  // The next slave of the line. Not while frames pass.
  void add(std::unique_ptr<Esc> slave);

  // The frame as it comes back. What is no EtherCAT frame comes back as it was. Nothing allocates.
  void pass(std::span<std::uint8_t> frame, rt::Time now) noexcept;
  // The same, and a cable damages it: `cable` n is the one behind slave n, 0 that of the master's
  // card, at most the last that is connected. Whoever hears it then refuses and counts it by its
  // check sequence, which is not among these bytes, as their damage is not: that is the caller's.
  struct Damage {
    std::size_t cable = 1;
    bool out = false;  // on its way out; else on its way back, when all have worked on it
  };
  void pass_damaged(std::span<std::uint8_t> frame, rt::Time now, Damage) noexcept;

  // Only the first `n` are connected: a cut cable, or power that ends there. Their state goes on by
  // itself, and both ends of the cable count a lost link. size(): whole.
  void cut_behind(std::size_t n) noexcept;
  [[nodiscard]] std::size_t reach() const noexcept { return reach_; }
  [[nodiscard]] std::size_t size() const noexcept { return slaves_.size(); }
  [[nodiscard]] Esc& slave(std::size_t i) noexcept { return *slaves_[i]; }
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }

 private:
  // Through the first `n`.
  void pass_first(std::size_t n, std::span<std::uint8_t> frame, rt::Time now) noexcept;
  std::vector<std::unique_ptr<Esc>> slaves_;
  std::size_t reach_ = 0;
  FrameView view_;
  std::uint64_t frames_ = 0;
};

}  // namespace drivers::ethercat
