#include "drivers/road/road.hpp"

#include <algorithm>

#include "drivers/road/road_impl.hpp"
#include "drivers/road/road_socket.hpp"
#include "rt/clock/box_time.hpp"

namespace drivers {

namespace {

constexpr std::int64_t kLastWords = 500'000'000;
// BBR's own period is 10 s.
constexpr std::int64_t kAnew = 5'000'000'000;
// A session that ends sooner does not make the next attempt quick again.
constexpr std::int64_t kSteadySession = 2'000'000'000;

std::string problem_of(const RoadOptions& o) {
  const auto out_of = [](const char* what, const std::string& value, const char* allowed) {
    return std::string("road.") + what + " = " + value + ": allowed " + allowed;
  };
  if (o.port < (o.listen ? 0 : 1) || o.port > 65535)
    return out_of("port", std::to_string(o.port), o.listen ? "0..65535" : "1..65535");
  if (o.address.empty()) return out_of("address", "''", "an address");
  boost::system::error_code code;
  static_cast<void>(boost::asio::ip::make_address(o.address, code));
  if (o.listen && code)
    return "road: listen on " + o.address + ":" + std::to_string(o.port) +
           ": not an IPv4 or IPv6 address";
  if (!(o.rate_Mbit_per_s >= 0 && o.rate_Mbit_per_s <= 10000))
    return out_of("rate_Mbit_per_s", std::to_string(o.rate_Mbit_per_s), "0..10000");
  if (o.handshake_limit.count() <= 0 || o.silence_limit.count() <= 0 ||
      o.redial_first.count() <= 0 || o.redial_most < o.redial_first || o.reread_period.count() <= 0)
    return "road: limits of time must be positive, and redial_most no less than redial_first";
  const bool by_key = o.expected_peer.starts_with("sha256:");
  const bool hex = o.expected_peer.size() == 71 &&
                   o.expected_peer.find_first_not_of("0123456789abcdef", 7) == std::string::npos;
  if (!o.expected_peer.empty() && !(by_key ? hex : good_box_name(o.expected_peer)))
    return out_of("expected_peer", o.expected_peer,
                  "the name of a box, or sha256: and 64 lower-case hex digits");
  return {};
}

}  // namespace

Road::Impl::Impl(const RoadOptions& o, const Caps& caps, std::unique_ptr<RoadTrust> t)
    : options(o),
      trust(std::move(t)),
      pace(o.rate_Mbit_per_s),
      caps_(caps),
      door_(o.role),
      work_(io_.get_executor()),
      acceptor_(io_),
      names_(o.address, o.lookup),
      backoff_(o.redial_first) {
  make_context();
  port = o.port;
  next_list_ns_ = rt::monotonic_ns() + o.reread_period.count();
}

Road::Impl::~Impl() {
  for (auto* list : {&doorstep_.arrivals, &doorstep_.leaving})
    for (Arrival& a : *list) a.connection->close();
  // Before io_, which their timers are of.
  for (Shared* c : {&control, &bulk}) {
    if (*c) (*c)->close();
    c->reset();
  }
}

void Road::Impl::make_context() {
  SSL_CTX* made = trust->make_context();
  context_ = made == nullptr ? nullptr : std::make_unique<boost::asio::ssl::context>(made);
}

void Road::Impl::run_for(rt::Nanos span) {
  if (io_.stopped()) io_.restart();
  io_.run_for(span);
  tick(rt::monotonic_ns());
}

void Road::Impl::tick(std::int64_t now_ns) {
  if (options.listen) {
    accept_one();
    give_turns(now_ns);
    if (door_.overdue(now_ns)) {
      ++counts.refused;
      last_refusal = "'" + control->peer().name + "': the second connection did not come";
      drop_connections(false, RoadDoor::End::kOver);
    }
  } else {
    dial_if_due(now_ns);
  }
  drop_late_arrivals(now_ns);
  look_at_list(now_ns);
  look_at_pace(now_ns);
  if (up && now_ns - heard_ns_ > options.silence_limit.count())
    close_session("nothing was heard of the other box for too long", RoadDoor::End::kCut);
}

void Road::Impl::look_at_list(std::int64_t now_ns) {
  if (now_ns < next_list_ns_) return;
  next_list_ns_ = now_ns + options.reread_period.count();
  if (trust->refresh()) make_context();
  drop_revoked();
}

// At each look, whoever is there: a certificate that was good in the handshake may not be now.
void Road::Impl::drop_revoked() {
  drop_revoked_arrivals();
  const auto revoked = [&](const Shared& c) { return c && trust->revoked(c->peer().serial); };
  if (!revoked(control) && !revoked(bulk)) return;
  const auto& who = *(revoked(control) ? control : bulk);
  const std::string why = "the certificate of '" + who.peer().name + "' is revoked";
  constexpr auto kForgotten = RoadDoor::End::kForgotten;
  if (up) {
    ++counts.revoked_live;
    return close_session(why, kForgotten, false);
  }
  if (!options.listen) return dial_failed(why);
  ++counts.refused;
  last_refusal = who.address() + ": " + why;
  drop_connections(false, kForgotten);
}

void Road::Impl::look_at_pace(std::int64_t now_ns) {
  if (!up || now_ns < next_pace_ns_) return;
  next_pace_ns_ = now_ns + RoadPace::kPeriod.count();
  const RoadSocketState s = state_of(bulk->fd());
  pace.look(s.round_trip, s.least_round_trip, in_flight_of(bulk->fd()));
  if (now_ns < next_anew_ns_) return;
  next_anew_ns_ = now_ns + kAnew;
  for (const Shared* c : {&control, &bulk}) {
    const RoadSocketState now = state_of((*c)->fd());
    if (now.round_trip - now.least_round_trip < RoadPace::kTooLong)
      begin_congestion_anew((*c)->fd());
  }
  last_congestion = congestion_of(bulk->fd());
}

void Road::Impl::session_up() {
  const std::int64_t now = rt::monotonic_ns();
  up = true;
  dialling_ = end_expected = false;
  up_ns_ = heard_ns_ = now;
  next_pace_ns_ = now + RoadPace::kPeriod.count();
  next_anew_ns_ = now + kAnew;
  pace = RoadPace(options.rate_Mbit_per_s);
  set_up_road_socket(bulk->fd(), true, pace.pacing_rate());
  ++counts.sessions;
  last_peer = control->peer();
  last_address = control->address();
  doorstep_.turns.had_session(place_of(last_address));
  last_congestion = congestion_of(bulk->fd());
  last_end.clear();
  control->allow_messages(caps_.control);
  bulk->allow_messages(caps_.bulk);
  if (handlers.up) handlers.up();
  if (up && !options.listen) control->resume();
}

void Road::Impl::leave_slowly(Shared connection) {
  if (connection && !connection->gone())
    doorstep_.leaving.push_back({std::move(connection), rt::monotonic_ns() + kLastWords});
}

void Road::Impl::drop_connections(bool gently, RoadDoor::End end) {
  for (Shared* c : {&control, &bulk}) {
    if (!*c) continue;
    gently ? (*c)->close_gently() : (*c)->close();
    leave_slowly(std::move(*c));
    c->reset();
  }
  door_.leave(rt::monotonic_ns(), end);
}

void Road::Impl::close_session(const std::string& why, RoadDoor::End end, bool gently) {
  if (!up) return;
  up = false;
  last_end = why;
  const std::int64_t now = rt::monotonic_ns();
  const bool steady = now - up_ns_ > kSteadySession;
  if (steady) backoff_ = options.redial_first;
  if ((!steady || end_expected) && end == RoadDoor::End::kCut) end = RoadDoor::End::kOver;
  next_dial_ns_ = now + backoff_.count();
  backoff_ = std::min(2 * backoff_, options.redial_most);
  drop_connections(gently, end);
  if (handlers.down) handlers.down(why);
}

void Road::Impl::connection_shaken(RoadConnection& c) {
  if (options.listen) return;  // who dials speaks first
  RoadGreet greet;
  if (&c == bulk.get()) {
    greet.connection = RoadConnectionKind::kBulk;
    greet.token = token_;
    // Two boxes behind one address would be a session with two peers.
    if (!control || c.peer().serial != control->peer().serial)
      return dial_failed("the second connection reached another box than the first");
  }
  append_greet(greet, c.out());
  c.send();
}

bool Road::Impl::connection_frame(RoadConnection& c, RoadKind kind,
                                  std::span<const std::uint8_t> body) {
  if (up && (&c == control.get() || &c == bulk.get())) {
    if (kind != RoadKind::kMessage) return false;
    heard_ns_ = rt::monotonic_ns();
    if (!handlers.message || handlers.message(body)) return true;
    close_session(handlers.closing_reason ? handlers.closing_reason() : "refused",
                  RoadDoor::End::kOver);
    return true;
  }
  if (!options.listen) return answered(c, kind, body);
  RoadGreet greet;
  const bool arrival = std::any_of(doorstep_.arrivals.begin(), doorstep_.arrivals.end(),
                                   [&](const Arrival& a) { return a.connection.get() == &c; });
  if (!arrival || kind != RoadKind::kGreet || !read_greet(body, greet)) return false;
  return greeted(c, greet);
}

void Road::Impl::connection_closed(RoadConnection& c, const std::string& why) {
  if (&c == control.get() || &c == bulk.get()) {
    if (up) return close_session(why, RoadDoor::End::kCut);
    if (!options.listen) return dial_failed(why);
    return drop_connections(true, RoadDoor::End::kOver);
  }
  if (auto shared = take_arrival(c)) {
    ++counts.refused;
    last_refusal = c.address() + ": " + why;
    leave_slowly(std::move(shared));
  }
}

void Road::Impl::send(bool for_bulk, std::span<const std::uint8_t> message, bool at_once) {
  if (!up) return;
  RoadConnection& c = for_bulk ? *bulk : *control;
  append_road_frame(RoadKind::kMessage, message, c.out());
  if (at_once) c.send();
}

rt::Nanos Road::Impl::bulk_busy_for() const noexcept {
  if (!up) return rt::Nanos::max();
  const std::size_t flying = in_flight_of(bulk->fd()), allowed = pace.allowance();
  const std::size_t over = flying > allowed ? flying - allowed : 0;
  const std::size_t waits = bulk->left() + over;
  if (waits == 0 && flying < allowed) return rt::Nanos{0};
  double rate = state_of(bulk->fd()).delivered_bytes_per_s;
  if (pace.pacing_rate() > 0) {
    const auto most = static_cast<double>(pace.pacing_rate());
    rate = rate > 0 ? std::min(rate, most) : most;
  }
  if (rate <= 0) return rt::Nanos::max();
  return rt::Nanos{1 + static_cast<std::int64_t>(1e9 * static_cast<double>(waits) / rate)};
}

rt::Result<bool> Road::check(const RoadOptions& options) {
  if (const std::string problem = problem_of(options); !problem.empty()) return rt::Error{problem};
  const auto trust = RoadTrust::load(options);
  if (!trust) return rt::Error{trust.error()};
  return true;
}

rt::Result<std::unique_ptr<Road>> Road::open(const RoadOptions& options, const Caps& caps) {
  if (const std::string problem = problem_of(options); !problem.empty()) return rt::Error{problem};
  auto trust = RoadTrust::load(options);
  if (!trust) return rt::Error{trust.error()};
  auto impl = std::make_unique<Impl>(options, caps, std::move(trust).value());
  if (options.listen) {
    if (const std::string problem = impl->listen(); !problem.empty()) return rt::Error{problem};
  }
  return std::unique_ptr<Road>(new Road(std::move(impl)));
}

Road::Road(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Road::~Road() = default;

void Road::set_handlers(Handlers handlers) { impl_->handlers = std::move(handlers); }
void Road::run_for(rt::Nanos span) { impl_->run_for(span); }
bool Road::up() const noexcept { return impl_->up; }
bool Road::control_free() const noexcept { return impl_->up && impl_->control->left() == 0; }
bool Road::bulk_taken() const noexcept { return impl_->up && impl_->bulk->left() == 0; }
rt::Nanos Road::bulk_busy_for() const noexcept { return impl_->bulk_busy_for(); }
void Road::send(bool bulk, std::span<const std::uint8_t> m, bool at_once) {
  impl_->send(bulk, m, at_once);
}
void Road::flush() {
  if (!impl_->up) return;
  impl_->control->send();
  impl_->bulk->send();
}
void Road::close_session(const std::string& why) {
  impl_->close_session(why, RoadDoor::End::kOver);
}
void Road::expect_end() noexcept { impl_->end_expected = true; }
int Road::port() const noexcept { return impl_->port; }
int Road::wish() const noexcept { return impl_->up ? impl_->pace.wish() : 0; }
const RoadPeer& Road::peer() const noexcept { return impl_->last_peer; }
const std::string& Road::peer_address() const noexcept { return impl_->last_address; }
const RoadPeer& Road::self() const noexcept { return impl_->trust->self(); }
std::string Road::congestion() const { return impl_->last_congestion; }
const RoadCounts& Road::counts() const noexcept { return impl_->counts; }
const std::string& Road::last_end() const noexcept { return impl_->last_end; }
const std::string& Road::last_refusal() const noexcept { return impl_->last_refusal; }
std::string Road::note() const { return impl_->trust->note(); }

}  // namespace drivers
