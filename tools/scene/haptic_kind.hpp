// A kind of haptic device, as a scene chooses it, and the device once it is open.
// A new kind: its own kind_<name>.cpp, short by kind_of.hpp, and a row in haptic_kinds.hpp
// (docs/devices.md).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "config/schema.hpp"
#include "drivers/haptic/hand_script.hpp"
#include "drivers/haptic/haptic_device.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

struct Scene;

class OpenedDevice {
 public:
  using Figures = std::vector<std::pair<std::string, double>>;

  virtual ~OpenedDevice() = default;
  [[nodiscard]] virtual drivers::HapticDevice& device() noexcept = 0;
  [[nodiscard]] virtual std::string description() const = 0;
  // The hand is a twin's: who holds the device acts in the program too. False: only a person brings
  // forces back.
  [[nodiscard]] virtual bool person_simulated() const noexcept { return false; }
  // CPU time that a twin spent inside the tick; null: nothing is simulated there.
  [[nodiscard]] virtual std::function<std::int64_t()> twin_cpu() { return nullptr; }
  [[nodiscard]] virtual std::vector<std::string> effects() const { return {}; }
  // What the driver counted, one "name value" a line.
  [[nodiscard]] virtual Figures figures() const { return {}; }
};

class HapticKind {
 public:
  virtual ~HapticKind() = default;
  // Its keys: section [device.<name>].
  virtual void describe(config::Section& s) = 0;
  // As these keys have it, whether or not a device is there.
  [[nodiscard]] virtual drivers::DeviceProperties properties() const = 0;
  // Opens the device. `hand` is for its twin. Throws std::runtime_error with one line.
  [[nodiscard]] virtual std::unique_ptr<OpenedDevice> open(rt::NonRealtime&, const Scene&,
                                                           drivers::HandScript& hand,
                                                           rt::Time epoch) const = 0;
};

}  // namespace teletact
