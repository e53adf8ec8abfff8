// One connection before it is a WebSocket: TLS, then requests one after the other, each checked
// before
// anything is done for it.
#pragma once

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "tools/console/server_core.hpp"
#include "tools/console/web_stream.hpp"

namespace teletact {

// A body whose bytes are shared by all who are sent it.
struct SharedBody {
  using value_type = std::shared_ptr<const std::string>;
  static std::uint64_t size(const value_type& body) { return body ? body->size() : 0; }
  struct writer {
    using const_buffers_type = boost::asio::const_buffer;
    template <bool request, class Fields>
    writer(const boost::beast::http::header<request, Fields>&, const value_type& body)
        : body_(body) {}
    void init(boost::system::error_code& failed) { failed = {}; }
    boost::optional<std::pair<const_buffers_type, bool>> get(boost::system::error_code& failed) {
      failed = {};
      if (!body_) return boost::none;
      return {{const_buffers_type(body_->data(), body_->size()), false}};
    }

   private:
    const value_type& body_;
  };
};

class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  static constexpr std::uint32_t kMostHeadBytes = 8192;
  static constexpr std::uint64_t kMostBodyBytes = 1024;

  HttpConnection(ServerCore& core, boost::asio::ip::tcp::socket&& socket);
  void run();
  void cut();
  [[nodiscard]] const WebPeer& peer() const noexcept { return peer_; }

 private:
  using Request = boost::beast::http::request<boost::beast::http::string_body>;
  using Response = boost::beast::http::response<SharedBody>;
  using Status = boost::beast::http::status;

  void read();
  void got(boost::system::error_code failed);
  void handle();
  void handle_page();
  void handle_post(std::uint32_t session);
  void open_session(std::uint32_t before);
  void open_view_link(std::uint32_t session);
  void upgrade(std::uint32_t session);
  [[nodiscard]] bool good_names();
  [[nodiscard]] bool go_into_folder();
  [[nodiscard]] std::string_view target() const;  // without the path of the public address
  [[nodiscard]] std::string cookie_of(const std::string& secret) const;
  [[nodiscard]] std::uint32_t session_of_cookie();
  [[nodiscard]] std::string_view field(boost::beast::http::field name) const;

  void refuse(Refusal why, Status status, const std::string& text);
  void reply_json(Status status, const std::string& json, const std::string& cookie = {});
  void send(Response response);

  ServerCore& core_;
  WebStream stream_;
  WebPeer peer_;
  boost::beast::flat_buffer in_{2 * kMostHeadBytes};
  std::optional<boost::beast::http::request_parser<boost::beast::http::string_body>> parser_;
  Request request_;
  std::optional<Response> response_;
  bool cut_ = false;
};

}  // namespace teletact
