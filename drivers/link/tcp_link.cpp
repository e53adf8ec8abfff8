#include "drivers/link/tcp_link.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "rt/clock/box_time.hpp"
#include "rt/effect_count.hpp"

namespace drivers {

namespace {

rt::Result<sockaddr_in> loopback(const std::string& address, int port) {
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_port = htons(static_cast<std::uint16_t>(port));
  if (inet_pton(AF_INET, address.c_str(), &a.sin_addr) != 1) {
    return rt::Error{"link.address = " + address + ": not an IPv4 address"};
  }
  if ((ntohl(a.sin_addr.s_addr) >> 24U) != 127U) {
    return rt::Error{
        "link.address = " + address +
        ": the link is not authenticated yet, so only loopback (127.0.0.0/8) is allowed"};
  }
  if (port < 0 || port > 65535)
    return rt::Error{"link.port = " + std::to_string(port) + ": allowed 0..65535"};
  return a;
}

void set_up(int fd) {
  const int one = 1;
  ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
  // Little waits in the kernel: what is not yet sent can still be replaced by something newer.
  const int low = 16384;
  ::setsockopt(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &low, sizeof low);
  ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) | O_NONBLOCK);
}

std::string errno_text(const std::string& what) { return what + ": " + std::strerror(errno); }

}  // namespace

