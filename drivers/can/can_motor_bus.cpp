#include "drivers/can/can_motor_bus.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "drivers/tmcl/motor_faults.hpp"
#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "drivers/youbot/motor_flags.hpp"

namespace drivers::can {

namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr double kMostRpm = 200'000;  // of parameter 2
// Of every so many turns that ask for the speed, one asks for flags and one for the current.
constexpr unsigned kRareEvery = 16;
// A reply that comes at all comes within so many times the limit.
constexpr int kQuietTimes = 4;
constexpr std::uint32_t kLatched = motor_flag::kTimeout | motor_flag::kI2tExceeded;

std::uint8_t code(tmcl::Command c) noexcept { return static_cast<std::uint8_t>(c); }

}  // namespace

void CanMotorConfig::describe(config::Section& s) {
  s.text("iface", iface, {}, "network interface of the bus");
  s.numbers("request_ids", request_ids, 0, 0x7FF,
            "CAN identifiers of the wheels' modules (global parameter 71)");
  s.numbers("module_addresses", module_addresses, 0, 255,
            "module address in the replies (global parameter 66)");
  s.integer("reply_id", reply_id, 0, 0x7FF, "CAN identifier of the replies (global parameter 70)");
  s.integer("ticks_per_motor_turn", ticks_per_motor_turn, 1, 1'000'000, "of the encoders");
  s.integer(
      "requests_per_job", requests_per_job, 1, 4,
      "a bus of 1 Mbit/s carries 4 requests with their replies a millisecond, and is then full");
  s.number("reply_ms", reply_ms, 1, 100, "a later reply counts as lost");
  s.integer("silent_jobs", silent_jobs, 10, 10000,
            "jobs without a position of a module until the bus counts as down");
  s.integer("full_jobs", full_jobs, 1, 10000,
            "jobs in a row whose frames the send queue refused until the bus counts as down");
}

CanMotorBus::CanMotorBus(rt::NonRealtime&, CanPort& port, const CanMotorConfig& config)
    : port_(port), config_(config), reply_limit_(rt::nanos_from_seconds(config.reply_ms * 1e-3)) {
  for (std::size_t i = 0; i < kWheels; ++i) {
    Module& m = modules_[i];
    m.id = static_cast<std::uint32_t>(config.request_ids[i]);
    m.address = static_cast<std::uint8_t>(config.module_addresses[i]);
    m.turn = static_cast<unsigned>(i);  // so that not all ask for a position in the same job
    for (std::size_t k = 0; k < i; ++k) {
      if (modules_[k].id == m.id || modules_[k].address == m.address)
        throw std::invalid_argument("robot.bus.can: wheels " + std::to_string(k) + " and " +
                                    std::to_string(i) + " share an identifier or an address");
    }
    stop_[i] = stop_frame(m);
  }
}

std::vector<std::uint32_t> CanMotorBus::receive_ids(const CanMotorConfig& c) {
  return {static_cast<std::uint32_t>(c.reply_id)};
}

CanFrame CanMotorBus::stop_frame(const Module& m) const noexcept {
  CanFrame f;
  (void)fill(f, m.id, tmcl::to_can(tmcl::Request{0, code(tmcl::Command::kMotorStop), 0, 0, 0}));
  return f;
}

BusStatus CanMotorBus::sense(rt::Time now, MotorStates& states) noexcept {
  take_replies(now);
  const bool late = drop_late(now);
  look_at_bus();
  const bool known = all_known();
  const bool looked =
      std::all_of(modules_.begin(), modules_.end(), [](const Module& m) { return m.looked; });
  if (!down_ && known && looked) why_ = {};
  detail_ = why_;
  if (down_ || why_.trouble != BusTrouble::kNone) return BusStatus::kDown;
  if (late || !known) {
    detail_.trouble = BusTrouble::kFrameLost;
    return BusStatus::kFrameLost;
  }
  if (rearming()) detail_.trouble = BusTrouble::kRearming;
  if (safe_.load(std::memory_order_acquire)) detail_.trouble = BusTrouble::kMadeSafe;
  write_states(now, states);
  return BusStatus::kOk;
}

