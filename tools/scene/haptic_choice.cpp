#include "tools/scene/haptic_choice.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <sstream>
#include <stdexcept>

#include "drivers/falcon/falcon_twin_thread.hpp"
#include "drivers/falcon/libusb_transport.hpp"
#include "drivers/omega/twin_sdk/twin_control.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {
namespace {

using Figures = std::vector<std::pair<std::string, double>>;

double as_number(std::uint64_t n) { return static_cast<double>(n); }

void add_times(Figures& out, const std::string& name, const drivers::ExchangeHistogram& h) {
  out.emplace_back(name + "_p50_us", static_cast<double>(h.quantile_ns(0.5)) * 1e-3);
  out.emplace_back(name + "_p99_us", static_cast<double>(h.quantile_ns(0.99)) * 1e-3);
  out.emplace_back(name + "_max_us", static_cast<double>(h.max_ns()) * 1e-3);
  out.emplace_back(name + "_over_bound", as_number(h.over_bound()));
}

// ---- the twin, in this process

std::unique_ptr<drivers::OmegaTwin> make_twin(rt::NonRealtime& nrt, const Scene& scene,
                                              drivers::HandScript& hand, rt::Time epoch) {
  const auto start = hand.target(rt::Nanos{0});
  auto twin =
      std::make_unique<drivers::OmegaTwin>(nrt, scene.device, hand.size() > 0 ? &hand : nullptr,
                                           scene.workspace().to_device(start.p_WT));
  twin->set_cpu_clock(&rt::thread_cpu_ns);
  twin->start_hand(epoch);
  twin->enable_force(epoch);
  return twin;
}

class TwinHere : public OpenedDevice {
 public:
  explicit TwinHere(std::unique_ptr<drivers::OmegaTwin> twin) : twin_(std::move(twin)) {}
  drivers::HapticDevice& device() noexcept override { return *twin_; }
  std::string description() const override { return "twin of an Omega.3"; }
  bool person_simulated() const noexcept override { return true; }
  std::function<std::int64_t()> twin_cpu() override {
    return [this] { return twin_->twin_cpu_ns(); };
  }
  std::vector<std::string> effects() const override { return twin_->effects(); }

 protected:
  std::unique_ptr<drivers::OmegaTwin> twin_;
};

// The twin's mechanics under the properties of the chosen device.
class StandIn final : public TwinHere, private drivers::HapticDevice {
 public:
  StandIn(std::unique_ptr<drivers::OmegaTwin> twin, const drivers::DeviceProperties& p)
      : TwinHere(std::move(twin)), properties_(p) {}
  drivers::HapticDevice& device() noexcept override { return *this; }

 private:
  drivers::DeviceProperties properties() const noexcept override { return properties_; }
  bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    return twin_->sense(now, out);
  }
  void act(rt::Time now, const drivers::ForceCommand& c) noexcept override { twin_->act(now, c); }
  void request_enable() noexcept override { twin_->request_enable(); }
  void make_safe() noexcept override { twin_->make_safe(); }
  drivers::DeviceProperties properties_;
};

// ---- Omega.3 through the SDK

// What of a scene the twin library takes: [device] is its [twin], and, `with_hand`, [hand] its hand.
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

// The vendor's library has no such handles; the twin's gets its scene and its hand, before the driver
// opens it. Kept loaded beside the driver, since a library that is closed forgets.
std::unique_ptr<drivers::DhdLibrary> set_up_twin_library(rt::NonRealtime& nrt, const Scene& scene,
                                                         bool with_hand, rt::Time epoch) {
  drivers::DhdSearch search;
  search.named = scene.choice.omega.sdk;
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
  RealOmega(rt::NonRealtime& nrt, const Scene& scene, bool with_hand, rt::Time epoch)
      : twin_(set_up_twin_library(nrt, scene, with_hand, epoch)), device_(nrt, scene.choice.omega) {
    device_.request_enable();
  }
  drivers::HapticDevice& device() noexcept override { return device_; }
  std::string description() const override { return device_.description(); }
  bool person_simulated() const noexcept override { return twin_ != nullptr; }
  Figures figures() const override {
    const auto c = device_.counters();
    Figures out{{"samples", as_number(c.samples)},      {"repeats", as_number(c.repeats)},
                {"failures", as_number(c.failures)},    {"saturated", as_number(c.saturated)},
                {"losses", as_number(c.losses)},        {"reopened", as_number(c.reopened)},
                {"force_offs", as_number(c.force_offs)}};
    add_times(out, "exchange", device_.exchange_times());
    return out;
  }

 private:
  std::unique_ptr<drivers::DhdLibrary> twin_;
  drivers::OmegaDevice device_;
};

// ---- Falcon

