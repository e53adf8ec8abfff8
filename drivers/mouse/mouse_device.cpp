#include "drivers/mouse/mouse_device.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace drivers {
namespace {

using perception::Vec3;

constexpr std::size_t kMostPackets = 64;
// Sample rates 200, 100, 80 in a row switch a PS/2 mouse, and the kernel's imitation, to four
// bytes.
constexpr std::array<std::uint8_t, 6> kWheelPlease{0xF3, 200, 0xF3, 100, 0xF3, 80};

}  // namespace

// Byte 0: buttons 1, 2, 4, always-one 8, signs 0x10 and 0x20, overflows 0x40 and 0x80. Motions are
// nine-bit, the wheel four-bit. A first byte without the always-one bit is skipped.
bool MouseParser::push(std::uint8_t byte) noexcept {
  if (size_ == 0 && (byte & 0x08) == 0) {
    ++skipped_;
    return false;
  }
  packet_[size_++] = byte;
  if (size_ < packet_.size()) return false;
  size_ = 0;
  const std::uint8_t head = packet_[0];
  move_ = MouseMove{};
  move_.button = (head & 1) != 0;
  move_.clutch = (head & 2) != 0;
  if ((head & 0x40) == 0) move_.right = packet_[1] - ((head & 0x10) != 0 ? 256 : 0);
  if ((head & 0x80) == 0) move_.up = packet_[2] - ((head & 0x20) != 0 ? 256 : 0);
  const int wheel = packet_[3] & 0x0F;
  move_.wheel = -(wheel < 8 ? wheel : wheel - 16);  // on the wire toward the hand is positive
  return true;
}

MouseDevice::MouseDevice(rt::NonRealtime&, const MouseConfig& config) : config_(config) {
  if (config.path.empty()) return;
  // Written to as well, to ask for the wheel; a source that is read only gives what it gives.
  fd_ = ::open(config.path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) fd_ = ::open(config.path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) {
    const int error = errno;
    throw std::runtime_error("mouse: " + config.path +
                             (error == EACCES
                                  ? std::string(": no permission: udev rule missing; copy "
                                                "config/system/udev/70-teletact-haptic.rules to "
                                                "/etc/udev/rules.d/")
                                  : ": " + std::string(std::strerror(error))));
  }
  struct stat about {};
  if (::fstat(fd_, &about) != 0 || S_ISDIR(about.st_mode) || S_ISREG(about.st_mode)) {
    ::close(fd_);
    fd_ = -1;
    throw std::runtime_error("mouse: " + config.path + ": is not a mouse");
  }
  if (S_ISCHR(about.st_mode)) {
    (void)!::write(fd_, kWheelPlease.data(), kWheelPlease.size());
    // What it says to that (and what was waiting) would put the packets out of step.
    std::array<std::uint8_t, 256> answers{};
    (void)!::read(fd_, answers.data(), answers.size());
  }
}

MouseDevice::~MouseDevice() {
  if (fd_ >= 0) ::close(fd_);
}

DeviceProperties MouseDevice::properties_of(const MouseConfig& config) noexcept {
  DeviceProperties p;
  p.renders_force = false;
  p.force_limit_N = 0;
  p.mass_kg = p.damping_N_s_per_m = p.coulomb_N = 0;
  p.quantum_m = config.metres_per_count;
  p.workspace_radius_m = config.workspace_radius_m;
  return p;
}

void MouseDevice::apply(const MouseMove& m) noexcept {
  p_ += Vec3(m.up * config_.metres_per_count, -m.right * config_.metres_per_count,
             m.wheel * config_.metres_per_notch);
  const double reach = p_.norm();
  if (reach > config_.workspace_radius_m) p_ *= config_.workspace_radius_m / reach;
  button_ = m.button;
  clutch_ = m.clutch;
  moved_ = true;
}

void MouseDevice::read_source() noexcept {
  if (fd_ < 0 || lost_.load(std::memory_order_relaxed)) return;
  std::array<std::uint8_t, 4 * kMostPackets> bytes{};
  const ssize_t n = ::read(fd_, bytes.data(), bytes.size());
  if (n == 0 || (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
    lost_.store(true);
    button_ = clutch_ = false;
    return;
  }
  for (ssize_t i = 0; i < n; ++i) {
    if (parser_.push(bytes[static_cast<std::size_t>(i)])) apply(parser_.move());
  }
}

bool MouseDevice::sense(rt::Time now, StylusSample& out) noexcept {
  moved_ = last_.seq == 0;
  read_source();
  MouseMove m;
  for (std::size_t i = 0; i < kMostPackets && pushed_.try_pop(m); ++i) apply(m);
  if (moved_) {
    ++last_.seq;
    last_.taken = now;
    last_.p_DH = p_;
  }
  last_.button = button_;
  last_.clutch = clutch_;
  last_.repeated = !moved_;
  last_.state = DeviceState::kForce;
  out = last_;
  return true;
}

}  // namespace drivers