BusStatus CanMotorBus::act(rt::Time now, const MotorSetpoints& setpoints) noexcept {
  const std::uint64_t refused = port_.counters().refused;
  ask_all(now, setpoints);
  const bool full = port_.counters().refused != refused;
  full_ = full ? full_ + 1 : 0;
  look_at_bus();
  detail_ = why_;
  if (down_) return BusStatus::kDown;
  if (full) detail_.trouble = BusTrouble::kQueueFull;
  return full ? BusStatus::kFrameLost : BusStatus::kOk;
}

// Pressed for long, a clear comes every job: what is being read anew is not begun again.
void CanMotorBus::rearm() noexcept {
  const bool anew = down_ || safe_.load(std::memory_order_acquire);
  for (Module& m : modules_) {
    const bool latched = m.latches == Latches::kNone && (m.flags & kLatched) != 0;
    if (anew || latched) m.latches = Latches::kLook;
  }
  if (!anew) return;
  down_ = false;
  full_ = 0;
  for (Module& m : modules_) {
    // Flags are seldom read: those that are known may be of before a silence.
    m.placed = m.paced = m.looked = m.waiting = m.refuses = false;
    m.silent = 0;
  }
  safe_.store(false, std::memory_order_release);
}

void CanMotorBus::make_safe() noexcept {
  safe_.store(true, std::memory_order_release);
  port_.send_at_once(stop_);
}

bool CanMotorBus::all_known() const noexcept {
  return std::all_of(modules_.begin(), modules_.end(),
                     [](const Module& m) { return m.placed && m.paced; });
}

bool CanMotorBus::rearming() const noexcept {
  return std::any_of(modules_.begin(), modules_.end(),
                     [](const Module& m) { return m.latches != Latches::kNone; });
}

void CanMotorBus::look_at_bus() noexcept {
  const BusDetail now = trouble();
  if (down_ || now.trouble == BusTrouble::kNone) return;
  down_ = true;
  why_ = now;
}

// What alone takes the bus down. What concerns all modules goes before what concerns one.
BusDetail CanMotorBus::trouble() noexcept {
  BusDetail d;
  // Counted, as a controller may be off and back (restart-ms) between two jobs.
  const std::uint64_t seen = std::exchange(bus_offs_, port_.counters().bus_offs);
  const PortState s = port_.state();
  if (seen != bus_offs_ || s == PortState::kBusOff) {
    d.trouble = BusTrouble::kBusOff;
  } else if (s == PortState::kDown || s == PortState::kGone) {
    d.trouble = BusTrouble::kInterfaceDown;
  } else if (full_ >= config_.full_jobs) {
    d.trouble = BusTrouble::kQueueFull;
  }
  for (std::size_t i = 0; i < kWheels && d.trouble == BusTrouble::kNone; ++i) {
    const Module& m = modules_[i];
    if (m.refuses) d.trouble = BusTrouble::kModuleRefuses;
    if (m.silent >= config_.silent_jobs) d.trouble = BusTrouble::kModuleSilent;
    if (d.trouble != BusTrouble::kNone) d.slave = static_cast<std::int16_t>(i + 1);
  }
  return d;
}

// ---- replies

void CanMotorBus::take_replies(rt::Time now) noexcept {
  for (Module& m : modules_) ++m.silent;
  const int n = port_.receive(now, in_);
  for (int i = 0; i < n; ++i) take_reply(in_[static_cast<std::size_t>(i)]);
}

void CanMotorBus::take_reply(const Received& r) noexcept {
  tmcl::Reply reply;
  const bool ours = !r.frame.extended && !r.frame.remote &&
                    r.frame.id == static_cast<std::uint32_t>(config_.reply_id) &&
                    tmcl::from_can(r.frame.bytes(), reply);
  const auto m = std::find_if(modules_.begin(), modules_.end(),
                              [&](const Module& x) { return x.address == reply.module; });
  if (!ours || m == modules_.end() || !m->waiting || reply.command != m->asked.command) {
    ++counters_.strange;
    return;
  }
  m->waiting = false;
  ++counters_.replies;
  // Another value with a good status is the late reply to an older setpoint, and no refusal.
  if (m->kind == Ask::kSetpoint) m->refuses = reply.status != tmcl::status::kOk;
  if (tmcl::answers(reply, m->asked))
    keep(*m, reply, r.at);
  else
    ++counters_.refused;
  // A module that knows no flags, or no such clear, is not asked for ever: its flags tell.
  if (m->kind == Ask::kFlags || m->kind == Ask::kClear) go_on(*m);
}

