#include "drivers/ethercat/al_state.hpp"

#include <algorithm>
#include <array>

namespace drivers::ethercat {

namespace {

struct CodeText {
  std::uint16_t code;
  const char* text;
};

constexpr std::array kCodeTexts{
    CodeText{0x0000, "no error"},
    CodeText{0x0001, "unspecified error"},
    CodeText{0x0002, "no memory"},
    CodeText{0x0011, "invalid requested state change"},
    CodeText{0x0012, "unknown requested state"},
    CodeText{0x0013, "bootstrap not supported"},
    CodeText{0x0014, "no valid firmware"},
    CodeText{0x0015, "invalid mailbox configuration (bootstrap)"},
    CodeText{0x0016, "invalid mailbox configuration"},
    CodeText{0x0017, "invalid sync manager configuration"},
    CodeText{0x0018, "no valid inputs available"},
    CodeText{0x0019, "no valid outputs"},
    CodeText{0x001A, "synchronisation error"},
    CodeText{0x001B, "sync manager watchdog"},
    CodeText{0x001C, "invalid sync manager types"},
    CodeText{0x001D, "invalid output configuration"},
    CodeText{0x001E, "invalid input configuration"},
    CodeText{0x001F, "invalid watchdog configuration"},
    CodeText{0x0020, "slave needs cold start"},
    CodeText{0x0021, "slave needs INIT"},
    CodeText{0x0022, "slave needs PREOP"},
    CodeText{0x0023, "slave needs SAFEOP"},
    CodeText{0x002B, "no valid inputs and outputs"},
    CodeText{0x002C, "fatal synchronisation error"},
    CodeText{0x0030, "invalid distributed clock configuration"},
    CodeText{0x0050, "EEPROM no access"},
    CodeText{0x0051, "EEPROM error"},
    CodeText{0x0060, "slave restarted locally"},
};

}  // namespace

const char* state_text(AlState s) noexcept {
  switch (s) {
    case AlState::kInit:
      return "INIT";
    case AlState::kPreOp:
      return "PREOP";
    case AlState::kBoot:
      return "BOOT";
    case AlState::kSafeOp:
      return "SAFEOP";
    case AlState::kOp:
      return "OP";
    case AlState::kNone:
      return "none";
  }
  return "?";
}

const char* code_text(std::uint16_t code) noexcept {
  const auto at =
      std::lower_bound(kCodeTexts.begin(), kCodeTexts.end(), code,
                       [](const CodeText& t, std::uint16_t wanted) { return t.code < wanted; });
  return at != kCodeTexts.end() && at->code == code ? at->text : "unknown AL status code";
}

}  // namespace drivers::ethercat
