// A TCP connection with or without TLS, as one type: Beast is compiled once.
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <memory>
#include <utility>

namespace teletact {

class WebStream {
 public:
  using next_layer_type = boost::beast::tcp_stream;
  using executor_type = next_layer_type::executor_type;

  // `tls` null: plain.
  WebStream(boost::asio::ip::tcp::socket&& socket, boost::asio::ssl::context* tls)
      : tcp_(std::make_unique<next_layer_type>(std::move(socket))) {
    if (tls != nullptr) tls_ = std::make_unique<Tls>(*tcp_, *tls);
  }
  [[nodiscard]] executor_type get_executor() noexcept { return tcp_->get_executor(); }
  [[nodiscard]] next_layer_type& next_layer() noexcept { return *tcp_; }
  [[nodiscard]] const next_layer_type& next_layer() const noexcept { return *tcp_; }
  [[nodiscard]] bool secure() const noexcept { return tls_ != nullptr; }
  [[nodiscard]] SSL* session() noexcept { return tls_ ? tls_->native_handle() : nullptr; }

  template <class Handler>
  void async_tls(Handler&& handler) {
    tls_->async_handshake(boost::asio::ssl::stream_base::server, std::forward<Handler>(handler));
  }
  template <class Buffers, class Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    if (tls_) {
      tls_->async_read_some(buffers, std::forward<Handler>(handler));
    } else {
      tcp_->async_read_some(buffers, std::forward<Handler>(handler));
    }
  }
  template <class Buffers, class Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    if (tls_) {
      tls_->async_write_some(buffers, std::forward<Handler>(handler));
    } else {
      tcp_->async_write_some(buffers, std::forward<Handler>(handler));
    }
  }

 private:
  using Tls = boost::asio::ssl::stream<next_layer_type&>;
  std::unique_ptr<next_layer_type> tcp_;
  std::unique_ptr<Tls> tls_;  // of tcp_: goes first
};

// Beast's ends of a WebSocket. Its closing frames have said that it is over; TLS adds nothing.
inline void teardown(boost::beast::role_type role, WebStream& stream,
                     boost::system::error_code& failed) {
  using boost::beast::websocket::teardown;
  teardown(role, stream.next_layer().socket(), failed);
}
template <class Handler>
void async_teardown(boost::beast::role_type role, WebStream& stream, Handler&& handler) {
  using boost::beast::websocket::async_teardown;
  async_teardown(role, stream.next_layer().socket(), std::forward<Handler>(handler));
}

}  // namespace teletact
