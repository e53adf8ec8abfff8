#include "tools/console/server_core.hpp"

#include <fcntl.h>
#include <openssl/rand.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <utility>

#include "rt/clock/box_time.hpp"
#include "tools/console/http_connection.hpp"
#include "tools/console/ws_viewer.hpp"

namespace teletact {

namespace {

constexpr auto kTick = std::chrono::milliseconds{250}, kAcceptPause = std::chrono::milliseconds{50},
               kLastWords = std::chrono::milliseconds{300};
constexpr int kListTicks = 4;

// A program that this one starts must not keep the port when this one has died. Asio of Boost 1.74
// opens and accepts without the flag.
void close_on_exec(int fd) noexcept { (void)::fcntl(fd, F_SETFD, FD_CLOEXEC); }

}  // namespace

ServerCore::ServerCore(const ConsoleOptions& o, ConsoleCallbacks c, PageFiles p)
    : options(o),
      callbacks(std::move(c)),
      sessions({o.code_life, o.session_life, o.absence_limit, o.asked_limit}),
      page(std::move(p)) {}

std::string ServerCore::listen(const boost::asio::ip::address& address,
                               const std::vector<std::string>& good_names,
                               const std::optional<PublicAddress>& known) {
  const boost::asio::ip::tcp::endpoint end(address, static_cast<std::uint16_t>(options.port));
  const std::string place = "console " + options.address + ":" + std::to_string(options.port);
  boost::system::error_code failed;
  acceptor_.open(end.protocol(), failed);
  if (!failed) close_on_exec(acceptor_.native_handle());
  if (!failed) acceptor_.set_option(boost::asio::socket_base::reuse_address(true), failed);
  if (!failed) acceptor_.bind(end, failed);
  if (!failed) acceptor_.listen(boost::asio::socket_base::max_listen_connections, failed);
  if (failed) return place + ": " + failed.message();
  port = acceptor_.local_endpoint(failed).port();
  names = std::make_unique<WebNames>(good_names, port, tls != nullptr, known);
  // Cookies do not know ports: two servers of one host must not take each other's, nor two tunnels
  // that end at one host and come from the same port of two.
  cookie_name = "teletact_" + std::to_string(port);
  const std::size_t colon = known ? known->host.rfind(':') : std::string::npos;
  if (colon != std::string::npos && known->host.back() != ']')
    cookie_name += "_" + known->host.substr(colon + 1);
  return {};
}

void ServerCore::run() {
  if (callbacks.on_thread) callbacks.on_thread();
  accept();
  tick();
  for (;;) {
    try {
      io.run();
      return;
    } catch (const std::exception&) {
      // Of one connection, whose handler is gone with it: the others go on.
      tally.refuse(Refusal::kRequest);
    }
  }
}

void ServerCore::shut_down() {
  ending_ = true;
  boost::system::error_code ignored;
  acceptor_.close(ignored);
  tick_timer_.cancel();
  accept_timer_.cancel();
  for (const auto& c : std::vector(connections_.begin(), connections_.end())) c->cut();
  for (const auto& v : std::vector(viewers_)) v->close(kCloseGoing, "the box ends");
  if (viewers_.empty()) return io.stop();
  tick_timer_.expires_after(kLastWords);
  tick_timer_.async_wait([this](boost::system::error_code) {
    for (const auto& v : std::vector(viewers_)) v->cut();
    io.stop();
  });
}

void ServerCore::accept() {
  acceptor_.async_accept(
      [this](boost::system::error_code failed, boost::asio::ip::tcp::socket socket) {
        if (ending_ || failed == boost::asio::error::operation_aborted) return;
        if (!failed) {
          admit(std::move(socket));
          return accept();
        }
        // No file handle is left, or the other has gone: not in a tight loop.
        accept_timer_.expires_after(kAcceptPause);
        accept_timer_.async_wait([this](boost::system::error_code stopped) {
          if (!stopped) accept();
        });
      });
}

void ServerCore::admit(boost::asio::ip::tcp::socket socket) {
  close_on_exec(socket.native_handle());
  ++tally.connections;
  if (connections_.size() + viewers_.size() >= options.most_connections) {
    tally.refuse(Refusal::kCrowded);
    if (connections_.empty()) return;
    const auto oldest = connections_.front();
    oldest->cut();
  }
  connections_.push_back(std::make_shared<HttpConnection>(*this, std::move(socket)));
  connections_.back()->run();
}

void ServerCore::connection_down(const HttpConnection& connection) {
  connections_.remove_if([&](const auto& c) { return c.get() == &connection; });
}

void ServerCore::tick() {
  const std::int64_t now = rt::monotonic_ns();
  for (const auto& v : std::vector(viewers_)) v->look(now);
  tally.cpu_ns = rt::thread_cpu_ns();
  if (++ticks_ % kListTicks == 0) look_at_list();
  tick_timer_.expires_after(kTick);
  tick_timer_.async_wait([this](boost::system::error_code stopped) {
    if (!stopped && !ending_) tick();
  });
}

void ServerCore::look_at_list() {
  if (!trust || !trust->refresh()) return;
  if (SSL_CTX* made = trust->make_context())
    tls = std::make_unique<boost::asio::ssl::context>(made);
  for (const auto& c : std::vector(connections_.begin(), connections_.end()))
    if (trust->revoked(c->peer().serial)) c->cut();
  for (const auto& v : std::vector(viewers_)) {
    if (!trust->revoked(v->peer.serial)) continue;
    tally.refuse(Refusal::kCertificate);
    sessions.drop(v->session, rt::monotonic_ns());
    v->close(kCloseReplaced, "this browser's certificate is revoked");
  }
  tell_roles();
}

// A reload takes the place of the connection that it replaces.
bool ServerCore::viewer_place(std::uint32_t session) const noexcept {
  const auto others = std::count_if(viewers_.begin(), viewers_.end(),
                                    [&](const auto& v) { return v->session != session; });
  return static_cast<std::size_t>(others) < options.most_viewers &&
         viewers_.size() < 2 * options.most_viewers;
}

void ServerCore::viewer_up(const std::shared_ptr<WsViewer>& viewer) {
  for (const auto& v : std::vector(viewers_)) {
    if (v->session != viewer->session) continue;
    ++tally.reconnects;
    v->close(kCloseReplaced, "opened again elsewhere");
  }
  if (viewers_.empty()) reset_mesh();
  viewers_.push_back(viewer);
  viewer_count = static_cast<int>(viewers_.size());
  sessions.connected(viewer->session, rt::monotonic_ns());
  tell_roles();
}

void ServerCore::close_viewers_of(std::uint32_t session) {
  for (const auto& v : std::vector(viewers_))
    if (v->session == session) v->close(kCloseReplaced, "another session took its place");
}

void ServerCore::viewer_down(const WsViewer& viewer) {
  std::erase_if(viewers_, [&](const auto& v) { return v.get() == &viewer; });
  viewer_count = static_cast<int>(viewers_.size());
  const bool elsewhere = std::any_of(viewers_.begin(), viewers_.end(),
                                     [&](const auto& v) { return v->session == viewer.session; });
  if (!elsewhere) sessions.disconnected(viewer.session, rt::monotonic_ns());
  if (viewers_.empty()) reset_mesh();
  tell_roles();
}

// With nobody there nothing is made, so what is here would have holes for the next one.
void ServerCore::reset_mesh() {
  const std::lock_guard held(mesh_mutex);
  mesh.clear();
  wants_mesh = true;
}

ConsoleSecret ServerCore::fresh_secret() const {
  ConsoleSecret secret{};
  // Without random numbers there is nothing to be safe with.
  if (RAND_bytes(secret.data(), static_cast<int>(secret.size())) != 1) std::abort();
  return secret;
}

void ServerCore::tell_roles() {
  const auto events = sessions.take_events();
  {
    const std::lock_guard held(shared_mutex);
    people = sessions.people();
  }
  if (!callbacks.on_role) return;
  for (const RoleEvent& e : events) callbacks.on_role(e);
}

void ServerCore::stop_asked(std::uint32_t session) {
  ++tally.stops;
  if (callbacks.on_stop) callbacks.on_stop(sessions.person(session));
}

void ServerCore::wake(std::unique_lock<std::mutex> held) {
  if (std::exchange(inbox.posted, true)) return;
  held.unlock();
  boost::asio::post(io, [this] { drain_inbox(); });
}

void ServerCore::drain_inbox() {
  std::array<ViewBytes, kViewKinds> newest;
  std::vector<ConsoleInbox::Directed> directed;
  std::deque<ConsoleInbox::Directed> answers;
  {
    const std::lock_guard held(inbox.mutex);
    inbox.posted = false;
    newest.swap(inbox.newest);
    directed.swap(inbox.directed);
    answers.swap(inbox.answers);
  }
  for (const auto& v : std::vector(viewers_)) {
    for (std::size_t k = 0; k < kViewKinds; ++k)
      if (newest[k] && v->mailbox.put(static_cast<ViewKind>(k), newest[k])) ++tally.views_replaced;
    for (const auto& d : directed)
      if (d.session == v->session && v->mailbox.put(d.kind, d.view)) ++tally.views_replaced;
    for (const auto& a : answers) {
      if (a.session != v->session || v->mailbox.put_answer(a.view)) continue;
      tally.refuse(Refusal::kSlow);
      v->close(kClosePolicy, "answers are not read");
      break;
    }
    v->pump();
  }
}

}  // namespace teletact
