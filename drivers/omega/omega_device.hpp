// Force Dimension Omega.3 through the vendor's SDK, loaded at run time.
//
// Safety    Watchdog of the controller at most 20 ms, read back; its velocity threshold is left on
//           and must be on; forces start only by request_enable(); the sum of weight and command
//           stays within the force limit; make_safe() needs nothing from the owner's thread and
//           overtakes a request that the owner has not yet seen (force_gate.hpp).
// Unplug    After a failed exchange sense() returns false and act() sends nothing; an ordinary
//           thread closes, and opens again when the device is back. It then reads; forces come back
//           with the next request_enable(), never by themselves.
// Real time sense() is at most four calls into the SDK, act() one. They may block in the SDK (USB);
//           their time is counted in exchange_times() against its own bound. No allocation of ours.
// Clock     The device lives in real time: not for the virtual clock.
//
// One owner thread for sense() and act(); make_safe(), request_enable() and the counters from any.
// One device a process: the SDK itself is one global object.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "config/schema.hpp"
#include "drivers/haptic/device_minder.hpp"
#include "drivers/haptic/exchange_histogram.hpp"
#include "drivers/haptic/force_gate.hpp"
#include "drivers/haptic/haptic_device.hpp"
#include "drivers/omega/dhd_library.hpp"
#include "drivers/omega/omega_twin.hpp"
#include "drivers/usb/usb_scan.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

// Section [device.omega]. What no data sheet says is "assumed" until measured on the device.
struct OmegaConfig {
  std::string sdk;  // library file or SDK folder; empty: FORCEDIM_SDK, then the usual places
  int serial = 0;   // 0: the first Omega.3
  double watchdog_s = 0.020;
  int time_guard_us = -1;  // -1: as the controller has it
  double force_limit_N = 12.0;
  double mass_kg = 0.2;
  double damping_N_s_per_m = 2.0;
  double coulomb_N = 0.1;
  double delay_s = 0.00025;
  double speed_limit_m_per_s = 1.0;
  double exchange_bound_s = 0.0005;
  double retry_s = 0.5;
  std::string measured;  // when mass, damping and friction were measured; empty: assumed

  void describe(config::Section& s) {
    s.text("sdk", sdk, {}, "library file or SDK folder; empty: FORCEDIM_SDK, then usual places");
    s.integer("serial", serial, 0, 65535, "serial number; 0: the first Omega.3");
    s.number("watchdog_s", watchdog_s, 0.001, 0.020, "no command for so long: forces off");
    s.integer("time_guard_us", time_guard_us, -1, 10000, "nearer reads repeat; -1: unchanged");
    s.number("force_limit_N", force_limit_N, 0.1, 12, "limit of weight plus command");
    s.number("mass_kg", mass_kg, 0.01, 5, "effective mass at the tip (assumed)");
    s.number("damping_N_s_per_m", damping_N_s_per_m, 0, 100, "viscous friction b (assumed)");
    s.number("coulomb_N", coulomb_N, 0, 5, "Coulomb friction c (assumed)");
    s.number("delay_s", delay_s, 0, 0.01, "sample to force: two USB microframes (assumed)");
    s.number("speed_limit_m_per_s", speed_limit_m_per_s, 0.05, 20, "of the hand (assumed)");
    s.number("exchange_bound_s", exchange_bound_s, 1e-5, 0.1, "longer exchanges are counted");
    s.number("retry_s", retry_s, 0.01, 60, "between two tries to open after an unplug");
    s.text("measured", measured, {}, "when teletact identify measured them; empty: assumed");
  }
};

struct OmegaCounters {
  std::uint64_t samples = 0, repeats = 0, failures = 0, saturated = 0, refused_commands = 0;
  std::uint64_t losses = 0, reopened = 0, stops = 0, force_offs = 0;
};

class OmegaDevice final : public HapticDevice {
 public:
  // Throws std::runtime_error with one line: SDK not found (every file tried), wrong SDK version,
  // not plugged in, no permission, not an Omega.3, no watchdog, velocity threshold off.
  OmegaDevice(rt::NonRealtime&, const OmegaConfig&, const UsbScanner& scan = scan_usb);
  ~OmegaDevice() override;

  // What a configuration states of the device, without one.
  [[nodiscard]] static DeviceProperties properties_of(const OmegaConfig&) noexcept;
  [[nodiscard]] DeviceProperties properties() const noexcept override {
    return properties_of(config_);
  }
  [[nodiscard]] bool sense(rt::Time now, StylusSample& out) noexcept override;
  void act(rt::Time now, const ForceCommand& command) noexcept override;
  void request_enable() noexcept override { gate_.ask(); }
  void make_safe() noexcept override;

  [[nodiscard]] OmegaCounters counters() const noexcept;
  [[nodiscard]] const ExchangeHistogram& exchange_times() const noexcept { return times_; }
  [[nodiscard]] ForceOffCause force_off_cause() const noexcept { return cause_.load(); }
  [[nodiscard]] bool connected() const noexcept { return link_.load() == Link::kLive; }
  // "Omega.3 through libdhd.so.3 3.17.5.0, watchdog 20 ms, velocity threshold on"
  [[nodiscard]] const std::string& description() const noexcept { return description_; }
  [[nodiscard]] const DhdLibrary& library() const noexcept { return *library_; }

  static constexpr std::array<UsbId, 2> kUsbIds{
      {{0x1451, 0x0402, "omega.x"}, {0x1451, 0x0301, "Force Dimension controller"}}};
  static constexpr const char* kUdevRule = "config/system/udev/70-teletact-haptic.rules";

 private:
  // kLive: the owner may call the SDK. kLost: the minder may. Each changes only its own.
  enum class Link : std::uint8_t { kLive, kLost };
  struct Counters {
    std::atomic<std::uint64_t> samples{0}, repeats{0}, failures{0}, saturated{0}, refused{0};
    std::atomic<std::uint64_t> losses{0}, reopened{0}, stops{0}, force_offs{0};
  };
  [[nodiscard]] std::string open();  // empty, or why not
  [[nodiscard]] std::string set_up();
  [[nodiscard]] std::string sdk_error() const;
  [[nodiscard]] bool mind();
  [[nodiscard]] bool exchange(rt::Time now, StylusSample& out) noexcept;
  void read_status(rt::Time now) noexcept;
  // Of each call its own: one that always fails is a loss, however well the others go.
  enum class Call : std::uint8_t { kPosition, kStatus, kForce };
  void failed(Call call) noexcept;
  void succeeded(Call call) noexcept { failed_in_a_row_[static_cast<std::size_t>(call)] = 0; }
  void lose() noexcept;

  OmegaConfig config_;
  std::unique_ptr<DhdLibrary> library_;
  const DhdApi* api_ = nullptr;
  std::string description_;
  char id_ = -1;
  double weight_N_ = 0;
  std::int64_t watchdog_units_ = 0;

  std::atomic<Link> link_{Link::kLost};
  ForceGate gate_;
  std::atomic<bool> stop_asked_{false};
  std::atomic<ForceOffCause> cause_{ForceOffCause::kNone};
  Counters counts_;
  ExchangeHistogram times_;

  // The owner's.
  StylusSample last_;
  DeviceState state_ = DeviceState::kReset;
  rt::Time status_due_{};
  std::array<int, 3> failed_in_a_row_{};

  DeviceMinder minder_;  // last: ends before what it works on
};

}  // namespace drivers
