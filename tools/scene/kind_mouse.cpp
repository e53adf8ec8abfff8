// A mouse in place of a haptic device: no force.
#include "drivers/mouse/mouse_device.hpp"
#include "tools/scene/haptic_kinds.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {
namespace {

class RealMouse final : public OpenedDevice {
 public:
  RealMouse(rt::NonRealtime& nrt, const drivers::MouseConfig& config)
      : path_(config.path), device_(nrt, config) {}
  drivers::HapticDevice& device() noexcept override { return device_; }
  std::string description() const override {
    return "mouse " + (path_.empty() ? std::string("(console only)") : path_) + ", no force";
  }

 private:
  std::string path_;
  drivers::MouseDevice device_;
};

class MouseKind final : public HapticKind {
 public:
  void describe(config::Section& s) override { config_.describe(s); }
  drivers::DeviceProperties properties() const override {
    return drivers::MouseDevice::properties_of(config_);
  }
  std::unique_ptr<OpenedDevice> open(rt::NonRealtime& nrt, const Scene&, drivers::HandScript&,
                                     rt::Time) const override {
    return std::make_unique<RealMouse>(nrt, config_);
  }

 private:
  drivers::MouseConfig config_;
};

}  // namespace

std::unique_ptr<HapticKind> mouse_kind() { return std::make_unique<MouseKind>(); }

}  // namespace teletact
