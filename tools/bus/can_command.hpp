// What `teletact can` does, one function a word. Exit code 0: fine; 1: nobody there, or a module
// refuses. Throws CouldNotDo (exit code 1), and std::runtime_error with one line for bad input (2).
#pragma once

#include <cstdint>
#include <string>

#include "tools/bus/can_session.hpp"

namespace teletact {

struct CanOptions {
  CanChoice bus;
  std::string json;
  int last_id = 127, wait_ms = 10;        // scan
  double for_s = 1;                       // dump, serve
  int id = 1, parameter = -1, motor = 0;  // get, set
  bool global = false;                    // parameter of the module, motor is then the bank
  std::int64_t value = 0;
  bool yes = false;
};

[[nodiscard]] int can_scan(const CanOptions&);
[[nodiscard]] int can_dump(const CanOptions&);
[[nodiscard]] int can_get(const CanOptions&);
[[nodiscard]] int can_set(const CanOptions&);
// Simulated modules on an interface, for as long as was asked for.
[[nodiscard]] int can_serve(const CanOptions&);

}  // namespace teletact
