#include "drivers/youbot_bus/ethercat_motor_bus.hpp"

#include <bit>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "drivers/youbot/motor_flags.hpp"

namespace drivers::youbot_bus {

namespace {

// Above any motor's speed; a setpoint beyond it is no setpoint.
constexpr double kMost_rpm = 200000;
constexpr std::uint32_t kLatched = motor_flag::kTimeout | motor_flag::kI2tExceeded;
constexpr unsigned bit(std::size_t n) noexcept { return 1U << static_cast<unsigned>(n); }

BusDetail trouble_of(const ethercat::BusHealth& h) noexcept {
  using ethercat::BusFault;
  BusDetail d;
  d.slave = static_cast<std::int16_t>(h.slave + 1);
  switch (h.fault) {
    case BusFault::kNone:
      break;
    case BusFault::kLinkDown:
      d.trouble = BusTrouble::kLinkDown;
      break;
    case BusFault::kFramesLost:
      d.trouble = BusTrouble::kFrameLost;
      break;
    case BusFault::kSlavesMissing:
      d.trouble = BusTrouble::kSlavesMissing;
      break;
    case BusFault::kSlaveState:
      d.trouble = BusTrouble::kSlaveState;
      d.al_state = h.al.state;
      d.al_code = h.al.code;
      break;
    case BusFault::kWorkingCounter:
      d.trouble = BusTrouble::kWorkingCounter;
      break;
  }
  return d;
}

BusTrouble trouble_of_joint(std::uint32_t flags) noexcept {
  if ((flags & motor_flag::kInitialised) == 0) return BusTrouble::kJointNotCommutated;
  if ((flags & motor_flag::kTimeout) != 0) return BusTrouble::kJointTimeout;
  if ((flags & motor_flag::kI2tExceeded) != 0) return BusTrouble::kJointI2t;
  return (flags & motor_flag::kFaults) != 0 ? BusTrouble::kJointFault : BusTrouble::kNone;
}

}  // namespace

EtherCatMotorBus::EtherCatMotorBus(rt::NonRealtime& nrt, ethercat::Master& master,
                                   const MotorBusConfig& c)
    : master_(master), config_(c) {
  if (config_.joints.size() > held_.size())
    throw std::invalid_argument("a youBot has at most ten arm joints");
  for (std::size_t d = 0; d < drives(); ++d)
    if (master_.inputs(slave_of(d)).size() == kNarrowInputBytes) narrow_ |= bit(d);
  for (const std::size_t slave : config_.joints) master_.keep_outputs(nrt, slave);
}

std::size_t EtherCatMotorBus::slave_of(std::size_t drive) const noexcept {
  return drive < kWheels ? config_.slave[drive] : config_.joints[drive - kWheels];
}

bool EtherCatMotorBus::read_drive(std::size_t drive, DriveInputs& out) const noexcept {
  if (!decode(master_.inputs(slave_of(drive)), out)) return false;
  out.flags = (out.flags | latched_[drive]) & ~config_.ignored_flags;
  return true;
}

// Pressed for long, a clear comes every job: what is under way is not begun anew.
void EtherCatMotorBus::rearm() noexcept {
  safe_.store(false, std::memory_order_release);
  const bool bad = master_.stopped() || master_.health().fault != ethercat::BusFault::kNone;
  if (to_clear_ == 0 && to_look_ == 0) {
    // Drives that were without frames have latched it since their inputs were read last.
    flags_awaited_ = bad || master_.recovering() || !fresh_;
    if (!flags_awaited_) choose_clears();
  }
  if (bad && !master_.recovering()) master_.recover();
}

// Of the first firmware's drives, which do not tell by themselves, both flags.
void EtherCatMotorBus::choose_clears() noexcept {
  flags_awaited_ = false;
  clearing_ = looking_ = -1;
  to_look_ = narrow_;
  for (std::size_t d = 0; d < drives(); ++d) {
    DriveInputs in;
    const bool told = read_drive(d, in);
    const bool narrow = (narrow_ & bit(d)) != 0;
    if (narrow || (told && (in.flags & motor_flag::kTimeout) != 0)) to_clear_ |= bit(d);
    if (narrow || (told && (in.flags & motor_flag::kI2tExceeded) != 0))
      to_clear_ |= bit(drives() + d);
  }
}

BusStatus EtherCatMotorBus::sense(rt::Time now, MotorStates& states) noexcept {
  use_mailbox();
  const ethercat::CycleResult read = master_.read_inputs();
  const BusStatus status = status_of(read);
  if (recovering_ && !master_.recovering())
    for (std::size_t w = 0; w < primed_.size(); ++w)
      primed_[w] = primed_[w] && !master_.began_anew(config_.slave[w]);
  recovering_ = master_.recovering();
  fresh_ = status == BusStatus::kOk;
  if (flags_awaited_ && fresh_ && !master_.recovering()) choose_clears();
  if (!fresh_) {
    // A slave that fell to SAFEOP turns no motor and still tells what its encoder counts. In a
    // recovery one may have begun to count anew: its words are taken again after it.
    if (read.status == ethercat::CycleStatus::kOk && !recovering_) (void)take_states(now, states);
    return status;
  }
  if (take_states(now, states) && ready_) {
    if (rearming()) detail_.trouble = BusTrouble::kRearming;
    if (safe_.load(std::memory_order_acquire)) detail_.trouble = BusTrouble::kMadeSafe;
    look_at_arm();
    return BusStatus::kOk;
  }
  detail_.trouble = BusTrouble::kNotReady;
  for (std::size_t w = kWheels; w-- > 0;) {
    DriveInputs in;
    if (read_drive(w, in) && (in.flags & motor_flag::kInitialised) != 0) continue;
    detail_.slave = static_cast<std::int16_t>(config_.slave[w] + 1);
  }
  return BusStatus::kDown;
}

// Also while flags are being cleared: until its joints hold, a robot is not to be called well.
void EtherCatMotorBus::look_at_arm() noexcept {
  for (std::size_t d = kWheels; d < drives(); ++d) {
    DriveInputs in;  // of an unknown size: no flags, so not commutated
    (void)read_drive(d, in);
    const BusTrouble trouble = trouble_of_joint(in.flags);
    if (trouble == BusTrouble::kNone) continue;
    detail_.trouble = trouble;
    detail_.slave = static_cast<std::int16_t>(slave_of(d) + 1);
    return;
  }
}

BusStatus EtherCatMotorBus::act(rt::Time, const MotorSetpoints& setpoints) noexcept {
  put_setpoints(setpoints);
  return status_of(master_.write_outputs());
}

void EtherCatMotorBus::put_setpoints(const MotorSetpoints& s) noexcept {
  const bool safe = safe_.load(std::memory_order_acquire);
  put_arm(safe || s.mode == MotorMode::kStop);
  bool moves = s.mode == MotorMode::kVelocity && ready_ && !rearming() && !safe;
  std::array<double, kWheels> rpm{};
  for (std::size_t w = 0; w < rpm.size(); ++w) {
    rpm[w] = s.wheel_rad_per_s[w] * config_.gear_ratio * 60 / (2 * std::numbers::pi);
    moves = moves && std::abs(rpm[w]) <= kMost_rpm;  // NaN is not
  }
  for (std::size_t w = 0; w < rpm.size(); ++w) {
    DriveOutputs o;
    if (moves) o = {static_cast<std::int32_t>(std::lround(rpm[w])), ControllerMode::kVelocity};
    (void)encode(o, master_.outputs(config_.slave[w]));
  }
}

void EtherCatMotorBus::put_arm(bool stopped) noexcept {
  for (std::size_t j = 0; j < config_.joints.size(); ++j) {
    DriveInputs in;
    DriveOutputs o;
    const ethercat::AlStatus& al = master_.al_status(config_.joints[j]);
    const bool drives = al.is() == ethercat::AlState::kOp && !al.error();
    const bool able = read_drive(kWheels + j, in) && drives &&
                      (in.flags & motor_flag::kInitialised) != 0 && (in.flags & kLatched) == 0;
    if (!able) {
      held_[j] = false;
    } else if (stopped && config_.arm_rest == ArmRest::kFree) {
      held_[j] = false;
      o.mode = ControllerMode::kCurrent;
    } else {
      // Of this job's inputs: those of before a stop may be of before the power went.
      if (!held_[j] && fresh_) hold_ticks_[j] = in.position_ticks;
      held_[j] = held_[j] || fresh_;
      if (held_[j]) o = {hold_ticks_[j], ControllerMode::kPosition};
    }
    (void)encode(o, master_.outputs(config_.joints[j]));
  }
}

// One mailbox request at a time, a datagram a cycle.
void EtherCatMotorBus::use_mailbox() noexcept {
  if (master_.recovering() || master_.mailbox().busy()) return;
  take_answer();
  clearing_ = looking_ = -1;
  if (to_clear_ != 0)
    post_clear();
  else if (to_look_ != 0 || (narrow_ != 0 && fresh_))
    post_look();
}

void EtherCatMotorBus::take_answer() noexcept {
  tmcl::Reply reply;
  if (master_.mailbox().state() != ethercat::TransferState::kDone ||
      !tmcl::decode(master_.mailbox().reply(), reply))
    return;
  // A firmware that refuses to clear I2t refuses it for ever: the flag tells what became of it.
  const bool i2t = clearing_ >= static_cast<int>(drives());
  if (clearing_ >= 0 && (i2t || reply.status == tmcl::status::kOk))
    to_clear_ &= ~bit(static_cast<std::size_t>(clearing_));
  const bool told = reply.command == static_cast<std::uint8_t>(tmcl::Command::kGetAxisParameter);
  if (looking_ < 0 || !told) return;
  const auto drive = static_cast<std::size_t>(looking_);
  // A firmware that refuses has no such flags to tell.
  const bool has = reply.status == tmcl::status::kOk;
  latched_[drive] = has ? static_cast<std::uint32_t>(reply.value) & kLatched : 0;
  to_look_ &= ~bit(drive);
}

void EtherCatMotorBus::post_clear() noexcept {
  const auto first = static_cast<std::size_t>(std::countr_zero(to_clear_));
  const bool timeout = first < drives();
  tmcl::Request clear{0, static_cast<std::uint8_t>(tmcl::Command::kSetAxisParameter),
                      tmcl::axis::kClearTimeout, 0, 1};
  if (!timeout) {
    clear.type = tmcl::axis::kClearI2t;
    clear.value = 0;
  }
  clearing_ = static_cast<int>(first);
  (void)master_.post(slave_of(timeout ? first : first - drives()), tmcl::encode(clear));
}

// The next behind the one that was asked last; in rearm() of those that have not answered yet.
void EtherCatMotorBus::post_look() noexcept {
  const unsigned all = to_look_ != 0 ? to_look_ : narrow_;
  const unsigned behind = all & ~(bit(static_cast<std::size_t>(looked_ + 1)) - 1);
  looked_ = looking_ = std::countr_zero(behind != 0 ? behind : all);
  const tmcl::Request look{0, static_cast<std::uint8_t>(tmcl::Command::kGetAxisParameter),
                           tmcl::axis::kFlags, 0, 0};
  (void)master_.post(slave_of(static_cast<std::size_t>(looking_)), tmcl::encode(look));
}

BusStatus EtherCatMotorBus::status_of(const ethercat::CycleResult& r) noexcept {
  using ethercat::BusFault;
  const ethercat::BusHealth h = master_.health();
  detail_ = trouble_of(h);
  if (master_.stopped() || h.fault == BusFault::kLinkDown || h.fault == BusFault::kSlavesMissing ||
      h.fault == BusFault::kSlaveState)
    return BusStatus::kDown;
  if (r.status != ethercat::CycleStatus::kOk) return BusStatus::kFrameLost;
  detail_ = {};
  return BusStatus::kOk;
}

bool EtherCatMotorBus::take_states(rt::Time now, MotorStates& states) noexcept {
  std::array<DriveInputs, kWheels> in{};
  for (std::size_t w = 0; w < in.size(); ++w)
    if (!read_drive(w, in[w])) return false;
  ready_ = true;
  for (const DriveInputs& i : in) ready_ = ready_ && (i.flags & motor_flag::kInitialised) != 0;
  const double rad_per_tick =
      2 * std::numbers::pi / (config_.ticks_per_motor_turn * config_.gear_ratio);
  for (std::size_t w = 0; w < in.size(); ++w) {
    // The difference of two words is right across a wrap.
    const auto step = static_cast<std::int32_t>(static_cast<std::uint32_t>(in[w].position_ticks) -
                                                static_cast<std::uint32_t>(word_[w]));
    if (primed_[w]) ticks_[w] += step;
    if (seq_ == 0) ticks_[w] = in[w].position_ticks;
    primed_[w] = true;
    word_[w] = in[w].position_ticks;
    states.wheel_rad[w] = static_cast<double>(ticks_[w]) * rad_per_tick;
    states.wheel_rad_per_s[w] = in[w].velocity_rpm * 2 * std::numbers::pi / 60 / config_.gear_ratio;
    states.current_A[w] = 1e-3 * in[w].current_mA;
    states.flags[w] = in[w].flags;
  }
  states.seq = ++seq_;
  states.taken = now;
  return true;
}

}  // namespace drivers::youbot_bus