class RealFalcon final : public OpenedDevice {
 public:
  RealFalcon(rt::NonRealtime& nrt, const Scene& scene, drivers::HandScript& hand, rt::Time epoch)
      : twin_(make_falcon_twin(nrt, scene, hand, epoch)),
        device_(nrt, scene.choice.falcon, opener(scene.choice.falcon.event_priority)) {
    device_.request_enable();
  }
  drivers::HapticDevice& device() noexcept override { return device_; }
  std::string description() const override {
    return device_.description() + (twin_ ? " (twin at the wire)" : "");
  }
  bool person_simulated() const noexcept override { return twin_ != nullptr; }
  Figures figures() const override {
    const auto c = device_.counters();
    Figures out{{"frames", as_number(c.frames)},    {"samples", as_number(c.samples)},
                {"repeats", as_number(c.repeats)},  {"damaged", as_number(c.damaged)},
                {"leaps", as_number(c.leaps)},      {"unsolved", as_number(c.unsolved)},
                {"kicks", as_number(c.kicks)},      {"losses", as_number(c.losses)},
                {"reopened", as_number(c.reopened)}};
    add_times(out, "round_trip", device_.round_trips());
    return out;
  }

 private:
  static std::unique_ptr<drivers::FalconTwin> make_falcon_twin(rt::NonRealtime& nrt,
                                                               const Scene& scene,
                                                               drivers::HandScript& hand,
                                                               rt::Time epoch) {
    if (!scene.choice.falcon_twin) return nullptr;
    drivers::FalconTwinConfig c;
    c.plant = scene.device;
    c.loaded = c.homed = true;
    c.counts_per_N_m = scene.choice.falcon.counts_per_N_m;
    const auto start = scene.workspace().to_device(hand.target(rt::Nanos{0}).p_WT);
    auto twin =
        std::make_unique<drivers::FalconTwin>(nrt, c, hand.size() > 0 ? &hand : nullptr, start);
    twin->plant().start_hand(epoch);
    return twin;
  }
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

// ---- mouse

class RealMouse final : public OpenedDevice {
 public:
  RealMouse(rt::NonRealtime& nrt, const Scene& scene)
      : path_(scene.choice.mouse.path), device_(nrt, scene.choice.mouse) {}
  drivers::HapticDevice& device() noexcept override { return device_; }
  std::string description() const override {
    return "mouse " + (path_.empty() ? std::string("(console only)") : path_) + ", no force";
  }

 private:
  std::string path_;
  drivers::MouseDevice device_;
};

drivers::DeviceProperties chosen_properties(const HapticChoice& choice) {
  if (choice.kind == "omega") return drivers::OmegaDevice::properties_of(choice.omega);
  if (choice.kind == "falcon") return drivers::FalconDevice::properties_of(choice.falcon);
  return drivers::MouseDevice::properties_of(choice.mouse);
}

}  // namespace

void HapticChoice::describe(config::Section& s) {
  s.text("kind", kind, {"twin", "omega", "falcon", "mouse"}, "which haptic device");
  omega.describe(s.section("omega", "Omega.3 through the vendor's SDK"));
  auto& f = s.section("falcon", "Novint Falcon over USB");
  falcon.describe(f);
  f.flag("twin", falcon_twin, "its twin at the wire instead of the hardware");
  mouse.describe(s.section("mouse", "a mouse in place of a device"));
}

std::unique_ptr<OpenedDevice> open_haptic_device(rt::NonRealtime& nrt, const Scene& scene,
                                                 drivers::HandScript& hand, rt::Time epoch,
                                                 bool real) {
  const HapticChoice& choice = scene.choice;
  if (choice.in_process()) {
    return std::make_unique<TwinHere>(make_twin(nrt, scene, hand, epoch));
  }
  if (!real) {
    return std::make_unique<StandIn>(make_twin(nrt, scene, hand, epoch), chosen_properties(choice));
  }
  if (choice.kind == "omega") {
    return std::make_unique<RealOmega>(nrt, scene, hand.size() > 0, epoch);
  }
  if (choice.kind == "falcon") return std::make_unique<RealFalcon>(nrt, scene, hand, epoch);
  return std::make_unique<RealMouse>(nrt, scene);
}

void check_haptic_device(const Scene& scene) {
  if (scene.choice.in_process()) return;
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0)
    throw std::runtime_error(std::string("device: no pipe for the check: ") + std::strerror(errno));
  const pid_t child = ::fork();
  if (child < 0)
    throw std::runtime_error(std::string("device: no process for the check: ") +
                             std::strerror(errno));
  if (child == 0) {
    std::string why;
    try {
      rt::Startup startup;
      auto& nrt = startup.token();
      drivers::HandScript hand(nrt, scene.hand, scene.workspace());
      (void)open_haptic_device(nrt, scene, hand, rt::time_from_ns(rt::monotonic_ns()), true);
    } catch (const std::exception& e) {
      why = e.what();
    }
    (void)!::write(ends[1], why.data(), why.size());
    ::_exit(why.empty() ? 0 : 1);
  }
  ::close(ends[1]);
  std::string why;
  std::array<char, 512> part{};
  for (ssize_t n = 0; (n = ::read(ends[0], part.data(), part.size())) > 0;) {
    why.append(part.data(), static_cast<std::size_t>(n));
  }
  ::close(ends[0]);
  int status = 0;
  (void)::waitpid(child, &status, 0);
  if (!why.empty()) throw std::runtime_error(why);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw std::runtime_error("device.kind = \"" + scene.choice.kind +
                             "\": its driver ended by a signal while it was opened");
  }
}

}  // namespace teletact
