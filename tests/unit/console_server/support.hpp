// A server with a page on disk, and browsers that share no code with it: sockets, HTTP and
// WebSocket frames by hand, TLS by OpenSSL.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openssl/ssl.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "tools/console/console_server.hpp"

namespace console_test {

using Bytes = std::vector<std::uint8_t>;

// For events; a loaded machine makes it slower, not red.
bool wait_for(const std::function<bool()>& done, int seconds = 40);

struct Folder {
  std::string path;
  Folder();
  ~Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  void write(const std::string& name, const std::string& text) const;
};

// A connection to a port of this machine; reads give up after 20 s.
class Wire {
 public:
  explicit Wire(int port, SSL_CTX* tls = nullptr, int receive_bytes = 0);
  ~Wire();
  Wire(const Wire&) = delete;
  Wire& operator=(const Wire&) = delete;
  bool send(const std::string& bytes);
  // "" at the end, or when nothing comes for 20 s.
  std::string receive();
  bool good() const { return good_; }
  int fd() const { return fd_; }

 private:
  int fd_ = -1;
  SSL* ssl_ = nullptr;
  bool good_ = false;
};

struct Reply {
  int status = 0;  // 0: closed without one
  std::string head, body;
  std::string header(const std::string& name) const;  // lower-case name
};
// One reply from a wire that may have more behind it.
Reply read_reply(Wire& wire);

struct Frame {
  int opcode = -1;  // -1: the wire ended without a frame; 8: close
  std::string payload;
  int close_code() const;
  int kind() const { return payload.empty() ? 0 : static_cast<std::uint8_t>(payload[0]); }
  std::uint32_t sequence() const;
  std::string body() const { return payload.size() < 24 ? "" : payload.substr(24); }
};

class Socket {
 public:
  Socket(int port, const std::string& head, SSL_CTX* tls = nullptr, int receive_bytes = 0);
  int status() const { return reply_.status; }
  const Reply& reply() const { return reply_; }
  bool text(const std::string& payload) { return frame(1, payload); }
  bool frame(int opcode, const std::string& payload);
  Frame next();          // answers pings itself
  Frame next(int kind);  // views of other kinds are thrown away
  std::string answer();  // body of the next answer
  int close_code();      // reads on to the end; -1: ended without a close frame
  Wire& wire() { return *wire_; }

 private:
  bool need(std::size_t bytes);
  std::unique_ptr<Wire> wire_;
  Reply reply_;
  std::string in_;
};

class Console : public ::testing::Test {
 protected:
  void SetUp() override;
  void TearDown() override { server_.reset(); }
  void start();

  std::string host() const { return "127.0.0.1:" + std::to_string(server_->port()); }
  std::string origin() const { return (tls_ ? "https://" : "http://") + host(); }
  std::string fresh_code();
  Reply ask(const std::string& request);
  Reply get(const std::string& path, const std::string& more = "");
  Reply post(const std::string& path, const std::string& body, const std::string& more = "");
  // The cookie ("name=value") of a new session.
  std::string join(const std::string& code);
  std::string join_operator() { return join(fresh_code()); }
  std::string join_viewer(const std::string& operator_cookie);
  std::string upgrade_head(const std::string& cookie, const std::string& more = "") const;
  std::unique_ptr<Socket> open(const std::string& cookie, int receive_bytes = 0);
  std::uint64_t refused(teletact::Refusal r) const { return server_->counts().of(r); }
  std::vector<teletact::RoleEvent> events();

  Folder folder_;
  teletact::ConsoleOptions options_;
  teletact::ConsoleCallbacks callbacks_;
  std::unique_ptr<teletact::ConsoleServer> server_;
  SSL_CTX* tls_ = nullptr;
  std::atomic<int> acts_{0}, stops_{0};
  std::mutex mutex_;
  std::vector<teletact::RoleEvent> events_;
  std::vector<std::string> seen_;  // "session act id"
};

}  // namespace console_test
