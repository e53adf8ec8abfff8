// What `teletact youbot` does, one function a word. `setup` and `jog` first say what will move and
// wait for a person's word; without it they end with code 1 and nothing has moved. Exit code 0:
// fine; 1: something is wrong with the robot, or nobody confirmed. Throws CouldNotDo (1) and
// std::runtime_error with one line for bad input (2).
#pragma once

#include <istream>
#include <string>
#include <vector>

#include "tools/bus/ethercat_session.hpp"

namespace teletact {

struct YoubotOptions {
  EtherCatChoice bus;
  std::string json;
  std::string expect;       // the chain that it must be; empty: any
  double wait_s = 0;        // for boards that are missing; 0: told at once
  std::string calibration;  // setup: file of what homing measures, and so homing anyway
  int slave = 2;
  double speed_rad_per_s = 0.2, seconds = 1;
};

[[nodiscard]] int run_youbot_check(const YoubotOptions&);
// `person`: where the word comes from, standard input.
[[nodiscard]] int run_youbot_setup(const YoubotOptions&, std::istream& person);
[[nodiscard]] int run_youbot_jog(const YoubotOptions&, std::istream& person);

struct TwinOptions {
  std::string iface, chain = "base+arm", generation = "new";
  double seconds = 0;               // 0: until it is interrupted
  bool ready = false;               // commutation known at power-up
  std::string effects;              // file of its motors' effects; empty: ideal ones
  std::vector<std::string> faults;  // twin_faults.hpp
};

// The virtual youBot as a program behind a network card: every frame that comes goes through its
// slaves and back. On the real clock alone. Ends on SIGINT and SIGTERM.
[[nodiscard]] int run_youbot_twin(const TwinOptions&);

}  // namespace teletact
