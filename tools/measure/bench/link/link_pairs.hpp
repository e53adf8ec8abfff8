// Whether the road disturbs the tasks of 1 kHz: both boxes over a road that carries all there is to
// carry and over one that does not, in turn.
//
// Idle: the base stands, depth codec `quiet`, a quarter of the road. Saturated: lossless depth,
// four times what the road carries. The hand touches in both.
//
// The instructions of a tick are those of a virtual run in free air: that no code of the link runs
// in a tick. What a tick of a hand in contact does depends on the pictures that have come.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "tools/measure/bench/link/link_rig.hpp"

namespace teletact {

inline constexpr int kLinkPairs = 10;
inline constexpr std::array<const char*, 2> kPairedTasks{"haptic", "robot_io"};

// One side of all pairs. By pair, and by task in the order of kPairedTasks.
struct PairedSide {
  std::array<std::vector<double>, kPairedTasks.size()> late_us;  // p99 over the sentinel
  std::vector<double> fps, mbit_s;                               // of pictures
  std::uint64_t own_misses = 0;                                  // of all tasks of both boxes
  double tick_instructions = 0;  // of the median tick of the hand in free air, virtual clock
};

struct LinkPairs {
  std::string problem;      // a run did not come to its end: nothing is measured
  std::string busy;         // others took too much of the machine for figures of time
  std::string not_counted;  // why there are no instructions
  double others_cores = 0;  // the most of a run
  PairedSide idle, saturated;
};

// `idle` and `saturated`: as a rig's runs; their names are its own. Throws std::runtime_error where
// a program can not be started.
[[nodiscard]] LinkPairs measure_pairs(std::ostream& progress, const LinkRig& rig, RigRun idle,
                                      RigRun saturated, int pairs = kLinkPairs);

}  // namespace teletact
