#include "drivers/can/twin/tmcl_module.hpp"

#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"

namespace drivers::can {

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
      if (q.type != tmcl::axis::kTargetSpeed) {
        out.status = tmcl::status::kWrongType;
        break;
      }
      turning = true;
      target_rpm = q.value;
      break;
    case Command::kGetAxisParameter:
      if (q.type == tmcl::axis::kTargetSpeed) {
        out.value = target_rpm;
      } else if (q.type == tmcl::axis::kActualPosition) {
        out.value = position;
      } else if (q.type == tmcl::axis::kActualSpeed) {
        out.value = rpm;
      } else if (q.type == tmcl::axis::kActualCurrent) {
        out.value = current_mA;
      } else if (q.type == tmcl::axis::kFlags) {
        out.value = static_cast<std::int32_t>(flags);
      } else {
        out.status = tmcl::status::kWrongType;
      }
      break;
    case Command::kGetGlobal:
      if (q.type == tmcl::global::kCanRate) {
        out.value = 8;  // 1000 kbit/s
      } else if (q.type == tmcl::global::kCanReplyId) {
        out.value = static_cast<std::int32_t>(reply_id);
      } else if (q.type == tmcl::global::kCanId) {
        out.value = static_cast<std::int32_t>(id);
      } else {
        out.status = tmcl::status::kWrongType;
      }
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
