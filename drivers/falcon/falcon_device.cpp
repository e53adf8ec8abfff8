#include "drivers/falcon/falcon_device.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "drivers/falcon/falcon_boot.hpp"

namespace drivers {
namespace {

using perception::Vec3;

// A metre is at most about this many encoder steps of one leg.
constexpr double kCountsPerMetre = 27000;
constexpr int kBelieveAfter = 3;  // a leap that three frames agree on is the truth
constexpr std::int64_t kKick_ns = 5'000'000;
constexpr std::uint8_t kAllHomed = 7;
constexpr std::uint8_t kLineErrors = 0x0E;  // FTDI: overrun, parity, framing
constexpr int kBootTries = 3;

void count(std::atomic<std::uint64_t>& n) noexcept { n.fetch_add(1, std::memory_order_relaxed); }

bool within(const std::array<std::int16_t, 3>& a, const std::array<std::int16_t, 3>& b,
            int limit) noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    if (std::abs(int{a[i]} - int{b[i]}) > limit) return false;
  }
  return true;
}

}  // namespace

rt::Result<std::vector<std::uint8_t>> read_falcon_firmware(const std::string& path) {
  constexpr std::size_t kLargest = 1U << 20;
  std::ifstream file(path, std::ios::binary);
  std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(file),
                                  std::istreambuf_iterator<char>()};
  if (!file || bytes.empty() || bytes.size() > kLargest) {
    return rt::Error{"device.falcon.firmware = '" + path +
                     "': can not be read, or is not between 1 byte and 1 MiB long"};
  }
  return bytes;
}

FalconDevice::FalconDevice(rt::NonRealtime& nrt, const FalconConfig& config, Opener opener)
    : config_(config),
      opener_(std::move(opener)),
      raw_(nrt, std::vector<int>{1}),
      torque_(nrt, std::vector<int>{1}) {
  if (const std::string why = open(); !why.empty()) throw std::runtime_error("falcon: " + why);
  description_ = "Novint Falcon, stated delay " + std::to_string(config.delay_s * 1e3) + " ms";
  minder_.start([this] { return mind(); },
                std::chrono::milliseconds{static_cast<int>(config.retry_s * 1e3)});
}

FalconDevice::~FalconDevice() {
  minder_.stop();
  gate_.make_safe();
  if (transport_) transport_->stop();
  // The last word is zero torque.
  if (transport_ && link_.load() == Link::kLive) {
    (void)transport_->write_wait(encode(FalconCommand{}), 100);
  }
}

std::string FalconDevice::boot(FalconTransport& t) const {
  if (!falcon_normal_mode(t)) return "the FTDI chip refuses a setting";
  if (falcon_answers(t)) return {};
  if (config_.firmware.empty()) {
    return "the firmware is not loaded (it is lost with the power), and device.falcon.firmware "
           "names "
           "no file";
  }
  auto firmware = read_falcon_firmware(config_.firmware);
  if (!firmware) return firmware.error();
  std::string why;
  for (int i = 0; i < kBootTries; ++i) {
    why = falcon_load_firmware(t, firmware.value());
    if (why.empty()) break;
  }
  return why;
}

std::string FalconDevice::open() {
  auto opened = opener_();
  if (!opened) return opened.error();
  transport_ = std::move(opened).value();
  if (std::string why = boot(*transport_); !why.empty()) {
    transport_.reset();
    return why;
  }
  framer_.reset();
  sent_ns_ = heard_ns_ = 0;
  awaited_ = false;
  session_.fetch_add(1, std::memory_order_release);
  // Live before the first callback, so that a loss right after the start is one.
  link_.store(Link::kLive, std::memory_order_release);
  if (!transport_->start(*this)) {
    link_.store(Link::kLost, std::memory_order_release);
    transport_.reset();
    return "the transfers can not be started";
  }
  return {};
}

bool FalconDevice::mind() {
  if (link_.load(std::memory_order_acquire) == Link::kLive) return false;
  if (transport_) {
    transport_->stop();
    transport_.reset();
  }
  gate_.forget();
  if (!open().empty()) return true;
  count(n_.reopened);
  return false;
}

DeviceProperties FalconDevice::properties_of(const FalconConfig& config) noexcept {
  DeviceProperties p;
  p.mass_kg = config.mass_kg;
  p.damping_N_s_per_m = config.damping_N_s_per_m;
  p.coulomb_N = config.coulomb_N;
  p.delay_s = config.delay_s;
  p.quantum_m = 6e-5;
  p.force_limit_N = config.force_limit_N;
  p.workspace_radius_m = 0.05;
  p.speed_limit_m_per_s = config.speed_limit_m_per_s;
  p.damping_known = p.measured = !config.measured.empty();
  return p;
}

