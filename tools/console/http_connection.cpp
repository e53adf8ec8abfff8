#include "tools/console/http_connection.hpp"

#include <boost/beast/http/error.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>

#include "rt/clock/box_time.hpp"
#include "tools/console/ws_viewer.hpp"

namespace teletact {

namespace {

namespace beast = boost::beast;
namespace http = boost::beast::http;

// A page of 2 MB on a thin line.
constexpr auto kSendLimit = std::chrono::seconds{60};
constexpr char kPolicy[] =
    "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

// The page looks for the option's name, and adds its own address.
constexpr char kPublicHint[] =
    "start the box with --console-public and the address that the browser shows";

std::string_view text_of(beast::string_view s) { return {s.data(), s.size()}; }

std::string_view path_of(std::string_view target) { return target.substr(0, target.find('?')); }

}  // namespace

HttpConnection::HttpConnection(ServerCore& core, boost::asio::ip::tcp::socket&& socket)
    : core_(core), stream_(std::move(socket), core.tls.get()) {}

void HttpConnection::run() {
  if (!stream_.secure()) return read();
  stream_.next_layer().expires_after(core_.options.request_limit);
  stream_.async_tls([self = shared_from_this()](boost::system::error_code failed) {
    if (failed) {
      self->core_.tally.refuse(Refusal::kCertificate);
      return self->cut();
    }
    self->peer_ = WebTrust::peer_of(self->stream_.session());
    if (self->core_.trust->revoked(self->peer_.serial)) {
      self->core_.tally.refuse(Refusal::kCertificate);
      return self->cut();
    }
    self->read();
  });
}

void HttpConnection::cut() {
  if (cut_) return;
  cut_ = true;
  const auto self = shared_from_this();
  boost::system::error_code ignored;
  stream_.next_layer().socket().close(ignored);
  stream_.next_layer().cancel();
  core_.connection_down(*this);
}

void HttpConnection::read() {
  parser_.emplace();
  parser_->header_limit(kMostHeadBytes);
  parser_->body_limit(kMostBodyBytes);
  stream_.next_layer().expires_after(core_.options.request_limit);
  http::async_read(stream_, in_, *parser_,
                   [self = shared_from_this()](boost::system::error_code failed, std::size_t) {
                     self->got(failed);
                   });
}

void HttpConnection::got(boost::system::error_code failed) {
  if (cut_) return;
  if (failed) {
    const bool begun = parser_->got_some();
    if (failed == beast::error::timeout) {
      if (begun) core_.tally.refuse(Refusal::kLate);
      return cut();
    }
    // The other has gone, or TLS is damaged: nobody to answer.
    if (failed == http::error::end_of_stream || failed == http::error::partial_message ||
        failed.category() != http::make_error_code(http::error::end_of_stream).category()) {
      return cut();
    }
    request_ = {};
    request_.keep_alive(false);
    return refuse(Refusal::kRequest,
                  failed == http::error::body_limit     ? Status::payload_too_large
                  : failed == http::error::header_limit ? Status::request_header_fields_too_large
                                                        : Status::bad_request,
                  "not a request that this server takes");
  }
  request_ = parser_->release();
  handle();
}

std::string_view HttpConnection::field(http::field name) const {
  const auto found = request_.find(name);
  return found == request_.end() ? std::string_view{} : text_of(found->value());
}

bool HttpConnection::good_names() {
  const std::string_view host = field(http::field::host);
  const std::string port_text = std::to_string(core_.port);
  if (request_.count(http::field::host) != 1 || !core_.names->good_host(host)) {
    refuse(Refusal::kHost, Status::misdirected_request,
           "this server has another name: open the address that the box printed. Through a tunnel, "
           "forward the same port (ssh -L " +
               port_text + ":127.0.0.1:" + port_text + "); behind a proxy or by another port, " +
               kPublicHint);
    return false;
  }
  const bool page = request_.method() == http::verb::get && !beast::websocket::is_upgrade(request_);
  if (page)
    return true;  // what changes nothing may be asked for from anywhere: it can not be read there
  if (request_.count(http::field::origin) != 1 ||
      !core_.names->good_origin(field(http::field::origin), host)) {
    refuse(Refusal::kOrigin, Status::forbidden,
           std::string("asked by a page of another origin: behind a proxy or a tunnel ") +
               kPublicHint);
    return false;
  }
  return true;
}

std::uint32_t HttpConnection::session_of_cookie() {
  if (request_.count(http::field::cookie) > 1) return 0;
  const std::string_view secret = cookie_value(field(http::field::cookie), core_.cookie_name);
  return secret.empty() ? 0 : core_.sessions.find(secret, rt::monotonic_ns());
}

std::string_view HttpConnection::target() const {
  return core_.names->inside(text_of(request_.target()));
}

// The page names its files from its folder: without the last '/' of the public address they would
// be looked for beside it.
bool HttpConnection::go_into_folder() {
  const auto& known = core_.names->known();
  if (!known || known->path.size() == 1) return false;
  const std::string_view folder = std::string_view(known->path).substr(0, known->path.size() - 1);
  if (path_of(text_of(request_.target())) != folder) return false;
  Response response(Status::permanent_redirect, request_.version());
  response.set(http::field::location, known->path);
  response.set(http::field::cache_control, "no-store");
  response.body() = std::make_shared<std::string>();
  send(std::move(response));
  return true;
}

void HttpConnection::handle() {
  if (!good_names()) return;
  if (go_into_folder()) return;
  const std::string_view path = path_of(target());
  const std::uint32_t session = session_of_cookie();
  if (request_.method() == http::verb::post) {
    // A form of another page can not send this type.
    if (field(http::field::content_type) != "application/json")
      return refuse(Refusal::kRequest, Status::unsupported_media_type, "not application/json");
    if (path == "/session") return open_session(session);
    return handle_post(session);
  }
  if (request_.method() != http::verb::get)
    return refuse(Refusal::kRequest, Status::method_not_allowed, "GET or POST");
  if (path == "/ws") return upgrade(session);
  if (path != "/session") return handle_page();
  if (session == 0) return refuse(Refusal::kSession, Status::unauthorized, "no session");
  reply_json(Status::ok,
             "{\"role\":\"" + std::string(role_text(core_.sessions.person(session).role)) + "\"}");
}

void HttpConnection::handle_page() {
  const std::vector<std::string> segments = page_path(target());
  if (segments.empty()) return refuse(Refusal::kPath, Status::not_found, "no such file");
  PageFiles::Content content = core_.page.get(segments);
  if (!content) return refuse(Refusal::kPath, Status::not_found, "no such file");
  Response response(Status::ok, request_.version());
  response.set(http::field::content_type, std::string(content_type(segments.back())));
  response.set(http::field::cache_control, "no-cache");
  response.body() = std::move(content);
  send(std::move(response));
}

void HttpConnection::handle_post(std::uint32_t session) {
  if (session == 0) return refuse(Refusal::kSession, Status::unauthorized, "no session");
  const std::string_view path = path_of(target());
  if (path == "/stop") {
    core_.stop_asked(session);
    return reply_json(Status::ok, "{\"ok\":true}");
  }
  if (path == "/view-link") return open_view_link(session);
  refuse(Refusal::kPath, Status::not_found, "no such thing");
}

void HttpConnection::open_session(std::uint32_t before) {
  const std::int64_t now = rt::monotonic_ns();
  if (!core_.code_rate.take(now))
    return refuse(Refusal::kRate, Status::too_many_requests, "too many codes a second");
  const auto code = code_of(request_.body());
  const ConsoleSecret fresh = core_.fresh_secret();
  const std::uint32_t session =
      code ? core_.sessions.exchange(*code, before, fresh, peer_.name, now) : 0;
  if (session == 0)
    return refuse(Refusal::kCode, Status::forbidden, "this code is used, expired or wrong");
  ++core_.tally.sessions;
  core_.close_viewers_of(before);
  core_.tell_roles();
  reply_json(Status::ok,
             "{\"role\":\"" + std::string(role_text(core_.sessions.person(session).role)) + "\"}",
             cookie_of(secret_text(fresh)));
}

// By the public address the cookie is for its path, and as secure as that.
std::string HttpConnection::cookie_of(const std::string& secret) const {
  const bool by_public = core_.names->is_public(field(http::field::origin));
  const bool secure = stream_.secure() || (by_public && core_.names->known()->secure);
  return core_.cookie_name + "=" + secret +
         "; Path=" + (by_public ? core_.names->known()->path : "/") +
         "; HttpOnly; SameSite=Strict" + (secure ? "; Secure" : "");
}

void HttpConnection::open_view_link(std::uint32_t session) {
  if (core_.sessions.person(session).role != ConsoleRole::kOperator)
    return refuse(Refusal::kRole, Status::forbidden, "only the operator makes view links");
  const ConsoleSecret code = core_.fresh_secret();
  core_.sessions.add_code(code, true, rt::monotonic_ns());
  reply_json(Status::ok, "{\"code\":\"" + secret_text(code) + "\"}");
}

void HttpConnection::upgrade(std::uint32_t session) {
  if (!beast::websocket::is_upgrade(request_))
    return refuse(Refusal::kRequest, Status::upgrade_required, "a WebSocket");
  if (session == 0) return refuse(Refusal::kSession, Status::unauthorized, "no session");
  bool offered = false;
  for (const auto& one : http::token_list(request_[http::field::sec_websocket_protocol]))
    offered = offered || text_of(one) == kSubProtocol;
  if (!offered) return refuse(Refusal::kRequest, Status::bad_request, "sub-protocol teletact.1");
  if (!core_.viewer_place(session))
    return refuse(Refusal::kCrowded, Status::service_unavailable, "too many viewers");
  stream_.next_layer().expires_never();
  const auto viewer = std::make_shared<WsViewer>(core_, std::move(stream_), session, peer_);
  cut_ = true;  // the connection is the viewer's
  const auto self = shared_from_this();
  core_.connection_down(*this);
  viewer->run(std::move(request_));
}

void HttpConnection::refuse(Refusal why, Status status, const std::string& text) {
  core_.tally.refuse(why);
  Response response(status, request_.version());
  response.set(http::field::content_type, "text/plain; charset=utf-8");
  response.set(http::field::cache_control, "no-store");
  response.body() = std::make_shared<std::string>(text + "\n");
  send(std::move(response));
}

void HttpConnection::reply_json(Status status, const std::string& json, const std::string& cookie) {
  Response response(status, request_.version());
  response.set(http::field::content_type, "application/json");
  response.set(http::field::cache_control, "no-store");
  if (!cookie.empty()) response.set(http::field::set_cookie, cookie);
  response.body() = std::make_shared<std::string>(json);
  send(std::move(response));
}

void HttpConnection::send(Response response) {
  response.set("Content-Security-Policy", kPolicy);
  response.set("X-Content-Type-Options", "nosniff");
  response.set("Referrer-Policy", "no-referrer");
  response.set("Cross-Origin-Opener-Policy", "same-origin");
  response.set("Cross-Origin-Resource-Policy", "same-origin");
  response.keep_alive(request_.keep_alive());
  response.prepare_payload();
  response_ = std::move(response);
  stream_.next_layer().expires_after(kSendLimit);
  http::async_write(stream_, *response_,
                    [self = shared_from_this()](boost::system::error_code failed, std::size_t) {
                      const bool again = !failed && !self->cut_ && self->response_->keep_alive();
                      self->response_.reset();
                      if (again) return self->read();
                      if (!failed && !self->stream_.secure()) {
                        boost::system::error_code ignored;
                        self->stream_.next_layer().socket().shutdown(
                            boost::asio::ip::tcp::socket::shutdown_send, ignored);
                      }
                      self->cut();
                    });
}

}  // namespace teletact