void CanMotorBus::go_on(Module& m) noexcept {
  if (m.kind == Ask::kClear) {
    m.to_clear &= m.to_clear - 1;
    if (m.to_clear == 0) m.latches = Latches::kLookAgain;
  } else if (m.latches == Latches::kLook && (m.flags & kLatched) != 0) {
    m.to_clear = m.flags & kLatched;
    m.latches = Latches::kClear;
  } else if (m.latches != Latches::kClear) {
    const bool looked_for_it = m.latches == Latches::kLook || m.latches == Latches::kLookAgain;
    if (looked_for_it) m.latches = Latches::kNone;
    m.looked = true;
    if (looked_for_it && !rearming())
      for (Module& each : modules_) each.latches = Latches::kPace;
  }
}

void CanMotorBus::keep(Module& m, const tmcl::Reply& reply, rt::Time at) noexcept {
  switch (m.kind) {
    case Ask::kSetpoint:
    case Ask::kClear:
      break;
    case Ask::kPosition: {
      const auto step = static_cast<std::int32_t>(static_cast<std::uint32_t>(reply.value) -
                                                  static_cast<std::uint32_t>(m.word));
      m.ticks = m.unwrapped ? m.ticks + step : reply.value;
      m.word = reply.value;
      m.unwrapped = m.placed = true;
      m.placed_at = at;
      m.silent = 0;
      break;
    }
    case Ask::kSpeed:
      m.rad_per_s = reply.value * kTwoPi / 60 / config_.gear_ratio;
      m.paced = true;
      if (m.latches == Latches::kPace) m.latches = Latches::kNone;
      break;
    case Ask::kFlags:
      m.flags = static_cast<std::uint32_t>(reply.value);
      break;
    case Ask::kCurrent:
      m.current_A = reply.value * 1e-3;
      break;
  }
}

bool CanMotorBus::drop_late(rt::Time now) noexcept {
  bool any = false;
  for (Module& m : modules_) {
    if (!m.waiting || now - m.asked_at <= reply_limit_) continue;
    m.waiting = false;
    any = true;
    ++counters_.late;
    // A reply does not say which parameter it is of. What still comes of this one must not pass for
    // that of another: until it can not come any more, nothing is asked for, setpoints go out.
    m.ask_from = now + kQuietTimes * reply_limit_;
  }
  return any;
}

// ---- requests

CanMotorBus::Ask CanMotorBus::next_kind(const Module& m, unsigned turn) noexcept {
  if (turn % 2 == 0) {
    // In place of every other motor stop: positions and speeds stay as fresh as ever.
    if (turn % 4 == 0 || m.latches == Latches::kNone || m.driven) return Ask::kSetpoint;
    if (m.latches == Latches::kPace) return Ask::kSpeed;
    return m.latches == Latches::kClear ? Ask::kClear : Ask::kFlags;
  }
  if (!m.placed) return Ask::kPosition;
  if (!m.paced) return Ask::kSpeed;
  if (turn % 4 == 1) return Ask::kPosition;
  const unsigned round = turn / 4 % kRareEvery;
  if (round == 0) return Ask::kFlags;
  return round == kRareEvery / 2 ? Ask::kCurrent : Ask::kSpeed;
}

