#include "tools/measure/bench/console/page_client.hpp"

#include <boost/asio/connect.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <stdexcept>
#include <thread>

#include "tools/console/console_views.hpp"

namespace teletact {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using tcp = asio::ip::tcp;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kLook{2}, kToken{50};

}  // namespace

struct PageClient::Wire {
  using Stream = beast::websocket::stream<beast::tcp_stream>;
  explicit Wire(const std::string& url) {
    const auto host_at = url.find("//") + 2, path_at = url.find('/', host_at);
    host = url.substr(host_at, path_at - host_at);
    const int port = std::stoi(host.substr(host.find(':') + 1));
    there = tcp::endpoint(asio::ip::make_address("127.0.0.1"), static_cast<std::uint16_t>(port));
    const auto answer =
        post("/session", nlohmann::json{{"code", url.substr(url.find("code=") + 5)}}.dump());
    if (answer.result_int() != 200) throw std::runtime_error("the box takes no session");
    const std::string set(answer[http::field::set_cookie]);
    cookie = set.substr(0, set.find(';'));
    connect();
  }

  void connect() {
    ws = std::make_unique<Stream>(io);
    ws->next_layer().connect(there);
    ws->next_layer().socket().set_option(tcp::no_delay(true));
    ws->set_option(beast::websocket::stream_base::decorator([this](auto& r) {
      r.set(http::field::origin, "http://" + host);
      r.set(http::field::cookie, cookie);
      r.set(http::field::sec_websocket_protocol, "teletact.1");
    }));
    ws->handshake(host, "/ws");
    ws->text(true);
  }

  http::response<http::string_body> post(const std::string& path, const std::string& body) {
    beast::tcp_stream stream(io);
    stream.connect(there);
    http::request<http::string_body> r{http::verb::post, path, 11};
    r.set(http::field::host, host);
    r.set(http::field::origin, "http://" + host);
    r.set(http::field::content_type, "application/json");
    if (!cookie.empty()) r.set(http::field::cookie, cookie);
    r.body() = body;
    r.prepare_payload();
    http::write(stream, r);
    beast::flat_buffer in;
    http::response<http::string_body> answer;
    http::read(stream, in, answer);
    return answer;
  }

  asio::io_context io;
  std::unique_ptr<Stream> ws;
  beast::flat_buffer buffer;
  tcp::endpoint there;
  std::string host, cookie;
};

PageClient::PageClient(const std::string& url) : wire_(std::make_unique<Wire>(url)) {}

PageClient::~PageClient() { leave(); }

void PageClient::leave() {
  beast::error_code ignored;
  if (wire_->ws) wire_->ws->next_layer().socket().close(ignored);
  wire_->ws.reset();
  wire_->buffer.clear();
  mode.clear();
}

void PageClient::come_back() {
  wire_->connect();
  id_ = 0;  // within one WebSocket
}

std::int64_t PageClient::say(nlohmann::json intent) {
  intent["id"] = ++id_;
  wire_->ws->write(asio::buffer(intent.dump()));
  return id_;
}

bool PageClient::post_stop() { return wire_->post("/stop", "{}").result_int() == 200; }

void PageClient::tokens() {
  // Once something was held, an empty list says that it was let go: only then a new press counts.
  held_ = held_ || !holds.empty();
  if (!held_ || Clock::now() < token_due_) return;
  token_due_ = Clock::now() + kToken;
  say({{"act", "token"}, {"holds", holds}});
  if (!driven.is_null()) say(driven);
}

void PageClient::take(const char* data, std::size_t size) {
  ++views;
  bytes += size;
  if (size < kViewHeadBytes) return;
  const auto kind = static_cast<ViewKind>(static_cast<unsigned char>(data[0]));
  if (kind != ViewKind::kText && kind != ViewKind::kAnswer) return;
  const auto json = nlohmann::json::parse(data + kViewHeadBytes, data + size, nullptr,
                                          /*allow_exceptions=*/false);
  if (!json.is_object()) return;
  if (kind == ViewKind::kText) {
    mode = json.value("mode", "");
    return;
  }
  const bool ok = json.value("ok", false);
  if (!ok && json.value("why", "").rfind("too fast", 0) == 0) {
    ++refused;
    return;
  }
  answers[json.value("id", std::int64_t{-1})] = json;
}

void PageClient::take_all() {
  // A view that has begun to come is waited for: the server writes each as a whole.
  while (wire_->ws->next_layer().socket().available() > 0) {
    wire_->ws->read(wire_->buffer);
    const auto data = wire_->buffer.data();
    take(static_cast<const char*>(data.data()), data.size());
    wire_->buffer.consume(wire_->buffer.size());
  }
}

void PageClient::run(milliseconds how_long) {
  const auto end = Clock::now() + how_long;
  do {
    tokens();
    take_all();
    std::this_thread::sleep_for(kLook);
  } while (Clock::now() < end);
}

bool PageClient::answered(std::int64_t id, milliseconds most) {
  const auto end = Clock::now() + most;
  while (answers.count(id) == 0 && Clock::now() < end) run(kLook);
  return answers.count(id) > 0;
}

void PageClient::hammer(milliseconds how_long, int rate) {
  const auto begin = Clock::now();
  std::int64_t done = 0;
  while (Clock::now() - begin < how_long) {
    const double passed = std::chrono::duration<double>(Clock::now() - begin).count();
    for (; done < static_cast<std::int64_t>(passed * rate); ++done, ++said)
      say({{"act", "note"}, {"text", "noise"}});
    run(kLook);
  }
}

}  // namespace teletact
