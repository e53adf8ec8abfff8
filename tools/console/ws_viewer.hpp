// One WebSocket: reads intents one at a time, writes one view at a time from its mailbox.
#pragma once

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <memory>
#include <string>

#include "tools/console/bulk_window.hpp"
#include "tools/console/server_core.hpp"
#include "tools/console/viewer_mailbox.hpp"
#include "tools/console/web_stream.hpp"

namespace teletact {

inline constexpr std::string_view kSubProtocol = "teletact.1";
inline constexpr std::uint16_t kCloseReplaced = 4001, kCloseRole = 4003, kClosePolicy = 1008,
                               kCloseGoing = 1001;

class WsViewer : public std::enable_shared_from_this<WsViewer> {
 public:
  using Request = boost::beast::http::request<boost::beast::http::string_body>;
  // Refused so often on one connection for its role or for what it sent: closed.
  static constexpr int kMostRefused = 100;

  WsViewer(ServerCore& core, WebStream&& stream, std::uint32_t session, WebPeer peer);
  void run(Request request);
  void pump();  // something may be there to be written
  void close(std::uint16_t code, const char* why);
  void cut();  // without a word
  // The page has taken in so many bytes of bulk views since this connection stands. What it has not
  // seen waits in sockets, where nothing newer can replace it: from the first such word on bulk
  // views wait here. False: more than was sent, or less than it said before.
  bool seen(std::uint64_t bytes);
  // Each tick: what takes too long is cut.
  void look(std::int64_t now_ns);

  const std::uint32_t session;
  const WebPeer peer;
  ViewerMailbox mailbox;
  // Limits of this session's intents. The streams: token, hand, drive, seen.
  RateWindow<200> act_rate;
  std::array<RateWindow<100>, 4> stream_rates;
  std::int64_t last_id = -1, fast_since_ns = 0, fast_last_ns = 0;
  int refused_role = 0, refused_form = 0;

 private:
  void accepted(boost::system::error_code failed);
  void read();
  void got(boost::system::error_code failed);
  void sent(boost::system::error_code failed, std::size_t bytes);

  ServerCore& core_;
  boost::beast::websocket::stream<WebStream> ws_;
  boost::beast::flat_buffer in_;
  Request request_;
  ViewBytes out_;
  std::int64_t writing_since_ns_ = 0, closing_since_ns_ = 0;
  BulkWindow window_;
  bool up_ = false, closing_ = false, cut_ = false;
};

}  // namespace teletact
