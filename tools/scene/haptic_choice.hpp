// Which haptic device the operator's box drives: the twin in this process, the Omega.3 through the
// vendor's SDK (or its twin library), a Falcon over USB (or its twin at the wire), a mouse.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "drivers/falcon/falcon_device.hpp"
#include "drivers/haptic/hand_script.hpp"
#include "drivers/mouse/mouse_device.hpp"
#include "drivers/omega/omega_device.hpp"
#include "drivers/omega/omega_twin.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

struct Scene;

// Section [device], beside the keys of the twin.
struct HapticChoice {
  std::string kind = "twin";
  drivers::OmegaConfig omega;
  drivers::FalconConfig falcon;
  bool falcon_twin = false;
  drivers::MouseConfig mouse;

  void describe(config::Section& s);
  [[nodiscard]] bool in_process() const { return kind == "twin"; }
};

class OpenedDevice {
 public:
  virtual ~OpenedDevice() = default;
  [[nodiscard]] virtual drivers::HapticDevice& device() noexcept = 0;
  [[nodiscard]] virtual std::string description() const = 0;
  // The hand is a twin's: who holds the device acts in the program too. False: only a person brings forces back.
  [[nodiscard]] virtual bool person_simulated() const noexcept { return false; }
  // CPU time that a twin spent inside the tick; null: nothing is simulated there.
  [[nodiscard]] virtual std::function<std::int64_t()> twin_cpu() { return nullptr; }
  [[nodiscard]] virtual std::vector<std::string> effects() const { return {}; }
  // What the driver counted, one "name value" a line.
  [[nodiscard]] virtual std::vector<std::pair<std::string, double>> figures() const { return {}; }
};

// `real`: opens the chosen device. Otherwise (simulated time, calibration, replay) the twin's mechanics
// stand in, with the properties of the chosen one. Throws std::runtime_error with one line.
[[nodiscard]] std::unique_ptr<OpenedDevice> open_haptic_device(rt::NonRealtime&, const Scene&,
                                                               drivers::HandScript& hand,
                                                               rt::Time epoch, bool real);

// Opens and closes the chosen device in a process of its own, for a vendor's library leaves threads and
// state behind. Throws the one line that says what is missing. The twin needs no check.
void check_haptic_device(const Scene&);

}  // namespace teletact
