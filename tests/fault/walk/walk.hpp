// A walk through docs/faults.md: a fault lasts 10 s, then a person follows what its row says.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "tasks/supervision/fault_ids.hpp"
#include "tests/fault/walk/faulty_devices.hpp"
#include "tests/unit/desk_run/person.hpp"
#include "tools/scene/box_devices.hpp"

namespace walk {

class Walker;

// What a fault is done to.
struct World {
  teletact::RobotTwins twins;
  FaultyHand* hand = nullptr;
  FaultyCamera* camera = nullptr;
  Walker* person = nullptr;
  rt::Time robot_now{};  // the robot's clock
};

// One message fault or timing fault of a plan (rt/fault/plan.hpp).
struct Planned {
  std::string kind, target;
  int first = 0, count = 0;
  double magnitude_ms = 0;
  int every = 1;
};

struct Story {
  std::string code{};  // F-RIO-12
  std::string what{};  // which of its causes, for the printed line
  std::vector<std::string> overrides{};
  std::vector<Planned> plan{};
  std::function<void(teletact::Scene&)> set_up{};
  // At 3 s; every 20 ms until 13 s; at 13 s.
  std::function<void(World&)> begin{}, lasts{}, end{};
  // In tools/test, and there from a hold too; the others in --all.
  bool short_run = false, holding_too = false;
  // The person drives while the fault comes, or both boxes hold: the operator's box then follows no
  // safe stop of the robot's.
  bool engaged = true;
};
[[nodiscard]] std::vector<Story> stories();

// A row that a run on the virtual clock can not make, and the test that makes it ("suite Name").
struct Elsewhere {
  std::string code, test, why;
};
[[nodiscard]] std::vector<Elsewhere> elsewhere();

inline constexpr double kFrom_s = 3, kUntil_s = 13, kMost_s = 30;

struct Outcome {
  bool ready = false;   // engaged and driven before the fault
  bool seen = false;    // the row's fault was reported by a task, or is on the page
  bool driven = false;  // after it
  bool final = false;   // a clear was refused with the row's words, which ask for a new start
  int clears = 0, engages = 0;
  double after_s = -1;           // from the end of the fault until it drove again
  std::string words;             // of the last refusal, and why it did not drive
  std::set<std::string> causes;  // rows that put a box into its mode, as the page named them
};
[[nodiscard]] Outcome walk(const Story& story);
// The row of a text that begins with its code, or holds it; null: none.
[[nodiscard]] const tasks::FaultRow* row_in(const std::string& text);
[[nodiscard]] const tasks::FaultRow& row_of(const std::string& code);

}  // namespace walk
