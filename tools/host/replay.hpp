// Runs a recorded box again (input_record.hpp): its own tasks, fed what they were fed, in an order
// in which every job finds the values it used. Time has no part in it: the instants a job sees are
// the recorded ones.
//
// Which orders are allowed (any one gives the same bytes; tests try random ones):
//   within a task        latch k, end of k, latch k + 1, ...
//   on the link          messages as they arrived
//   for each value       a latch that used number n of a cell comes after the publication of n and
//                        before that of n + 1
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "rt/fault/plan.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"
#include "rt/sched/job_record.hpp"
#include "tasks/graph/samples.hpp"
#include "tools/record/input_record.hpp"
#include "tools/scene/scene.hpp"

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
  std::uint64_t inputs_hash = 0;  // of all that was fed from outside: messages, sensed data, frames
  std::string first_difference;   // empty: none
  [[nodiscard]] bool same() const noexcept { return jobs == equal && first_difference.empty(); }
};

// `scene` and `faults` of the recorded run. The scene's own recording, if it has one, is not
// opened.
[[nodiscard]] rt::Result<ReplayResult> replay(rt::NonRealtime&, Scene& scene,
                                              const rt::FaultPlan& faults,
                                              const Recording& recording, std::uint64_t seed = 0);

// Runs another variant of a task on the same input: the recorded jobs at the recorded instants and
// in the recorded order, each at the level that `level` gives it, in a box whose scene may differ
// from the recorded one (voxel size). Input from outside is the recording's, byte for byte;
// messages between tasks of the box are computed again. Compared are the messages taken and the
// sequence numbers that jobs latched, not the outputs.
struct Trial {
  std::function<int(tasks::TaskId, int recorded)> level;
  // A job that committed. cpu_ns: thread CPU of latch, step and commit; feeding it is not in it.
  std::function<void(const rt::JobRecord&)> took;
  // What fusion told of each of its jobs, in order, at the end. May be empty.
  std::function<void(const std::vector<tasks::FusionSample>&)> fused;
  // Threads of fusion's pool beside its own. The CPU of their parts is subtracted from fusion's;
  // the cost that a worker's budget must cover is given as the record of a task kTaskCount.
  int fusion_workers = 0;
};
[[nodiscard]] rt::Result<ReplayResult> run_trial(rt::NonRealtime&, Scene& scene,
                                                 const Recording& recording, const Trial& trial);

}  // namespace teletact
