#include "tools/console/console_server.hpp"

#include <pthread.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/post.hpp>
#include <csignal>
#include <thread>
#include <utility>

#include "rt/clock/box_time.hpp"
#include "tools/console/server_core.hpp"

namespace teletact {

namespace {

std::string problem_of(const ConsoleOptions& o, const boost::asio::ip::address& at, bool numeric) {
  if (!numeric) return "console address '" + o.address + "': a numeric address is wanted";
  if (o.port < 0 || o.port > 65535)
    return "console port = " + std::to_string(o.port) + ": allowed 0..65535";
  if (!at.is_loopback() && o.keys.empty())
    return "console address " + o.address +
           ": is not this machine alone, so keys are needed (teletact keys web)";
  if (o.most_viewers < 1 || o.most_viewers > 64 || o.most_connections < 2 * o.most_viewers)
    return "console: most_viewers: allowed 1..64, and twice as many connections";
  return {};
}

std::vector<std::string> names_of(const ConsoleOptions& o, const boost::asio::ip::address& at) {
  std::vector<std::string> names = o.names;
  if (!at.is_unspecified()) names.push_back(o.address);
  if (at.is_loopback() || at.is_unspecified())
    for (const char* n : {"127.0.0.1", "localhost", "::1"}) names.emplace_back(n);
  return names;
}

}  // namespace

class ConsoleServer::Impl {
 public:
  Impl(const ConsoleOptions& options, ConsoleCallbacks callbacks, PageFiles page)
      : core(options, std::move(callbacks), std::move(page)) {}
  ServerCore core;
  std::thread thread;
  std::string host;  // of the address that is printed
};

// All but the thread: what is wrong is said here.
rt::Result<std::unique_ptr<ConsoleServer::Impl>> ConsoleServer::prepare(
    const ConsoleOptions& options, ConsoleCallbacks callbacks) {
  boost::system::error_code failed;
  const auto at = boost::asio::ip::make_address(options.address, failed);
  if (const std::string bad = problem_of(options, at, !failed); !bad.empty()) return rt::Error{bad};
  auto page = PageFiles::open(options.page_folder);
  if (!page) return rt::Error{page.error()};
  auto impl = std::make_unique<Impl>(options, std::move(callbacks), std::move(page).value());
  ServerCore& core = impl->core;
  if (!options.keys.empty()) {
    auto trust = WebTrust::load(options.keys);
    if (!trust) return rt::Error{trust.error()};
    core.trust = std::move(trust).value();
    SSL_CTX* context = core.trust->make_context();
    if (context == nullptr) return rt::Error{options.keys + ": TLS takes none of it"};
    core.tls = std::make_unique<boost::asio::ssl::context>(context);
  }
  std::optional<PublicAddress> known;
  if (!options.public_url.empty()) {
    auto parsed = PublicAddress::parse(options.public_url);
    if (!parsed) return rt::Error{parsed.error()};
    known = std::move(parsed).value();
    if (!options.keys.empty() && !known->secure)
      return rt::Error{"console public address '" + options.public_url + "': with keys, https"};
  }
  if (const std::string bad = core.listen(at, names_of(options, at), known); !bad.empty())
    return rt::Error{bad};
  impl->host = !options.names.empty() ? options.names.front()
               : at.is_unspecified()  ? "localhost"
               : at.is_v6()           ? "[" + options.address + "]"
                                      : options.address;
  return impl;
}

std::string ConsoleServer::problem(const ConsoleOptions& options) {
  const auto prepared = prepare(options, {});
  return prepared ? std::string() : prepared.error();
}

rt::Result<std::unique_ptr<ConsoleServer>> ConsoleServer::start(const ConsoleOptions& options,
                                                                ConsoleCallbacks callbacks) {
  auto prepared = prepare(options, std::move(callbacks));
  if (!prepared) return rt::Error{prepared.error()};
  auto impl = std::move(prepared).value();
  ServerCore& core = impl->core;
  // Signals are for the threads that wait for them.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  impl->thread = std::thread([&core] { core.run(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  return std::unique_ptr<ConsoleServer>(new ConsoleServer(std::move(impl)));
}

ConsoleServer::ConsoleServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ConsoleServer::~ConsoleServer() { stop(); }

void ConsoleServer::stop() {
  if (!impl_->thread.joinable()) return;
  boost::asio::post(impl_->core.io, [this] { impl_->core.shut_down(); });
  impl_->thread.join();
  impl_->core.viewer_count = 0;
}

int ConsoleServer::port() const noexcept { return impl_->core.port; }

std::string ConsoleServer::address() const {
  if (const auto& known = impl_->core.names->known()) return known->origin + known->path;
  return (impl_->core.tls ? "https://" : "http://") + impl_->host + ":" + std::to_string(port()) +
         "/";
}

std::string ConsoleServer::url() {
  ServerCore& core = impl_->core;
  const ConsoleSecret code = core.fresh_secret();
  boost::asio::post(core.io,
                    [&core, code] { core.sessions.add_code(code, false, rt::monotonic_ns()); });
  return address() + "#code=" + secret_text(code);
}

int ConsoleServer::viewers() const noexcept { return impl_->core.viewer_count; }

std::vector<ConsolePerson> ConsoleServer::people() const {
  const std::lock_guard held(impl_->core.shared_mutex);
  return impl_->core.people;
}

bool ConsoleServer::publish(ViewKind kind, const ViewStamp& stamp,
                            std::span<const std::uint8_t> body) {
  ServerCore& core = impl_->core;
  const auto k = static_cast<std::size_t>(kind);
  if (viewers() == 0) return false;
  if (k >= kViewKinds || kind == ViewKind::kAnswer || body.size() > kMostViewBytes[k] ||
      kMostViewBytes[k] == 0) {
    ++core.tally.views_refused;
    return false;
  }
  std::unique_lock held(core.inbox.mutex);
  core.inbox.newest[k] = make_view(kind, core.inbox.sequence[k]++, stamp, body);
  core.wake(std::move(held));
  return true;
}

bool ConsoleServer::publish(ViewKind kind, const ViewStamp& stamp, std::string_view body) {
  return publish(kind, stamp,
                 std::span(reinterpret_cast<const std::uint8_t*>(body.data()), body.size()));
}

bool ConsoleServer::send_to(std::uint32_t session, ViewKind kind, const ViewStamp& stamp,
                            std::span<const std::uint8_t> body) {
  ServerCore& core = impl_->core;
  const auto k = static_cast<std::size_t>(kind);
  if (viewers() == 0) return false;
  std::unique_lock held(core.inbox.mutex);
  auto& directed = core.inbox.directed;
  const auto same = std::find_if(directed.begin(), directed.end(), [&](const auto& d) {
    return d.session == session && d.kind == kind;
  });
  const bool no_place = same == directed.end() && directed.size() >= ConsoleInbox::kMostDirected;
  if (k >= kViewKinds || kind == ViewKind::kAnswer || body.size() > kMostViewBytes[k] ||
      kMostViewBytes[k] == 0 || no_place) {
    ++core.tally.views_refused;
    return false;
  }
  ViewBytes view = make_view(kind, core.inbox.sequence[k]++, stamp, body);
  if (same == directed.end()) {
    directed.push_back({session, kind, std::move(view)});
  } else {
    same->view = std::move(view);
  }
  core.wake(std::move(held));
  return true;
}

void ConsoleServer::answer(std::uint32_t session, std::int64_t id, const ConsoleAnswer& answer) {
  ServerCore& core = impl_->core;
  ViewBytes view = core.answer_view(id, answer);
  std::unique_lock held(core.inbox.mutex);
  if (core.inbox.answers.size() >= ConsoleInbox::kMostAnswers) {
    ++core.tally.views_refused;
    return;
  }
  core.inbox.answers.push_back({session, ViewKind::kAnswer, std::move(view)});
  core.wake(std::move(held));
}

void ConsoleServer::set_clock(std::function<double()> now_s) {
  const std::lock_guard held(impl_->core.shared_mutex);
  impl_->core.clock_s = std::move(now_s);
}

bool ConsoleServer::wants_whole_mesh() const noexcept { return impl_->core.wants_mesh; }

bool ConsoleServer::publish_mesh(const perception::MeshDelta& delta, const ViewStamp& stamp,
                                 double block_edge_m) {
  ServerCore& core = impl_->core;
  if (viewers() == 0) return false;
  {
    const std::lock_guard held(core.mesh_mutex);
    if (!core.mesh.take(delta, stamp, block_edge_m)) {
      ++core.tally.views_refused;
      return false;
    }
    core.wants_mesh = false;
  }
  core.wake(std::unique_lock(core.inbox.mutex));
  return true;
}

ConsoleCounts ConsoleServer::counts() const {
  const ConsoleTally& t = impl_->core.tally;
  ConsoleCounts c;
  c.views_sent = t.views_sent;
  c.views_replaced = t.views_replaced;
  c.views_refused = t.views_refused;
  c.bytes_sent = t.bytes_sent;
  c.acts = t.acts;
  c.stops = t.stops;
  c.connections = t.connections;
  c.sessions = t.sessions;
  c.reconnects = t.reconnects;
  for (std::size_t i = 0; i < kRefusals; ++i) c.refused[i] = t.refused[i];
  c.cpu_ns = t.cpu_ns;
  const std::lock_guard held(impl_->core.mesh_mutex);
  c.mesh_blocks = impl_->core.mesh.blocks();
  c.mesh_bytes = impl_->core.mesh.bytes();
  return c;
}

}  // namespace teletact