// ---------------------------------------------------------------- event thread

void FalconDevice::on_packet(std::span<const std::uint8_t> packet, std::int64_t t_ns) noexcept {
  if (packet.size() < ftdi::kStatus) return;
  if ((packet[1] & kLineErrors) != 0) count(n_.line_errors);
  bool got = false;
  const std::uint64_t damaged = framer_.damaged();
  for (const std::uint8_t byte : packet.subspan(ftdi::kStatus)) {
    if (!framer_.push(byte)) continue;
    FalconReport report;
    if (!decode(framer_.frame(), report)) {
      count(n_.damaged);
      continue;
    }
    Raw& raw = raw_.begin_write();
    raw.report = report;
    raw.session = session_.load(std::memory_order_relaxed);
    raw_.publish();
    count(n_.frames);
    all_homed_.store(report.homed == kAllHomed, std::memory_order_relaxed);
    got = true;
  }
  n_.damaged.fetch_add(framer_.damaged() - damaged, std::memory_order_relaxed);
  if (!got) return;
  heard_ns_ = t_ns;
  if (awaited_) round_trips_.add(t_ns - sent_ns_);
  awaited_ = false;
  send_next(t_ns);
}

void FalconDevice::send_next(std::int64_t t_ns) noexcept {
  FalconCommand c;
  const auto newest = torque_.acquire_if_new(0);
  if (newest && newest.seq != command_seq_) {
    command_seq_ = newest.seq;
    command_ns_ = t_ns;
  }
  const bool fresh =
      newest && t_ns - command_ns_ <= static_cast<std::int64_t>(config_.watchdog_s * 1e9);
  const bool forces = newest && newest->forces && !gate_.safe();
  if (forces && fresh) {
    c.torque_cnt = newest->counts;
  } else if (forces) {
    count(n_.starved);
  }
  const bool homed = all_homed_.load(std::memory_order_relaxed);
  c.home = c.red = !homed;
  c.blue = homed && forces;
  c.green = homed && !forces;
  if (transport_->send(encode(c))) {
    sent_ns_ = t_ns;
    awaited_ = true;
  }
}

void FalconDevice::on_time(std::int64_t t_ns) noexcept {
  if (heard_ns_ == 0) heard_ns_ = t_ns;  // just started
  if (t_ns - heard_ns_ > static_cast<std::int64_t>(config_.lost_after_s * 1e9)) {
    on_lost();
    return;
  }
  // The device only answers: a lost frame would end the conversation.
  if (sent_ns_ == 0 || t_ns - sent_ns_ > kKick_ns) {
    if (sent_ns_ != 0) count(n_.kicks);
    send_next(t_ns);
  }
}

void FalconDevice::on_lost() noexcept {
  if (link_.exchange(Link::kLost, std::memory_order_acq_rel) == Link::kLost) return;
  count(n_.losses);
  braked_.store(true, std::memory_order_release);
  cause_.store(ForceOffCause::kDisconnect);
  minder_.poke();
}

// ---------------------------------------------------------------- owner

DeviceState FalconDevice::state() const noexcept {
  if (!have_counts_) return DeviceState::kReset;
  if (gate_.safe() || braked_.load(std::memory_order_acquire)) return DeviceState::kBrake;
  return forces_ ? DeviceState::kForce : DeviceState::kIdle;
}

void FalconDevice::brake(ForceOffCause cause) noexcept {
  braked_.store(true, std::memory_order_release);
  cause_.store(cause);
  forces_ = false;
}

bool FalconDevice::sense(rt::Time now, StylusSample& out) noexcept {
  if (link_.load(std::memory_order_acquire) != Link::kLive) {
    forces_ = have_counts_ = have_sample_ = false;
    unhomed_ = 0;
    return false;
  }
  if (braked_.load(std::memory_order_acquire)) forces_ = false;
  const auto raw = raw_.acquire_if_new(0);
  // What an earlier plug left in the cell is not this one's.
  if (!raw || raw->session != session_.load(std::memory_order_acquire)) return false;
  const bool fresh = raw.seq != taken_seq_;
  taken_seq_ = raw.seq;
  const bool sample = fresh && take(raw->report, now);
  if (have_counts_ && gate_.take()) {
    braked_.store(false, std::memory_order_release);
    cause_.store(ForceOffCause::kNone);
    forces_ = true;
    fast_ = 0;
  }
  if (!sample && !have_sample_) return false;
  if (sample) {
    ++last_.seq;
    last_.taken = now;
    count(n_.samples);
  } else {
    count(n_.repeats);
  }
  last_.repeated = !sample;
  last_.state = state();
  out = last_;
  return true;
}

