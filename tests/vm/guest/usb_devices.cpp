// The haptic devices on the guest's USB (vhci_hcd), through libusb and the product's own code: what
// is found, what is said of a device that this user may not open, of one that is pulled out and put
// back. The Falcon is its twin behind the kernel's USB, driven by the product's driver; of the
// Omega there is what the kernel sees of it, as its driver is the vendor's.
//
//   vm_usb_devices
//
// Figures: usb.{frames, round_trip_p50_us, round_trip_p99_us}, of 200 jobs of 1 ms and a bit.
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <mutex>
#include <stdexcept>

#include "drivers/falcon/falcon_device.hpp"
#include "drivers/falcon/falcon_twin.hpp"
#include "drivers/falcon/libusb_transport.hpp"
#include "drivers/omega/omega_device.hpp"
#include "rt/clock/box_time.hpp"
#include "tests/vm/guest/say.hpp"
#include "tests/vm/guest/usb_plug.hpp"

namespace {

using namespace drivers;
using perception::Vec3;
using vm::check;

class FalconFunction final : public vm::UsbFunction {
 public:
  explicit FalconFunction(rt::NonRealtime& nrt) : twin_(nrt, config()) {}
  [[nodiscard]] bool vendor(std::uint8_t request, std::uint16_t value) override {
    const std::lock_guard lock(mutex_);
    return twin_.control(request, value, rt::monotonic_ns());
  }
  void out(std::span<const std::uint8_t> bytes) override {
    const std::lock_guard lock(mutex_);
    (void)twin_.write(bytes, rt::monotonic_ns());
  }
  [[nodiscard]] std::size_t in(std::span<std::uint8_t> packet) override {
    const std::lock_guard lock(mutex_);
    return static_cast<std::size_t>(std::max(0, twin_.read(packet, rt::monotonic_ns())));
  }
  [[nodiscard]] Vec3 motor() {
    const std::lock_guard lock(mutex_);
    return twin_.motor_force_D();
  }

 private:
  static FalconTwinConfig config() {
    FalconTwinConfig c;
    c.plant.hand_stiffness_N_per_m = 0;
    c.plant.mass_kg = 5;
    c.loaded = c.homed = true;
    return c;
  }
  std::mutex mutex_;
  FalconTwin twin_;
};

UsbVerdict omega() {
  return judge(scan_usb(OmegaDevice::kUsbIds), OmegaDevice::kUsbIds, OmegaDevice::kUdevRule);
}
UsbVerdict falcon() {
  using Transport = LibusbFalconTransport;
  return judge(scan_usb(Transport::kUsbIds), Transport::kUsbIds, Transport::kUdevRule);
}

template <class Is>
bool until(Is is, int ms) {
  for (int i = 0; i < ms / 5; ++i) {
    if (is()) return true;
    ::usleep(5000);
  }
  return is();
}
// It comes to that, and is said of this device.
template <class Verdict>
void comes_to(const std::string& name, Verdict verdict, UsbPresence wanted, const std::string& id) {
  UsbVerdict v;
  const auto is = [&] {
    v = verdict();
    return v.presence == wanted;
  };
  const bool good = until(is, 1500) && v.text.find(id) != std::string::npos;
  check(name, good, v.text);
}
bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// As another user: the child may not write the device's node.
template <class Verdict>
void no_right(const std::string& name, Verdict verdict, const std::string& id) {
  const pid_t child = ::fork();
  if (child == 0) {
    if (::setgid(65534) != 0 || ::setuid(65534) != 0) ::_exit(2);
    const UsbVerdict v = verdict();
    const bool good = v.presence == UsbPresence::kNoPermission && has(v.text, id) &&
                      has(v.text, "udev rule missing");
    ::_exit(check(name + " without the right is named", good, v.text) ? 0 : 1);
  }
  int status = 1;
  if (::waitpid(child, &status, 0) != child || !WIFEXITED(status))
    check(name + " without the right", false, "the other user's program did not end");
}

void discovery(vm::UsbPlug& falcon_plug, vm::UsbPlug& omega_plug) {
  constexpr const char *kFalcon = "0403:cb48", *kOmega = "1451:0402";
  comes_to("no Falcon before", falcon, UsbPresence::kAbsent, kFalcon);
  comes_to("no Omega before", omega, UsbPresence::kAbsent, kOmega);
  check("an Omega is plugged in", omega_plug.push(), "");
  comes_to("the Omega is found", omega, UsbPresence::kUsable, "1451:0402 (omega.x) on bus");
  comes_to("and is no Falcon", falcon, UsbPresence::kAbsent, kFalcon);
  check("a Falcon is plugged in", falcon_plug.push(), "");
  comes_to("the Falcon is found", falcon, UsbPresence::kUsable, "0403:cb48 (Novint Falcon) on bus");
  no_right("an Omega", omega, kOmega);
  no_right("a Falcon", falcon, kFalcon);
  omega_plug.pull();
  comes_to("an Omega that is pulled out is gone", omega, UsbPresence::kAbsent, kOmega);
  check("an Omega that is put back", omega_plug.push(), "");
  comes_to("is found again", omega, UsbPresence::kUsable, kOmega);
}

double micros(std::int64_t ns) { return 1e-3 * static_cast<double>(ns); }

class Hand {
 public:
  Hand(rt::NonRealtime& nrt, const FalconConfig& c)
      : device_(nrt, c, [] { return LibusbFalconTransport::open(50); }) {}
  // One job a millisecond until it comes to that.
  template <class Is>
  bool until(Is is, int ms, const Vec3& force = Vec3::Zero()) {
    for (int i = 0; i < ms; ++i) {
      if (is()) return true;
      tick(force);
    }
    return is();
  }
  void tick(const Vec3& force) {
    ::usleep(1000);
    const rt::Time now = rt::time_from_ns(rt::monotonic_ns());
    sensed = device_.sense(now, sample);
    device_.act(now, {force});
    samples += sensed ? 1 : 0;
  }
  FalconDevice& device() { return device_; }
  StylusSample sample;
  bool sensed = false;
  std::uint64_t samples = 0;

