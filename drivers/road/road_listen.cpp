// Who listens: strangers before the door, the two connections of a session, refusals.
#include <openssl/rand.h>

#include <algorithm>

#include "drivers/road/road_impl.hpp"
#include "drivers/road/road_socket.hpp"
#include "rt/clock/box_time.hpp"

namespace drivers {

namespace asio = boost::asio;

std::string Road::Impl::listen() {
  Code code;
  const auto address = asio::ip::make_address(options.address, code);
  const std::string where =
      "road: listen on " + options.address + ":" + std::to_string(options.port) + ": ";
  if (code) return where + "not an IPv4 or IPv6 address";
  const Tcp::endpoint endpoint(address, static_cast<std::uint16_t>(options.port));
  acceptor_.open(endpoint.protocol(), code);
  if (!code) acceptor_.set_option(Tcp::acceptor::reuse_address(true), code);
  if (!code) acceptor_.bind(endpoint, code);
  if (!code) acceptor_.listen(static_cast<int>(kMostArrivals), code);
  if (!code) port = acceptor_.local_endpoint(code).port();
  return code ? where + code.message() : std::string{};
}

void Road::Impl::accept_one() {
  if (accepting_ || !acceptor_.is_open() || !arrival_rate_.may_begin(rt::monotonic_ns())) return;
  accepting_ = true;
  acceptor_.async_accept([this](const Code& code, Tcp::socket socket) {
    accepting_ = false;
    if (!code) arrived(std::move(socket));
    if (code != asio::error::operation_aborted) accept_one();
  });
}

void Road::Impl::arrived(Tcp::socket socket) {
  if (!context_) return;
  Code code;
  const auto from = socket.remote_endpoint(code);
  if (code) return;
  set_up_road_socket(socket.native_handle(), false, 0);
  auto c = std::make_shared<RoadConnection>(std::move(socket), *context_, *trust, *this,
                                            from.address().to_string());
  arrivals_.push_back({c, rt::monotonic_ns() + options.handshake_limit.count()});
  if (arrivals_.size() > kMostArrivals) {
    std::vector<std::string> addresses;
    for (const Arrival& a : arrivals_) addresses.push_back(a.connection->address());
    const auto drop =
        std::next(arrivals_.begin(), static_cast<std::ptrdiff_t>(arrival_to_drop(addresses)));
    ++counts.crowded;
    drop->connection->close();
    arrivals_.erase(drop);
  }
  if (!c->gone()) c->shake_hands(false);
}

Road::Impl::Shared Road::Impl::take_arrival(RoadConnection& c) {
  const auto at = std::find_if(arrivals_.begin(), arrivals_.end(),
                               [&](const Arrival& a) { return a.connection.get() == &c; });
  if (at == arrivals_.end()) return nullptr;
  Shared shared = at->connection;
  arrivals_.erase(at);
  return shared;
}

// With words that the other side can read; only who has shown a good certificate gets here.
void Road::Impl::refuse(RoadConnection& c, const std::string& why) {
  ++counts.refused;
  last_refusal = c.address() + ": '" + c.peer().name + "': " + why;
  append_refusal(why, c.out());
  c.close_gently();
  leave_slowly(take_arrival(c));
}

bool Road::Impl::greeted(RoadConnection& c, const RoadGreet& greet) {
  const std::int64_t now = rt::monotonic_ns();
  const bool for_bulk = greet.connection == RoadConnectionKind::kBulk;
  RoadToken fresh{};
  if (RAND_bytes(fresh.data(), static_cast<int>(fresh.size())) != 1) return false;
  const std::string why = for_bulk ? door_.ask_bulk(c.peer(), now, greet.token)
                                   : door_.ask_control(c.peer(), now, fresh);
  if (!why.empty()) {
    refuse(c, why);
    return true;
  }
  append_road_frame(RoadKind::kWelcome, for_bulk ? RoadToken{} : fresh, c.out());
  c.send();
  (for_bulk ? bulk : control) = take_arrival(c);
  if (for_bulk) session_up();
  return true;
}

void Road::Impl::drop_late_arrivals(std::int64_t now_ns) {
  for (auto a = arrivals_.begin(); a != arrivals_.end();) {
    if (a->until_ns >= now_ns && !a->connection->gone()) {
      ++a;
      continue;
    }
    ++counts.refused;
    last_refusal = a->connection->address() + ": the handshake took too long";
    a->connection->close();
    a = arrivals_.erase(a);
  }
  for (auto a = leaving_.begin(); a != leaving_.end();) {
    if (a->until_ns >= now_ns && !a->connection->gone()) {
      ++a;
      continue;
    }
    a->connection->close();
    a = leaving_.erase(a);
  }
}

}  // namespace drivers
