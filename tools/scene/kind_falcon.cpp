// The Novint Falcon over USB, or its twin at the wire.
#include "drivers/falcon/falcon_device.hpp"
#include "drivers/falcon/falcon_twin_thread.hpp"
#include "drivers/falcon/libusb_transport.hpp"
#include "tools/scene/haptic_kinds.hpp"
#include "tools/scene/kind_figures.hpp"
#include "tools/scene/kind_of.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {
namespace {

class RealFalcon final : public OpenedDevice {
 public:
  RealFalcon(rt::NonRealtime& nrt, const drivers::FalconConfig& config,
             std::unique_ptr<drivers::FalconTwin> twin)
      : twin_(std::move(twin)), device_(nrt, config, opener(config.event_priority)) {
    device_.request_enable();
  }
  drivers::HapticDevice& device() noexcept override { return device_; }
  std::string description() const override {
    return device_.description() + (twin_ ? " (twin at the wire)" : "");
  }
  bool person_simulated() const noexcept override { return twin_ != nullptr; }
  Figures figures() const override {
    const auto c = device_.counters();
    Figures out = counted({{"frames", c.frames},
                           {"samples", c.samples},
                           {"repeats", c.repeats},
                           {"damaged", c.damaged},
                           {"leaps", c.leaps},
                           {"unsolved", c.unsolved},
                           {"kicks", c.kicks},
                           {"losses", c.losses},
                           {"reopened", c.reopened}});
    add_times(out, "round_trip", device_.round_trips());
    return out;
  }

 private:
  drivers::FalconDevice::Opener opener(int priority) {
    if (!twin_) return [priority] { return drivers::LibusbFalconTransport::open(priority); };
    return [this] {
      return std::unique_ptr<drivers::FalconTransport>(
          std::make_unique<drivers::FalconTwinThread>(*twin_));
    };
  }
  std::unique_ptr<drivers::FalconTwin> twin_;
  drivers::FalconDevice device_;
};

class FalconKind final : public KindOf<drivers::FalconDevice, drivers::FalconConfig> {
 public:
  void describe(config::Section& s) override {
    KindOf::describe(s);
    s.flag("twin", twin_, "its twin at the wire instead of the hardware");
  }
  std::unique_ptr<OpenedDevice> open(rt::NonRealtime& nrt, const Scene& scene,
                                     drivers::HandScript& hand, rt::Time epoch) const override {
    return std::make_unique<RealFalcon>(nrt, config_, make_twin(nrt, scene, hand, epoch));
  }

 private:
  // Null: the hardware is meant.
  std::unique_ptr<drivers::FalconTwin> make_twin(rt::NonRealtime& nrt, const Scene& scene,
                                                 drivers::HandScript& hand, rt::Time epoch) const {
    if (!twin_) return nullptr;
    drivers::FalconTwinConfig c;
    c.plant = scene.device;
    c.loaded = c.homed = true;
    c.counts_per_N_m = config_.counts_per_N_m;
    const auto start = scene.workspace().to_device(hand.target(rt::Nanos{0}).p_WT);
    auto twin =
        std::make_unique<drivers::FalconTwin>(nrt, c, hand.size() > 0 ? &hand : nullptr, start);
    twin->plant().start_hand(epoch);
    return twin;
  }

  bool twin_ = false;
};

}  // namespace

std::unique_ptr<HapticKind> falcon_kind() { return std::make_unique<FalconKind>(); }

}  // namespace teletact
