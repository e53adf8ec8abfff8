// What kinds of haptic devices have in common.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "tools/scene/haptic_kind.hpp"

namespace teletact {

// A kind whose keys are those of its driver. open() is left to it.
template <class Device, class Config>
class KindOf : public HapticKind {
 public:
  void describe(config::Section& s) override { config_.describe(s); }
  drivers::DeviceProperties properties() const override { return Device::properties_of(config_); }

 protected:
  Config config_;
};

// A device without a twin, figures or acts of its own.
template <class Device>
class PlainDevice final : public OpenedDevice {
 public:
  template <class Config>
  PlainDevice(rt::NonRealtime& nrt, const Config& config, std::string description)
      : description_(std::move(description)), device_(nrt, config) {}
  drivers::HapticDevice& device() noexcept override { return device_; }
  std::string description() const override { return description_; }

 private:
  std::string description_;
  Device device_;
};

// Its kind: a new one needs only the driver and what its open device is called.
template <class Device, class Config>
class PlainKind final : public KindOf<Device, Config> {
 public:
  using Describe = std::string (*)(const Config&);
  explicit PlainKind(Describe describe_device) : describe_device_(describe_device) {}
  std::unique_ptr<OpenedDevice> open(rt::NonRealtime& nrt, const Scene&, drivers::HandScript&,
                                     rt::Time) const override {
    return std::make_unique<PlainDevice<Device>>(nrt, this->config_,
                                                 describe_device_(this->config_));
  }

 private:
  Describe describe_device_;
};

}  // namespace teletact
