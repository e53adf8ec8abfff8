#include "tools/measure/tun_road/tun_device.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>

namespace teletact {

namespace {

std::string failed(const std::string& what) { return what + ": " + std::strerror(errno); }

// This thread is in the namespace until the object ends.
class Inside {
 public:
  explicit Inside(const std::string& ns)
      : back_(::open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC)) {
    const int there = ::open(("/run/netns/" + ns).c_str(), O_RDONLY | O_CLOEXEC);
    inside_ = back_ >= 0 && there >= 0 && ::setns(there, CLONE_NEWNET) == 0;
    error_ = errno;
    if (there >= 0) ::close(there);
  }
  ~Inside() {
    if (inside_ && ::setns(back_, CLONE_NEWNET) != 0) std::abort();  // nobody knows where we are
    if (back_ >= 0) ::close(back_);
  }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;
  [[nodiscard]] bool well() const noexcept { return inside_; }
  [[nodiscard]] int error() const noexcept { return error_; }

 private:
  int back_ = -1, error_ = 0;
  bool inside_ = false;
};

ifreq named(const std::string& name) {
  ifreq r{};
  std::memcpy(r.ifr_name, name.c_str(), std::min(name.size(), sizeof r.ifr_name - 1));
  return r;
}

bool set_address(int fd, const std::string& name, unsigned long what, in_addr address) {
  ifreq r = named(name);
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_addr = address;
  std::memcpy(&r.ifr_addr, &a, sizeof a);
  return ::ioctl(fd, what, &r) == 0;
}

bool bring_up(int fd, const std::string& name) {
  ifreq r = named(name);
  if (::ioctl(fd, SIOCGIFFLAGS, &r) != 0) return false;
  r.ifr_flags = static_cast<short>(r.ifr_flags | IFF_UP | IFF_RUNNING);
  return ::ioctl(fd, SIOCSIFFLAGS, &r) == 0;
}

}  // namespace

std::vector<std::string> settable_congestion(const std::vector<std::string>& names) {
  std::vector<std::string> out;
  for (const std::string& name : names) {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0) break;
    std::array<char, 32> got{};
    socklen_t size = got.size() - 1;
    const auto length = static_cast<socklen_t>(name.size());
    if (::setsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, name.c_str(), length) == 0 &&
        ::getsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, got.data(), &size) == 0 && name == got.data())
      out.push_back(name);
    ::close(fd);
  }
  return out;
}

std::string road_refusal() {
  if (::geteuid() != 0) return "needs root: it makes devices in other network namespaces";
  const int fd = ::open("/dev/net/tun", O_RDWR | O_CLOEXEC);
  if (fd < 0) return failed("needs /dev/net/tun (modprobe tun)");
  ::close(fd);
  return {};
}

rt::Result<TunDevice> TunDevice::open(const std::string& ns, const std::string& name,
                                      const std::string& address, int prefix) {
  const Inside inside(ns);
  if (!inside.well()) {
    errno = inside.error();
    return rt::Error{failed("namespace '" + ns + "' (make it with: ip netns add " + ns + ")")};
  }
  TunDevice tun(::open("/dev/net/tun", O_RDWR | O_CLOEXEC | O_NONBLOCK));
  if (tun.fd() < 0) return rt::Error{failed("/dev/net/tun")};
  ifreq made = named(name);
  made.ifr_flags = IFF_TUN | IFF_NO_PI;
  if (::ioctl(tun.fd(), TUNSETIFF, &made) != 0)
    return rt::Error{failed("device '" + name + "' in namespace '" + ns + "'")};
  std::ofstream("/proc/sys/net/ipv6/conf/" + name + "/disable_ipv6") << "1\n";
  in_addr ip{}, mask{};
  mask.s_addr = htonl(~std::uint32_t{0} << (32U - static_cast<unsigned>(prefix)));
  const int control = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool up = control >= 0 && ::inet_pton(AF_INET, address.c_str(), &ip) == 1 &&
                  set_address(control, name, SIOCSIFADDR, ip) &&
                  set_address(control, name, SIOCSIFNETMASK, mask) && bring_up(control, name) &&
                  bring_up(control, "lo");
  const std::string why = failed("address " + address + " in namespace '" + ns + "'");
  if (control >= 0) ::close(control);
  if (!up) return rt::Error{why};
  return tun;
}

TunDevice::~TunDevice() {
  if (fd_ >= 0) ::close(fd_);
}

std::span<const std::uint8_t> TunDevice::read() {
  const ssize_t n = ::read(fd_, buffer_.data(), buffer_.size());
  if (n <= 0) return {};
  return std::span<const std::uint8_t>(buffer_).first(static_cast<std::size_t>(n));
}

bool TunDevice::write(std::span<const std::uint8_t> packet) {
  return ::write(fd_, packet.data(), packet.size()) == static_cast<ssize_t>(packet.size());
}

}  // namespace teletact
