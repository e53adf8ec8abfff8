// Over the wire: the page's files, sessions, and everything that must be refused.
#include <arpa/inet.h>
#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <thread>

#include "support.hpp"

namespace console_test {
namespace {

using teletact::Refusal;
using teletact::RoleEvent;
using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

TEST_F(Console, ServesThePageWithItsPolicy) {
  start();
  const Reply index = get("/");
  EXPECT_EQ(index.status, 200);
  EXPECT_EQ(index.body, "<!doctype html><title>t</title>");
  EXPECT_EQ(index.header("content-type"), "text/html; charset=utf-8");
  EXPECT_THAT(index.header("content-security-policy"), StartsWith("default-src 'self'"));
  EXPECT_EQ(index.header("x-content-type-options"), "nosniff");
  const Reply script = get("/assets/main.js?v=1");
  EXPECT_EQ(script.status, 200);
  EXPECT_EQ(script.header("content-type"), "text/javascript; charset=utf-8");
  folder_.write("page/assets/main.js", "export const x = 22;\n");
  EXPECT_EQ(get("/assets/main.js").body, "export const x = 22;\n") << "built again";
}

// Sockets of this process whose own end is the port: the listening one, and those it has accepted.
std::vector<int> sockets_at(int port) {
  std::vector<int> out;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const int fd = std::stoi(entry.path().filename().string());
    sockaddr_in at{};
    socklen_t size = sizeof at;
    if (::getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size) == 0 &&
        at.sin_family == AF_INET && ntohs(at.sin_port) == port)
      out.push_back(fd);
  }
  return out;
}

// Whatever is started meanwhile: after a crash of the box the port is free for the next one.
TEST_F(Console, NoProgramThatIsStartedInheritsItsSockets) {
  start();
  Wire wire(server_->port());
  ASSERT_TRUE(wire.good());
  ASSERT_TRUE(wait_for([&] { return server_->counts().connections == 1; }));
  const auto all = sockets_at(server_->port());
  EXPECT_EQ(all.size(), 2U);
  for (const int fd : all) EXPECT_NE(::fcntl(fd, F_GETFD) & FD_CLOEXEC, 0) << fd;
}

TEST_F(Console, NoPathLeadsOutOfTheFolder) {
  std::filesystem::create_symlink(folder_.path + "/secret.txt", folder_.path + "/page/link.txt");
  std::filesystem::create_directory_symlink(folder_.path, folder_.path + "/page/up");
  start();
  int n = 0;
  for (const char* path : {"/../secret.txt", "/assets/../../secret.txt", "/%2e%2e/secret.txt",
                           "/..%2fsecret.txt", "/link.txt", "/up/secret.txt", "/assets", "/assets/",
                           "/.", "//etc/passwd", "/etc/passwd", "/none.js"}) {
    const Reply r = get(path);
    EXPECT_EQ(r.status, 404) << path;
    EXPECT_THAT(r.body, Not(HasSubstr("not for you"))) << path;
    EXPECT_EQ(refused(Refusal::kPath), static_cast<std::uint64_t>(++n)) << path;
  }
}

TEST_F(Console, ACodeMakesOneSession) {
  start();
  EXPECT_THAT(server_->url(), StartsWith("http://" + host() + "/#code="));
  const std::string code = fresh_code();
  const Reply r = post("/session", "{\"code\":\"" + code + "\"}");
  EXPECT_EQ(r.status, 200);
  EXPECT_EQ(r.body, "{\"role\":\"operator\"}");
  const std::string cookie = r.header("set-cookie");
  EXPECT_THAT(cookie, StartsWith("teletact_" + std::to_string(server_->port()) + "="));
  EXPECT_THAT(cookie, HasSubstr("; HttpOnly; SameSite=Strict"));
  EXPECT_EQ(get("/session", "Cookie: " + cookie.substr(0, cookie.find(';')) + "\r\n").body, r.body);
  EXPECT_EQ(get("/session").status, 401);
  EXPECT_EQ(get("/session", "Cookie: " + cookie.substr(0, 14) + "=00\r\n").status, 401);
  const Reply again = post("/session", "{\"code\":\"" + code + "\"}");
  EXPECT_EQ(again.status, 403) << "used";
  EXPECT_EQ(again.header("set-cookie"), "");
  EXPECT_EQ(post("/session", "{\"code\":\"" + std::string(32, '0') + "\"}").status, 403);
  EXPECT_EQ(post("/session", "{}").status, 403);
  EXPECT_EQ(refused(Refusal::kCode), 3U);
  EXPECT_EQ(refused(Refusal::kSession), 2U);
}

