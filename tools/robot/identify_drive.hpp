// The robot's parameters out of a drive of the twin or of files, told and written: what
// `teletact identify robot` does. Its options are told in tools/teletact/cmd_identify_robot.cpp.
#pragma once

#include <string>
#include <vector>

namespace teletact {

struct IdentifyRobotOptions {
  std::string scene = "rounds", wheels, poses, rgbd, plan, write, json, record;
  std::vector<std::string> overrides;
  double ticks_per_turn = 0;
  bool partial = false;
};

// Throws std::runtime_error with one line; then no output is left.
void identify_drive(const IdentifyRobotOptions& o);

}  // namespace teletact
