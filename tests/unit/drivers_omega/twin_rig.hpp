// The real driver on the twin library: loaded by its path, on a clock that the test moves.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "drivers/omega/omega_device.hpp"
#include "drivers/omega/twin_sdk/twin_control.hpp"
#include "tests/support/paths.hpp"

namespace twin_rig {

using drivers::DeviceState;
using drivers::ForceOffCause;
using drivers::OmegaConfig;
using drivers::OmegaDevice;
using perception::Vec3;

inline const std::string kTwinLibrary = tests::in_build("libteletact_omega_twin.so");

// A device without friction, quantum and hand, so that what is seen is what was put in.
inline const std::string kIdeal =
    "manual_clock = true\n"
    "[twin]\ncoulomb_N = 0\nquantum_m = 0\nhand_stiffness_N_per_m = 0\n";

inline drivers::UsbScan plugged(int open_error = 0) {
  drivers::UsbScan scan;
  scan.devices.push_back({0x1451, 0x0402, 1, 4, open_error});
  return scan;
}

inline OmegaConfig quick_config() {
  OmegaConfig c;
  c.sdk = kTwinLibrary;
  c.retry_s = 0.01;
  return c;
}

// Keeps the library loaded and gives its handles, before and beside the driver.
class TwinLibrary {
 public:
  explicit TwinLibrary(const std::string& toml = kIdeal) {
    drivers::DhdSearch search;
    search.named = kTwinLibrary;
    auto loaded = drivers::DhdLibrary::load(startup_.token(), search);
    if (!loaded) throw std::runtime_error(loaded.error());
    library_ = std::move(loaded).value();
    control_ = drivers::find_twin_control(*library_);
    if (!control_.complete()) throw std::runtime_error("the twin library has no controls");
    if (control_.reset(toml.c_str()) != 0) throw std::runtime_error(control_.error());
  }
  ~TwinLibrary() { (void)control_.reset(""); }
  TwinLibrary(const TwinLibrary&) = delete;
  TwinLibrary& operator=(const TwinLibrary&) = delete;

  void set(const char* key, double value) const {
    if (control_.set(key, value) != 0) ADD_FAILURE() << "twin: no key " << key;
  }
  [[nodiscard]] double get(const char* key) const {
    const double v = control_.get(key);
    EXPECT_FALSE(std::isnan(v)) << "twin: no key " << key;
    return v;
  }
  [[nodiscard]] Vec3 truth() const { return {get("x_m"), get("y_m"), get("z_m")}; }
  [[nodiscard]] Vec3 motor() const { return {get("fx_N"), get("fy_N"), get("fz_N")}; }
  [[nodiscard]] Vec3 sent() const { return {get("sent_x_N"), get("sent_y_N"), get("sent_z_N")}; }
  [[nodiscard]] DeviceState state() const { return static_cast<DeviceState>(get("state")); }
  [[nodiscard]] ForceOffCause cause() const { return static_cast<ForceOffCause>(get("cause")); }
  [[nodiscard]] const drivers::OmegaTwinControl& control() const { return control_; }
  [[nodiscard]] rt::NonRealtime& token() { return startup_.token(); }

 private:
  rt::Startup startup_;
  std::unique_ptr<drivers::DhdLibrary> library_;
  drivers::OmegaTwinControl control_;
};

struct Rig {
  TwinLibrary twin;
  std::unique_ptr<OmegaDevice> device;
  rt::Time now = rt::time_from_ns(5'000'000'000);
  drivers::StylusSample sample;
  bool sensed = false;

  explicit Rig(const std::string& toml = kIdeal, const OmegaConfig& config = quick_config())
      : twin(toml) {
    device = std::make_unique<OmegaDevice>(twin.token(), config, [](auto) { return plugged(); });
  }
  // One millisecond later: read, then send.
  void tick(const Vec3& f = Vec3::Zero(), bool command = true) {
    now += std::chrono::milliseconds{1};
    twin.control().advance(1e-3);
    sensed = device->sense(now, sample);
    if (command) device->act(now, {f});
  }
  void ticks(int n, const Vec3& f = Vec3::Zero()) {
    for (int i = 0; i < n; ++i) tick(f);
  }
  // Forces on, and the driver has seen it.
  void enable() {
    device->request_enable();
    tick();
    ASSERT_EQ(sample.state, DeviceState::kForce);
  }
  // Ticks in real time until `done`; the minder works on a thread of its own.
  template <class Done>
  [[nodiscard]] bool wait_until(Done done) {
    for (int i = 0; i < 5000; ++i) {
      if (done()) return true;
      tick();
      std::this_thread::sleep_for(std::chrono::milliseconds{1});
    }
    return false;
  }
};

}  // namespace twin_rig
