// When a box could hear anything of the other one: instants at which bytes of a TCP stream became
// whole at a port of a network namespace, taken from the packets there. Knows nothing of the box.
#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/if_packet.h>
#include <net/ethernet.h>
#include <netinet/ip.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <map>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "rt/clock/box_time.hpp"

namespace packets_test {

// One direction of a connection: the next byte that is wanted, and what came beyond it.
class Stream {
 public:
  void begin(std::uint32_t first) { next_ = first, beyond_.clear(); }
  // True: the stream goes on by something.
  bool add(std::uint32_t from, std::uint32_t size) {
    beyond_.emplace_back(from, from + size);
    const std::uint32_t before = next_;
    for (bool more = true; more;) {
      more = false;
      for (const auto& [a, b] : beyond_) {
        if (after(a, next_) || !after(b, next_)) continue;
        next_ = b;
        more = true;
      }
    }
    std::erase_if(beyond_, [&](const auto& part) { return !after(part.second, next_); });
    return next_ != before;
  }

 private:
  static bool after(std::uint32_t a, std::uint32_t b) {
    return static_cast<std::int32_t>(a - b) > 0;
  }
  std::uint32_t next_ = 0;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> beyond_;
};

class HeardStream {
 public:
  HeardStream(const std::string& ns, int port) : port_(static_cast<std::uint16_t>(port)) {
    std::thread([&] { open(ns); }).join();  // a thread of its own: it stays in that namespace
    if (fd_ >= 0) reader_ = std::thread([this] { read(); });
  }
  ~HeardStream() {
    (void)end();
    if (fd_ >= 0) ::close(fd_);
  }
  HeardStream(const HeardStream&) = delete;
  HeardStream& operator=(const HeardStream&) = delete;
  // Of the monotonic clock, in order. Empty: nothing, or packets were missed here.
  std::vector<std::int64_t> end() {
    ended_ = true;
    if (reader_.joinable()) reader_.join();
    tpacket_stats missed{};
    socklen_t size = sizeof missed;
    if (fd_ < 0 || ::getsockopt(fd_, SOL_PACKET, PACKET_STATISTICS, &missed, &size) != 0 ||
        missed.tp_drops > 0)
      heard_.clear();
    return heard_;
  }

 private:
  void open(const std::string& ns) {
    const int there = ::open(("/run/netns/" + ns).c_str(), O_RDONLY | O_CLOEXEC);
    if (there < 0) return;
    if (::setns(there, CLONE_NEWNET) == 0)
      fd_ = ::socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC, htons(ETH_P_IP));
    ::close(there);
    const int on = 1, room = 8 << 20;
    if (fd_ < 0) return;
    (void)::setsockopt(fd_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
    (void)::setsockopt(fd_, SOL_SOCKET, SO_RCVBUFFORCE, &room, sizeof room);
  }
  void read() {
    std::array<std::uint8_t, 2048> packet{};
    pollfd p{fd_, POLLIN, 0};
    while (!ended_) {
      if (::poll(&p, 1, 50) <= 0) continue;
      sockaddr_ll from{};
      iovec part{packet.data(), packet.size()};
      alignas(cmsghdr) std::array<char, 64> control{};
      msghdr m{};
      m.msg_name = &from, m.msg_namelen = sizeof from;
      m.msg_iov = &part, m.msg_iovlen = 1;
      m.msg_control = control.data(), m.msg_controllen = control.size();
      const ssize_t n = ::recvmsg(fd_, &m, MSG_DONTWAIT);
      if (n > 0 && from.sll_pkttype != PACKET_OUTGOING)
        take({packet.data(), static_cast<std::size_t>(n)}, instant(m));
    }
  }
  // When the kernel saw it. Its stamp is of the wall clock.
  static std::int64_t instant(msghdr& m) {
    const std::int64_t now = rt::monotonic_ns();
    timespec wall{};
    ::clock_gettime(CLOCK_REALTIME, &wall);
    for (cmsghdr* c = CMSG_FIRSTHDR(&m); c != nullptr; c = CMSG_NXTHDR(&m, c)) {
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_TIMESTAMPNS) continue;
      timespec seen{};
      std::memcpy(&seen, CMSG_DATA(c), sizeof seen);
      return now - (wall.tv_sec - seen.tv_sec) * 1'000'000'000 - (wall.tv_nsec - seen.tv_nsec);
    }
    return now;
  }
  void take(std::span<const std::uint8_t> packet, std::int64_t at) {
    iphdr ip{};
    tcphdr tcp{};
    if (packet.size() < sizeof ip) return;
    std::memcpy(&ip, packet.data(), sizeof ip);
    const std::size_t ip_bytes = std::size_t{4} * ip.ihl, whole = ntohs(ip.tot_len);
    if (ip.protocol != IPPROTO_TCP || whole > packet.size() || whole < ip_bytes + sizeof tcp)
      return;
    std::memcpy(&tcp, packet.data() + ip_bytes, sizeof tcp);
    const std::size_t heads = ip_bytes + std::size_t{4} * tcp.doff;
    if (ntohs(tcp.dest) != port_ || heads > whole) return;
    if (tcp.syn != 0) return streams_[tcp.source].begin(ntohl(tcp.seq) + 1);
    const auto size = static_cast<std::uint32_t>(whole - heads);
    if (size > 0 && streams_[tcp.source].add(ntohl(tcp.seq), size)) heard_.push_back(at);
  }

  const std::uint16_t port_;
  int fd_ = -1;
  std::atomic<bool> ended_{false};
  std::map<std::uint16_t, Stream> streams_;
  std::vector<std::int64_t> heard_;
  std::thread reader_;
};

}  // namespace packets_test
