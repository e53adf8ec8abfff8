// Checks whether the tasks may have what the real clock needs: real-time priority, locked memory,
// CPU time of two cores. States in words what is missing, and the one command that gives it. The
// demo asks before it chooses a clock; the doctor ends with the same words.
#pragma once

#include <string>
#include <vector>

namespace teletact {

struct Rights {
  std::vector<std::string> lacks;  // a few words each; empty: nothing
  std::string command;             // gives what is missing; a line of advice where no command does

  [[nodiscard]] bool enough() const noexcept { return lacks.empty(); }
  [[nodiscard]] std::string why() const;  // all of `lacks`, on one line
};

// What a look at the machine finds. `root` as in doctor.hpp: "" is this machine.
struct RightsAsked {
  std::string root;
  std::string program;  // the file that would get capabilities
  int cpus = 0;         // of the affinity mask
  std::string no_fifo;  // why a thread did not get SCHED_FIFO when it was tried; empty: it did
};
[[nodiscard]] Rights find_rights(const RightsAsked& asked);
// Of this process, by trying; with a root as its files say.
[[nodiscard]] Rights find_rights(const std::string& root = {});

}  // namespace teletact
