// What the link spares of the pictures, in words for a person: what is lowered, why, and when it
// comes back. The rules are those of drivers/link/frame_asker.hpp and drivers/road/pace.hpp.
#pragma once

#include <optional>
#include <string>

#include "drivers/link/encoded_frame.hpp"
#include "rt/time.hpp"

namespace teletact {

// "depth 2 steps coarser: images fill the road; a step comes back when it is idle for half of the
// time". Empty: nothing is lowered.
[[nodiscard]] std::string spared_text(drivers::Spared spared);

// "112 ms old", "1.4 s old"; "no picture yet".
[[nodiscard]] std::string age_text(std::optional<rt::Nanos> age);

// Tells when that changes, a line each: what is lowered and why, and that it is whole again. What
// goes up and down within two seconds is told once. Pure: time is an argument.
class SparedNews {
 public:
  // The line that is due, or empty.
  [[nodiscard]] std::string look(drivers::Spared now_spared, std::int64_t now_ns);

 private:
  drivers::Spared told_{};
  std::int64_t next_ns_ = 0;
};

}  // namespace teletact
