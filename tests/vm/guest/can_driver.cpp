#include "tests/vm/guest/can_driver.hpp"

#include <time.h>
#include <unistd.h>

#include <cmath>
#include <numbers>

#include "rt/clock/box_time.hpp"
#include "tests/vm/guest/say.hpp"

namespace vm {

namespace {

constexpr int kPriority = 80;
constexpr std::int64_t kPeriod_ns = 1'000'000;
constexpr std::size_t kMostJobs = 30'000, kStart = 60;
constexpr double kTwoPi = 2 * std::numbers::pi;
const drivers::can::CanMotorConfig kConfig;

// Each wheel has a speed of its own.
double rpm(std::size_t wheel) { return 600 + 50 * static_cast<double>(wheel); }
double rad_per_s(double motor_rpm) { return motor_rpm * kTwoPi / 60 / kConfig.gear_ratio; }

std::unique_ptr<drivers::can::CanPort> open_port(rt::NonRealtime& nrt, const std::string& iface) {
  return drivers::can::open_socket_port(
      nrt, {iface, drivers::can::CanMotorBus::receive_ids(kConfig), 1 << 18});
}

}  // namespace

CanDriver::CanDriver(rt::NonRealtime& nrt, const std::string& iface, const CanModules& modules)
    : modules_(modules), port_(open_port(nrt, iface)), bus_(nrt, *port_, kConfig) {
  setpoints_.mode = drivers::MotorMode::kVelocity;
  for (std::size_t w = 0; w < drivers::kWheels; ++w)
    setpoints_.wheel_rad_per_s[w] = rad_per_s(rpm(w));
  jobs_.resize(kMostJobs);
  thread_ = std::thread([this] { live(); });
}

CanDriver::~CanDriver() {
  ends_ = true;
  thread_.join();
}

void CanDriver::wait(int jobs) const {
  const std::size_t until = count() + static_cast<std::size_t>(jobs);
  while (count() < until) ::usleep(500);
}

std::size_t CanDriver::first_after(std::int64_t ns) const {
  return first(0, [ns](const Job& j) { return j.start_ns >= ns; });
}

void CanDriver::live() {
  become_real_time(kPriority);
  std::int64_t next = rt::monotonic_ns() + kPeriod_ns;
  while (!ends_.load() && count() < jobs_.size()) {
    timespec at{};
    at.tv_sec = next / 1'000'000'000;
    at.tv_nsec = next % 1'000'000'000;
    while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) != 0) {
    }
    next += kPeriod_ns;
    if (hangs_.load()) continue;
    one(jobs_[count()]);
    ++count_;
  }
}

void CanDriver::one(Job& j) {
  const std::int64_t cpu = rt::thread_cpu_ns();
  j.start_ns = rt::monotonic_ns();
  const rt::Time now = rt::time_from_ns(j.start_ns);
  if (rearm_.exchange(false)) bus_.rearm();
  j.in = bus_.sense(now, states_);
  j.port = port_->state();
  j.bus = port_->bus_state();
  j.out = bus_.act(now, setpoints_);
  if (j.in != drivers::BusStatus::kDown) j.port = port_->state();
  j.cpu_ns = rt::thread_cpu_ns() - cpu;
  if (j.in != drivers::BusStatus::kOk) return;
  j.age_ns = j.start_ns - rt::ns_of(states_.taken);
  j.wrong = wrong(j.start_ns, j.age_ns);
}

// A position may be as old as the states say, no older; a speed is 0 or what the wheel was told.
bool CanDriver::wrong(std::int64_t now, std::int64_t age_ns) const {
  if (age_ns < 0 || now <= age_ns) return true;
  // Between the module's look at its motor and the stamp; and of `truth`, which is taken later.
  // The kernel begins to stamp some time after a socket asked for it: the first replies have the
  // time at which they were read, up to a job later.
  const double slack_ns = count() < kStart ? 1.5e6 : 0.5e6;
  const double rad_per_tick = kTwoPi / (kConfig.ticks_per_motor_turn * kConfig.gear_ratio);
  for (std::size_t w = 0; w < drivers::kWheels; ++w) {
    const double truth = modules_.motor(static_cast<int>(w)).ticks_at(now);
    const double behind = truth - states_.wheel_rad[w] / rad_per_tick;
    const double per_ns = rpm(w) * 4000 / 60e9;
    const double most = per_ns * (static_cast<double>(age_ns) + slack_ns) + 2;
    if (behind < -per_ns * slack_ns - 2 || behind > most) return true;
    const double told = std::abs(states_.wheel_rad_per_s[w]);
    if (told > 1e-9 && std::abs(told - rad_per_s(rpm(w))) > rad_per_s(1)) return true;
  }
  return false;
}

}  // namespace vm
