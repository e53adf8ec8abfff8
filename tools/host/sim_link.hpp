// The link of the virtual clock: the same two endpoints and the same encoded bytes as over TCP, moved
// by an actor in simulated time, through the same shaper.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "drivers/link/endpoint.hpp"
#include "drivers/link/shaper.hpp"
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

  [[nodiscard]] std::int64_t next_host_ns() const noexcept override;
  void act(std::int64_t host_ns) override;
  // Cable cut: nothing arrives any more, in either direction.
  void cut() noexcept { cut_ = true; }
  // Runs handshake and clock exchange before the epoch; false when they do not come about.
  [[nodiscard]] bool handshake(std::int64_t from_host_ns, std::int64_t to_host_ns);
  // Hash over all bytes sent, both directions.
  [[nodiscard]] std::uint64_t byte_hash() const noexcept { return hash_.digest(); }

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
  };
  void send(Direction& d, std::span<const std::uint8_t> message, std::int64_t host_ns);
  void deliver(Direction& d, Direction& back, std::int64_t host_ns);
  void note(Direction& d, std::int64_t host_ns);

  Direction to_robot_, to_operator_;
  std::int64_t next_poll_;
  rt::Hash64 hash_;
  bool cut_ = false;
};

}  // namespace teletact
