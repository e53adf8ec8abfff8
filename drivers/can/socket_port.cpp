#include "drivers/can/socket_port.hpp"

#include <fcntl.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/net_tstamp.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <stdexcept>

#include "drivers/can/socket_frames.hpp"

namespace drivers::can {

namespace {

constexpr std::size_t kBatch = 32;  // frames a call
constexpr int kMostBatches = 4;     // calls a job: a flooded bus must not hold the job
constexpr std::size_t kControlBytes = 128;

[[noreturn]] void fail(const std::string& iface, const char* what, const std::string& todo) {
  throw std::runtime_error(iface + ": " + what + ": " + std::strerror(errno) + todo);
}

std::int64_t realtime_ns() noexcept {
  timespec t{};
  clock_gettime(CLOCK_REALTIME, &t);
  return t.tv_sec * 1'000'000'000LL + t.tv_nsec;
}

class SocketPort final : public CanPort {
 public:
  explicit SocketPort(const SocketOptions& o) {
    open(o);
    for (std::size_t i = 0; i < kBatch; ++i) {
      in_iov_[i] = {&in_frame_[i], sizeof in_frame_[i]};
      in_[i].msg_hdr.msg_iov = &in_iov_[i];
      in_[i].msg_hdr.msg_iovlen = 1;
      out_iov_[i] = {&out_frame_[i], sizeof(can_frame)};
      out_[i].msg_hdr.msg_iov = &out_iov_[i];
      out_[i].msg_hdr.msg_iovlen = 1;
    }
  }
  ~SocketPort() override {
    if (fd_ >= 0) close(fd_);
  }
  SocketPort(const SocketPort&) = delete;
  SocketPort& operator=(const SocketPort&) = delete;

  [[nodiscard]] int send(rt::Time, std::span<const CanFrame> frames) noexcept override {
    const std::size_t n = std::min(frames.size(), kBatch);
    for (std::size_t i = 0; i < n; ++i) out_frame_[i] = to_kernel(frames[i]);
    const int done =
        n == 0 ? 0 : sendmmsg(fd_, out_.data(), static_cast<unsigned>(n), MSG_DONTWAIT);
    const int taken = std::max(done, 0);
    // A call that took some of them does not say why it stopped: the next frame tells.
    if (done < 0) watch_.take_errno(errno);
    if (done >= 0 && static_cast<std::size_t>(done) < n) watch_.take_errno(ENOBUFS);
    if (n > 0 && static_cast<std::size_t>(taken) == n) watch_.take_room();
    watch_.counters.sent += static_cast<std::uint64_t>(taken);
    watch_.counters.refused += frames.size() - static_cast<std::size_t>(taken);
    return taken;
  }

  [[nodiscard]] int receive(rt::Time now, std::span<Received> out) noexcept override {
    int count = 0;
    for (int batch = 0; batch < kMostBatches; ++batch) {
      const std::size_t room = out.size() - static_cast<std::size_t>(count);
      const std::size_t want = std::min(room, kBatch);
      if (want == 0) break;
      for (std::size_t i = 0; i < want; ++i) {
        in_[i].msg_hdr.msg_control = control_[i].data();
        in_[i].msg_hdr.msg_controllen = kControlBytes;
      }
      const int n = recvmmsg(fd_, in_.data(), static_cast<unsigned>(want), MSG_DONTWAIT, nullptr);
      if (n < 0 && errno != EAGAIN) watch_.take_errno(errno);
      for (int i = 0; i < n; ++i)
        if (take(static_cast<std::size_t>(i), now, out[static_cast<std::size_t>(count)])) ++count;
      if (n < static_cast<int>(want)) break;
    }
    return count;
  }

  // One call a frame into the kernel's queue; any thread may make it.
  void send_at_once(std::span<const CanFrame> frames) noexcept override {
    for (const CanFrame& f : frames) {
      const can_frame k = to_kernel(f);
      (void)::send(fd_, &k, sizeof k, MSG_DONTWAIT);
    }
  }
  [[nodiscard]] PortState state() const noexcept override { return watch_.port; }
  [[nodiscard]] BusState bus_state() const noexcept override { return watch_.bus; }
  [[nodiscard]] const PortCounters& counters() const noexcept override { return watch_.counters; }

