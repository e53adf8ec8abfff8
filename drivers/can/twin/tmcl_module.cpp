#include "drivers/can/twin/tmcl_module.hpp"

#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "drivers/youbot/motor_flags.hpp"

namespace drivers::can {

bool TmclModule::axis_parameter(std::uint8_t number, std::int32_t& value) const noexcept {
  switch (number) {
    case tmcl::axis::kTargetSpeed:
      value = target_rpm;
      return true;
    case tmcl::axis::kActualPosition:
      value = position;
      return true;
    case tmcl::axis::kActualSpeed:
      value = rpm;
      return true;
    case tmcl::axis::kActualCurrent:
      value = current_mA;
      return true;
    case tmcl::axis::kFlags:
      value = static_cast<std::int32_t>(flags | (timed_out ? motor_flag::kTimeout : 0U) |
                                        (tripped ? motor_flag::kI2tExceeded : 0U));
      return true;
    default:
      return false;
  }
}

std::uint8_t TmclModule::set_axis(std::uint8_t number, std::int32_t value) noexcept {
  switch (number) {
    case tmcl::axis::kTargetSpeed:
      turning = !timed_out && !tripped;
      target_rpm = turning ? value : 0;
      return tmcl::status::kOk;
    case tmcl::axis::kClearTimeout:
      if (!knows_clears) return tmcl::status::kWrongType;
      timed_out = false;
      return tmcl::status::kOk;
    case tmcl::axis::kClearI2t:
      if (!knows_clears) return tmcl::status::kWrongType;
      tripped = tripped && hot;
      return tmcl::status::kOk;
    default:
      return tmcl::status::kWrongType;
  }
}

bool TmclModule::global_parameter(std::uint8_t number, std::int32_t& value) const noexcept {
  switch (number) {
    case tmcl::global::kCanRate:
      value = 8;  // 1000 kbit/s
      return true;
    case tmcl::global::kCanReplyId:
      value = static_cast<std::int32_t>(reply_id);
      return true;
    case tmcl::global::kCanId:
      value = static_cast<std::int32_t>(id);
      return true;
    default:
      return false;
  }
}

bool TmclModule::answer(const tmcl::Request& q, tmcl::Reply& out, bool& text) noexcept {
  using tmcl::Command;
  text = false;
  if (silent) return false;
  ++requests;
  out = {0, address, tmcl::status::kOk, q.command, q.value};
  if (status_instead != 0) {
    out.status = status_instead;
    return true;
  }
  if (q.motor != 0 && static_cast<Command>(q.command) != Command::kGetGlobal) {
    out.status = tmcl::status::kInvalidValue;
    return true;
  }
  switch (static_cast<Command>(q.command)) {
    case Command::kMotorStop:
      turning = false;
      target_rpm = 0;
      ++stops;
      break;
    case Command::kSetAxisParameter:
      out.status = set_axis(q.type, q.value);
      break;
    case Command::kGetAxisParameter:
      if (!axis_parameter(q.type, out.value)) out.status = tmcl::status::kWrongType;
      break;
    case Command::kGetGlobal:
      if (!global_parameter(q.type, out.value)) out.status = tmcl::status::kWrongType;
      break;
    case Command::kFirmwareVersion:
      text = q.type == 0;
      out.value = 0x06680148;  // type 1: number 1640, version 1.72
      break;
    default:
      out.status = tmcl::status::kInvalidCommand;
  }
  return true;
}

}  // namespace drivers::can