TEST_F(Console, CodesAreTriedAtMost20TimesASecond) {
  start();
  int forbidden = 0, limited = 0;
  for (int i = 0; i < 40; ++i) {
    const int status = post("/session", "{\"code\":\"" + std::string(32, 'b') + "\"}").status;
    forbidden += status == 403 ? 1 : 0;
    limited += status == 429 ? 1 : 0;
  }
  EXPECT_EQ(forbidden + limited, 40);
  EXPECT_GE(forbidden, 20);
  EXPECT_EQ(refused(Refusal::kRate), static_cast<std::uint64_t>(limited));
}

TEST_F(Console, AStrangersNameIsRefusedEverywhere) {
  start();
  const std::string cookie = join_operator();
  const std::string rest = "Cookie: " + cookie + "\r\n\r\n";
  EXPECT_EQ(ask("GET / HTTP/1.1\r\nHost: evil.example\r\n" + rest).status, 421);
  EXPECT_EQ(ask("GET / HTTP/1.1\r\n" + rest).status, 421);
  EXPECT_EQ(ask("GET / HTTP/1.1\r\nHost: " + host() + "\r\nHost: evil.example\r\n" + rest).status,
            421);
  EXPECT_EQ(ask("POST /stop HTTP/1.1\r\nHost: evil.example\r\nOrigin: http://evil.example\r\n"
                "Content-Type: application/json\r\n" +
                rest)
                .status,
            421);
  EXPECT_EQ(refused(Refusal::kHost), 4U);
  EXPECT_EQ(stops_, 0);
}

TEST_F(Console, APageOfAnotherOriginMovesNothing) {
  start();
  const std::string cookie = join_operator(), head = "POST /stop HTTP/1.1\r\nHost: " + host() +
                                                     "\r\nCookie: " + cookie +
                                                     "\r\nContent-Length: 0\r\n";
  const std::string json = "Content-Type: application/json\r\n";
  EXPECT_EQ(ask(head + json + "\r\n").status, 403) << "no origin";
  EXPECT_EQ(ask(head + json + "Origin: http://evil.example\r\n\r\n").status, 403);
  EXPECT_EQ(ask(head + json + "Origin: null\r\n\r\n").status, 403);
  EXPECT_EQ(ask(head + json + "Origin: http://127.0.0.1:1\r\n\r\n").status, 403)
      << "another server of this host";
  EXPECT_EQ(ask(head + "Content-Type: text/plain\r\nOrigin: " + origin() + "\r\n\r\n").status, 415)
      << "what a form can send";
  for (const std::string& o : {std::string("http://evil.example"), std::string("null"),
                               "http://localhost:" + std::to_string(server_->port())}) {
    const Socket s(
        server_->port(),
        upgrade_head(cookie, "Origin: " + o + "\r\nSec-WebSocket-Protocol: teletact.1\r\n"));
    EXPECT_EQ(s.status(), 403) << o;
  }
  const Socket bare(server_->port(),
                    upgrade_head(cookie, "Sec-WebSocket-Protocol: teletact.1\r\n"));
  EXPECT_EQ(bare.status(), 403) << "no origin";
  EXPECT_EQ(refused(Refusal::kOrigin), 8U);
  EXPECT_EQ(stops_, 0);
  EXPECT_EQ(server_->viewers(), 0);
}

