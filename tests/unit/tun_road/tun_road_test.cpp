// The program between two namespaces: real TCP meets the rate, the delay and the loss that were
// asked for, by the road's own count. Where the rights lack, skipped with the reason.
#include "tools/measure/tun_road/tun_road.hpp"
#include "tests/support/paths.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <thread>

#include "rt/hash.hpp"
#include "rt/random.hpp"
#include "tools/measure/tun_road/tun_device.hpp"

namespace {

const std::string kProgram = tests::in_build("teletact-road");

bool shell(const std::string& command) {
  return std::system((command + " 2>/dev/null").c_str()) == 0;
}

// Two namespaces of this process' own.
struct Namespaces {
  std::string left = "troad-l" + std::to_string(::getpid()),
              right = "troad-r" + std::to_string(::getpid());
  bool made = false;
  Namespaces() { made = shell("ip netns add " + left) && shell("ip netns add " + right); }
  ~Namespaces() {
    (void)shell("ip netns del " + left);
    (void)shell("ip netns del " + right);
  }
};

// The program as a child; its figures when it was asked to end.
class RoadProcess {
 public:
  RoadProcess(const Namespaces& ns, std::vector<std::string> keys) {
    std::vector<std::string> words{kProgram, "--left", ns.left, "--right", ns.right};
    for (auto& k : keys) words.insert(words.end(), {"--set", k});
    std::array<int, 2> out{}, err{};
    if (::pipe(out.data()) != 0 || ::pipe(err.data()) != 0) std::abort();
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(out[1], 1);
      ::dup2(err[1], 2);
      for (int fd : {out[0], out[1], err[0], err[1]}) ::close(fd);
      std::vector<char*> argv;
      for (auto& w : words) argv.push_back(w.data());
      argv.push_back(nullptr);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(out[1]);
    ::close(err[1]);
    out_ = out[0];
    // Its one line: ready, or why not.
    char c = 0;
    while (::read(err[0], &c, 1) == 1 && c != '\n') said += c;
    ::close(err[0]);
  }
  nlohmann::json end() {
    ::kill(pid_, SIGTERM);
    std::string text;
    std::array<char, 4096> part{};
    for (ssize_t n = 0; (n = ::read(out_, part.data(), part.size())) > 0;)
      text.append(part.data(), static_cast<std::size_t>(n));
    ::close(out_);
    int status = 0;
    ::waitpid(pid_, &status, 0);
    code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    return text.empty() ? nlohmann::json() : nlohmann::json::parse(text);
  }
  std::string said;
  int code = -1;

 private:
  pid_t pid_ = 0;
  int out_ = -1;
};

// This thread into the namespace, for good.
bool enter(const std::string& ns) {
  const int fd = ::open(("/run/netns/" + ns).c_str(), O_RDONLY | O_CLOEXEC);
  const bool ok = fd >= 0 && ::setns(fd, CLONE_NEWNET) == 0;
  if (fd >= 0) ::close(fd);
  return ok;
}

sockaddr_in right_at(int port) {
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_port = htons(static_cast<std::uint16_t>(port));
  ::inet_pton(AF_INET, "10.77.0.2", &a.sin_addr);
  return a;
}

constexpr int kPort = 5001;

struct Received {
  std::uint64_t bytes = 0, hash = 0;
};

// All that one connection brings.
Received receive_all(const std::string& ns, std::atomic<bool>& listening) {
  Received r;
  const bool inside = enter(ns);
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in a = right_at(kPort);
  const bool bound = inside && ::bind(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a) == 0 &&
                     ::listen(fd, 1) == 0;
  listening = true;
  if (!bound) return r;
  const int c = ::accept4(fd, nullptr, nullptr, SOCK_CLOEXEC);
  rt::Hash64 hash;
  std::vector<std::uint8_t> part(65536);
  for (ssize_t n = 0; (n = ::recv(c, part.data(), part.size(), 0)) > 0;) {
    hash.bytes(part.data(), static_cast<std::size_t>(n));
    r.bytes += static_cast<std::uint64_t>(n);
  }
  r.hash = hash.digest();
  ::close(c);
  ::close(fd);
  return r;
}

// Random bytes over one connection; what was set and read back of the congestion control.
Received send_all(const std::string& ns, std::size_t bytes, std::string& congestion) {
  Received r;
  if (!enter(ns)) return r;
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  (void)::setsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, congestion.c_str(),
                     static_cast<socklen_t>(congestion.size()));
  std::array<char, 32> got{};
  socklen_t size = got.size() - 1;
  (void)::getsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, got.data(), &size);
  congestion = got.data();
  const sockaddr_in a = right_at(kPort);
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a) != 0) return r;
  rt::Random random(5);
  rt::Hash64 hash;
  std::vector<std::uint8_t> part(8192);
  while (r.bytes < bytes) {
    for (auto& b : part) b = static_cast<std::uint8_t>(random());
    std::size_t at = 0;
    while (at < part.size()) {
      const ssize_t n = ::send(fd, part.data() + at, part.size() - at, MSG_NOSIGNAL);
      if (n <= 0) return r;
      at += static_cast<std::size_t>(n);
    }
    hash.bytes(part.data(), part.size());
    r.bytes += part.size();
  }
  r.hash = hash.digest();
  ::shutdown(fd, SHUT_WR);
  char end = 0;
  (void)::recv(fd, &end, 1, 0);  // the other side has read to the end
  ::close(fd);
  return r;
}

