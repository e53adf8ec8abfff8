#include "drivers/tmcl/tmcl_status.hpp"

namespace drivers::tmcl {

const char* status_text(std::uint8_t code) noexcept {
  switch (code) {
    case status::kWrongChecksum:
      return "wrong checksum";
    case status::kInvalidCommand:
      return "invalid command";
    case status::kWrongType:
      return "wrong type";
    case status::kInvalidValue:
      return "invalid value";
    case status::kEepromLocked:
      return "configuration EEPROM locked";
    case status::kNotAvailable:
      return "command not available";
    case status::kPasswordProtected:
      return "parameter is password protected";
    case status::kOk:
      return "executed";
    case status::kLoaded:
      return "loaded into the program memory";
    default:
      return "unknown status";
  }
}

}  // namespace drivers::tmcl
