// The Omega.3 through the vendor's SDK, or through its twin library.
#include <sstream>
#include <stdexcept>

#include "drivers/omega/omega_device.hpp"
#include "drivers/omega/twin_sdk/twin_control.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/scene/haptic_kinds.hpp"
#include "tools/scene/kind_figures.hpp"
#include "tools/scene/kind_of.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {
namespace {

// What of a scene the twin library takes: [device] is its [twin], and, `with_hand`, [hand] its
// hand.
std::string twin_library_text(const Scene& scene, bool with_hand) {
  std::istringstream lines(config::effective(scene.schema));
  std::ostringstream out;
  bool wanted = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("# ", 0) == 0) line.erase(0, 2);
    if (!line.empty() && line.front() == '[') {
      wanted =
          line == "[device]" || (with_hand && (line == "[hand]" || line == "[[hand.segment]]"));
      if (line == "[device]") line = "[twin]";
    }
    if (wanted && line.rfind("kind = \"" + scene.choice.kind + "\"", 0) != 0) out << line << '\n';
  }
  const auto& h = scene.graph.haptic;
  out << "[workspace]\nworkspace_W_m = [" << h.workspace_W_m[0] << ", " << h.workspace_W_m[1]
      << ", " << h.workspace_W_m[2] << "]\nscale = " << h.scale
      << "\nyaw_deg = " << h.workspace_yaw_deg << '\n';
  return out.str();
}

// The vendor's library has no such handles; the twin's gets its scene and its hand, before the
// driver opens it. Kept loaded beside the driver, since a library that is closed forgets.
std::unique_ptr<drivers::DhdLibrary> set_up_twin_library(rt::NonRealtime& nrt, const Scene& scene,
                                                         const std::string& sdk, bool with_hand,
                                                         rt::Time epoch) {
  drivers::DhdSearch search;
  search.named = sdk;
  auto loaded = drivers::DhdLibrary::load(nrt, search);
  if (!loaded) return nullptr;  // the driver says it
  auto library = std::move(loaded).value();
  const auto control = drivers::find_twin_control(*library);
  if (!control.complete()) return nullptr;
  if (control.reset(twin_library_text(scene, with_hand).c_str()) != 0) {
    throw std::runtime_error(std::string("omega: twin library: ") + control.error());
  }
  control.start_hand(rt::seconds(epoch - rt::time_from_ns(rt::monotonic_ns())));
  return library;
}

class RealOmega final : public OpenedDevice {
 public:
  RealOmega(rt::NonRealtime& nrt, const Scene& scene, const drivers::OmegaConfig& config,
            bool with_hand, rt::Time epoch)
      : twin_(set_up_twin_library(nrt, scene, config.sdk, with_hand, epoch)), device_(nrt, config) {
    device_.request_enable();
  }
  drivers::HapticDevice& device() noexcept override { return device_; }
  std::string description() const override { return device_.description(); }
  bool person_simulated() const noexcept override { return twin_ != nullptr; }
  Figures figures() const override {
    const auto c = device_.counters();
    Figures out = counted({{"samples", c.samples},
                           {"repeats", c.repeats},
                           {"failures", c.failures},
                           {"saturated", c.saturated},
                           {"losses", c.losses},
                           {"reopened", c.reopened},
                           {"force_offs", c.force_offs}});
    add_times(out, "exchange", device_.exchange_times());
    return out;
  }

 private:
  std::unique_ptr<drivers::DhdLibrary> twin_;
  drivers::OmegaDevice device_;
};

class OmegaKind final : public KindOf<drivers::OmegaDevice, drivers::OmegaConfig> {
 public:
  std::unique_ptr<OpenedDevice> open(rt::NonRealtime& nrt, const Scene& scene,
                                     drivers::HandScript& hand, rt::Time epoch) const override {
    return std::make_unique<RealOmega>(nrt, scene, config_, hand.size() > 0, epoch);
  }
};

}  // namespace

std::unique_ptr<HapticKind> omega_kind() { return std::make_unique<OmegaKind>(); }

}  // namespace teletact