TEST(TunRoad, RealTcpMeetsTheRateTheDelayAndTheLoss) {
  if (const auto why = teletact::road_refusal(); !why.empty()) GTEST_SKIP() << "the road " << why;
  const Namespaces ns;
  if (!ns.made) GTEST_SKIP() << "no network namespaces can be made here (ip netns add)";
  RoadProcess road(ns, {"rate_Mbit_per_s=10", "queue_kB=200", "delay_ms=40", "jitter_ms=10",
                        "loss=0.005", "seed=3"});
  ASSERT_EQ(road.said, "teletact-road: ready");
  const auto kernel = teletact::settable_congestion({"bbr", "cubic"});
  ASSERT_FALSE(kernel.empty());
  std::string congestion = kernel.front();
  std::atomic<bool> listening{false};
  Received got, sent;
  std::thread receiver([&] { got = receive_all(ns.right, listening); });
  while (!listening) std::this_thread::yield();
  constexpr std::size_t kBytes = 3000000;
  std::thread sender([&] { sent = send_all(ns.left, kBytes, congestion); });
  sender.join();
  receiver.join();
  const auto figures = road.end();
  ASSERT_EQ(road.code, 0);
  const auto& there = figures["to_right"];
  std::printf("congestion control %s\n%s\n", congestion.c_str(), figures.dump(1).c_str());
  EXPECT_EQ(congestion, kernel.front()) << "set and read back";
  EXPECT_GE(sent.bytes, kBytes);
  EXPECT_EQ(got.bytes, sent.bytes);
  EXPECT_EQ(got.hash, sent.hash) << "loss costs time, no byte";
  // The road's own count: the bottleneck's rate, to a nanosecond a packet.
  EXPECT_NEAR(there["busy_Mbit_per_s"].get<double>(), 10, 0.01);
  EXPECT_LE(8e-6 * there["bytes_out"].get<double>(), 10 * figures["seconds"].get<double>());
  EXPECT_GE(there["delay_ms_min"].get<double>(), 40);
  EXPECT_LE(there["delay_ms_max"].get<double>(), 40 + 10 + 160 + 1.3)
      << "delay, jitter, full queue, itself";
  const auto packets = there["packets_in"].get<double>() - there["dropped_by_queue"].get<double>();
  EXPECT_GE(packets, 3e6 / 1460);
  EXPECT_NEAR(there["lost"].get<double>(), 0.005 * packets, 5 * std::sqrt(0.005 * packets));
  EXPECT_LE(there["queue_bytes_max"].get<double>(), 200000);
  const double on_the_way =
      packets - there["packets_out"].get<double>() - there["lost"].get<double>();
  EXPECT_GE(on_the_way, 0);
  EXPECT_LE(on_the_way, 5) << "the end of the connection, when the road was asked to end";
}

TEST(TunRoad, RefusesWithOneLine) {
  const auto said = [](const std::string& arguments) {
    std::string text;
    FILE* p = ::popen((kProgram + " " + arguments + " 2>&1").c_str(), "r");
    for (int c = 0; p != nullptr && (c = std::fgetc(p)) != EOF;) text += static_cast<char>(c);
    const int status = ::pclose(p);
    EXPECT_EQ(WEXITSTATUS(status), 2) << arguments;
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
    return text;
  };
  using testing::HasSubstr;
  EXPECT_THAT(said("--set loss=2"), HasSubstr("loss"));
  EXPECT_THAT(said("--set delay=2"), HasSubstr("delay"));
  EXPECT_THAT(said("--set 'stall=[{for_ms=950, every_s=1}]'"), HasSubstr("stall"));
  if (teletact::road_refusal().empty()) {
    EXPECT_THAT(said("--left no-such-namespace"), HasSubstr("ip netns add no-such-namespace"));
  } else {
    EXPECT_THAT(said(""), HasSubstr("teletact-road: needs "));
  }
}

}  // namespace
