// The link of the virtual clock: the same two endpoints and the same encoded bytes as over TCP,
// moved by an actor in simulated time, through the same shaper or over the same network
// (emulate()). A connection that such a network, or a damaged byte, has ended is made again as by a
// lasting transport: kAgain_ns later, as soon as the network lets through.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "drivers/link/endpoint.hpp"
#include "drivers/link/sent_road.hpp"
#include "drivers/link/shaper.hpp"
#include "drivers/link/stream_reader.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/hash.hpp"
#include "rt/sched/virtual_executor.hpp"
#include "tasks/graph/operator_graph.hpp"

namespace teletact {

class SimLink final : public rt::Actor {
 public:
  struct End {
    drivers::LinkEndpoint* endpoint = nullptr;
    tasks::LinkStatus* status = nullptr;
    rt::BoxTime clock;
  };
  SimLink(End op, End robot, const drivers::LinkShapeConfig& shape, std::int64_t start_host_ns);

  // After the end of a connection the next one begins no sooner.
  static constexpr std::int64_t kAgain_ns = 100000000;

  // The network of a scene instead of a shape; `epoch_host_ns`: the start of the run. Before the
  // handshake.
  void emulate(const drivers::NetworkConfig& network, std::int64_t epoch_host_ns);

  [[nodiscard]] std::int64_t next_host_ns() const noexcept override;
  void act(std::int64_t host_ns) override;
  // Cable cut: nothing arrives any more, in either direction.
  void cut() noexcept { cut_ = true; }
  // Runs handshake and clock exchange before the epoch; false when they do not come about.
  [[nodiscard]] bool handshake(std::int64_t from_host_ns, std::int64_t to_host_ns);
  // Hash over all bytes sent, both directions.
  [[nodiscard]] std::uint64_t byte_hash() const noexcept { return hash_.digest(); }
  // CPU that both ends took so far, decoding included: what the threads of two transports take,
  // less sockets, TLS and waking up. The hash over the bytes, an emulated network and a recorder
  // are in it too: a little more, never less.
  [[nodiscard]] std::int64_t cpu_ns() const noexcept { return cpu_ns_; }
  // Bytes that this object holds for both directions: what a run of days must not let grow.
  [[nodiscard]] std::size_t held_bytes() const noexcept;
  // Of an emulated network, one way; null: none.
  [[nodiscard]] const drivers::StreamEmulator* road(drivers::Way way) const noexcept;

 private:
  struct Packet {
    std::int64_t due = 0;
    std::vector<std::uint8_t> bytes;
  };
  struct Direction {
    End from, to;
    drivers::LinkShaper shaper;
    bool shaped = false;
    std::deque<Packet> queue;
    std::optional<drivers::SentRoad>
        road;  // of a scene with a network: instead of shaper and queue
    drivers::StreamReader reader;
  };
  void turn(std::int64_t host_ns);
  void send(Direction& d, std::span<const std::uint8_t> message, std::int64_t host_ns);
  void deliver(Direction& d, Direction& back, std::int64_t host_ns);
  [[nodiscard]] bool receive(Direction& d, Direction& back, std::span<const std::uint8_t> message,
                             std::int64_t host_ns);
  void deliver_road(Direction& d, Direction& back, std::int64_t host_ns);
  void end_connection(std::int64_t host_ns);
  void connect_again(std::int64_t host_ns);
  void note(Direction& d, std::int64_t host_ns);

  Direction to_robot_, to_operator_;
  std::int64_t next_poll_;
  rt::Hash64 hash_;
  bool cut_ = false, ended_ = false;
  std::int64_t ended_at_ = 0, cpu_ns_ = 0;
  std::uint64_t connections_ = 1;
};

}  // namespace teletact
