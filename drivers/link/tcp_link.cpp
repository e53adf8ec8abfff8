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
    return rt::Error{"link.address = " + address +
                     ": this link has no keys, so only loopback (127.0.0.0/8) is allowed"};
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

rt::Result<std::unique_ptr<TcpLink>> TcpLink::listen_lasting(const std::string& address, int port) {
  auto link = listen(address, port);
  if (link) link.value()->lasting_ = true;
  return link;
}

rt::Result<std::unique_ptr<TcpLink>> TcpLink::dial_lasting(const std::string& address, int port) {
  auto a = loopback(address, port);
  if (!a) return rt::Error{a.error()};
  std::unique_ptr<TcpLink> link(new TcpLink);
  link->lasting_ = true;
  link->dial_address_ = a.value().sin_addr.s_addr;
  link->port_ = port;
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
  if (network_) {
    rt::effect_built(rt::Effect::kLinkNetwork);
    const Way way = endpoint.box() == rt::Box::kOperator ? Way::kToRobot : Way::kToOperator;
    road_.emplace(*network_, way, network_epoch_ns_);
  }
  inbox_.resize(2 * (kHeaderSize + kMaxBody));
  thread_ = std::thread([this] { run(); });
}

bool TcpLink::emulate(const NetworkConfig& network, std::int64_t epoch_host_ns) {
  if (network.any()) network_ = network;
  network_epoch_ns_ = epoch_host_ns;
  return true;
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
  const std::lock_guard lock(fault_mutex_);
  fault_ = std::move(why);
  state_.store(State::kFault);
}

