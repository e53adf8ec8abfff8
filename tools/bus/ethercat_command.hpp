// What `teletact ethercat` does, one function a word. Each prints a table and writes JSON where it
// is asked to. Exit code 0: fine; 1: a wrong chain. Throws CouldNotDo for a slave that does not do
// it (exit code 1), and std::runtime_error with one line for bad input (2).
#pragma once

#include <cstdint>
#include <string>

#include "tools/bus/ethercat_session.hpp"

namespace teletact {

struct EtherCatOptions {
  EtherCatChoice bus;
  std::string json, expect, to;
  int slave = 1;
  // Of a register, an EEPROM word or a written object; -1: not said, so 2. Of a parameter; -1: not
  // said, so 0.
  int bytes = -1, motor = -1, module = -1;
  int reg = -1, parameter = -1, sii = -1;
  std::string sdo;
  std::int64_t value = 0;
  double seconds = 1;  // capture
};

[[nodiscard]] int run_scan(const EtherCatOptions&);
[[nodiscard]] int run_state(const EtherCatOptions&);
[[nodiscard]] int run_read(const EtherCatOptions&);
[[nodiscard]] int run_write(const EtherCatOptions&);
// Every frame of the card, of other programs too, into `bus.capture`; sends none. Of a twin: cycles
// in OP. 1: there was no frame.
[[nodiscard]] int run_capture(const EtherCatOptions&);

}  // namespace teletact
