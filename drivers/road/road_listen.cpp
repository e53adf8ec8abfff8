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
  if (!code) acceptor_.listen(Doorstep::kBacklog, code);
  if (!code) port = acceptor_.local_endpoint(code).port();
  return code ? where + code.message() : std::string{};
}

void Road::Impl::accept_one() {
  if (doorstep_.accepting || !acceptor_.is_open() ||
      !doorstep_.accept_rate.may_begin(rt::monotonic_ns()))
    return;
  doorstep_.accepting = true;
  acceptor_.async_accept([this](const Code& code, Tcp::socket socket) {
    doorstep_.accepting = false;
    if (!code) arrived(std::move(socket));
    if (code != asio::error::operation_aborted) accept_one();
  });
}

void Road::Impl::arrived(Tcp::socket socket) {
  Code code;
  const auto from = socket.remote_endpoint(code);
  if (code) return;
  const std::string address = from.address().to_string();
  doorstep_.waiting.push_back({std::move(socket), address, place_of(address),
                               rt::monotonic_ns() + options.handshake_limit.count()});
  drop_waiting();
}

std::vector<std::string> Road::Impl::waiting_places() const {
  std::vector<std::string> places;
  for (const Waiting& w : doorstep_.waiting) places.push_back(w.place);
  return places;
}

// Too many of one place: its oldest goes, for who dials in earnest has given that one up first.
void Road::Impl::drop_waiting() {
  const std::vector<std::string> places = waiting_places();
  const std::string& newest = places.back();
  const auto of_one = std::count(places.begin(), places.end(), newest);
  std::size_t drop = doorstep_.waiting.size();
  if (of_one > static_cast<std::ptrdiff_t>(kMostWaitingOfOne))
    drop =
        static_cast<std::size_t>(std::find(places.begin(), places.end(), newest) - places.begin());
  else if (doorstep_.waiting.size() > kMostWaiting)
    drop = doorstep_.turns.to_drop(places);
  if (drop == doorstep_.waiting.size()) return;
  const auto at = std::next(doorstep_.waiting.begin(), static_cast<std::ptrdiff_t>(drop));
  ++counts.crowded;
  last_refusal = at->address + ": too many connections wait before the door";
  doorstep_.waiting.erase(at);
}

void Road::Impl::give_turns(std::int64_t now_ns) {
  std::erase_if(doorstep_.waiting, [&](const Waiting& w) { return w.until_ns < now_ns; });
  while (!doorstep_.waiting.empty() && context_) {
    const auto turn = doorstep_.turns.next(waiting_places(), now_ns);
    if (!turn) return;
    const auto at = std::next(doorstep_.waiting.begin(), static_cast<std::ptrdiff_t>(*turn));
    Waiting stranger = std::move(*at);
    doorstep_.waiting.erase(at);
    begin(std::move(stranger));
  }
}

void Road::Impl::begin(Waiting stranger) {
  set_up_road_socket(stranger.socket.native_handle(), false, 0);
  auto c = std::make_shared<RoadConnection>(std::move(stranger.socket), *context_, *trust, *this,
                                            stranger.address);
  doorstep_.arrivals.push_back({c, rt::monotonic_ns() + options.handshake_limit.count()});
  make_room();
  if (!c->gone()) c->shake_hands(false);
}

void Road::Impl::make_room() {
  if (doorstep_.arrivals.size() <= kMostArrivals) return;
  std::vector<std::string> places;
  for (const Arrival& a : doorstep_.arrivals) places.push_back(place_of(a.connection->address()));
  const auto drop = std::next(doorstep_.arrivals.begin(),
                              static_cast<std::ptrdiff_t>(doorstep_.turns.to_drop(places)));
  ++counts.crowded;
  last_refusal = drop->connection->address() + ": too many handshakes at once";
  drop->connection->close();
  doorstep_.arrivals.erase(drop);
}

Road::Impl::Shared Road::Impl::take_arrival(RoadConnection& c) {
  const auto at = std::find_if(doorstep_.arrivals.begin(), doorstep_.arrivals.end(),
                               [&](const Arrival& a) { return a.connection.get() == &c; });
  if (at == doorstep_.arrivals.end()) return nullptr;
  Shared shared = at->connection;
  doorstep_.arrivals.erase(at);
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
  // The handshake may be older than the list.
  if (trust->revoked(c.peer().serial)) {
    refuse(c, "its certificate " + c.peer().serial + " is revoked");
    return true;
  }
  const std::string why = for_bulk ? door_.ask_bulk(c.peer(), now, greet.token)
                                   : door_.ask_control(c.peer(), now, fresh);
  if (!for_bulk && door_.displaced()) {
    ++counts.refused;
    last_refusal = "'" + (control ? control->peer().name : std::string()) +
                   "': the second connection did not come";
    if (control) control->close_gently();
    leave_slowly(std::move(control));
    control.reset();
  }
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

// Whose handshake is done, or nearly, and who has not greeted.
void Road::Impl::drop_revoked_arrivals() {
  std::erase_if(doorstep_.arrivals, [&](const Arrival& a) {
    const RoadPeer& peer = a.connection->peer();
    if (!trust->revoked(peer.serial)) return false;
    ++counts.refused;
    last_refusal = a.connection->address() + ": '" + peer.name + "': its certificate " +
                   peer.serial + " is revoked";
    a.connection->close();
    return true;
  });
}

void Road::Impl::drop_late_arrivals(std::int64_t now_ns) {
  for (auto a = doorstep_.arrivals.begin(); a != doorstep_.arrivals.end();) {
    if (a->until_ns >= now_ns && !a->connection->gone()) {
      ++a;
      continue;
    }
    ++counts.refused;
    last_refusal = a->connection->address() + ": the handshake took too long";
    a->connection->close();
    a = doorstep_.arrivals.erase(a);
  }
  for (auto a = doorstep_.leaving.begin(); a != doorstep_.leaving.end();) {
    if (a->until_ns >= now_ns && !a->connection->gone()) {
      ++a;
      continue;
    }
    a->connection->close();
    a = doorstep_.leaving.erase(a);
  }
}

}  // namespace drivers