// A frame has no checksum, so a damaged one may read as a leap. What is faster than twice the speed
// limit is believed only when the next frames agree.
bool FalconDevice::plausible(const std::array<std::int16_t, 3>& counts, rt::Time now) noexcept {
  const double gap = std::clamp(rt::seconds(now - last_.taken), 1e-3, 2e-3);
  const int limit = 10 + static_cast<int>(2 * config_.speed_limit_m_per_s * gap * kCountsPerMetre);
  if (!have_counts_ || within(counts, counts_, limit)) {
    far_ = 0;
    return true;
  }
  far_ = far_ > 0 && within(counts, far_counts_, limit) ? far_ + 1 : 1;
  far_counts_ = counts;
  count(n_.leaps);
  if (far_ < kBelieveAfter) return false;
  far_ = 0;
  return true;
}

// False: this frame is no sample.
bool FalconDevice::take(const FalconReport& report, rt::Time now) noexcept {
  // The flags too may be damaged: a button counts when two frames agree, lost marks when three do.
  const bool button = (report.buttons & ~kClutchButton) != 0,
             clutch = (report.buttons & kClutchButton) != 0;
  if (button == button_before_) last_.button = button;
  if (clutch == clutch_before_) last_.clutch = clutch;
  button_before_ = button;
  clutch_before_ = clutch;
  unhomed_ = report.homed != kAllHomed ? unhomed_ + 1 : 0;
  if (unhomed_ > 0) {  // the counts mean nothing
    if (have_counts_ && unhomed_ < kBelieveAfter) return false;
    have_counts_ = forces_ = false;
    last_.p_DH.setZero();
    return have_sample_ = true;
  }
  const auto& c = report.encoder_cnt;
  if (!plausible(c, now)) return false;
  const Vec3 theta(FalconKinematics::angle(c[0]), FalconKinematics::angle(c[1]),
                   FalconKinematics::angle(c[2]));
  const FalconForward solved = FalconKinematics::forward(theta, p_F_);
  if (!solved.good) {
    count(n_.unsolved);
    return false;
  }
  counts_ = c;
  theta_ = theta;
  p_F_ = solved.p_F;
  const Vec3 p_D = to_D(p_F_);
  if (have_counts_) watch_speed(p_D, now);
  have_counts_ = have_sample_ = true;
  last_.p_DH = p_D;
  return true;
}

void FalconDevice::watch_speed(const Vec3& p_D, rt::Time now) noexcept {
  const double dt = std::max(rt::seconds(now - last_.taken), 2.5e-4);
  const bool fast = (p_D - last_.p_DH).norm() > config_.speed_limit_m_per_s * dt;
  fast_ = fast ? fast_ + 1 : 0;
  if (fast_ >= 3 && forces_) brake(ForceOffCause::kVelocity);
}

void FalconDevice::act(rt::Time, const ForceCommand& command) noexcept {
  if (link_.load(std::memory_order_acquire) != Link::kLive) return;
  Torque& t = torque_.begin_write();
  t = Torque{};
  t.forces = state() == DeviceState::kForce;
  Vec3 f = command.f_H_D;
  if (!f.allFinite()) {
    count(n_.refused);
    f.setZero();
  }
  if (const double size = f.norm(); size > config_.force_limit_N) f *= config_.force_limit_N / size;
  perception::Mat3 J;
  Vec3 tau;
  if (t.forces && FalconKinematics::jacobian(p_F_, theta_, J) &&
      FalconKinematics::torque(J, direction_to_F(f), tau)) {
    Vec3 counts = -config_.counts_per_N_m * tau;  // the motors turn against the thighs
    // All three by one factor: less force, the same direction.
    const double most = counts.cwiseAbs().maxCoeff();
    if (most > config_.torque_limit_cnt) {
      counts *= config_.torque_limit_cnt / most;
      count(n_.saturated);
    }
    for (std::size_t i = 0; i < 3; ++i) {
      t.counts[i] = static_cast<std::int16_t>(std::lround(counts[static_cast<int>(i)]));
    }
  }
  torque_.publish();
}

FalconCounters FalconDevice::counters() const noexcept {
  FalconCounters c;
  c.frames = n_.frames.load();
  c.damaged = n_.damaged.load();
  c.line_errors = n_.line_errors.load();
  c.samples = n_.samples.load();
  c.repeats = n_.repeats.load();
  c.leaps = n_.leaps.load();
  c.unsolved = n_.unsolved.load();
  c.saturated = n_.saturated.load();
  c.refused_commands = n_.refused.load();
  c.kicks = n_.kicks.load();
  c.starved = n_.starved.load();
  c.losses = n_.losses.load();
  c.reopened = n_.reopened.load();
  return c;
}

}  // namespace drivers
