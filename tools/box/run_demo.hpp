// One run of the demo: chooses the clock, sets up what the scene names, runs both boxes, reports.
#pragma once

#include <memory>
#include <string>

#include "tools/host/run_options.hpp"

namespace teletact {

struct DemoWords {
  std::string clock = "auto";  // auto, real, paced, virtual
  bool cores_given = false;
  std::string json;  // file for the figures; empty: none
};

// The program starts again with one instruction set, so that a run repeats on another machine.
// argv: of the subcommand, behind the program's name. Returns when it is so already; throws when it
// can not be.
void start_again_scalar(char** argv);

// Writes the report folder, and returns the exit code. Throws std::runtime_error with one line for
// what can not be run, CouldNotStart for what is not admitted.
[[nodiscard]] int run_demo(Scene&, DemoOptions&, const DemoWords&);

}  // namespace teletact