 private:
  FalconDevice device_;
};

bool in_force(Hand& h) {
  h.device().request_enable();
  return h.until([&] { return h.sensed && h.sample.state == DeviceState::kForce; }, 2000);
}

std::string hand_state(const Hand& h) {
  return "state " + std::to_string(static_cast<int>(h.sample.state)) +
         (h.sensed ? ", sensed" : ", nothing sensed");
}

void session(rt::NonRealtime& nrt, FalconFunction& function, vm::UsbPlug& plug) {
  FalconConfig config;
  config.retry_s = 0.05;
  Hand h(nrt, config);
  const Vec3 force(1, 0.5, 0);
  const auto renders = [&] { return (function.motor() - force).norm() < 0.05; };
  check("the Falcon's driver opens it and gets to force", in_force(h), h.device().description());
  check("a force is at its motors", h.until(renders, 1000, force), hand_state(h));
  const auto frames = h.device().counters().frames;
  for (int i = 0; i < 200; ++i) h.tick(force);
  const auto now = h.device().counters();
  vm::figure("usb.frames", static_cast<double>(now.frames - frames), "1");
  vm::figure("usb.round_trip_p50_us", micros(h.device().round_trips().quantile_ns(.5)), "us");
  vm::figure("usb.round_trip_p99_us", micros(h.device().round_trips().quantile_ns(.99)), "us");
  check("frames come and none is damaged",
        now.frames - frames > 140 && now.damaged == 0 && now.line_errors == 0 && now.losses == 0,
        std::to_string(now.frames - frames) + " in 200 jobs");
  plug.pull();
  check("a Falcon that is pulled out while it is open is lost",
        h.until([&] { return !h.device().connected() && !h.sensed; }, 300, force) &&
            h.device().counters().losses == 1,
        "");
  const auto why = LibusbFalconTransport::open(0);
  check("and is named", !why && has(why.error(), "not plugged in: no USB device 0403:cb48"),
        why ? "opened" : why.error());
  check("a Falcon that is put back", plug.push(), "");
  check("gives samples again", h.until([&] { return h.sensed; }, 2000, force), "");
  for (int i = 0; i < 50; ++i) h.tick(force);
  check("without a force until somebody enables it",
        h.sample.state != DeviceState::kForce && function.motor() == Vec3::Zero(), "");
  check("then with it", in_force(h) && h.until(renders, 1000, force), hand_state(h));
}

}  // namespace

int main() {
  rt::Startup startup;
  FalconFunction function(startup.token());
  vm::UsbFunction nothing;
  vm::UsbPlug falcon_plug(0, {0x0403, 0xcb48}, function), omega_plug(1, {0x1451, 0x0402}, nothing);
  try {
    discovery(falcon_plug, omega_plug);
    session(startup.token(), function, falcon_plug);
  } catch (const std::exception& e) {
    return check("the Falcon's driver", false, e.what()) ? 0 : 1;
  }
  return 0;
}
