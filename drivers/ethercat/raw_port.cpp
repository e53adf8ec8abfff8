#include "drivers/ethercat/raw_port.hpp"

#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "drivers/ethercat/card_claim.hpp"
#include "drivers/ethercat/frame.hpp"
#include "rt/clock/box_time.hpp"

namespace drivers::ethercat {

namespace {

timespec timespec_of(std::int64_t ns) noexcept {
  timespec t{};
  t.tv_sec = ns / 1'000'000'000;
  t.tv_nsec = ns % 1'000'000'000;
  return t;
}

}  // namespace

rt::Result<std::unique_ptr<RawPort>> RawPort::open(rt::NonRealtime&, const std::string& interface) {
  const unsigned index = if_nametoindex(interface.c_str());
  if (index == 0) return rt::Error{card_problem(interface, ENODEV)};
  const int fd = ::socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, htons(kEtherType));
  if (fd < 0) return rt::Error{card_problem(interface, errno)};
  std::unique_ptr<RawPort> port(new RawPort(fd, interface));
  sockaddr_ll address{};
  address.sll_family = AF_PACKET;
  address.sll_protocol = htons(kEtherType);
  address.sll_ifindex = static_cast<int>(index);
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    return rt::Error{card_problem(interface, errno)};
  if (const std::string down = card_down(interface); !down.empty()) return rt::Error{down};
  return port;
}

RawPort::RawPort(int socket, const std::string& interface) noexcept : socket_(socket) {
  static_assert(sizeof interface_ == IFNAMSIZ);
  std::copy_n(interface.begin(), std::min(interface.size(), interface_.size() - 1),
              interface_.begin());
}

RawPort::~RawPort() { ::close(socket_); }

bool RawPort::send(std::span<const std::uint8_t> frame) noexcept {
  const ssize_t sent = ::send(socket_, frame.data(), frame.size(), MSG_DONTWAIT);
  const bool taken = sent == static_cast<ssize_t>(frame.size());
  // Down, or gone: any other refusal is of this frame alone (ENOBUFS, EAGAIN).
  gone_ = !taken && sent < 0 && (errno == ENETDOWN || errno == ENXIO || errno == ENODEV);
  return taken;
}

std::size_t RawPort::receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept {
  for (;;) {
    sockaddr_ll from{};
    socklen_t length = sizeof from;
    const ssize_t got = ::recvfrom(socket_, into.data(), into.size(), MSG_DONTWAIT,
                                   reinterpret_cast<sockaddr*>(&from), &length);
    if (got > 0 && from.sll_pkttype != PACKET_OUTGOING) return static_cast<std::size_t>(got);
    if (got >= 0) continue;
    // ENETDOWN: the link went; the deadline is waited for all the same, so a cycle keeps its
    // length.
    const std::int64_t left = rt::ns_of(deadline) - rt::monotonic_ns();
    if (left <= 0) return 0;
    pollfd ready{socket_, POLLIN, 0};
    const timespec wait = timespec_of(left);
    const int event = ::ppoll(&ready, 1, &wait, nullptr);
    if (event == 0) return 0;
    if (event > 0 && (ready.revents & POLLIN) == 0) {
      // Nothing to read, only the error of a link that is down: take it off the socket.
      int error = 0;
      socklen_t size = sizeof error;
      (void)::getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error, &size);
    }
  }
}

bool RawPort::link_up() noexcept {
  if (gone_) return false;
  if (interface_[0] == '\0') return true;
  ifreq request{};
  std::copy(interface_.begin(), interface_.end(), std::begin(request.ifr_name));
  if (::ioctl(socket_, SIOCGIFFLAGS, &request) != 0) {
    // Renamed: for a name that is not there a kernel may look for a module, and waits for that.
    interface_[0] = '\0';
    return true;
  }
  const auto flags = static_cast<unsigned>(request.ifr_flags);
  return (flags & IFF_UP) != 0 && (flags & IFF_RUNNING) != 0;
}

rt::Time RawPort::now() const noexcept { return rt::time_from_ns(rt::monotonic_ns()); }

void RawPort::sleep_until(rt::Time until) noexcept {
  const timespec at = timespec_of(rt::ns_of(until));
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) == EINTR) {
  }
}

}  // namespace drivers::ethercat
