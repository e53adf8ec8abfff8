#include "drivers/road/road_socket.hpp"

// The kernel's own header: that of the C library lacks the newer fields of tcp_info.
#include <linux/sockios.h>
#include <linux/tcp.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <array>

namespace drivers {

namespace {

constexpr int kUnsentControl = 4096, kUnsentBulk = 16384;
constexpr unsigned kUserTimeout_ms = 20000;
constexpr char kBbr[] = "bbr";
constexpr int kOpen = 0;  // TCP_CA_Open: nothing is lost, and nothing out of order

template <class T>
void set_option(int fd, int level, int name, const T& value) noexcept {
  (void)::setsockopt(fd, level, name, &value, sizeof value);
}

}  // namespace

void set_up_road_socket(int fd, bool bulk, std::size_t pacing_rate) noexcept {
  set_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  set_option(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, bulk ? kUnsentBulk : kUnsentControl);
  set_option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, kUserTimeout_ms);
  (void)::setsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, kBbr, sizeof kBbr - 1);
  // Few packets are under way: after a loss of many, try again at an even pace.
  if (!bulk) set_option(fd, IPPROTO_TCP, TCP_THIN_LINEAR_TIMEOUTS, 1);
  if (bulk && pacing_rate > 0) {
    set_option(fd, SOL_SOCKET, SO_MAX_PACING_RATE, static_cast<unsigned>(pacing_rate));
  }
}

void begin_congestion_anew(int fd) noexcept {
  tcp_info info{};
  socklen_t size = sizeof info;
  if (::getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return;
  if (info.tcpi_ca_state != kOpen || congestion_of(fd) != kBbr) return;
  // The same name again would be left as it is.
  static constexpr char kOther[] = "reno";
  if (::setsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, kOther, sizeof kOther - 1) == 0)
    (void)::setsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, kBbr, sizeof kBbr - 1);
}

std::string congestion_of(int fd) {
  std::array<char, 32> name{};
  socklen_t size = name.size() - 1;
  if (::getsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, name.data(), &size) != 0) return "?";
  return name.data();
}

RoadSocketState state_of(int fd) noexcept {
  tcp_info info{};
  socklen_t size = sizeof info;
  if (::getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return {};
  RoadSocketState s;
  s.round_trip = std::chrono::microseconds{info.tcpi_rtt};
  s.least_round_trip = std::chrono::microseconds{info.tcpi_min_rtt};
  s.delivered_bytes_per_s = static_cast<double>(info.tcpi_delivery_rate);
  return s;
}

std::size_t in_flight_of(int fd) noexcept {
  int bytes = 0;
  return ::ioctl(fd, SIOCOUTQ, &bytes) == 0 && bytes > 0 ? static_cast<std::size_t>(bytes) : 0;
}

}  // namespace drivers