// A proxy that ends TLS: it leaves the name and the path, or takes them away.
TEST_F(Console, ThePublicAddressIsReachedThroughAProxy) {
  options_.public_url = "https://lab.example/rover/";
  start();
  const std::string here = "https://lab.example/rover/#code=";
  const auto code = [&] { return server_->url().substr(here.size()); };
  EXPECT_THAT(server_->url(), StartsWith(here));
  const std::string origin_line = "Origin: https://lab.example\r\n";
  for (const std::string& name : {std::string("lab.example"), host()}) {
    for (const std::string& path : {std::string("/rover"), std::string()}) {
      const std::string host_line = " HTTP/1.1\r\nHost: " + name + "\r\n";
      EXPECT_EQ(ask("GET " + path + "/" + host_line + "\r\n").status, 200);
      const std::string body = R"({"code":")" + code() + R"("})";
      const Reply joined =
          ask("POST " + path + "/session" + host_line + origin_line +
              "Content-Type: application/json\r\nContent-Length: " + std::to_string(body.size()) +
              "\r\n\r\n" + body);
      EXPECT_EQ(joined.status, 200) << joined.body;
      const std::string cookie = joined.header("set-cookie");
      EXPECT_THAT(cookie, HasSubstr("; Path=/rover/;"));
      EXPECT_THAT(cookie, HasSubstr("; Secure"));
      const std::string known = "Cookie: " + cookie.substr(0, cookie.find(';')) + "\r\n";
      EXPECT_EQ(ask("GET " + path + "/session" + host_line + known + "\r\n").status, 200);
      const std::string key =
          "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
          "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: teletact.1\r\n";
      const Socket socket(server_->port(),
                          "GET " + path + "/ws" + host_line + origin_line + known + key + "\r\n");
      EXPECT_EQ(socket.status(), 101);
      const int before = stops_;
      EXPECT_EQ(ask("POST " + path + "/stop" + host_line + origin_line + known +
                    "Content-Type: application/json\r\nContent-Length: 0\r\n\r\n")
                    .status,
                200);
      EXPECT_EQ(stops_, before + 1);
      for (const char* bad : {"http://lab.example", "https://evil.example", "null"}) {
        EXPECT_EQ(ask("POST " + path + "/stop" + host_line + "Origin: " + bad + "\r\n" + known +
                      "Content-Type: application/json\r\nContent-Length: 0\r\n\r\n")
                      .status,
                  403)
            << bad;
      }
      EXPECT_EQ(stops_, before + 1);
    }
  }
  const Reply moved = ask("GET /rover HTTP/1.1\r\nHost: lab.example\r\n\r\n");
  EXPECT_EQ(moved.status, 308);
  EXPECT_EQ(moved.header("location"), "/rover/");
  // By its own address it is as ever.
  const std::string own = join(code());
  EXPECT_EQ(get("/session", "Cookie: " + own + "\r\n").status, 200);
}

TEST_F(Console, WhoComesByAnotherWayIsToldWhatToDo) {
  start();
  const std::string port = std::to_string(server_->port());
  const Reply tunnel = ask("GET / HTTP/1.1\r\nHost: localhost:1\r\n\r\n");
  EXPECT_EQ(tunnel.status, 421);
  EXPECT_THAT(tunnel.body, HasSubstr("--console-public"));
  EXPECT_THAT(tunnel.body, HasSubstr("ssh -L " + port + ":127.0.0.1:" + port));
  const Reply proxy = ask("POST /session HTTP/1.1\r\nHost: " + host() +
                          "\r\nOrigin: https://lab.example\r\nContent-Type: application/json\r\n"
                          "Content-Length: 2\r\n\r\n{}");
  EXPECT_EQ(proxy.status, 403);
  EXPECT_THAT(proxy.body, HasSubstr("--console-public"));
}

// Two robots' pages, each by a tunnel of its own to the same desk.
TEST_F(Console, TunnelsToOneHostHaveCookiesOfTheirOwn) {
  std::vector<std::string> names;
  for (const char* port : {"9000", "9001"}) {
    server_.reset();
    options_.public_url = std::string("http://localhost:") + port;
    start();
    const std::string cookie = join(server_->url().substr(server_->url().find('=') + 1));
    names.push_back(cookie.substr(0, cookie.find('=')));
    EXPECT_THAT(names.back(), EndsWith(std::string("_") + port));
  }
}

TEST_F(Console, AWebSocketWantsASessionAndTheProtocol) {
  start();
  EXPECT_EQ(Socket(server_->port(), upgrade_head("")).status(), 401);
  EXPECT_EQ(Socket(server_->port(), upgrade_head("teletact_1=aa")).status(), 401);
  const std::string cookie = join_operator();
  EXPECT_EQ(
      Socket(server_->port(),
             upgrade_head(cookie, "Origin: " + origin() + "\r\nSec-WebSocket-Protocol: chat\r\n"))
          .status(),
      400);
  EXPECT_EQ(get("/ws", "Cookie: " + cookie + "\r\n").status, 426);
  const auto good = open(cookie);
  EXPECT_EQ(good->reply().header("sec-websocket-accept"), "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=")
      << "the key's answer of RFC 6455, 1.3";
  EXPECT_EQ(good->reply().header("sec-websocket-protocol"), "teletact.1");
  EXPECT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
}

TEST_F(Console, RequestsThatAreNoneOrTooLongAreRefused) {
  start();
  EXPECT_EQ(ask("nonsense\r\n\r\n").status, 400);
  EXPECT_EQ(ask("GET /" + std::string(9000, 'a') + " HTTP/1.1\r\n\r\n").status, 431);
  EXPECT_EQ(post("/session", std::string(2000, ' ')).status, 413);
  EXPECT_EQ(
      ask("PUT / HTTP/1.1\r\nHost: " + host() + "\r\nOrigin: " + origin() + "\r\n\r\n").status,
      405);
  EXPECT_GE(refused(Refusal::kRequest), 4U);
  EXPECT_EQ(get("/").status, 200);
}

