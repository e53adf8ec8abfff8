// Names of states, as the page shows them and as events say them.
#pragma once

#include "tasks/contract/messages.hpp"

namespace teletact {

[[nodiscard]] constexpr const char* mode_text(tasks::Mode m) noexcept {
  constexpr const char* kText[] = {"init", "hold", "engaged", "ramp down", "safe stop"};
  const auto i = static_cast<std::size_t>(m);
  return i < 5 ? kText[i] : "?";
}
[[nodiscard]] constexpr const char* phase_text(tasks::TaskState::Phase p) noexcept {
  constexpr const char* kText[] = {"idle",    "planning", "driving",
                                   "arrived", "failed",   "short of the goal"};
  const auto i = static_cast<std::size_t>(p);
  return i < 6 ? kText[i] : "?";
}
[[nodiscard]] constexpr const char* tracking_text(tasks::CameraPose::Tracking t) noexcept {
  constexpr const char* kText[] = {"lost", "weak", "tracking"};
  return kText[static_cast<std::size_t>(t)];
}

}  // namespace teletact
