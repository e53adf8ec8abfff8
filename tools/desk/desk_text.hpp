// The slow state, as JSON: docs/console_protocol.md, view `text`.
#pragma once

#include <string>

#include "tools/desk/desk_acts.hpp"
#include "tools/desk/desk_events.hpp"
#include "tools/desk/link_now.hpp"
#include "tools/desk/task_watch.hpp"

namespace teletact {

struct LinkFacts {
  LinkNow now;
  double loss = -1;          // share of the pictures; below 0: not known
  double round_trip_ms = 0;  // 0: not measured yet
  double heard_ago_ms = -1;  // any message; below 0: never
  double heard_at_s = 0;     // the same, since the epoch of the run
  bool closed = false, refused = false;
  std::string lowered;                 // of the pictures, in words; empty: they are whole
  std::uint64_t commands_refused = 0;  // by the robot's box

  static constexpr double kSilent_ms = 500;
  // What is wrong with it now, whatever the mode is. A box that was never heard is not silent.
  [[nodiscard]] rt::FaultId fault() const noexcept;
};

// What the desk knows beside what the console has seen.
struct DeskFacts {
  bool paced = false;      // the simulated clock, paced by the real one
  bool takes_acts = true;  // false: every act is refused in this run
  std::string device;      // kind
  bool renders_force = true;
  double scale = 0;  // scene metres per hand metre
  LinkFacts link;
  std::vector<TaskFigures> tasks;
  int viewers = 0;
  double share = 0;  // of a core: the views and the server's thread
};

[[nodiscard]] std::string text_body(const OperatorView& seen, const DeskActs& acts,
                                    const DeskEvents& events, const DeskFacts& facts,
                                    std::string_view role, std::string_view operator_name);

}  // namespace teletact
