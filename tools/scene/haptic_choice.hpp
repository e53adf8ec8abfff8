// Opens the haptic device of the operator's box: the twin in this process, the Omega.3 through the
// vendor's SDK (or its twin library), a Falcon over USB (or its twin at the wire), or a mouse.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "drivers/haptic/hand_script.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tools/scene/haptic_kind.hpp"

namespace teletact {

// What device.kind may be: the twin, and the rows of haptic_kinds.hpp.
[[nodiscard]] std::vector<std::string> haptic_kind_names();
[[nodiscard]] std::string haptic_kind_list();  // the same with commas, for a help text

// Section [device], beside the keys of the twin.
class HapticChoice {
 public:
  HapticChoice();

  std::string kind = "twin";

  void describe(config::Section& s);
  [[nodiscard]] bool in_process() const { return kind == "twin"; }
  // Not of the twin in this process.
  [[nodiscard]] const HapticKind& chosen() const;

 private:
  std::vector<std::unique_ptr<HapticKind>> kinds_;  // as the rows of haptic_kinds.hpp
};

// `real`: opens the chosen device. Otherwise (simulated time, calibration, replay) the twin's
// mechanics stand in, with the properties of the chosen one. Throws std::runtime_error with one
// line.
[[nodiscard]] std::unique_ptr<OpenedDevice> open_haptic_device(rt::NonRealtime&, const Scene&,
                                                               drivers::HandScript& hand,
                                                               rt::Time epoch, bool real);

// Opens and closes the chosen device in a process of its own, for a vendor's library leaves threads
// and state behind. Throws the one line that says what is missing. The twin needs no check.
void check_haptic_device(const Scene&);

}  // namespace teletact
