// The wire, as the master sees it: frames out, frames in, a clock. One implementation on a network
// card (raw_port.hpp), one on the virtual chain (twin/twin_port.hpp), one that writes down what
// passes (capture_port.hpp).
#pragma once

#include <cstdint>
#include <span>

#include "rt/time.hpp"

namespace drivers::ethercat {

class Port {
 public:
  virtual ~Port() = default;
  // Puts a frame on the wire. False: the link is down or the card took nothing. Does not wait. True
  // does not say that a cable is plugged in: link_up() does.
  [[nodiscard]] virtual bool send(std::span<const std::uint8_t> frame) noexcept = 0;
  // The next frame that came, at the latest at `deadline`; its length, 0: none came. A deadline
  // that has passed only looks.
  [[nodiscard]] virtual std::size_t receive(std::span<std::uint8_t> into,
                                            rt::Time deadline) noexcept = 0;
  // Has the card a carrier, as far as it can tell? For a cycle whose frame was lost or refused:
  // neither waits nor allocates, and costs a call of the kernel.
  [[nodiscard]] virtual bool link_up() noexcept { return true; }
  [[nodiscard]] virtual rt::Time now() const noexcept = 0;
  // Set-up only: nothing is done until then.
  virtual void sleep_until(rt::Time) noexcept = 0;
};

}  // namespace drivers::ethercat