tmcl::Request CanMotorBus::next_request(Module& m, double rpm, bool drive,
                                        bool setpoint) const noexcept {
  tmcl::Request q;
  q.command = code(tmcl::Command::kGetAxisParameter);
  m.kind = setpoint ? Ask::kSetpoint : next_kind(m, m.turn);
  ++m.turn;
  switch (m.kind) {
    case Ask::kSetpoint:
      if (drive) {
        q.command = code(tmcl::Command::kSetAxisParameter);
        q.type = tmcl::axis::kTargetSpeed;
        q.value = static_cast<std::int32_t>(std::lround(rpm));
      } else {
        q.command = code(tmcl::Command::kMotorStop);
      }
      break;
    case Ask::kPosition:
      q.type = tmcl::axis::kActualPosition;
      break;
    case Ask::kSpeed:
      q.type = tmcl::axis::kActualSpeed;
      break;
    case Ask::kFlags:
      q.type = tmcl::axis::kFlags;
      break;
    case Ask::kCurrent:
      q.type = tmcl::axis::kActualCurrent;
      break;
    case Ask::kClear: {
      const auto bit = static_cast<std::size_t>(std::countr_zero(m.to_clear));
      q.command = code(tmcl::Command::kSetAxisParameter);
      q.type = tmcl::motor_flags()[bit].clear_parameter;
      q.value = q.type == tmcl::axis::kClearTimeout ? 1 : 0;
      break;
    }
  }
  return q;
}

// What drives goes out by turns; motor stop is at the head of the queue in the job that asks for
// it, also to a module that still owes a reply: that one is then not waited for.
void CanMotorBus::ask_all(rt::Time now, const MotorSetpoints& setpoints) noexcept {
  bool drive = setpoints.mode == MotorMode::kVelocity && all_known() && !rearming() && !down_ &&
               !safe_.load(std::memory_order_acquire);
  std::array<double, kWheels> rpm{};
  for (std::size_t i = 0; i < kWheels; ++i) {
    rpm[i] = setpoints.wheel_rad_per_s[i] * 60 / kTwoPi * config_.gear_ratio;
    drive = drive && std::isfinite(rpm[i]) && std::abs(rpm[i]) <= kMostRpm;
  }
  std::array<CanFrame, kWheels> frames{};
  std::array<std::size_t, kWheels> whose{};
  std::size_t n = 0;
  int room = config_.requests_per_job;
  for (std::size_t k = 0; k < kWheels; ++k) {
    const std::size_t i = (first_ + k) % kWheels;
    Module& m = modules_[i];
    const bool stop_now = !drive && m.driven;
    if ((m.waiting || room == 0) && !stop_now) continue;
    room -= room > 0 ? 1 : 0;
    const bool setpoint = stop_now || now < m.ask_from;
    if (setpoint) m.turn += m.turn % 2;  // its turn to be told
    m.asked = next_request(m, rpm[i], drive, setpoint);
    (void)fill(frames[n], m.id, tmcl::to_can(m.asked));
    whose[n++] = i;
    m.asked_at = now;
    m.waiting = true;
  }
  first_ = n == 0 ? first_ : (whose[n - 1] + 1) % kWheels;
  const int taken = n == 0 ? 0 : port_.send(now, std::span(frames).first(n));
  counters_.requests += static_cast<std::uint64_t>(taken);
  for (std::size_t k = 0; k < static_cast<std::size_t>(taken); ++k) {
    Module& m = modules_[whose[k]];
    if (m.kind == Ask::kSetpoint) m.driven = drive;
  }
  // Not sent: asked again in the next job, with what is then the setpoint.
  for (std::size_t k = static_cast<std::size_t>(taken); k < n; ++k) {
    modules_[whose[k]].waiting = false;
    --modules_[whose[k]].turn;
  }
}

void CanMotorBus::write_states(rt::Time now, MotorStates& out) noexcept {
  const double rad_per_tick = kTwoPi / (config_.ticks_per_motor_turn * config_.gear_ratio);
  out.seq = ++seq_;
  out.taken = now;
  for (std::size_t i = 0; i < kWheels; ++i) {
    const Module& m = modules_[i];
    out.taken = std::min(out.taken, m.placed_at);
    out.wheel_rad[i] = static_cast<double>(m.ticks) * rad_per_tick;
    out.wheel_rad_per_s[i] = m.rad_per_s;
    out.current_A[i] = m.current_A;
    out.flags[i] = m.flags;
  }
}

}  // namespace drivers::can
