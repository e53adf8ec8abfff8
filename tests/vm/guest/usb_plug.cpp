#include "tests/vm/guest/usb_plug.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "tests/vm/guest/say.hpp"

namespace vm {

namespace {

constexpr int kPriority = 90;
constexpr const char* kAttach = "/sys/devices/platform/vhci_hcd.0/attach";
constexpr int kFullSpeed = 2;
constexpr std::uint32_t kSubmit = 1, kUnlink = 2, kRetSubmit = 3, kRetUnlink = 4;
constexpr std::uint8_t kOutEndpoint = 0x02, kInEndpoint = 0x81;
constexpr std::size_t kPacket = 64;

bool read_all(int fd, void* into, std::size_t size) {
  auto* at = static_cast<std::uint8_t*>(into);
  while (size > 0) {
    const ssize_t n = ::recv(fd, at, size, 0);
    if (n <= 0) return false;
    at += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace

// 48 bytes, each word with its most significant byte first; what is behind `endpoint` depends on
// the command: of a submit flags, length, three words of isochronous transfers and the setup
// packet.
struct UsbPlug::Header {
  std::uint32_t command, seq, device, direction, endpoint;
  std::uint32_t word[5];
  std::uint8_t setup[8];
  [[nodiscard]] bool in() const noexcept { return ntohl(direction) == 1; }
  [[nodiscard]] std::size_t length() const noexcept { return ntohl(word[1]); }
};

bool UsbPlug::push() {
  static_assert(sizeof(Header) == 48);
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return false;
  const std::string line = std::to_string(port_) + " " + std::to_string(ends[1]) + " " +
                           std::to_string(0x10002 + port_) + " " + std::to_string(kFullSpeed);
  const int fd = ::open(kAttach, O_WRONLY | O_CLOEXEC);
  const bool taken = fd >= 0 && ::write(fd, line.data(), line.size()) > 0;
  if (!taken) std::perror(kAttach);
  if (fd >= 0) ::close(fd);
  ::close(ends[1]);
  socket_ = ends[0];
  if (!taken) {
    ::close(socket_);
    socket_ = -1;
    return false;
  }
  ends_ = false;
  waiting_.clear();
  thread_ = std::thread([this] { serve(); });
  return true;
}

void UsbPlug::pull() {
  if (!thread_.joinable()) return;
  ends_ = true;
  thread_.join();
  ::shutdown(socket_, SHUT_RDWR);
  ::close(socket_);
  socket_ = -1;
}

void UsbPlug::serve() {
  become_real_time(kPriority);
  while (!ends_.load()) {
    pollfd ready{socket_, POLLIN, 0};
    (void)::poll(&ready, 1, 1);
    if ((ready.revents & (POLLIN | POLLHUP)) != 0 && !take()) return;
    answer_in();
  }
}

bool UsbPlug::take() {
  Header h;
  if (!read_all(socket_, &h, sizeof h)) return false;
  ++transfers_;
  if (ntohl(h.command) == kUnlink) {
    unlink(h);
    return true;
  }
  if (ntohl(h.command) != kSubmit) return false;
  std::vector<std::uint8_t> data(h.in() ? 0 : h.length());
  if (!data.empty() && !read_all(socket_, data.data(), data.size())) return false;
  if (ntohl(h.endpoint) == 0) {
    control(h, data);
  } else if (h.in()) {
    waiting_.push_back({h.seq, h.length()});
  } else {
    function_.out(data);
    answer(h, 0, {}, data.size());
  }
  return true;
}

void UsbPlug::unlink(const Header& h) {
  const auto found = std::find_if(waiting_.begin(), waiting_.end(),
                                  [&](const Waiting& w) { return w.seq == h.word[0]; });
  Header out{};
  out.command = htonl(kRetUnlink);
  out.seq = h.seq;
  out.word[0] = found != waiting_.end() ? htonl(static_cast<std::uint32_t>(-ECONNRESET)) : 0;
  if (found != waiting_.end()) waiting_.erase(found);
  (void)!::send(socket_, &out, sizeof out, MSG_NOSIGNAL);
}

void UsbPlug::answer(const Header& h, std::int32_t status, std::span<const std::uint8_t> data,
                     std::size_t taken) {
  std::vector<std::uint8_t> bytes(sizeof(Header) + data.size());
  Header out{};
  out.command = htonl(kRetSubmit);
  out.seq = h.seq;
  out.word[0] = htonl(static_cast<std::uint32_t>(status));
  out.word[1] = htonl(static_cast<std::uint32_t>(data.empty() ? taken : data.size()));
  out.word[3] = htonl(0xFFFFFFFFU);  // not isochronous
  std::memcpy(bytes.data(), &out, sizeof out);
  std::copy(data.begin(), data.end(), bytes.begin() + sizeof out);
  (void)!::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
}

void UsbPlug::answer_in() {
  std::array<std::uint8_t, kPacket> packet{};
  while (!waiting_.empty()) {
    const Waiting first = waiting_.front();
    const std::size_t n = function_.in(std::span(packet).first(std::min(first.room, kPacket)));
    if (n == 0) return;
    waiting_.pop_front();
    Header h{};
    h.seq = first.seq;
    answer(h, 0, std::span(packet).first(n));
  }
}

// Of the standard requests those that a host makes of such a device; no text.
void UsbPlug::control(const Header& h, std::span<const std::uint8_t>) {
  constexpr std::uint8_t kVendor = 0x40, kGetDescriptor = 6, kGetStatus = 0, kSetConfiguration = 9,
                         kSetInterface = 11;
  const auto value = static_cast<std::uint16_t>(h.setup[2] | h.setup[3] << 8U);
  std::vector<std::uint8_t> data;
  bool good = true;
  if ((h.setup[0] & 0x60U) == kVendor) {
    good = function_.vendor(h.setup[1], value);
  } else if (h.setup[1] == kGetDescriptor) {
    data = descriptor(value);
    good = !data.empty();
  } else if (h.setup[1] == kGetStatus) {
    data = {0, 0};
  } else {
    good = h.setup[1] == kSetConfiguration || h.setup[1] == kSetInterface;
  }
  if (data.size() > h.length()) data.resize(h.length());
  answer(h, good ? 0 : -EPIPE, data);
}

std::vector<std::uint8_t> UsbPlug::descriptor(std::uint16_t which) const {
  const auto low = [](unsigned x) { return static_cast<std::uint8_t>(x & 0xFFU); };
  const auto high = [](unsigned x) { return static_cast<std::uint8_t>(x >> 8U); };
  if (which == 0x0100)  // USB 2.0, class by interface, one configuration
    return {18,
            1,
            0,
            2,
            0,
            0,
            0,
            kPacket,
            low(id_.vendor),
            high(id_.vendor),
            low(id_.product),
            high(id_.product),
            0,
            6,
            0,
            0,
            0,
            1};
  if (which == 0x0200)
    return {9,    2,       32,
            0,    1,       1,
            0,    0x80,    45,  // one interface, 90 mA
            9,    4,       0,
            0,    2,       0xFF,
            0xFF, 0xFF,    0,  // two endpoints, the vendor's class
            7,    5,       kInEndpoint,
            2,    kPacket, 0,
            0,  // bulk
            7,    5,       kOutEndpoint,
            2,    kPacket, 0,
            0};
  return {};
}

}  // namespace vm
