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

  // Only the first `n` are connected: a cut cable, or power that ends there. Their state goes on by
  // itself. size(): whole.
  void cut_behind(std::size_t n) noexcept;
  [[nodiscard]] std::size_t reach() const noexcept { return reach_; }
  [[nodiscard]] std::size_t size() const noexcept { return slaves_.size(); }
  [[nodiscard]] Esc& slave(std::size_t i) noexcept { return *slaves_[i]; }
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }

 private:
  std::vector<std::unique_ptr<Esc>> slaves_;
  std::size_t reach_ = 0;
  FrameView view_;
  std::uint64_t frames_ = 0;
};

}  // namespace drivers::ethercat
