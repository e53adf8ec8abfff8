#include "tests/vm/guest/wire_tap.hpp"

#include <arpa/inet.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "drivers/ethercat/frame.hpp"
#include "drivers/youbot_bus/process_data.hpp"

namespace vm {

namespace {

constexpr std::size_t kMostFrames = 200'000;

std::int64_t clock_ns(clockid_t clock) {
  timespec t{};
  ::clock_gettime(clock, &t);
  return t.tv_sec * 1'000'000'000LL + t.tv_nsec;
}

// Nobody sets the guest's clock, so what the wall clock is ahead stays as it is.
std::int64_t wall_ahead() {
  const std::int64_t before = clock_ns(CLOCK_MONOTONIC);
  const std::int64_t wall = clock_ns(CLOCK_REALTIME);
  return wall - (before + clock_ns(CLOCK_MONOTONIC)) / 2;
}

}  // namespace

WireTap::WireTap(const std::string& iface, const drivers::ethercat::ProcessMapping& mapping)
    : wall_ahead_ns_(wall_ahead()) {
  for (std::size_t s = 1; s <= 4; ++s) wheel_at_.push_back(mapping.slaves.at(s).output_at);
  frames_.resize(kMostFrames);
  // What leaves is shown to sockets of all protocols alone.
  socket_ = ::socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, htons(ETH_P_ALL));
  sockaddr_ll address{};
  address.sll_family = AF_PACKET;
  address.sll_protocol = htons(ETH_P_ALL);
  address.sll_ifindex = static_cast<int>(::if_nametoindex(iface.c_str()));
  const int on = 1, bytes = 8 << 20;
  if (socket_ < 0 || ::bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
      ::setsockopt(socket_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on) != 0 ||
      ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes) != 0) {
    std::perror("tap");
    std::exit(2);
  }
  thread_ = std::thread([this] { listen(); });
}

WireTap::~WireTap() {
  ends_ = true;
  thread_.join();
  ::close(socket_);
}

std::size_t WireTap::first_from(std::int64_t at_ns) const noexcept {
  std::size_t i = count();
  while (i > 0 && frames_[i - 1].at_ns >= at_ns) --i;
  return i;
}

bool WireTap::off_now() const noexcept {
  const std::size_t n = count();
  return n == 0 || frames_[n - 1].off;
}

void WireTap::listen() {
  std::array<std::uint8_t, 2048> bytes{};
  alignas(cmsghdr) std::array<char, 128> control{};
  while (!ends_.load()) {
    pollfd ready{socket_, POLLIN, 0};
    if (::poll(&ready, 1, 5) <= 0) continue;
    for (;;) {
      sockaddr_ll from{};
      iovec part{bytes.data(), bytes.size()};
      msghdr head{};
      head.msg_name = &from;
      head.msg_namelen = sizeof from;
      head.msg_iov = &part;
      head.msg_iovlen = 1;
      head.msg_control = control.data();
      head.msg_controllen = control.size();
      const ssize_t got = ::recvmsg(socket_, &head, 0);
      if (got <= 0) break;
      if (from.sll_pkttype != PACKET_OUTGOING) continue;
      std::int64_t at = 0;
      for (cmsghdr* c = CMSG_FIRSTHDR(&head); c != nullptr; c = CMSG_NXTHDR(&head, c)) {
        timespec t{};
        if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS) continue;
        std::memcpy(&t, CMSG_DATA(c), sizeof t);
        at = t.tv_sec * 1'000'000'000LL + t.tv_nsec;
      }
      if (at == 0) ++unstamped_;
      take(bytes.data(), static_cast<std::size_t>(got), at - wall_ahead_ns_);
    }
  }
}

void WireTap::take(const std::uint8_t* bytes, std::size_t size, std::int64_t at_ns) {
  using drivers::ethercat::Command;
  drivers::ethercat::FrameView view;
  drivers::ethercat::parse_frame({bytes, size}, view);
  if (!view.good()) return;
  for (std::size_t d = 0; d < view.count; ++d) {
    const auto& datagram = view.datagram[d];
    if (datagram.command != Command::kLwr && datagram.command != Command::kLrw) continue;
    WireFrame f{at_ns, true, true};
    for (const std::size_t at : wheel_at_) {
      if (at < datagram.address) return;
      const std::size_t from = at - datagram.address;
      if (from + drivers::youbot_bus::kOutputBytes > datagram.data.size()) return;
      const auto wheel = datagram.data.subspan(from, drivers::youbot_bus::kOutputBytes);
      const auto zero = [](std::uint8_t b) { return b == 0; };
      f.off = f.off && std::all_of(wheel.begin(), wheel.end(), zero);
      f.still = f.still && std::all_of(wheel.begin(), wheel.begin() + 4, zero);
    }
    if (count() == frames_.size()) return;
    frames_[count()] = f;
    ++count_;
  }
}

}  // namespace vm