// Of a lasting link why the last session was refused, until the next one is ready.
std::string TcpLink::fault() const {
  if (!lasting_ && state_.load() != State::kFault) return {};
  const std::lock_guard lock(fault_mutex_);
  return fault_;
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

// One attempt, until it is answered, refused, or a second has passed.
bool TcpLink::dial_one() {
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_port = htons(static_cast<std::uint16_t>(port_));
  a.sin_addr.s_addr = dial_address_;
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return false;
  int error = ::connect(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a) == 0 ? 0 : errno;
  for (int i = 0; error == EINPROGRESS && i < 100 && !stop_.load(); ++i) {
    pollfd p{fd, POLLOUT, 0};
    if (::poll(&p, 1, 10) == 0) continue;
    socklen_t size = sizeof error;
    ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
  }
  if (error != 0) {
    ::close(fd);
    return false;
  }
  fd_ = fd;
  set_up(fd_);
  return true;
}

void TcpLink::turn_away() noexcept {
  const int fd = ::accept4(listen_fd_, nullptr, nullptr, SOCK_CLOEXEC);
  if (fd < 0) return;
  ::close(fd);
  turned_away_.fetch_add(1);
}

void TcpLink::pause(rt::Nanos wait) const {
  const std::int64_t until = rt::monotonic_ns() + wait.count();
  while (!stop_.load() && rt::monotonic_ns() < until) ::usleep(1000);
}

void TcpLink::enqueue(std::span<const std::uint8_t> message) {
  const std::int64_t now = rt::monotonic_ns();
  if (road_) {
    rt::effect_ran(rt::Effect::kLinkNetwork);
    return road_->send(message, now);
  }
  if (shaper_) rt::effect_ran(rt::Effect::kLinkShape);
  const std::int64_t due = shaper_ ? shaper_->deliver_at(now, message.size()) : now;
  queue_.push_back({due, {message.begin(), message.end()}, 0});
}

// The other end of the cable is this end of the socket. False: the connection is gone.
bool TcpLink::write_road(std::int64_t now_ns) {
  if (road_->ended(now_ns)) return false;
  const auto bytes = road_->arrived(now_ns);
  if (bytes.empty()) return true;
  const ssize_t n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
  road_->take(static_cast<std::size_t>(n));
  return true;
}

// False: the connection is gone.
bool TcpLink::write_due(std::int64_t now_ns) {
  if (road_) return write_road(now_ns);
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

// False: asked to stop before there was a connection.
bool TcpLink::open_session() {
  while (!stop_.load()) {
    if (fd_ >= 0) break;  // connected before the thread began
    const bool down = road_ && !road_->passable(rt::monotonic_ns());
    if (cut_.load() || down) {
      ::usleep(1000);
    } else if (listen_fd_ >= 0) {
      if (accept_one()) break;
      ::usleep(1000);
    } else {
      if (dial_one()) break;
      pause(back_off_.next());
    }
  }
  opened_ns_ = heard_ns_ = rt::monotonic_ns();
  heard_ = endpoint_->last_heard();
  return fd_ >= 0;
}

// Of a lasting link: this session comes to nothing, or no longer carries anything.
bool TcpLink::session_is_dead(std::int64_t now_ns) {
  const LinkEndpoint& e = *endpoint_;
  if (e.last_heard() != heard_) {
    heard_ = e.last_heard();
    heard_ns_ = now_ns;
  }
  if (e.bye_received()) return true;
  const bool mute = now_ns - heard_ns_ > kDeadAfter.count();
  const bool slow = !e.ready() && now_ns - opened_ns_ > kHandshakeWithin.count();
  if (!mute && !slow) return false;
  fail(mute ? "link: nothing was heard for 2 s" : "link: the handshake took more than 5 s");
  return true;
}

void TcpLink::publish(const LinkEndpoint& e) {
  if (e.ready() && state_.load() == State::kHandshake) {
    sessions_.fetch_add(1);
    back_off_.succeeded();
    const std::lock_guard lock(fault_mutex_);
    fault_.clear();
    state_.store(State::kReady);
  }
  if (e.ever_heard()) last_heard_.store(rt::ns_of(e.last_heard()));
  round_trip_.store(e.round_trip().count());
  if (e.clock().valid()) uncertainty_.store(e.clock().uncertainty(now_()).count());
  cpu_.store(rt::thread_cpu_ns());
}

void TcpLink::run_session() {
  LinkEndpoint& e = *endpoint_;
  const auto send = [this](std::span<const std::uint8_t> m) { enqueue(m); };
  state_.store(State::kHandshake);
  while (!stop_.load()) {
    if (lasting_) {
      if (listen_fd_ >= 0) turn_away();
      if (session_is_dead(rt::monotonic_ns())) return;
    }
    if (cut_.load()) {
      drain_unread();
      ::usleep(1000);
      continue;
    }
    // Bytes that are due and still here are backlog: then nothing large is added to it.
    const bool backlog = !queue_.empty() && queue_.front().due <= rt::monotonic_ns();
    const std::int64_t now = rt::monotonic_ns();
    const bool line_free =
        road_ ? road_->line_free(now) : !backlog && (!shaper_ || !shaper_->busy(now));
    e.poll(now_(), line_free, send,
           road_                 ? road_->busy_for(now)
           : backlog || !shaper_ ? rt::Nanos::max()
                                 : shaper_->busy_for(now));
    if (!write_due(rt::monotonic_ns()) || !read_all(e)) return;
    publish(e);
    if (after_poll_) after_poll_();
    pollfd p{fd_, POLLIN, 0};
    ::poll(&p, 1, 1);
  }
}

void TcpLink::end_session() {
  const auto send = [this](std::span<const std::uint8_t> m) { enqueue(m); };
  const bool refused = state_.load() == State::kFault;
  if (fd_ >= 0 && !cut_.load() && (stop_.load() || refused)) {
    // A refused side still gets the Hello that waits here: it must be able to name both schemas
    // too.
    if (!refused) endpoint_->send_bye(now_(), send);
    const auto waits = [this] { return road_ ? !road_->empty() : !queue_.empty(); };
    for (int i = 0; i < 200 && waits() && write_due(rt::monotonic_ns()); ++i) {
      ::usleep(1000);
    }
  }
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
  if (state_.load() != State::kFault) state_.store(State::kClosed);
  if (after_poll_) after_poll_();
}

void TcpLink::run() {
  for (;;) {
    if (open_session()) run_session();
    end_session();
    if (!lasting_ || stop_.load()) return;
    // A dialler that is closed at once must not dial at once; a listener only waits for the next.
    if (listen_fd_ < 0) pause(back_off_.next());
    queue_.clear();
    if (road_) road_->renew(rt::monotonic_ns());
    inbox_size_ = 0;
    endpoint_->renew();
    state_.store(State::kConnecting);
  }
}

}  // namespace drivers
