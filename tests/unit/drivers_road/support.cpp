#include "tests/unit/drivers_road/support.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <ctime>
#include <fstream>

namespace road_test {

namespace fs = std::filesystem;

bool wait_for(const std::function<bool()>& done, int seconds) {
  for (int i = 0; i < seconds * 500; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return false;
}

std::int64_t wall_s() { return std::time(nullptr); }

Folder::Folder() {
  std::string name = (fs::temp_directory_path() / "teletact_road_XXXXXX").string();
  EXPECT_NE(mkdtemp(name.data()), nullptr);
  path = name;
}
Folder::~Folder() {
  std::error_code ignored;
  fs::remove_all(path, ignored);
}

Lab::Lab(const std::string& name) : at(folder.path + "/lab") {
  const auto made = teletact::KeyLab::init(at, name, 3650, wall_s());
  EXPECT_TRUE(made) << (made ? "" : made.error());
  issue(rt::Box::kRobot, "rover");
  issue(rt::Box::kOperator, "ada");
}

std::string Lab::issue(rt::Box role, const std::string& name) {
  auto lab = teletact::KeyLab::open(at);
  EXPECT_TRUE(lab) << (lab ? "" : lab.error());
  auto where = lab.value().issue(role, name, 365, wall_s());
  EXPECT_TRUE(where) << (where ? "" : where.error());
  return where ? where.value() : "";
}

void Lab::revoke(const std::string& name) {
  auto lab = teletact::KeyLab::open(at);
  ASSERT_TRUE(lab);
  const auto n = lab.value().revoke(name, wall_s());
  ASSERT_TRUE(n) << n.error();
  EXPECT_GE(n.value(), 1);
}

void Lab::certify(const std::string& name, rt::Box role, std::int64_t from_s,
                  std::int64_t until_s) {
  auto ca = drivers::read_certificate(at + "/ca.crt");
  auto ca_key = drivers::read_key(at + "/ca.key");
  auto key = drivers::read_key(box(name) + "/box.key");
  ASSERT_TRUE(ca && ca_key && key);
  auto made = teletact::make_certificate({name, drivers::role_name(role), from_s, until_s, false},
                                         *key.value(), ca.value().get(), *ca_key.value());
  ASSERT_TRUE(made);
  std::ofstream(box(name) + "/box.crt", std::ios::trunc) << teletact::pem_of(*made.value());
}

drivers::RoadOptions listening(const Lab& lab, const std::string& name, rt::Box role) {
  drivers::RoadOptions o;
  o.role = role;
  o.listen = true;
  o.address = "127.0.0.1";
  o.keys = lab.box(name);
  o.rate_Mbit_per_s = 0;
  o.reread_period = std::chrono::milliseconds{50};
  return o;
}

drivers::RoadOptions dialling(const Lab& lab, const std::string& name, rt::Box role, int port) {
  drivers::RoadOptions o = listening(lab, name, role);
  o.listen = false;
  o.port = port;
  o.redial_first = std::chrono::milliseconds{10};
  o.redial_most = std::chrono::milliseconds{100};
  return o;
}

End::End(const drivers::RoadOptions& options, rt::BoxTime time)
    : endpoint(startup.token(), options.role), clock(time) {
  auto opened = drivers::RoadLink::open(options);
  EXPECT_TRUE(opened) << (opened ? "" : opened.error());
  if (opened) link = std::move(opened).value();
}

End::~End() {
  if (link) link->stop();
}

void End::talk() {
  const bool robot = endpoint.box() == rt::Box::kRobot;
  endpoint.add_outgoing(robot ? drivers::MessageId::kRobotState : drivers::MessageId::kFrameReport,
                        rt::Nanos{5'000'000}, false, [this, robot](std::span<std::uint8_t> out) {
                          ++made;
                          if (!robot) return encode(drivers::FrameReport{made, 0}, out);
                          drivers::RobotState s;
                          s.seq = made;
                          s.taken = now();
                          return encode(s, out);
                        });
  endpoint.add_incoming(robot ? drivers::MessageId::kFrameReport : drivers::MessageId::kRobotState,
                        [this](std::span<const std::uint8_t>, rt::Time) {
                          ++got;
                          return true;
                        });
}

void End::start(const std::optional<drivers::LinkShapeConfig>& shape) {
  link->start(
      endpoint, [this] { return now(); }, shape,
      [this] {
        closed += link->state() == State::kClosed ? 1 : 0;
        faults += link->state() == State::kFault ? 1 : 0;
      });
}

bool End::alive() {
  const int before = got;
  return wait_for([&] { return got > before + 3; });
}

int dial_plain(int port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  timeval limit{20, 0};
  ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  ::setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_port = htons(static_cast<std::uint16_t>(port));
  a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a), 0);
  return fd;
}

