// Where this user's programs keep what must outlive a run.
#pragma once

#include <string>

namespace teletact {

// XDG_STATE_HOME, else ~/.local/state, with teletact. It need not exist.
[[nodiscard]] std::string user_state_folder();

}  // namespace teletact
