// The haptic devices that a scene may choose beside the twin in this process, a row each.
#pragma once

#include <array>
#include <memory>

#include "tools/scene/haptic_kind.hpp"

namespace teletact {

// Each in its kind_<name>.cpp.
[[nodiscard]] std::unique_ptr<HapticKind> omega_kind();
[[nodiscard]] std::unique_ptr<HapticKind> falcon_kind();
[[nodiscard]] std::unique_ptr<HapticKind> mouse_kind();

struct HapticKindRow {
  const char* name;  // device.kind, and the section of its keys
  const char* doc;
  std::unique_ptr<HapticKind> (*make)();
};
inline constexpr std::array kHapticKinds{
    HapticKindRow{"omega", "Omega.3 through the vendor's SDK", &omega_kind},
    HapticKindRow{"falcon", "Novint Falcon over USB", &falcon_kind},
    HapticKindRow{"mouse", "a mouse in place of a device", &mouse_kind},
};

}  // namespace teletact
