// teletact touch --replay: a recorded haptic run again.
#pragma once

#include <string>

namespace teletact {

struct TouchRerunOptions {
  std::string run;     // the file
  std::string method;  // empty: the recorded one, and then every byte must be the same
  std::string out, json;
};

// Exit code: 1 when the run replayed as it was and an answer differs. Throws std::runtime_error
// with one line.
[[nodiscard]] int rerun_touch(const TouchRerunOptions& options);

}  // namespace teletact
