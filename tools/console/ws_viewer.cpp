#include "tools/console/ws_viewer.hpp"

#include <netinet/tcp.h>

#include <boost/beast/http/field.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <utility>

#include "rt/clock/box_time.hpp"
#include "tools/console/intent_envelope.hpp"

namespace teletact {

namespace {

namespace beast = boost::beast;
namespace websocket = boost::beast::websocket;
constexpr std::int64_t kClosing_ns = 2'000'000'000;
// What waits unsent in the kernel is older than what will be made meanwhile.
constexpr int kUnsentBytes = 131072;

}  // namespace

WsViewer::WsViewer(ServerCore& core, WebStream&& stream, std::uint32_t s, WebPeer p)
    : session(s),
      peer(std::move(p)),
      core_(core),
      ws_(std::move(stream)),
      in_(2 * kMostIntentBytes) {}

void WsViewer::run(Request request) {
  request_ = std::move(request);
  auto& tcp = beast::get_lowest_layer(ws_);
  tcp.expires_never();
  boost::system::error_code ignored;
  tcp.socket().set_option(boost::asio::ip::tcp::no_delay(true), ignored);
  setsockopt(tcp.socket().native_handle(), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &kUnsentBytes,
             sizeof kUnsentBytes);
  ws_.set_option(websocket::stream_base::timeout{core_.options.request_limit,
                                                 core_.options.silence_limit, true});
  ws_.set_option(websocket::stream_base::decorator([](websocket::response_type& answer) {
    answer.erase(beast::http::field::server);
    answer.set(beast::http::field::sec_websocket_protocol, std::string(kSubProtocol));
  }));
  ws_.read_message_max(kMostIntentBytes);
  ws_.auto_fragment(false);
  ws_.binary(true);
  ws_.async_accept(request_, [self = shared_from_this()](boost::system::error_code failed) {
    self->accepted(failed);
  });
}

void WsViewer::accepted(boost::system::error_code failed) {
  if (failed || cut_) return cut();
  request_ = {};
  up_ = true;
  core_.viewer_up(shared_from_this());
  pump();
  read();
}

void WsViewer::read() {
  ws_.async_read(in_, [self = shared_from_this()](boost::system::error_code failed, std::size_t) {
    self->got(failed);
  });
}

void WsViewer::got(boost::system::error_code failed) {
  if (failed) {
    if (failed == websocket::error::message_too_big || failed == websocket::error::buffer_overflow)
      core_.tally.refuse(Refusal::kEnvelope);
    return cut();
  }
  if (!closing_) {
    const auto bytes = in_.cdata();
    const std::string_view text(static_cast<const char*>(bytes.data()), bytes.size());
    if (ws_.got_text()) {
      core_.act(*this, text);
    } else {
      core_.tally.refuse(Refusal::kEnvelope);
      if (++refused_form >= kMostRefused) close(kClosePolicy, "not an intent");
    }
  }
  in_.consume(in_.size());
  pump();
  if (!cut_) read();  // a closing one must hear the other's close
}

void WsViewer::pump() {
  if (!up_ || cut_ || closing_ || out_) return;
  {
    const std::lock_guard held(core_.mesh_mutex);
    out_ = mailbox.next(core_.mesh, window_.room());
  }
  if (!out_) return;
  writing_since_ns_ = rt::monotonic_ns();
  if (is_bulk(kind_of(*out_))) window_.sent(out_->size(), core_.options.line_clock());
  ws_.async_write(boost::asio::buffer(*out_),
                  [self = shared_from_this()](boost::system::error_code failed, std::size_t bytes) {
                    self->sent(failed, bytes);
                  });
}

bool WsViewer::seen(std::uint64_t bytes) { return window_.seen(bytes, core_.options.line_clock()); }

void WsViewer::sent(boost::system::error_code failed, std::size_t bytes) {
  out_ = nullptr;
  writing_since_ns_ = 0;
  if (failed) return cut();
  ++core_.tally.views_sent;
  core_.tally.bytes_sent += bytes;
  pump();
}

void WsViewer::close(std::uint16_t code, const char* why) {
  if (closing_ || cut_) return;
  closing_ = true;
  closing_since_ns_ = rt::monotonic_ns();
  ws_.async_close(websocket::close_reason(static_cast<websocket::close_code>(code), why),
                  [self = shared_from_this()](boost::system::error_code) { self->cut(); });
}

void WsViewer::cut() {
  if (cut_) return;
  cut_ = true;
  const auto self = shared_from_this();
  boost::system::error_code ignored;
  beast::get_lowest_layer(ws_).socket().close(ignored);
  beast::get_lowest_layer(ws_).cancel();
  if (up_) core_.viewer_down(*this);
}

void WsViewer::look(std::int64_t now_ns) {
  if (writing_since_ns_ != 0 && now_ns - writing_since_ns_ > core_.options.write_limit.count()) {
    core_.tally.refuse(Refusal::kSlow);
    return cut();
  }
  if (closing_ && now_ns - closing_since_ns_ > kClosing_ns) cut();
}

}  // namespace teletact
