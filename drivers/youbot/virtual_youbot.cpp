#include "drivers/youbot/virtual_youbot.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace drivers {

void PoseHistory::publish(const Sample& s) noexcept {
  const std::uint64_t index = count_.load(std::memory_order_relaxed);
  Slot& slot = slots_[index % kSlots];
  // Release stores keep the fields after the odd number and before the even one.
  slot.sequence.store(2 * index + 1, std::memory_order_relaxed);
  slot.ns.store(rt::ns_of(s.time), std::memory_order_release);
  const std::array<double, 7> v{s.X_WB.x, s.X_WB.y, s.X_WB.yaw, s.v_B.vx,
                                s.v_B.vy, s.v_B.wz, s.path_m};
  for (std::size_t i = 0; i < v.size(); ++i) slot.value[i].store(v[i], std::memory_order_release);
  slot.collisions.store(s.collisions, std::memory_order_release);
  slot.sequence.store(2 * index + 2, std::memory_order_release);
  count_.store(index + 1, std::memory_order_release);
}

bool PoseHistory::read(std::uint64_t index, Sample& out) const noexcept {
  const Slot& slot = slots_[index % kSlots];
  if (slot.sequence.load(std::memory_order_acquire) != 2 * index + 2) return false;
  out.time = rt::time_from_ns(slot.ns.load(std::memory_order_acquire));
  std::array<double, 7> v{};
  for (std::size_t i = 0; i < v.size(); ++i) v[i] = slot.value[i].load(std::memory_order_acquire);
  out.collisions = slot.collisions.load(std::memory_order_acquire);
  out.X_WB = {v[0], v[1], v[2]};
  out.v_B = {v[3], v[4], v[5]};
  out.path_m = v[6];
  return slot.sequence.load(std::memory_order_relaxed) == 2 * index + 2;
}

bool PoseHistory::newest(Sample& out) const noexcept {
  for (int tries = 0; tries < 4; ++tries) {
    const std::uint64_t n = count_.load(std::memory_order_acquire);
    if (n == 0) return false;
    if (read(n - 1, out)) return true;
  }
  return false;
}

bool PoseHistory::at(rt::Time t, Sample& out, rt::Nanos extrapolate) const noexcept {
  const std::uint64_t n = count_.load(std::memory_order_acquire);
  if (n == 0) return false;
  // The last sample not after t, by bisection over what the ring still holds. Some slots are left
  // out: the writer may reach them meanwhile.
  const std::uint64_t oldest = n > kKept ? n - kKept : 0;
  std::uint64_t lo = oldest, hi = n;
  Sample s;
  if (!read(lo, s) || s.time > t) return false;
  while (hi - lo > 1) {
    const std::uint64_t mid = lo + (hi - lo) / 2;
    if (!read(mid, s)) return false;
    if (s.time <= t)
      lo = mid;
    else
      hi = mid;
  }
  if (!read(lo, out)) return false;
  if (lo + 1 == n && t - out.time > extrapolate) return false;
  out.X_WB = perception::integrate(out.X_WB, out.v_B, rt::seconds(t - out.time));
  out.time = t;
  return true;
}

VirtualYoubot::VirtualYoubot(rt::NonRealtime&, const VirtualYoubotConfig& config, RobotPlant plant)
    : config_(config), plant_(std::move(plant)) {}

BusStatus VirtualYoubot::act(rt::Time now, const MotorSetpoints& setpoints) noexcept {
  if (faults_.down) return BusStatus::kDown;
  if (losing_) return BusStatus::kFrameLost;
  // Its owner may have hung since sense(): the watchdog stops the motors first.
  if (now > last_exchange_ + std::chrono::milliseconds{config_.watchdog_ms}) simulate(now);
  last_exchange_ = std::max(last_exchange_, now);
  bool finite = true;
  for (const double w : setpoints.wheel_rad_per_s) finite = finite && std::isfinite(w);
  powered_ = setpoints.mode == MotorMode::kVelocity && finite && !timeout_ && !safe();
  plant_.command(now, setpoints.wheel_rad_per_s, powered_);
  return BusStatus::kOk;
}

BusStatus VirtualYoubot::sense(rt::Time now, MotorStates& states) noexcept {
  simulate(now);
  if (faults_.down) return BusStatus::kDown;
  losing_ = faults_.lose_frames > 0;
  if (losing_) {
    --faults_.lose_frames;
    return BusStatus::kFrameLost;
  }
  last_exchange_ = now;
  powered_ = powered_ && !timeout_ && !safe();

  states.seq = ++seq_;
  states.taken = now;
  states.wheel_rad = plant_.encoder_rad();
  states.wheel_rad_per_s = plant_.encoder_rad_per_s();
  for (int i = 0; i < kWheels; ++i) {
    states.current_A[i] = plant_.current_A(i);
    std::uint32_t f = motor_flag::kInitialised;
    if (powered_) f |= motor_flag::kVelocityMode;
    if (std::abs(plant_.state().wheel_rad_per_s[i]) < 1e-3) f |= motor_flag::kMotorHalted;
    if (timeout_) f |= motor_flag::kTimeout;
    states.flags[i] = f;
  }
  if (faults_.nan_angle) states.wheel_rad[0] = std::numeric_limits<double>::quiet_NaN();
  return BusStatus::kOk;
}

void VirtualYoubot::simulate(rt::Time now) noexcept {
  const std::int64_t cpu = cpu_clock_ != nullptr ? cpu_clock_() : 0;
  plant_.set_stuck_wheel(faults_.stuck_wheel);
  if (!started_) {
    started_ = true;
    last_exchange_ = now;
  }
  if (safe()) plant_.command(plant_.state().time, {}, false);
  // The watchdog stops the motors at its own instant, however late this access comes.
  const rt::Time expiry = last_exchange_ + std::chrono::milliseconds{config_.watchdog_ms};
  if (now > expiry && !timeout_) {
    plant_.advance(expiry);
    plant_.command(expiry, {}, false);
    timeout_ = true;
  }
  plant_.advance(now);
  const PlantState& s = plant_.state();
  history_.publish({s.time, s.X_WB, s.v_B, s.collisions, s.path_m});
  if (cpu_clock_ != nullptr) twin_cpu_ns_ += cpu_clock_() - cpu;
}

}  // namespace drivers
