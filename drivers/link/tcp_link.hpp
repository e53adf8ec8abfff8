// The link over TCP: one connection, one ordinary thread that polls the socket every millisecond,
// sends what the endpoint has, and hands arriving messages to it. The optional shaper delays what is
// sent, like the network would.
//
// Binds and connects to loopback only: until the link is authenticated any other address is refused.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "drivers/link/endpoint.hpp"
#include "drivers/link/shaper.hpp"
#include "rt/result.hpp"

namespace drivers {

class TcpLink {
 public:
  enum class State : std::uint8_t { kConnecting, kHandshake, kReady, kClosed, kFault };

  // Listens on 127.0.0.1; port 0 lets the kernel choose (see port()).
  [[nodiscard]] static rt::Result<std::unique_ptr<TcpLink>> listen(const std::string& address,
                                                                   int port);
  // Connects, trying again until `timeout`.
  [[nodiscard]] static rt::Result<std::unique_ptr<TcpLink>> connect(const std::string& address,
                                                                    int port, rt::Nanos timeout);
  ~TcpLink();
  TcpLink(const TcpLink&) = delete;
  TcpLink& operator=(const TcpLink&) = delete;

  [[nodiscard]] int port() const noexcept { return port_; }
  // Starts the thread. `now` is the box's clock; the endpoint is used by that thread only from here on.
  // `after_poll` is called there once a millisecond and once more when the connection has ended, e.g.
  // to hand the status on.
  void start(LinkEndpoint& endpoint, std::function<rt::Time()> now,
             const std::optional<LinkShapeConfig>& shape, std::function<void()> after_poll = {});
  // Sends Bye if it can, ends the thread, closes.
  void stop();
  // Fault injection and tests: the cable is cut. Nothing crosses any more and neither side is told:
  // no Bye, no end of the connection, only silence.
  void cut() noexcept { cut_.store(true); }

  [[nodiscard]] State state() const noexcept { return state_.load(); }
  // The connection is over: the peer said Bye, its process is gone (the kernel ends its connections,
  // also after a SIGKILL), or it was refused. Known at once, unlike a silence.
  [[nodiscard]] bool ended() const noexcept { return state_.load() >= State::kClosed; }
  [[nodiscard]] std::string fault() const;  // after kFault
  // Local time of the last valid message, ns; 0 = never. For supervision and robot_io.
  [[nodiscard]] std::int64_t last_heard_ns() const noexcept { return last_heard_.load(); }
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept { return round_trip_.load(); }
  [[nodiscard]] std::int64_t clock_uncertainty_ns() const noexcept { return uncertainty_.load(); }
  [[nodiscard]] std::int64_t thread_cpu_ns() const noexcept { return cpu_.load(); }
  [[nodiscard]] LinkEndpoint::Stats stats() const;  // after stop()

 private:
  TcpLink() = default;
  void run();
  bool accept_one();
  bool read_all(LinkEndpoint& e);
  bool write_due(std::int64_t now_ns);
  void drain_unread();
  void enqueue(std::span<const std::uint8_t> message);
  void fail(std::string why);

  struct Chunk {
    std::int64_t due = 0;
    std::vector<std::uint8_t> bytes;
    std::size_t sent = 0;
  };
  int listen_fd_ = -1, fd_ = -1, port_ = 0;
  LinkEndpoint* endpoint_ = nullptr;
  std::function<rt::Time()> now_;
  std::function<void()> after_poll_;
  std::optional<LinkShaper> shaper_;
  std::deque<Chunk> queue_;
  std::vector<std::uint8_t> inbox_;
  std::size_t inbox_size_ = 0;
  std::thread thread_;
  std::atomic<bool> stop_{false}, cut_{false};
  std::atomic<State> state_{State::kConnecting};
  std::atomic<std::int64_t> last_heard_{0}, round_trip_{0}, uncertainty_{0}, cpu_{0};
  std::string fault_;
};

}  // namespace drivers
