// A lab in a folder of its own, boxes with links, strangers with certificates of any kind, and a
// socket in between that sees the bytes.
#pragma once

#include <gtest/gtest.h>
#include <openssl/ssl.h>

#include <atomic>
#include <filesystem>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "drivers/link/road_link.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/keys/certificate_maker.hpp"
#include "tools/keys/key_lab.hpp"

namespace road_test {

using Bytes = std::vector<std::uint8_t>;
using State = drivers::LinkTransport::State;

inline constexpr std::int64_t kDay_s = 86400;

// For events; a loaded machine makes it slower, not red.
bool wait_for(const std::function<bool()>& done, int seconds = 40);
std::int64_t wall_s();

struct Folder {
  std::string path;
  Folder();
  ~Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
};

// A lab with the boxes 'rover' (robot) and 'ada' (operator).
struct Lab {
  Folder folder;
  std::string at;
  explicit Lab(const std::string& name = "lab");
  std::string box(const std::string& name) const { return at + "/boxes/" + name; }
  std::string issue(rt::Box role, const std::string& name);
  void revoke(const std::string& name);
  // A certificate of this lab with dates of one's own, in box folder `name`.
  void certify(const std::string& name, rt::Box role, std::int64_t from_s, std::int64_t until_s);
};

drivers::RoadOptions listening(const Lab& lab, const std::string& name, rt::Box role);
drivers::RoadOptions dialling(const Lab& lab, const std::string& name, rt::Box role, int port);

// A box: an endpoint with a clock, behind a RoadLink.
struct End {
  rt::Startup startup;
  drivers::LinkEndpoint endpoint;
  rt::BoxTime clock;
  std::unique_ptr<drivers::RoadLink> link;
  std::atomic<int> closed{0}, faults{0}, got{0};
  std::uint64_t made = 0;

  explicit End(const drivers::RoadOptions& options, rt::BoxTime time = {});
  ~End();
  rt::Time now() const { return clock.from_host(rt::monotonic_ns()); }
  // Sends a frame report (operator) or a state (robot) every 5 ms, and counts what comes.
  void talk();
  void start(const std::optional<drivers::LinkShapeConfig>& shape = {});
  bool ready() const { return link->state() == State::kReady; }
  bool alive();  // something new has come
};

// A plain TCP connection to a port of this machine; times out after 20 s.
int dial_plain(int port);

// A hostile TLS client that checks nothing and shows what it likes. `certificate`: a file; what
// follows the first one in it is its chain.
struct RawTls {
  int fd = -1;
  SSL_CTX* context = nullptr;
  SSL* ssl = nullptr;
  bool shaken = false;
  explicit RawTls(int port, const std::string& certificate = {}, const std::string& key = {},
                  int version = TLS1_3_VERSION);
  ~RawTls();
  RawTls(const RawTls&) = delete;
  RawTls& operator=(const RawTls&) = delete;
  void say(const Bytes& bytes);
  Bytes hear(std::size_t most = 4096);  // empty: the end
  // Greets for a control connection: what the answer says, or how it ended.
  Bytes greet(std::uint8_t connection = 0, const Bytes& token = Bytes(16));
};

// Passes bytes both ways between one client after the other and a port; keeps what it saw, and may
// change, hold or end it.
class Proxy {
 public:
  explicit Proxy(int to_port);
  ~Proxy();
  int port() const { return port_; }
  void hold(bool on) { held_.store(on); }               // half-open: nothing passes, nobody is told
  void hold_one(int which) { held_one_.store(which); }  // likewise, of the connections from 0 on
  void cut_all() { cut_.store(true); }
  // Called on what passes from the dialling side, per connection, with the number of bytes before.
  std::function<void(std::size_t before, Bytes& piece)> change;
  void keep() { keep_.store(true); }
  Bytes seen();  // all that has passed since keep(), both ways

 private:
  void run();
  void pass(int client, int server, int which);
  int listen_fd_ = -1, port_ = 0, to_port_;
  std::atomic<bool> stop_{false}, held_{false}, cut_{false}, keep_{false};
  std::atomic<int> held_one_{-1};
  int accepted_ = 0;
  std::mutex mutex_;
  Bytes seen_;
  struct Passing {
    std::thread thread;
    std::shared_ptr<std::atomic<bool>> done;
  };
  std::list<Passing> passing_;
  std::thread thread_;
};

std::size_t resident_kib();

}  // namespace road_test
