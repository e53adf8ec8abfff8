// Who dials: the control connection, its token, the bulk connection; again after a while.
#include <algorithm>
#include <boost/asio/connect.hpp>
#include <utility>

#include "drivers/road/road_impl.hpp"
#include "drivers/road/road_socket.hpp"
#include "rt/clock/box_time.hpp"

namespace drivers {

namespace asio = boost::asio;

void Road::Impl::dial_if_due(std::int64_t now_ns) {
  if (dialling_ && now_ns > dial_until_ns_) {
    if (naming_ != Naming::kNot) return dial_failed("no name server has answered in time");
    names_.pass_over_first();
    return dial_failed("no answer in time");
  }
  look_at_names();
  if (dialling_ || up || now_ns < next_dial_ns_) return;
  dialling_ = true;
  dial_until_ns_ = now_ns + options.handshake_limit.count();
  dial(false);
}

void Road::Impl::dial(bool for_bulk) {
  Code code;
  static_cast<void>(asio::ip::make_address(options.address, code));
  if (!code) return connect({options.address}, for_bulk);
  names_.ask();
  naming_ = for_bulk ? Naming::kBulk : Naming::kControl;
}

void Road::Impl::look_at_names() {
  if (naming_ == Naming::kNot) return;
  const auto found = names_.answer();
  if (!found) return;
  const bool for_bulk = std::exchange(naming_, Naming::kNot) == Naming::kBulk;
  if (!*found) return dial_failed(found->error());
  connect(found->value(), for_bulk);
}

void Road::Impl::connect(const std::vector<std::string>& addresses, bool for_bulk) {
  std::vector<Tcp::endpoint> ends;
  for (const std::string& text : addresses) {
    Code code;
    const auto address = asio::ip::make_address(text, code);
    if (!code) ends.emplace_back(address, static_cast<std::uint16_t>(options.port));
  }
  if (ends.empty()) return dial_failed("the name has no address");
  // Held by the handler, so that a late one meets its own socket and not the next one's.
  auto socket = std::make_shared<Tcp::socket>(io_);
  trying_ = socket;
  asio::async_connect(*socket, ends,
                      [this, socket, for_bulk](const Code& code, const Tcp::endpoint& to) {
                        if (trying_ != socket || !dialling_) return;
                        trying_.reset();
                        if (code) return dial_failed(code.message());
                        if (!context_) return dial_failed("TLS can not be set up");
                        set_up_road_socket(socket->native_handle(), for_bulk, pace.pacing_rate());
                        auto c = std::make_shared<RoadConnection>(
                            std::move(*socket), *context_, *trust, *this, to.address().to_string());
                        (for_bulk ? bulk : control) = c;
                        c->shake_hands(true);
                      });
}

bool Road::Impl::answered(RoadConnection& c, RoadKind kind, std::span<const std::uint8_t> body) {
  std::string words;
  if (kind == RoadKind::kRefusal && read_refusal(body, words)) {
    dial_failed("the other side refused: " + words);
    return true;
  }
  RoadToken token{};
  if (kind != RoadKind::kWelcome || !read_welcome(body, token)) return false;
  if (&c == control.get() && !bulk && !trying_ && naming_ == Naming::kNot) {
    token_ = token;
    // What the other end says first may come before the second connection stands here.
    c.pause();
    dial(true);
    return true;
  }
  if (&c != bulk.get()) return false;
  session_up();
  return true;
}

void Road::Impl::dial_failed(const std::string& why) {
  ++counts.failed;
  dialling_ = false;
  last_end = options.address + ":" + std::to_string(options.port) + ": " + why;
  naming_ = Naming::kNot;
  if (trying_) {
    Code ignored;
    trying_->close(ignored);
    trying_.reset();
  }
  drop_connections(false, RoadDoor::End::kForgotten);
  next_dial_ns_ = rt::monotonic_ns() + backoff_.count();
  backoff_ = std::min(2 * backoff_, options.redial_most);
}

}  // namespace drivers