RawTls::RawTls(int port, const std::string& certificate, const std::string& key, int version) {
  // At an end of the connection OpenSSL still sends an alert.
  ::signal(SIGPIPE, SIG_IGN);
  fd = dial_plain(port);
  context = SSL_CTX_new(TLS_method());
  SSL_CTX_set_min_proto_version(context, version);
  SSL_CTX_set_max_proto_version(context, version);
  SSL_CTX_set_verify(context, SSL_VERIFY_NONE, nullptr);
  if (!certificate.empty()) {
    EXPECT_EQ(SSL_CTX_use_certificate_chain_file(context, certificate.c_str()), 1);
    EXPECT_EQ(SSL_CTX_use_PrivateKey_file(context, key.c_str(), SSL_FILETYPE_PEM), 1);
  }
  ssl = SSL_new(context);
  SSL_set_fd(ssl, fd);
  shaken = SSL_connect(ssl) == 1;
}

RawTls::~RawTls() {
  SSL_free(ssl);
  SSL_CTX_free(context);
  ::close(fd);
}

void RawTls::say(const Bytes& bytes) {
  if (!bytes.empty()) (void)!SSL_write(ssl, bytes.data(), static_cast<int>(bytes.size()));
}

Bytes RawTls::hear(std::size_t most) {
  Bytes b(most);
  const int n = SSL_read(ssl, b.data(), static_cast<int>(most));
  b.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
  return b;
}

Bytes RawTls::greet(std::uint8_t connection, const Bytes& token) {
  Bytes b{'R', 'D', 1, 1, 17, 0, 0, 0, connection};
  b.insert(b.end(), token.begin(), token.end());
  say(b);
  return hear();
}

Proxy::Proxy(int to_port) : to_port_(to_port) {
  listen_fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof a;
  EXPECT_EQ(::bind(listen_fd_, reinterpret_cast<const sockaddr*>(&a), sizeof a), 0);
  EXPECT_EQ(::listen(listen_fd_, 16), 0);
  ::getsockname(listen_fd_, reinterpret_cast<sockaddr*>(&a), &size);
  port_ = ntohs(a.sin_port);
  thread_ = std::thread([this] { run(); });
}

Proxy::~Proxy() {
  stop_.store(true);
  thread_.join();
  for (auto& p : passing_) p.thread.join();
  ::close(listen_fd_);
}

void Proxy::run() {
  while (!stop_.load()) {
    pollfd p{listen_fd_, POLLIN, 0};
    if (::poll(&p, 1, 5) <= 0) continue;
    const int client = ::accept4(listen_fd_, nullptr, nullptr, SOCK_CLOEXEC);
    if (client < 0) continue;
    cut_.store(false);
    passing_.remove_if([](Passing& old) {
      if (!old.done->load()) return false;
      old.thread.join();
      return true;
    });
    auto done = std::make_shared<std::atomic<bool>>(false);
    passing_.push_back({std::thread([this, client, done, which = accepted_++] {
                          pass(client, dial_plain(to_port_), which);
                          done->store(true);
                        }),
                        done});
  }
}

void Proxy::pass(int client, int server, int which) {
  std::size_t before = 0;
  Bytes piece(16384);
  while (!stop_.load() && !cut_.load()) {
    if (held_.load() || held_one_.load() == which) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      continue;
    }
    pollfd p[2] = {{client, POLLIN, 0}, {server, POLLIN, 0}};
    if (::poll(p, 2, 2) <= 0) continue;
    bool open = true;
    for (const int side : {0, 1}) {
      if ((p[side].revents & (POLLIN | POLLHUP | POLLERR)) == 0) continue;
      piece.resize(16384);
      const ssize_t n = ::recv(side == 0 ? client : server, piece.data(), piece.size(), 0);
      if (n <= 0) {
        open = false;
        break;
      }
      piece.resize(static_cast<std::size_t>(n));
      if (side == 0 && change) change(before, piece);
      if (side == 0) before += static_cast<std::size_t>(n);
      if (keep_.load()) {
        const std::lock_guard lock(mutex_);
        seen_.insert(seen_.end(), piece.begin(), piece.end());
      }
      (void)!::send(side == 0 ? server : client, piece.data(), piece.size(), MSG_NOSIGNAL);
    }
    if (!open) break;
  }
  ::close(client);
  ::close(server);
}

Bytes Proxy::seen() {
  const std::lock_guard lock(mutex_);
  return seen_;
}

std::size_t resident_kib() {
  long pages = 0, resident = 0;
  std::FILE* f = std::fopen("/proc/self/statm", "r");
  if (f == nullptr || std::fscanf(f, "%ld %ld", &pages, &resident) != 2) resident = 0;
  if (f != nullptr) std::fclose(f);
  return static_cast<std::size_t>(resident) * 4;
}

}  // namespace road_test
