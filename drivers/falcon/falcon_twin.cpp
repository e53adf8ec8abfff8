#include "drivers/falcon/falcon_twin.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/falcon/falcon_device.hpp"

namespace drivers {
namespace {

using perception::Vec3;

constexpr std::int64_t kMs = 1'000'000;
// Where the index marks are: met on the way out and in, 10 degrees off the middle.
constexpr double kIndex_rad = 0.62;

StylusPlantConfig plain_plant(StylusPlantConfig c) {
  c.gravity_mass_kg = 0;
  return c;
}

}  // namespace

FalconTwin::FalconTwin(rt::NonRealtime&, const FalconTwinConfig& config, HandScript* hand,
                       const Vec3& start_p_D)
    : config_(config), plant_(plain_plant(config.plant), hand, start_p_D), random_(config.seed) {
  mode_ = config.loaded ? Mode::kRunning : Mode::kDead;
  homed_ = config.homed ? 7 : 0;
  // An encoder that has not met its mark counts from where it was at power-on.
  if (!config.homed) offset_ = {1234, -777, 4000};
}

void FalconTwin::power_cycle() {
  mode_ = Mode::kDead;
  homed_ = 0;
  offset_ = {1234, -777, 4000};
  line_out_.clear();
  heard_.clear();
}

// DTR going high at 9600 baud restarts the processor into its monitor.
void FalconTwin::reset_processor() {
  mode_ = faults_.deaf_monitor ? Mode::kDead : Mode::kMonitor;
  homed_ = 0;
  heard_.clear();
  line_out_.clear();
}

bool FalconTwin::control(std::uint8_t request, std::uint16_t value, std::int64_t t_ns) {
  using namespace ftdi;
  if (faults_.unplugged || faults_.refuse_control) return false;
  switch (request) {
    case kReset:
      if (value == kPurgeReceived) line_out_.clear();
      return value <= 2;
    case kModem: {
      const bool was = dtr_;
      if ((value & 0x0100) != 0) dtr_ = (value & 1) != 0;
      if ((value & 0x0200) != 0) rts_ = (value & 2) != 0;
      if (!was && dtr_ && baud_ == k9600) reset_processor();
      return true;
    }
    case kFlow:
      return value == 0;
    case kBaud:
      baud_ = value;
      // The upload ends when the host goes to full speed: right bytes run, others do not.
      if (mode_ == Mode::kUpload && baud_ == k1500k) {
        mode_ = heard_ == config_.firmware && !heard_.empty() ? Mode::kRunning : Mode::kDead;
        heard_.clear();
      }
      return true;
    case kLine:
      line_ = value;
      return true;
    case kLatency:
      latency_ms_ = std::max<int>(1, value);
      next_packet_ns_ = t_ns + latency_ms_ * kMs;
      return value >= 1 && value <= 255;
    default:
      return false;
  }
}

bool FalconTwin::write(std::span<const std::uint8_t> bytes, std::int64_t t_ns) {
  if (faults_.unplugged) return false;
  for (const std::uint8_t byte : bytes) {
    if (mode_ == Mode::kRunning) {
      if (baud_ != ftdi::k1500k) continue;  // garbage on the line
      const std::uint64_t damaged = framer_.damaged();
      if (framer_.push(byte)) exchange(framer_.frame(), t_ns);
      bad_frames_ += framer_.damaged() - damaged;
    } else {
      monitor(byte, t_ns);
    }
  }
  return true;
}

void FalconTwin::monitor(std::uint8_t byte, std::int64_t t_ns) {
  constexpr std::array<std::uint8_t, 3> kHello{0x0A, 0x43, 0x0D};
  constexpr std::array<std::uint8_t, 4> kAnswer{0x0A, 0x44, 0x2C, 0x0D};
  switch (mode_) {
    case Mode::kMonitor:
      if (baud_ != ftdi::k9600 || line_ != ftdi::k8N1 || rts_ || !dtr_) return;
      heard_.push_back(byte);
      if (heard_.size() < kHello.size()) return;
      if (std::equal(kHello.begin(), kHello.end(), heard_.end() - 3)) {
        reply(kAnswer, t_ns);
        mode_ = Mode::kGreeted;
      }
      heard_.clear();
      return;
    case Mode::kGreeted:
      if (baud_ != ftdi::k140k || dtr_ || byte != 0x41) return;
      reply(std::array<std::uint8_t, 1>{byte}, t_ns);
      mode_ = Mode::kUpload;
      heard_.clear();
      return;
    case Mode::kUpload: {
      heard_.push_back(byte);
      const bool lie = faults_.wrong_echo && heard_.size() == 100;
      reply(std::array<std::uint8_t, 1>{static_cast<std::uint8_t>(lie ? byte ^ 0x10 : byte)}, t_ns);
      return;
    }
    case Mode::kDead:
    case Mode::kRunning:
      return;
  }
}

std::array<std::int16_t, 3> FalconTwin::encoders() {
  Vec3 theta = Vec3::Zero();
  (void)FalconKinematics::inverse(FalconDevice::to_F(plant_.true_position()), theta);
  std::array<std::int16_t, 3> out{};
  const int mark = static_cast<int>(
      std::lround((kIndex_rad - FalconKinematics::kZero_rad) / FalconKinematics::kRadPerCount));
  for (std::size_t i = 0; i < 3; ++i) {
    const int truth =
        static_cast<int>(std::lround((theta[static_cast<int>(i)] - FalconKinematics::kZero_rad) /
                                     FalconKinematics::kRadPerCount));
    const bool passed = have_before_ && (before_[i] < mark) != (truth < mark);
    if (command_.home && passed) {
      homed_ = static_cast<std::uint8_t>(homed_ | (1U << i));
    }
    before_[i] = truth;
    const int counted = (homed_ & (1U << i)) != 0 ? truth : truth + offset_[i];
    out[i] = static_cast<std::int16_t>(std::clamp(counted + faults_.slip_cnt[i], -32768, 32767));
  }
  have_before_ = true;
  return out;
}

void FalconTwin::exchange(const FalconFrame& frame, std::int64_t t_ns) {
  if (!decode(frame, command_)) {
    ++bad_frames_;
    return;
  }
  ++frames_;
  exchange_ns_ = t_ns;
  const rt::Time now = rt::time_from_ns(t_ns);
  plant_.advance(now);
  FalconReport report;
  report.encoder_cnt = encoders();
  report.homed = homed_;
  const auto& hand = plant_.hand_target();
  report.buttons = static_cast<std::uint8_t>((hand.button ? 1 : 0) |
                                             (hand.clutch ? FalconDevice::kClutchButton : 0));
  // Motors: the Jacobian's transpose at where the grip is now.
  const Vec3 p_F = FalconDevice::to_F(plant_.true_position());
  Vec3 theta;
  perception::Mat3 J;
  if (FalconKinematics::inverse(p_F, theta) && FalconKinematics::jacobian(p_F, theta, J)) {
    Vec3 tau;
    for (int i = 0; i < 3; ++i) {
      tau[i] = -command_.torque_cnt[static_cast<std::size_t>(i)] / config_.counts_per_N_m;
    }
    const Vec3 f_F = J.transpose() * tau;
    force_D_ = Vec3(-f_F.z(), -f_F.x(), f_F.y());
    plant_.hold(now, force_D_.allFinite() ? force_D_ : Vec3::Zero());
  }
  if (faults_.silent) return;
  if (faults_.lose_answers > 0) {
    --faults_.lose_answers;
    return;
  }
  const std::int64_t ready = t_ns + config_.process_ns;
  for (; faults_.noise_bytes > 0; --faults_.noise_bytes) {
    const auto byte = static_cast<std::uint8_t>(random_.integer(0, 255));
    reply(std::array<std::uint8_t, 1>{byte}, ready);
  }
  FalconFrame answer = encode(report);
  if (faults_.damage_answers > 0) {
    --faults_.damage_answers;
    const auto at = static_cast<std::size_t>(random_.integer(0, 15));
    answer[at] = static_cast<std::uint8_t>(answer[at] ^ random_.integer(1, 255));
  }
  reply(answer, ready);
  if (faults_.double_answers > 0) {
    --faults_.double_answers;
    reply(answer, ready);
  }
}

void FalconTwin::reply(std::span<const std::uint8_t> bytes, std::int64_t t_ns) {
  for (const std::uint8_t byte : bytes) line_out_.emplace_back(t_ns, byte);
}

// The chip sends when a packet is full, or at the latency timer with what there is, be it nothing.
int FalconTwin::read(std::span<std::uint8_t> packet, std::int64_t t_ns) {
  if (faults_.unplugged) return -1;
  const std::int64_t latency = latency_ms_ * kMs;
  if (next_packet_ns_ == 0) next_packet_ns_ = t_ns + latency;
  constexpr std::size_t kRoom = ftdi::kPacket - ftdi::kStatus;
  const auto ready_by = [&](std::int64_t t) {
    std::size_t n = 0;
    while (n < line_out_.size() && n < kRoom && line_out_[n].first <= t) ++n;
    return n;
  };
  std::size_t n = ready_by(t_ns);
  if (n < kRoom) {
    if (t_ns < next_packet_ns_) return 0;
    n = ready_by(next_packet_ns_);
    next_packet_ns_ += latency;
    if (t_ns - next_packet_ns_ > 100 * latency) next_packet_ns_ = t_ns + latency;  // nobody read
  }
  packet[0] = 0x01;
  packet[1] = 0x60;
  if (faults_.line_errors > 0) {
    --faults_.line_errors;
    packet[1] |= 0x02;
  }
  for (std::size_t i = 0; i < n; ++i) {
    packet[ftdi::kStatus + i] = line_out_.front().second;
    line_out_.pop_front();
  }
  return static_cast<int>(ftdi::kStatus + n);
}

// ---------------------------------------------------------------- transport

bool FalconTwinTransport::control(std::uint8_t request, std::uint16_t value) {
  return twin_.control(request, value, now_ns_);
}

bool FalconTwinTransport::write_wait(std::span<const std::uint8_t> bytes, int) {
  return twin_.write(bytes, now_ns_);
}

int FalconTwinTransport::read_wait(std::span<std::uint8_t> bytes, int timeout_ms) {
  std::array<std::uint8_t, ftdi::kPacket> packet{};
  for (int i = 0; i < 4 * timeout_ms; ++i) {
    const int n = twin_.read(packet, now_ns_);
    if (n < 0) return -1;
    if (n > 0) {
      const auto got = static_cast<std::size_t>(n) - ftdi::kStatus;
      const std::size_t take = std::min(got, bytes.size());
      std::copy_n(packet.begin() + ftdi::kStatus, take, bytes.begin());
      return static_cast<int>(take);
    }
    now_ns_ += kMs / 4;
  }
  return -1;
}

bool FalconTwinTransport::start(Listener& listener) {
  listener_ = &listener;
  return !twin_.faults().unplugged;
}

bool FalconTwinTransport::send(const FalconFrame& frame) noexcept {
  return twin_.write(frame, now_ns_);
}

void FalconTwinTransport::pump() noexcept {
  if (listener_ == nullptr) return;
  listener_->on_time(now_ns_);
  std::array<std::uint8_t, ftdi::kPacket> packet{};
  for (int i = 0; i < 8 && listener_ != nullptr; ++i) {
    const int n = twin_.read(packet, now_ns_);
    if (n == 0) return;
    if (n < 0) {
      listener_->on_lost();
      listener_ = nullptr;
      return;
    }
    listener_->on_packet(std::span(packet).first(static_cast<std::size_t>(n)), now_ns_);
  }
}

}  // namespace drivers
