#include "drivers/omega/omega_device.hpp"

#include <cmath>
#include <stdexcept>

#include "drivers/haptic/force_sum.hpp"
#include "rt/clock/box_time.hpp"

namespace drivers {
namespace {

using perception::Vec3;

constexpr double kGravity = 9.81;
constexpr rt::Nanos kStatusPeriod = std::chrono::milliseconds{10};
constexpr int kFailuresUntilLost = 3;

// Device axes and D differ by half a turn about z; the same both ways.
Vec3 turned(const Vec3& v) noexcept { return {-v.x(), -v.y(), v.z()}; }

void count(std::atomic<std::uint64_t>& n) noexcept { n.fetch_add(1, std::memory_order_relaxed); }

}  // namespace

OmegaDevice::OmegaDevice(rt::NonRealtime& nrt, const OmegaConfig& config, const UsbScanner& scan)
    : config_(config), times_(rt::nanos_from_seconds(config.exchange_bound_s).count()) {
  DhdSearch search;
  search.named = config.sdk;
  auto loaded = DhdLibrary::load(nrt, search);
  if (!loaded) throw std::runtime_error("omega: " + loaded.error());
  library_ = std::move(loaded).value();
  api_ = &library_->api();
  watchdog_units_ = static_cast<std::int64_t>(config.watchdog_s / kDhdWatchdogUnit_s + 1e-9);
  if (const std::string why = open(); !why.empty()) {
    const UsbVerdict usb = judge(scan(kUsbIds), kUsbIds, kUdevRule);
    // The bus knows better than the SDK, unless it sees nothing wrong.
    throw std::runtime_error("omega: " + (usb.presence == UsbPresence::kUsable ? why : usb.text));
  }
  if (const std::string why = set_up(); !why.empty()) {
    api_->stop(id_);
    api_->close(id_);
    throw std::runtime_error("omega: " + why);
  }
  description_ = "Omega.3 through " + library_->path() + " " + library_->version().text() +
                 ", watchdog " + std::to_string(watchdog_units_ * 125) +
                 " us, velocity threshold on";
  link_.store(Link::kLive, std::memory_order_release);
  minder_.start([this] { return mind(); },
                std::chrono::milliseconds{static_cast<int>(config.retry_s * 1e3)});
}

OmegaDevice::~OmegaDevice() {
  minder_.stop();
  if (link_.load(std::memory_order_acquire) == Link::kLive) {
    api_->stop(id_);
    api_->close(id_);
  }
}

std::string OmegaDevice::sdk_error() const {
  const char* text = api_->get_last_error_text();
  return "the SDK says: " + std::string(text != nullptr ? text : "nothing") + " (error " +
         std::to_string(api_->get_last_error()) + ")";
}

std::string OmegaDevice::open() {
  const int id =
      config_.serial > 0 ? api_->open_serial(config_.serial) : api_->open_type(kDhdDeviceOmega3);
  if (id < 0) {
    return (config_.serial > 0 ? "serial number " + std::to_string(config_.serial) : "an Omega.3") +
           " can not be opened; " + sdk_error();
  }
  id_ = static_cast<char>(id);
  return {};
}

// Everything the device must promise before a force may flow; empty, or what it does not.
std::string OmegaDevice::set_up() {
  if (const int type = api_->get_system_type(id_); type != kDhdDeviceOmega3) {
    return "the device is of type " + std::to_string(type) + ", not an Omega.3 (33)";
  }
  if (api_->enable_expert_mode() < 0) return "expert mode refused; " + sdk_error();
  unsigned char units = 0;
  if (api_->set_watchdog(static_cast<unsigned char>(watchdog_units_), id_) < 0 ||
      api_->get_watchdog(&units, id_) < 0 || units == 0 || units > watchdog_units_) {
    (void)api_->disable_expert_mode();
    return "the controller does not take a watchdog of " + std::to_string(config_.watchdog_s) +
           " s (firmware older than 3?): without it a stalled program would leave its last force "
           "on the hand";
  }
  unsigned int threshold = 0;
  if (api_->get_velocity_threshold(&threshold, id_) < 0 || threshold == 0) {
    (void)api_->disable_expert_mode();
    return "the velocity threshold is off (another program set it to 0): switch the controller off "
           "and on";
  }
  if (config_.time_guard_us >= 0 && api_->set_time_guard(config_.time_guard_us, id_) < 0) {
    (void)api_->disable_expert_mode();
    return "time_guard_us = " + std::to_string(config_.time_guard_us) + " refused; " + sdk_error();
  }
  (void)api_->disable_expert_mode();
  if (api_->set_max_force(config_.force_limit_N, id_) < 0 ||
      api_->set_gravity_compensation(1, id_) < 0) {
    return "force limit or gravity compensation refused; " + sdk_error();
  }
  double mass = 0;
  weight_N_ = api_->get_effector_mass(&mass, id_) >= 0 && std::isfinite(mass) && mass > 0
                  ? mass * kGravity
                  : 0.0;
  if (weight_N_ >= config_.force_limit_N) {
    return "the arm's weight of " + std::to_string(weight_N_) +
           " N leaves nothing of force_limit_N = " + std::to_string(config_.force_limit_N);
  }
  return {};
}

// On the minder's thread. True: try again later.
bool OmegaDevice::mind() {
  if (stop_asked_.exchange(false, std::memory_order_acq_rel)) {
    if (link_.load(std::memory_order_acquire) == Link::kLive) api_->stop(id_);
    count(counts_.stops);
  }
  if (link_.load(std::memory_order_acquire) == Link::kLive) return false;
  if (id_ >= 0) {
    (void)api_->close(id_);
    id_ = -1;
  }
  if (!open().empty()) return true;
  if (!set_up().empty()) return true;
  // Forces stay off, brakes on, until the operator asks again: whatever the device kept of before.
  (void)api_->stop(id_);
  gate_.forget();
  count(counts_.reopened);
  link_.store(Link::kLive, std::memory_order_release);
  return false;
}

DeviceProperties OmegaDevice::properties_of(const OmegaConfig& config) noexcept {
  DeviceProperties p;
  p.mass_kg = config.mass_kg;
  p.damping_N_s_per_m = config.damping_N_s_per_m;
  p.coulomb_N = config.coulomb_N;
  p.delay_s = config.delay_s;
  p.quantum_m = 1e-5;
  p.force_limit_N = config.force_limit_N;
  p.workspace_radius_m = 0.075;
  p.speed_limit_m_per_s = config.speed_limit_m_per_s;
  p.damping_known = p.measured = !config.measured.empty();
  return p;
}

bool OmegaDevice::sense(rt::Time now, StylusSample& out) noexcept {
  if (link_.load(std::memory_order_acquire) != Link::kLive) {
    state_ = DeviceState::kReset;
    status_due_ = rt::Time{};
    return false;
  }
  const std::int64_t begin = rt::monotonic_ns();
  const bool good = exchange(now, out);
  times_.add(rt::monotonic_ns() - begin);
  return good;
}

bool OmegaDevice::exchange(rt::Time now, StylusSample& out) noexcept {
  if (gate_.take()) {
    if (api_->enable_force(1, id_) < 0) count(counts_.failures);
    // Made safe meanwhile: the minder's stop may have come before.
    if (gate_.safe()) (void)api_->stop(id_);
    status_due_ = now;
  }
  Vec3 p;
  const int got = api_->get_position(&p.x(), &p.y(), &p.z(), id_);
  if (got < 0) {
    failed(Call::kPosition);
    return false;
  }
  succeeded(Call::kPosition);
  if (now >= status_due_) read_status(now);
  if (link_.load(std::memory_order_relaxed) != Link::kLive) return false;
  const bool repeated = got == kDhdTimeGuard && last_.seq > 0;
  if (repeated) {
    count(counts_.repeats);
  } else {
    ++last_.seq;
    last_.taken = now;
    last_.p_DH = turned(p);
    const unsigned int buttons = api_->get_button_mask(id_);
    last_.button = (buttons & 1U) != 0;
    last_.clutch = (buttons & 2U) != 0;
    count(counts_.samples);
  }
  last_.repeated = repeated;
  last_.state = gate_.safe() && state_ == DeviceState::kForce ? DeviceState::kBrake : state_;
  out = last_;
  return true;
}

void OmegaDevice::read_status(rt::Time now) noexcept {
  status_due_ = now + kStatusPeriod;
  std::array<int, kDhdStatusRoom> status{};
  if (api_->get_status(status.data(), id_) < 0) {
    failed(Call::kStatus);
    return;
  }
  succeeded(Call::kStatus);
  if (status[kDhdConnected] == 0) {
    lose();
    return;
  }
  const DeviceState before = state_;
  state_ = status[kDhdReset] != 0   ? DeviceState::kReset
           : status[kDhdBrake] != 0 ? DeviceState::kBrake
           : status[kDhdForce] != 0 ? DeviceState::kForce
                                    : DeviceState::kIdle;
  const int cause = status[kDhdForceOffCause];
  cause_.store(cause >= 0 && cause <= static_cast<int>(ForceOffCause::kDisconnect)
                   ? static_cast<ForceOffCause>(cause)
                   : ForceOffCause::kSoftware);
  if (before == DeviceState::kForce && state_ != before) count(counts_.force_offs);
}

void OmegaDevice::act(rt::Time, const ForceCommand& command) noexcept {
  if (link_.load(std::memory_order_acquire) != Link::kLive) return;
  if (gate_.safe()) return;
  const std::int64_t begin = rt::monotonic_ns();
  Vec3 f = command.f_H_D;
  if (!f.allFinite()) {
    count(counts_.refused);
    f.setZero();
  }
  // Without forces a zero command still keeps the watchdog fed and the weight carried; so whatever
  // re-enables the device (the button on its base) meets no force that waited.
  if (state_ != DeviceState::kForce) f.setZero();
  f = turned(limited_beside(f, Vec3(0, 0, weight_N_), config_.force_limit_N));
  const int sent = api_->set_force(f.x(), f.y(), f.z(), id_);
  times_.add(rt::monotonic_ns() - begin);
  if (sent < 0) {
    failed(Call::kForce);
    return;
  }
  succeeded(Call::kForce);
  if (sent == kDhdMotorSaturated) count(counts_.saturated);
}

// The owner's flag stops further commands; the call into the SDK is the minder's, so a caller never
// waits behind an owner that hangs in there. If the minder hangs too, the controller's watchdog
// acts.
void OmegaDevice::make_safe() noexcept {
  gate_.make_safe();
  stop_asked_.store(true, std::memory_order_release);
  minder_.poke();
}

void OmegaDevice::failed(Call call) noexcept {
  count(counts_.failures);
  const int error = api_->get_last_error();
  int& in_a_row = failed_in_a_row_[static_cast<std::size_t>(call)];
  if (++in_a_row >= kFailuresUntilLost || error == kDhdErrorNoDevice) lose();
}

void OmegaDevice::lose() noexcept {
  failed_in_a_row_.fill(0);
  state_ = DeviceState::kReset;
  status_due_ = rt::Time{};
  cause_.store(ForceOffCause::kDisconnect);
  count(counts_.losses);
  link_.store(Link::kLost, std::memory_order_release);
  minder_.poke();
}

OmegaCounters OmegaDevice::counters() const noexcept {
  OmegaCounters c;
  c.samples = counts_.samples.load();
  c.repeats = counts_.repeats.load();
  c.failures = counts_.failures.load();
  c.saturated = counts_.saturated.load();
  c.refused_commands = counts_.refused.load();
  c.losses = counts_.losses.load();
  c.reopened = counts_.reopened.load();
  c.stops = counts_.stops.load();
  c.force_offs = counts_.force_offs.load();
  return c;
}

}  // namespace drivers