rt::Result<std::unique_ptr<TcpLink>> TcpLink::listen(const std::string& address, int port) {
  auto a = loopback(address, port);
  if (!a) return rt::Error{a.error()};
  std::unique_ptr<TcpLink> link(new TcpLink);
  link->listen_fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int one = 1;
  ::setsockopt(link->listen_fd_, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
  const auto* sa = reinterpret_cast<const sockaddr*>(&a.value());
  if (link->listen_fd_ < 0 || ::bind(link->listen_fd_, sa, sizeof(sockaddr_in)) != 0 ||
      ::listen(link->listen_fd_, 1) != 0) {
    return rt::Error{errno_text("link: listen on " + address + ":" + std::to_string(port))};
  }
  sockaddr_in bound{};
  socklen_t size = sizeof bound;
  ::getsockname(link->listen_fd_, reinterpret_cast<sockaddr*>(&bound), &size);
  link->port_ = ntohs(bound.sin_port);
  return link;
}

rt::Result<std::unique_ptr<TcpLink>> TcpLink::connect(const std::string& address, int port,
                                                      rt::Nanos timeout) {
  auto a = loopback(address, port);
  if (!a) return rt::Error{a.error()};
  std::unique_ptr<TcpLink> link(new TcpLink);
  const std::int64_t give_up = rt::monotonic_ns() + timeout.count();
  for (;;) {
    link->fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (link->fd_ < 0) return rt::Error{errno_text("link: socket")};
    if (::connect(link->fd_, reinterpret_cast<const sockaddr*>(&a.value()), sizeof(sockaddr_in)) ==
        0)
      break;
    const std::string why = errno_text("link: connect to " + address + ":" + std::to_string(port));
    ::close(link->fd_);
    link->fd_ = -1;
    if (rt::monotonic_ns() > give_up) return rt::Error{why};
    ::usleep(20000);
  }
  link->port_ = port;
  set_up(link->fd_);
  return link;
}

TcpLink::~TcpLink() { stop(); }

void TcpLink::start(LinkEndpoint& endpoint, std::function<rt::Time()> now,
                    const std::optional<LinkShapeConfig>& shape, std::function<void()> after_poll) {
  endpoint_ = &endpoint;
  now_ = std::move(now);
  after_poll_ = std::move(after_poll);
  if (shape && shape->any()) {
    rt::effect_built(rt::Effect::kLinkShape);
    shaper_.emplace(*shape, listen_fd_ >= 0 ? 1 : 0);
  }
  inbox_.resize(2 * (kHeaderSize + kMaxBody));
  thread_ = std::thread([this] { run(); });
}

void TcpLink::stop() {
  stop_.store(true);
  if (thread_.joinable()) thread_.join();
  for (int* fd : {&fd_, &listen_fd_}) {
    if (*fd >= 0) ::close(*fd);
    *fd = -1;
  }
}

void TcpLink::fail(std::string why) {
  fault_ = std::move(why);
  state_.store(State::kFault);
}

std::string TcpLink::fault() const {
  return state_.load() == State::kFault ? fault_ : std::string{};
}

LinkEndpoint::Stats TcpLink::stats() const {
  return endpoint_ != nullptr ? endpoint_->stats() : LinkEndpoint::Stats{};
}

bool TcpLink::accept_one() {
  fd_ = ::accept4(listen_fd_, nullptr, nullptr, SOCK_CLOEXEC);
  if (fd_ < 0) return false;
  set_up(fd_);
  return true;
}

void TcpLink::enqueue(std::span<const std::uint8_t> message) {
  const std::int64_t now = rt::monotonic_ns();
  if (shaper_) rt::effect_ran(rt::Effect::kLinkShape);
  const std::int64_t due = shaper_ ? shaper_->deliver_at(now, message.size()) : now;
  queue_.push_back({due, {message.begin(), message.end()}, 0});
}

// False: the connection is gone.
bool TcpLink::write_due(std::int64_t now_ns) {
  while (!queue_.empty() && queue_.front().due <= now_ns) {
    Chunk& c = queue_.front();
    const ssize_t n = ::send(fd_, c.bytes.data() + c.sent, c.bytes.size() - c.sent, MSG_NOSIGNAL);
    if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
    c.sent += static_cast<std::size_t>(n);
    if (c.sent < c.bytes.size()) return true;
    queue_.pop_front();
  }
  return true;
}

bool TcpLink::read_all(LinkEndpoint& e) {
  for (;;) {
    const ssize_t n = ::recv(fd_, inbox_.data() + inbox_size_, inbox_.size() - inbox_size_, 0);
    if (n == 0) return false;
    if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
    inbox_size_ += static_cast<std::size_t>(n);
    std::size_t at = 0;
    for (;;) {
      const auto rest = std::span<const std::uint8_t>(inbox_).subspan(at, inbox_size_ - at);
      Header h;
      const WireStatus status = read_header(rest, h);
      if (status == WireStatus::kIncomplete) break;
      if (status != WireStatus::kOk) {
        fail(std::string("link: ") + to_text(status));
        return false;
      }
      if (rest.size() < kHeaderSize + h.length) break;
      if (!e.receive(rest.first(kHeaderSize + h.length), now_(),
                     [this](std::span<const std::uint8_t> m) { enqueue(m); })) {
        fail(e.fault());
        return false;
      }
      at += kHeaderSize + h.length;
    }
    std::memmove(inbox_.data(), inbox_.data() + at, inbox_size_ - at);
    inbox_size_ -= at;
  }
}

// What arrives over a cut cable is lost; left unread it would pile up at the sender.
void TcpLink::drain_unread() {
  while (fd_ >= 0 && ::recv(fd_, inbox_.data(), inbox_.size(), 0) > 0) {
  }
}

void TcpLink::run() {
  LinkEndpoint& e = *endpoint_;
  const auto send = [this](std::span<const std::uint8_t> m) { enqueue(m); };
  while (!stop_.load()) {
    if (cut_.load()) {
      drain_unread();
      ::usleep(1000);
      continue;
    }
    if (fd_ < 0 && !accept_one()) {
      ::usleep(1000);
      continue;
    }
    if (state_.load() == State::kConnecting) state_.store(State::kHandshake);
    // Bytes that are due and still here are backlog: then nothing large is added to it.
    const bool backlog = !queue_.empty() && queue_.front().due <= rt::monotonic_ns();
    const bool line_free = !backlog && (!shaper_ || !shaper_->busy(rt::monotonic_ns()));
    e.poll(now_(), line_free, send,
           backlog || !shaper_ ? rt::Nanos::max() : shaper_->busy_for(rt::monotonic_ns()));
    if (!write_due(rt::monotonic_ns()) || !read_all(e)) break;
    if (e.ready() && state_.load() == State::kHandshake) state_.store(State::kReady);
    if (e.ever_heard()) last_heard_.store(rt::ns_of(e.last_heard()));
    round_trip_.store(e.round_trip().count());
    if (e.clock().valid()) uncertainty_.store(e.clock().uncertainty(now_()).count());
    cpu_.store(rt::thread_cpu_ns());
    if (after_poll_) after_poll_();
    pollfd p{fd_, POLLIN, 0};
    ::poll(&p, 1, 1);
  }
  const bool refused = state_.load() == State::kFault;
  if (fd_ >= 0 && !cut_.load() && (stop_.load() || refused)) {
    // A refused side still gets the Hello that waits here: it must be able to name both schemas too.
    if (!refused) e.send_bye(now_(), send);
    for (int i = 0; i < 200 && !queue_.empty() && write_due(rt::monotonic_ns()); ++i) {
      ::usleep(1000);
    }
  }
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
  if (state_.load() != State::kFault) state_.store(State::kClosed);
  if (after_poll_) after_poll_();
}

}  // namespace drivers
