// Admission at each mode change, worked out before the first release.
//
// A mode change must not run an analysis on a real-time thread, and a stop must not wait for one.
// So each mode's set of tasks and each change between modes is analysed once at start, on the
// placement that admission chose (a running thread is not moved). At run time a mode change only
// reads a table of bits (ModeGate). A change that does not fit is refused, and the table keeps the
// figures for the log.
//
//   a set         per task: whether it runs, and the levels that it may run in; charged the dearest
//                 of them
//   a change      from a to b: every task that runs in either, at the dearest level of both. The
//                 release grid does not move, and a level is switched only where no job is pending.
//                 So during the change no two jobs of a task are closer than its period and none
//                 costs more than this: the steady-state analysis of that set bounds every response
//                 during the change.
//   safe modes    the modes that a fault leads to (hold, ramp down, stop) must never be refused. If
//                 one of them, or a change into one from any mode, does not fit, the start is
//                 refused.
//
// The host's registry is entered with each task's dearest row over all modes that may be entered,
// so a mode change never has to ask it (largest_of).
#pragma once

#include <string>
#include <vector>

#include "rt/sched/admission.hpp"
#include "rt/sched/mode_gate.hpp"

namespace rt {

struct ModeDemand {
  bool runs = true;
  int first_level = 0, last_level = 0;  // any of them, at any time
};

struct ModeSet {
  std::string name;
  bool safe = false;  // may never be refused
  std::vector<ModeDemand>
      demands;  // as the tasks of the request; of a pool worker not used: its parent's
};

struct ModeVerdict {
  std::size_t from = 0, to = 0;  // equal: the mode itself
  bool admitted = false;
  std::string refusal;     // task and figures
  double utilisation = 0;  // of the fullest core, real-time with switch costs
  Nanos slack{0};          // least of all tasks
};

struct ModeTable {
  std::vector<ModeSet> modes;
  std::vector<ModeVerdict> verdicts;  // row-major: from * modes.size() + to
  ModeGate gate;
  std::string refusal;  // why the program may not start at all; empty: it may

  [[nodiscard]] const ModeVerdict& verdict(std::size_t from, std::size_t to) const {
    return verdicts[from * modes.size() + to];
  }
};

// `request` as admitted, `admission` its answer. Throws std::invalid_argument for more than
// kMaxModes, or demands that do not match the tasks.
[[nodiscard]] ModeTable analyse_modes(const AdmissionRequest& request, const Admission& admission,
                                      std::vector<ModeSet> modes);

// The request with every task at its dearest over the modes and changes that may be entered, pinned
// where it is: its admission gives the rows for the registry. That admission is a refusal where two
// modes exclude each other: they can then not share one entry of the registry.
[[nodiscard]] AdmissionRequest largest_of(const AdmissionRequest& request,
                                          const Admission& admission, const ModeTable& table);

// One line a mode, one a refused change.
[[nodiscard]] std::string mode_report(const ModeTable& table);

}  // namespace rt
