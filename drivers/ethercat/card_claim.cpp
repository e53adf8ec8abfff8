#include "drivers/ethercat/card_claim.hpp"

#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "drivers/ethercat/frame.hpp"
#include "rt/clock/box_time.hpp"

namespace drivers::ethercat {

namespace {

constexpr std::string_view kPrefix = "teletact/ethercat/";

// Abstract: the first byte of the path is zero. -1: errno says why, EADDRINUSE that it is taken.
int bind_abstract(const std::string& name) {
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return -1;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::size_t n = std::min(name.size(), sizeof address.sun_path - 1);
  std::copy_n(name.begin(), n, address.sun_path + 1);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + n);
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&address), size) == 0) return fd;
  const int error = errno;
  ::close(fd);
  errno = error;
  return -1;
}

std::string key_of_index(unsigned index) {
  return std::string(kPrefix) + "index/" + std::to_string(index);
}
std::string key_of_name(const std::string& interface) {
  return std::string(kPrefix) + "name/" + interface;
}
// Of each key: who has it, as one more name, which /proc/net/unix shows to everybody.
std::string owner_key(unsigned index, int pid) {
  return key_of_index(index) + "/pid/" + std::to_string(pid);
}

std::string name_of_process(int pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/cmdline", std::ios::binary);
  const std::string words((std::istreambuf_iterator<char>(file)), {});
  const std::string name = program_name(words);
  return name.empty() ? "a program" : name;
}

// The rest of the first abstract name that begins so; nullopt: there is none.
std::optional<std::string> abstract_name(const std::string& beginning) {
  std::ifstream file("/proc/net/unix");
  const std::string wanted = " @" + beginning;
  for (std::string line; std::getline(file, line);) {
    const std::size_t at = line.find(wanted);
    if (at != std::string::npos) return line.substr(at + wanted.size());
  }
  return std::nullopt;
}

CardOwner owner_of(unsigned index) {
  CardOwner out{0, "a program"};
  const auto pid = abstract_name(owner_key(index, 0).substr(0, owner_key(index, 0).size() - 1));
  if (!pid || pid->empty() || pid->size() > 9 ||
      !std::all_of(pid->begin(), pid->end(), [](char c) { return c >= '0' && c <= '9'; }))
    return out;
  out.pid = std::stoi(*pid);
  out.name = name_of_process(out.pid);
  return out;
}

rt::Error owned(const std::string& interface, const CardOwner& by) {
  return rt::Error{"interface " + interface + ": " + by.text() +
                   " owns it, and two masters on one cable stop each other's slaves. End that one "
                   "first (ethercat capture, ethercat state and ethercat read --register go beside "
                   "it)"};
}

// Of every protocol: of one alone a socket gets no copy of the frames that this machine sends.
class Listener {
 public:
  Listener(const std::string& interface, unsigned index)
      : fd_(::socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
    sockaddr_ll address{};
    address.sll_family = AF_PACKET;
    address.sll_protocol = htons(0x0003);  // ETH_P_ALL
    address.sll_ifindex = static_cast<int>(index);
    if (fd_ < 0 || ::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      problem_ = card_problem(interface, errno);
  }
  ~Listener() {
    if (fd_ >= 0) ::close(fd_);
  }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;
  [[nodiscard]] const std::string& problem() const noexcept { return problem_; }
  // A frame of EtherCAT within this time? Returns with the first one.
  [[nodiscard]] bool hears(rt::Nanos time) noexcept {
    const std::int64_t end = rt::monotonic_ns() + time.count();
    std::array<std::uint8_t, kMaxFrame> bytes{};
    for (;;) {
      const ssize_t n = ::recv(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT);
      if (n >= static_cast<ssize_t>(kEthernetHead) && bytes[12] == kEtherType >> 8U &&
          bytes[13] == (kEtherType & 0xFFU))
        return true;
      const std::int64_t left_ms = (end - rt::monotonic_ns() + 999'999) / 1'000'000;
      if (left_ms <= 0) return false;
      if (n > 0) continue;
      pollfd ready{fd_, POLLIN, 0};
      if (::poll(&ready, 1, static_cast<int>(left_ms)) == 0) return false;
      if ((ready.revents & POLLIN) == 0) return false;  // the card went: nobody is heard on it
    }
  }
  // What has come so far is no answer to the next question.
  void forget() noexcept {
    std::array<std::uint8_t, kMaxFrame> bytes{};
    while (::recv(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT) > 0) {
    }
  }

 private:
  int fd_;
  std::string problem_;
};

}  // namespace

std::string card_problem(const std::string& interface, int error) {
  const std::string what = "interface " + interface + ": ";
  if (error == EPERM || error == EACCES)
    return what +
           "raw Ethernet frames need CAP_NET_RAW (setcap cap_net_raw+ep on the program, or run "
           "it with that capability)";
  if (error == ENODEV) return what + "there is none of this name";
  return what + std::strerror(error);
}

std::string card_down(const std::string& interface) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return {};
  ifreq request{};
  std::copy_n(interface.begin(), std::min(interface.size(), std::size_t{IFNAMSIZ - 1}),
              std::begin(request.ifr_name));
  const bool asked = ::ioctl(fd, SIOCGIFFLAGS, &request) == 0;
  ::close(fd);
  if (!asked || (static_cast<unsigned>(request.ifr_flags) & IFF_UP) != 0) return {};
  return "interface " + interface + ": is down: sudo ip link set " + interface + " up";
}

