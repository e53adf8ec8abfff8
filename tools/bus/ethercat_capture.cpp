// `teletact ethercat capture`: every EtherCAT frame of a network card for a time, as pcap.
#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <stdexcept>

#include "drivers/ethercat/card_claim.hpp"
#include "drivers/ethercat/frame.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/bus/ethercat_parts.hpp"

namespace teletact {

namespace ec = drivers::ethercat;

namespace {

// Hears and never speaks. All protocols: of one protocol alone a socket gets no copy of the frames
// that another program of this machine sends (packet(7)).
class ListenPort final : public ec::Port {
 public:
  explicit ListenPort(const std::string& interface)
      : socket_(::socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
    if (socket_ < 0) throw std::runtime_error("--iface " + interface + ": " + reason());
    sockaddr_ll address{};
    address.sll_family = AF_PACKET;
    address.sll_protocol = htons(0x0003);  // ETH_P_ALL
    address.sll_ifindex = static_cast<int>(if_nametoindex(interface.c_str()));
    const bool there = address.sll_ifindex != 0;
    if (const std::string down = ec::card_down(interface); there && !down.empty()) {
      ::close(socket_);
      throw std::runtime_error(down);
    }
    if (there && ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0)
      return;
    const std::string why = there ? reason() : "there is none of this name";
    ::close(socket_);
    throw std::runtime_error("--iface " + interface + ": " + why);
  }
  ~ListenPort() override { ::close(socket_); }
  ListenPort(const ListenPort&) = delete;
  ListenPort& operator=(const ListenPort&) = delete;

  [[nodiscard]] bool send(std::span<const std::uint8_t>) noexcept override { return false; }
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into,
                                    rt::Time deadline) noexcept override {
    for (;;) {
      const ssize_t n = ::recv(socket_, into.data(), into.size(), MSG_DONTWAIT);
      if (n > 0) {
        const auto size = static_cast<std::size_t>(n);
        if (size >= ec::kEthernetHead && into[12] == 0x88 && into[13] == 0xA4) return size;
        if (now() >= deadline) return 0;  // a card full of other traffic
        continue;
      }
      const std::int64_t left_ms = (rt::ns_of(deadline) - rt::ns_of(now()) + 999'999) / 1'000'000;
      if (left_ms <= 0) return 0;
      pollfd ready{socket_, POLLIN, 0};
      if (::poll(&ready, 1, static_cast<int>(left_ms)) <= 0) return 0;
      if ((ready.revents & POLLIN) == 0) return 0;  // the card went
    }
  }
  [[nodiscard]] rt::Time now() const noexcept override {
    return rt::time_from_ns(rt::monotonic_ns());
  }
  void sleep_until(rt::Time) noexcept override {}

 private:
  static std::string reason() {
    const int error = errno;
    const bool right = error == EPERM || error == EACCES;
    return right ? "raw Ethernet frames need CAP_NET_RAW" : std::strerror(error);
  }
  int socket_;
};

volatile std::sig_atomic_t stop_capture = 0;
void on_stop_capture(int) { stop_capture = 1; }

std::uint64_t listen_to(const EtherCatOptions& o, rt::Nanos most) {
  rt::Startup startup;
  ListenPort wire(o.bus.iface);
  auto file = ec::CapturePort::open(startup.token(), wire, o.bus.capture);
  if (!file) throw std::runtime_error("--out " + file.error());
  std::signal(SIGINT, on_stop_capture);
  std::signal(SIGTERM, on_stop_capture);
  ec::CapturePort& port = *file.value();
  std::array<std::uint8_t, 1600> bytes{};
  const rt::Time end = wire.now() + most;
  while (stop_capture == 0 && wire.now() < end)
    (void)port.receive(bytes, std::min(end, wire.now() + rt::Nanos{100'000'000}));
  if (!port.close()) throw std::runtime_error("--out: the file could not be written to its end");
  return port.frames();
}

// Nobody else is on the virtual chain: it is brought to OP and has its cycles.
std::uint64_t run_twin(const EtherCatOptions& o, rt::Nanos most) {
  EtherCatSession bus(o.bus);
  bring_to(bus, ec::AlState::kOp);
  const rt::Time end = bus.port().now() + most;
  while (bus.port().now() < end) {
    const rt::Time next = bus.port().now() + std::chrono::milliseconds{1};
    (void)bus.master().exchange();
    bus.port().sleep_until(next);
  }
  bus.finish();
  return bus.captured();
}

}  // namespace

int run_capture(const EtherCatOptions& o) {
  check_choice(o.bus);
  const auto most = std::chrono::duration_cast<rt::Nanos>(std::chrono::duration<double>(o.seconds));
  const std::uint64_t frames = o.bus.twin.empty() ? listen_to(o, most) : run_twin(o, most);
  std::printf("%llu frames in %s\n", static_cast<unsigned long long>(frames),
              o.bus.capture.c_str());
  write_json(o, "capture", {{"frames", frames}, {"seconds", o.seconds}, {"file", o.bus.capture}});
  return frames > 0 ? 0 : 1;
}

}  // namespace teletact
