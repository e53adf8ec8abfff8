#include "tools/files/user_folder.hpp"

#include <cstdlib>
#include <filesystem>

namespace teletact {

std::string user_state_folder() {
  namespace fs = std::filesystem;
  const char* state = std::getenv("XDG_STATE_HOME");
  const char* home = std::getenv("HOME");
  const fs::path base = state != nullptr && *state != 0
                            ? fs::path(state)
                            : fs::path(home != nullptr ? home : "/tmp") / ".local/state";
  return (base / "teletact").string();
}

}  // namespace teletact
