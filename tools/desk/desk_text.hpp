// The slow state, as JSON: docs/console_protocol.md, view `text`.
#pragma once

#include <string>

#include "tools/desk/desk_acts.hpp"
#include "tools/desk/desk_events.hpp"

namespace teletact {

// What the desk knows beside what the console has seen.
struct DeskFacts {
  bool paced = false;      // the simulated clock, paced by the real one
  bool takes_acts = true;  // false: every act is refused in this run
  std::string device;      // kind
  bool renders_force = true;
  bool recording = false;
  double fps = 0, mesh_age_ms = 0, picture_age_ms = -1;
  std::uint64_t round_trip_ns = 0;
  std::uint64_t heard_ns = 0;
  bool link_closed = false, link_heard = false;
  int viewers = 0;
  double share = 0;           // of a core: the views and the server's thread
  std::string server_counts;  // JSON text; empty: none
};

[[nodiscard]] std::string text_body(const OperatorView& seen, const DeskActs& acts,
                                    const DeskEvents& events, const DeskFacts& facts,
                                    std::string_view role, std::string_view operator_name);

}  // namespace teletact
