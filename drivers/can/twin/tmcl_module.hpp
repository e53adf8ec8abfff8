// A TMCL motor module as its CAN bus sees it: takes a request, gives a reply. Its motor is the
// owner's: the module holds what was asked of it and tells what the owner put in.
#pragma once

#include <cstdint>

#include "drivers/tmcl/tmcl_can.hpp"
#include "rt/time.hpp"

namespace drivers::can {

struct TmclModule {
  // Set-up.
  std::uint32_t id = 1;
  std::uint32_t reply_id = 2;
  std::uint8_t address = 1;
  // From the bus.
  bool turning = false;
  std::int32_t target_rpm = 0;
  // To the bus.
  std::int32_t position = 0, rpm = 0, current_mA = 0;
  std::uint32_t flags = 0;
  // Faults.
  bool silent = false;              // powered off
  std::uint8_t status_instead = 0;  // refuses everything with this status
  std::uint64_t requests = 0, stops = 0;
  rt::Time answered{};  // when its newest reply was ready

  // False: it says nothing. `text`: the reply is eight bytes of text instead, the firmware's name.
  [[nodiscard]] bool answer(const tmcl::Request&, tmcl::Reply& out, bool& text) noexcept;
};

}  // namespace drivers::can
