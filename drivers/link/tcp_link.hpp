// The link over TCP: one connection, one ordinary thread that polls the socket every millisecond,
// sends what the endpoint has, and hands arriving messages to it. The optional shaper delays what
// is sent, like the network would.
//
// Lasting (link_transport.hpp): after each end the endpoint is renewed, and the thread listens or
// dials again (back_off.hpp). A session ends by itself after kDeadAfter without a valid message, or
// when its handshake takes longer than kHandshakeWithin: a road that is dead in one direction, or
// a peer that says nothing, holds the listener no longer. It has one session at a time: who
// connects meanwhile is turned away at once.
//
// Binds and connects to loopback only: until the link is authenticated any other address is
// refused.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "drivers/link/back_off.hpp"
#include "drivers/link/link_transport.hpp"
#include "drivers/link/sent_road.hpp"
#include "rt/result.hpp"

namespace drivers {

class TcpLink final : public ToldTransport {
 public:
  // Listens on 127.0.0.1; port 0 lets the kernel choose (see port()).
  [[nodiscard]] static rt::Result<std::unique_ptr<TcpLink>> listen(const std::string& address,
                                                                   int port);
  // Connects, trying again until `timeout`.
  [[nodiscard]] static rt::Result<std::unique_ptr<TcpLink>> connect(const std::string& address,
                                                                    int port, rt::Nanos timeout);
  // The same, lasting. Nobody needs to be there yet.
  [[nodiscard]] static rt::Result<std::unique_ptr<TcpLink>> listen_lasting(
      const std::string& address, int port);
  [[nodiscard]] static rt::Result<std::unique_ptr<TcpLink>> dial_lasting(const std::string& address,
                                                                         int port);
  ~TcpLink() override;

  static constexpr rt::Nanos kDeadAfter = std::chrono::seconds{2};
  static constexpr rt::Nanos kHandshakeWithin = std::chrono::seconds{5};

  [[nodiscard]] int port() const noexcept { return port_; }
  [[nodiscard]] bool emulate(const NetworkConfig& network, std::int64_t epoch_host_ns) override;
  void start(LinkEndpoint& endpoint, std::function<rt::Time()> now,
             const std::optional<LinkShapeConfig>& shape,
             std::function<void()> after_poll = {}) override;
  void stop() override;
  // The cable is cut: no Bye, no end of the connection, only silence.
  void cut() noexcept override { cut_.store(true); }
  // The cable is whole again: a lasting link finds its peer anew.
  void mend() noexcept { cut_.store(false); }

  [[nodiscard]] std::string fault() const override;
  // Connections that came while a session went on.
  [[nodiscard]] std::uint64_t turned_away() const noexcept { return turned_away_.load(); }
  [[nodiscard]] LinkEndpoint::Stats stats() const override;

 private:
  TcpLink() = default;
  void run();
  bool open_session();
  bool accept_one();
  bool dial_one();
  void turn_away() noexcept;
  void run_session();
  void end_session();
  [[nodiscard]] bool session_is_dead(std::int64_t now_ns);
  void publish(const LinkEndpoint& e);
  void pause(rt::Nanos wait) const;
  bool read_all(LinkEndpoint& e);
  bool write_due(std::int64_t now_ns);
  bool write_road(std::int64_t now_ns);
  void drain_unread();
  void enqueue(std::span<const std::uint8_t> message);
  void fail(std::string why);

  struct Chunk {
    std::int64_t due = 0;
    std::vector<std::uint8_t> bytes;
    std::size_t sent = 0;
  };
  int listen_fd_ = -1, fd_ = -1, port_ = 0;
  bool lasting_ = false;
  std::uint32_t dial_address_ = 0;  // of a lasting dialler, network order
  BackOff back_off_;
  std::int64_t opened_ns_ = 0, heard_ns_ = 0;  // of this session, host clock
  rt::Time heard_{};
  LinkEndpoint* endpoint_ = nullptr;
  std::function<rt::Time()> now_;
  std::function<void()> after_poll_;
  std::optional<LinkShaper> shaper_;
  std::optional<NetworkConfig> network_;
  std::int64_t network_epoch_ns_ = 0;
  std::optional<SentRoad> road_;
  std::deque<Chunk> queue_;
  std::vector<std::uint8_t> inbox_;
  std::size_t inbox_size_ = 0;
  std::thread thread_;
  std::atomic<bool> stop_{false}, cut_{false};
  std::atomic<std::uint64_t> turned_away_{0};
  mutable std::mutex fault_mutex_;
  std::string fault_;
};

}  // namespace drivers