std::string CardOwner::text() const {
  return pid == 0 ? name : name + " (pid " + std::to_string(pid) + ")";
}

std::string program_name(std::string_view words) {
  const auto next = [&] {
    const std::size_t end = std::min(words.find('\0'), words.size());
    const std::string_view word = words.substr(0, end);
    words.remove_prefix(std::min(end + 1, words.size()));
    return word;
  };
  // A terminal takes it as it is: nothing but what can be printed.
  const auto printed = [](std::string_view word) {
    std::string out;
    for (const char c : word.substr(0, 40)) out += c >= ' ' && c <= '~' ? c : '?';
    return out;
  };
  std::string_view program = next();
  program.remove_prefix(program.rfind('/') == std::string_view::npos ? 0 : program.rfind('/') + 1);
  if (program.empty()) return {};
  const std::string_view word = next();
  return printed(program) +
         (word.empty() || word.front() == '-' ? std::string() : " " + printed(word));
}

rt::Result<std::unique_ptr<CardClaim>> CardClaim::take(rt::NonRealtime&,
                                                       const std::string& interface) {
  const unsigned index = if_nametoindex(interface.c_str());
  if (index == 0) return rt::Error{card_problem(interface, ENODEV)};
  std::unique_ptr<CardClaim> claim(new CardClaim);
  const std::array<std::string, 3> keys{key_of_index(index), key_of_name(interface),
                                        owner_key(index, static_cast<int>(::getpid()))};
  for (std::size_t i = 0; i < keys.size(); ++i) {
    claim->sockets_[i] = bind_abstract(keys[i]);
    if (claim->sockets_[i] >= 0) continue;
    if (errno == EADDRINUSE) return owned(interface, owner_of(index));
    return rt::Error{card_problem(interface, errno)};
  }
  return claim;
}

CardClaim::~CardClaim() {
  for (const int fd : sockets_)
    if (fd >= 0) ::close(fd);
}

std::optional<CardOwner> card_owner(rt::NonRealtime&, const std::string& interface) {
  const unsigned index = if_nametoindex(interface.c_str());
  if (index == 0) return std::nullopt;
  for (const std::string& key : {key_of_index(index), key_of_name(interface)}) {
    const int fd = bind_abstract(key);
    const bool taken = fd < 0 && errno == EADDRINUSE;
    if (fd >= 0) ::close(fd);
    if (taken) return owner_of(index);
  }
  return std::nullopt;
}

rt::Result<bool> hears_a_master(rt::NonRealtime&, const std::string& interface, rt::Nanos time) {
  const unsigned index = if_nametoindex(interface.c_str());
  if (index == 0) return rt::Error{card_problem(interface, ENODEV)};
  Listener listener(interface, index);
  if (!listener.problem().empty()) return rt::Error{listener.problem()};
  if (!listener.hears(time)) return false;
  // The whole of a look of another program: it is short.
  const std::int64_t end = rt::monotonic_ns() + time.count();
  while (rt::monotonic_ns() < end) {
    pollfd none{-1, 0, 0};
    (void)::poll(&none, 1, static_cast<int>((end - rt::monotonic_ns()) / 1'000'000 + 1));
  }
  listener.forget();
  return listener.hears(time);
}

rt::Result<std::unique_ptr<CardClaim>> claim_silent_card(rt::NonRealtime& nrt,
                                                         const std::string& interface) {
  auto claim = CardClaim::take(nrt, interface);
  if (!claim) return claim;
  const auto heard = hears_a_master(nrt, interface);
  if (!heard) return rt::Error{heard.error()};
  if (heard.value())
    return rt::Error{"interface " + interface +
                     ": EtherCAT frames of another master pass on it: another program of this "
                     "machine, or another computer on the cable. End that one first"};
  return claim;
}

}  // namespace drivers::ethercat