 private:
  void open(const SocketOptions& o) {
    fd_ = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (fd_ < 0)
      fail(o.iface, "no CAN socket",
           "; the kernel needs the modules can and can-raw (modprobe can-raw)");
    const unsigned index = if_nametoindex(o.iface.c_str());
    if (index == 0)
      fail(o.iface, "no such interface", "; `ip -details link show type can` shows them");
    refuse_if_down(o.iface);
    std::vector<::can_filter> filters;
    constexpr std::uint32_t kExact = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
    for (const std::uint32_t id : o.receive) filters.push_back({id & CAN_SFF_MASK, kExact});
    if (filters.empty()) filters.push_back({0, CAN_EFF_FLAG | CAN_RTR_FLAG});
    const can_err_mask_t errors = CAN_ERR_CRTL | CAN_ERR_ACK | CAN_ERR_BUSOFF | CAN_ERR_RESTARTED |
                                  CAN_ERR_PROT | 0x200U;  // CAN_ERR_CNT, newer than some headers
    set(SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(), filters.size() * sizeof filters[0], o.iface);
    set(SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors, o.iface);
    const int stamps = SOF_TIMESTAMPING_RX_SOFTWARE | SOF_TIMESTAMPING_SOFTWARE;
    set(SOL_SOCKET, SO_TIMESTAMPING, &stamps, sizeof stamps, o.iface);
    const int on = 1;
    set(SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on, o.iface);
    set(SOL_SOCKET, SO_RCVBUF, &o.receive_buffer_bytes, sizeof o.receive_buffer_bytes, o.iface);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = static_cast<int>(index);
    if (bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      fail(o.iface, "bind", "; is it a CAN interface, and up? (ip link set " + o.iface + " up)");
  }
  // A virtual one (vcan) has no bit rate to set.
  void refuse_if_down(const std::string& iface) const {
    ifreq request{};
    std::copy_n(iface.begin(), std::min(iface.size(), std::size_t{IFNAMSIZ - 1}),
                std::begin(request.ifr_name));
    if (ioctl(fd_, SIOCGIFFLAGS, &request) != 0 ||
        (static_cast<unsigned>(request.ifr_flags) & IFF_UP) != 0)
      return;
    throw std::runtime_error(
        iface + ": is down: sudo ip link set " + iface + " up" +
        (iface.starts_with("vcan") ? "" : " type can bitrate 1000000 restart-ms 0"));
  }
  void set(int level, int option, const void* value, std::size_t size, const std::string& iface) {
    if (setsockopt(fd_, level, option, value, static_cast<socklen_t>(size)) != 0)
      fail(iface, "socket option", "");
  }
  bool take(std::size_t i, rt::Time now, Received& out) noexcept {
    std::int64_t stamp = 0;
    std::uint32_t dropped = dropped_;
    const bool stamped = read_control(in_[i].msg_hdr, stamp, dropped);
    watch_.counters.dropped += dropped - dropped_;  // the kernel's count may wrap
    dropped_ = dropped;
    CanFrame f;
    switch (from_kernel(in_frame_[i], in_[i].msg_len, f)) {
      case FrameKind::kError:
        watch_.take_error(in_frame_[i].can_id & CAN_ERR_MASK,
                          std::span<const std::uint8_t, 8>(in_frame_[i].data));
        return false;
      case FrameKind::kOther:
        ++watch_.counters.not_classic;
        return false;
      case FrameKind::kData:
        break;
    }
    watch_.take_life();
    ++watch_.counters.received;
    const std::int64_t age = stamped ? std::max<std::int64_t>(realtime_ns() - stamp, 0) : 0;
    out = {f, now - rt::Nanos{age}};
    return true;
  }

  int fd_ = -1;
  BusWatch watch_;
  std::uint32_t dropped_ = 0;
  std::array<can_frame, kBatch> in_frame_{}, out_frame_{};
  std::array<iovec, kBatch> in_iov_{}, out_iov_{};
  std::array<mmsghdr, kBatch> in_{}, out_{};
  alignas(cmsghdr) std::array<std::array<char, kControlBytes>, kBatch> control_{};
};

}  // namespace

std::unique_ptr<CanPort> open_socket_port(rt::NonRealtime&, const SocketOptions& o) {
  return std::make_unique<SocketPort>(o);
}

}  // namespace drivers::can
