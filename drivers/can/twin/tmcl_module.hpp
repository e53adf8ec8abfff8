// A TMCL motor module as its CAN bus sees it: takes a request, gives a reply. Its motor is the
// owner's: the module holds what was asked of it and tells what the owner put in.
#pragma once

#include <cstdint>

#include "drivers/tmcl/tmcl_can.hpp"
#include "rt/time.hpp"

namespace drivers::can {

class TmclModule {
 public:
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
  bool silent = false;  // powered off
  // Latched, bits 16 and 17 of its flags: it stands until they are cleared by SAP 158 and SAP 29.
  bool timed_out = false, tripped = false;
  bool hot = false;                 // its winding: SAP 29 is taken and clears nothing
  bool knows_clears = true;         // false: it has no such parameters
  std::uint8_t status_instead = 0;  // refuses everything with this status
  std::uint64_t requests = 0, stops = 0;
  rt::Time answered{};  // when its newest reply was ready

  // False: it says nothing. `text`: the reply is eight bytes of text instead, the firmware's name.
  [[nodiscard]] bool answer(const tmcl::Request&, tmcl::Reply& out, bool& text) noexcept;

 private:
  [[nodiscard]] std::uint8_t set_axis(std::uint8_t number, std::int32_t value) noexcept;
  // False: it has no such parameter.
  [[nodiscard]] bool axis_parameter(std::uint8_t number, std::int32_t& value) const noexcept;
  [[nodiscard]] bool global_parameter(std::uint8_t number, std::int32_t& value) const noexcept;
};

}  // namespace drivers::can
