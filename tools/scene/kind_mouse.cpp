// A mouse in place of a haptic device: no force.
#include "drivers/mouse/mouse_device.hpp"
#include "tools/scene/haptic_kinds.hpp"
#include "tools/scene/kind_of.hpp"

namespace teletact {

std::unique_ptr<HapticKind> mouse_kind() {
  using drivers::MouseConfig;
  return std::make_unique<PlainKind<drivers::MouseDevice, MouseConfig>>([](const MouseConfig& c) {
    return "mouse " + (c.path.empty() ? std::string("(console only)") : c.path) + ", no force";
  });
}

}  // namespace teletact
