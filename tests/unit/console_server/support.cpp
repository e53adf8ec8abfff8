#include "support.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <openssl/evp.h>
#include <openssl/sha.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

namespace console_test {

namespace fs = std::filesystem;

bool wait_for(const std::function<bool()>& done, int seconds) {
  for (int i = 0; i < 100 * seconds; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return done();
}

Folder::Folder() {
  std::string name = (fs::temp_directory_path() / "teletact_console_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) std::abort();
  path = name;
}
Folder::~Folder() {
  std::error_code ignored;
  fs::remove_all(path, ignored);
}
void Folder::write(const std::string& name, const std::string& text) const {
  fs::create_directories(fs::path(path + "/" + name).parent_path());
  std::ofstream(path + "/" + name, std::ios::binary) << text;
}

Wire::Wire(int port, SSL_CTX* tls, int receive_bytes) {
  fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (receive_bytes > 0)
    setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_bytes, sizeof receive_bytes);
  const timeval patience{20, 0};
  setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  setsockopt(fd_, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  good_ = ::connect(fd_, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0;
  if (!good_ || tls == nullptr) return;
  ssl_ = SSL_new(tls);
  SSL_set_fd(ssl_, fd_);
  // SSL_set_tlsext_host_name() is this, with a cast that C++ warns of.
  std::string name = "localhost";
  SSL_ctrl(ssl_, SSL_CTRL_SET_TLSEXT_HOSTNAME, TLSEXT_NAMETYPE_host_name, name.data());
  good_ = SSL_connect(ssl_) == 1;
}
Wire::~Wire() {
  SSL_free(ssl_);
  if (fd_ >= 0) ::close(fd_);
}
bool Wire::send(const std::string& bytes) {
  for (std::size_t at = 0; at < bytes.size();) {
    const auto left = bytes.size() - at;
    const auto n = ssl_ != nullptr ? SSL_write(ssl_, bytes.data() + at, static_cast<int>(left))
                                   : ::send(fd_, bytes.data() + at, left, MSG_NOSIGNAL);
    if (n <= 0) return good_ = false;
    at += static_cast<std::size_t>(n);
  }
  return true;
}
std::string Wire::receive() {
  std::string some(65536, '\0');
  const auto n = ssl_ != nullptr ? SSL_read(ssl_, some.data(), static_cast<int>(some.size()))
                                 : ::recv(fd_, some.data(), some.size(), 0);
  if (n <= 0) good_ = false;
  some.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
  return some;
}

std::string Reply::header(const std::string& name) const {
  std::string lower = head;
  std::transform(lower.begin(), lower.end(), lower.begin(), [](char c) { return std::tolower(c); });
  const std::size_t at = lower.find("\r\n" + name + ": ");
  if (at == std::string::npos) return "";
  const std::size_t from = at + name.size() + 4;
  return head.substr(from, head.find("\r\n", from) - from);
}

Reply read_reply(Wire& wire) {
  Reply r;
  std::string in;
  std::size_t end = 0;
  while ((end = in.find("\r\n\r\n")) == std::string::npos) {
    const std::string some = wire.receive();
    if (some.empty()) return r;
    in += some;
  }
  r.head = in.substr(0, end + 2);
  r.body = in.substr(end + 4);
  r.status = std::atoi(r.head.c_str() + std::min<std::size_t>(9, r.head.size()));
  const std::size_t length = std::strtoull(r.header("content-length").c_str(), nullptr, 10);
  while (r.body.size() < length) {
    const std::string some = wire.receive();
    if (some.empty()) break;
    r.body += some;
  }
  return r;
}

int Frame::close_code() const {
  return payload.size() < 2
             ? -1
             : 256 * static_cast<std::uint8_t>(payload[0]) + static_cast<std::uint8_t>(payload[1]);
}
std::uint32_t Frame::sequence() const {
  std::uint32_t v = 0;
  if (payload.size() < 24) return ~v;
  for (std::size_t i = 0; i < 4; ++i)
    v |= std::uint32_t{static_cast<std::uint8_t>(payload.at(4 + i))} << (8 * i);
  return v;
}

Socket::Socket(int port, const std::string& head, SSL_CTX* tls, int receive_bytes)
    : wire_(std::make_unique<Wire>(port, tls, receive_bytes)) {
  if (!wire_->send(head)) return;
  reply_ = read_reply(*wire_);
  if (reply_.status == 101) in_ = std::exchange(reply_.body, {});
}

bool Socket::frame(int opcode, const std::string& payload) {
  std::string out(1, static_cast<char>(0x80 | opcode));
  const std::size_t n = payload.size();
  if (n < 126) {
    out += static_cast<char>(0x80 | n);
  } else {
    out += static_cast<char>(0x80 | 126);
    out += static_cast<char>(n >> 8U);
    out += static_cast<char>(n & 255U);
  }
  static constexpr char kMask[] = {0x11, 0x22, 0x33, 0x44};
  out.append(kMask, 4);
  for (std::size_t i = 0; i < n; ++i) out += static_cast<char>(payload[i] ^ kMask[i % 4]);
  return wire_->send(out);
}

bool Socket::need(std::size_t bytes) {
  while (in_.size() < bytes) {
    const std::string some = wire_->receive();
    if (some.empty()) return false;
    in_ += some;
  }
  return true;
}

Frame Socket::next() {
  for (;;) {
    if (!need(2)) return {};
    const auto byte = [&](std::size_t i) {
      return std::uint64_t{static_cast<std::uint8_t>(in_[i])};
    };
    std::size_t head = 2;
    std::uint64_t n = byte(1) & 127U;
    if (n >= 126) {
      const std::size_t more = n == 126 ? 2 : 8;
      if (!need(2 + more)) return {};
      n = 0;
      for (std::size_t i = 0; i < more; ++i) n = n << 8U | byte(2 + i);
      head += more;
    }
    if (!need(head + n)) return {};
    Frame f{static_cast<int>(byte(0) & 15U), in_.substr(head, n)};
    EXPECT_EQ(byte(0) & 0x80U, 0x80U) << "not in one piece";
    EXPECT_EQ(byte(1) & 0x80U, 0U) << "a server does not mask";
    in_.erase(0, head + n);
    if (f.opcode != 9) return f;
    frame(10, f.payload);
  }
}

Frame Socket::next(int kind) {
  for (;;) {
    Frame f = next();
    if (f.opcode != 2 || f.kind() == kind) return f;
  }
}

std::string Socket::answer() {
  const Frame f = next(7);
  return f.opcode == 2 ? f.body() : "closed " + std::to_string(f.close_code());
}

int Socket::close_code() {
  for (;;) {
    const Frame f = next();
    if (f.opcode == 8) {
      frame(8, f.payload);
      return f.close_code();
    }
    if (f.opcode < 0) return -1;
  }
}

void Console::SetUp() {
  folder_.write("page/index.html", "<!doctype html><title>t</title>");
  folder_.write("page/assets/main.js", "export const x = 1;\n");
  folder_.write("secret.txt", "not for you");
  options_.page_folder = folder_.path + "/page";
  callbacks_.on_act = [this](const teletact::ConsoleAct& a) {
    ++acts_;
    const std::lock_guard held(mutex_);
    seen_.push_back(std::to_string(a.from.session) + " " + std::string(a.act) + " " +
                    std::to_string(a.id));
    return std::optional(teletact::ConsoleAnswer{true, "", ""});
  };
  callbacks_.on_stop = [this](const teletact::ConsolePerson&) { ++stops_; };
  callbacks_.on_role = [this](const teletact::RoleEvent& e) {
    const std::lock_guard held(mutex_);
    events_.push_back(e);
  };
}

void Console::start() {
  auto made = teletact::ConsoleServer::start(options_, callbacks_);
  ASSERT_TRUE(made) << made.error();
  server_ = std::move(made).value();
}

std::vector<teletact::RoleEvent> Console::events() {
  const std::lock_guard held(mutex_);
  return events_;
}

std::string Console::fresh_code() {
  const std::string url = server_->url();
  return url.substr(url.find("#code=") + 6);
}

Reply Console::ask(const std::string& request) {
  Wire wire(server_->port(), tls_);
  if (!wire.good() || !wire.send(request)) return {};
  return read_reply(wire);
}

Reply Console::get(const std::string& path, const std::string& more) {
  return ask("GET " + path + " HTTP/1.1\r\nHost: " + host() + "\r\n" + more + "\r\n");
}

Reply Console::post(const std::string& path, const std::string& body, const std::string& more) {
  return ask("POST " + path + " HTTP/1.1\r\nHost: " + host() + "\r\nOrigin: " + origin() +
             "\r\nContent-Type: application/json\r\nContent-Length: " +
             std::to_string(body.size()) + "\r\n" + more + "\r\n" + body);
}

std::string Console::join(const std::string& code) {
  const Reply r = post("/session", "{\"code\":\"" + code + "\"}");
  EXPECT_EQ(r.status, 200) << r.head << r.body;
  const std::string cookie = r.header("set-cookie");
  return cookie.substr(0, cookie.find(';'));
}

std::string Console::join_viewer(const std::string& operator_cookie) {
  const Reply r = post("/view-link", "{}", "Cookie: " + operator_cookie + "\r\n");
  EXPECT_EQ(r.status, 200) << r.body;
  return join(r.body.substr(9, 32));  // {"code":"...
}

std::string Console::upgrade_head(const std::string& cookie, const std::string& more) const {
  return "GET /ws HTTP/1.1\r\nHost: " + host() +
         "\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
         "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n" +
         (cookie.empty() ? "" : "Cookie: " + cookie + "\r\n") +
         (more.empty() ? "Origin: " + origin() + "\r\nSec-WebSocket-Protocol: teletact.1\r\n"
                       : more) +
         "\r\n";
}

std::unique_ptr<Socket> Console::open(const std::string& cookie, int receive_bytes) {
  auto s = std::make_unique<Socket>(server_->port(), upgrade_head(cookie), tls_, receive_bytes);
  EXPECT_EQ(s->status(), 101) << s->reply().head << s->reply().body;
  return s;
}

}  // namespace console_test
