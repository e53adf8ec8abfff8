// Runs a recorded box again (input_record.hpp): its own tasks, fed what they were fed, in an order in
// which every job finds the values it used. Time has no part in it: the instants a job sees are the
// recorded ones.
//
// Which orders are allowed (any one gives the same bytes; tests try random ones):
//   within a task        latch k, end of k, latch k + 1, ...
//   on the link          messages as they arrived
//   for each value       a latch that used number n of a cell comes after the publication of n and
//                        before that of n + 1
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rt/fault/plan.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"
#include "tools/teletact/input_record.hpp"
#include "tools/teletact/scene.hpp"

namespace teletact {

struct ReplayStep {
  bool message = false;     // else a job's op
  std::uint32_t index = 0;  // in Recording::messages or ::ops
};
// seed 0: by the instant things happened, as far as the rules allow; else a random allowed order.
// A latch whose job never ended is left out. Refused: a recording that contradicts itself.
[[nodiscard]] rt::Result<std::vector<ReplayStep>> replay_order(const Recording& recording,
                                                               std::uint64_t seed = 0);

struct ReplayResult {
  std::uint64_t jobs = 0;        // that committed in the recording
  std::uint64_t equal = 0;       // same inputs, same output hash, same publications
  std::uint64_t abandoned = 0;   // aborted jobs, taken back again
  std::uint64_t unfinished = 0;  // under way when the recording ended
  std::uint64_t messages = 0;
  std::string first_difference;  // empty: none
  [[nodiscard]] bool same() const noexcept { return jobs == equal && first_difference.empty(); }
};

// `scene` and `faults` of the recorded run. The scene's own recording, if it has one, is not opened.
[[nodiscard]] rt::Result<ReplayResult> replay(rt::NonRealtime&, Scene& scene,
                                              const rt::FaultPlan& faults,
                                              const Recording& recording, std::uint64_t seed = 0);

}  // namespace teletact