TEST_F(Console, ARequestThatNeverEndsIsCutAndACrowdKeepsNobodyOut) {
  options_.request_limit = std::chrono::milliseconds{400};
  options_.most_connections = 16;
  start();
  {
    Wire slow(server_->port());
    ASSERT_TRUE(slow.send("GET / HTTP/1.1\r\nHost: "));
    EXPECT_EQ(slow.receive(), "") << "closed";
    EXPECT_TRUE(wait_for([&] { return refused(Refusal::kLate) == 1; }));
  }
  options_.request_limit = std::chrono::seconds{60};
  start();
  std::vector<std::unique_ptr<Wire>> crowd;
  for (int i = 0; i < 60; ++i) {
    crowd.push_back(std::make_unique<Wire>(server_->port()));
    crowd.back()->send("GET");
  }
  EXPECT_EQ(get("/").status, 200);
  EXPECT_TRUE(wait_for([&] { return refused(Refusal::kCrowded) >= 40; }));
}

TEST_F(Console, TheStopNeedsASessionAndNoRole) {
  start();
  EXPECT_EQ(post("/stop", "").status, 401);
  EXPECT_EQ(stops_, 0);
  const std::string cookie = join_operator(), viewer = join_viewer(cookie);
  EXPECT_EQ(post("/stop", "", "Cookie: " + cookie + "\r\n").status, 200);
  EXPECT_EQ(post("/stop", "{}", "Cookie: " + viewer + "\r\n").status, 200);
  EXPECT_EQ(stops_, 2);
  EXPECT_EQ(server_->counts().stops, 2U);
  EXPECT_EQ(post("/view-link", "{}", "Cookie: " + viewer + "\r\n").status, 403);
  EXPECT_EQ(refused(Refusal::kRole), 1U);
}

TEST_F(Console, SetUpThatIsWrongIsOneLine) {
  const auto error = [&](auto spoil) {
    auto o = options_;
    spoil(o);
    const auto made = teletact::ConsoleServer::start(o, {});
    return made ? std::string("started") : made.error();
  };
  EXPECT_THAT(error([](auto& o) { o.page_folder = "/nowhere"; }), HasSubstr("/nowhere"));
  EXPECT_THAT(error([&](auto& o) { o.page_folder = folder_.path; }), HasSubstr("index.html"));
  EXPECT_THAT(error([](auto& o) { o.address = "localhost"; }), HasSubstr("numeric"));
  EXPECT_THAT(error([](auto& o) { o.address = "0.0.0.0"; }), HasSubstr("keys are needed"));
  EXPECT_THAT(error([](auto& o) { o.port = 70000; }), HasSubstr("70000"));
  EXPECT_THAT(error([](auto& o) { o.public_url = "lab.example"; }), HasSubstr("lab.example"));
  EXPECT_THAT(error([](auto& o) { o.public_url = "http://lab.example"; }),
              HasSubstr("http:// with localhost"));
  EXPECT_THAT(error([&](auto& o) { o.keys = folder_.path; }), HasSubstr("ca.crt"));
  start();
  EXPECT_THAT(error([&](auto& o) { o.port = server_->port(); }), HasSubstr("in use"));
}

// Before a run has measured for half a minute what it never starts.
TEST_F(Console, WhatWouldNotStartIsKnownBefore) {
  using teletact::ConsoleServer;
  EXPECT_EQ(ConsoleServer::problem(options_), "");
  const auto why = [&](auto change) {
    teletact::ConsoleOptions o = options_;
    change(o);
    const std::string said = ConsoleServer::problem(o);
    const auto made = ConsoleServer::start(o, callbacks_);
    EXPECT_EQ(made ? std::string() : made.error(), said);
    return said;
  };
  EXPECT_THAT(why([](auto& o) { o.address = "0.0.0.0"; }), HasSubstr("keys are needed"));
  EXPECT_THAT(why([](auto& o) { o.address = "here"; }), HasSubstr("numeric"));
  EXPECT_THAT(why([](auto& o) { o.page_folder += "/none"; }), HasSubstr("page folder"));
  EXPECT_THAT(why([&](auto& o) { o.keys = folder_.path; }), HasSubstr(folder_.path));
  start();
  const int taken = server_->port();
  EXPECT_THAT(why([&](auto& o) { o.port = taken; }), HasSubstr("Address already in use"));
  // A port that was tried is free again.
  server_.reset();
  options_.port = taken;
  EXPECT_EQ(ConsoleServer::problem(options_), "");
  start();
  EXPECT_EQ(server_->port(), taken);
}

}  // namespace
}  // namespace console_test
