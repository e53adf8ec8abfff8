// One way of a road for packets: what a packet meets between two hosts. Pure: no clock, no device;
// the same packets at the same instants come out, or not, in the same way.
//
// The keys of [link.network] mean what they mean for a stream (drivers/emulator), with what packets
// have and streams have not:
//   queue     drop-tail: a packet that does not fit is dropped
//   jitter    drawn for each packet; it does not overtake the one before it
//   loss      behind the bottleneck, as on a radio: a lost packet has used the line. For the whole
//             time, or for loss_for_s from loss_from_s on
//   reorder   a share of the packets comes reorder_ms later, and others overtake it
//   flap      a packet that has not arrived when the line goes down is lost; no connection ends
//   damage    a packet with a changed byte; IP and TCP drop it by their checksums
#pragma once

#include <cstddef>
#include <cstdint>
#include <queue>
#include <span>
#include <vector>

#include "config/schema.hpp"
#include "drivers/emulator/line_schedule.hpp"
#include "drivers/emulator/network_config.hpp"
#include "rt/random.hpp"

namespace teletact {

struct RoadConfig {
  drivers::NetworkConfig network;
  double loss = 0;                         // share of the packets
  double loss_from_s = 0, loss_for_s = 0;  // for 0: to the end
  double reorder = 0;                      // share of the packets
  double reorder_ms = 10;
  void describe(config::Section& s);
};

class PacketRoad {
 public:
  PacketRoad(const RoadConfig& c, drivers::Way way, std::int64_t epoch_ns);

  void offer(std::int64_t now_ns, std::span<const std::uint8_t> packet);
  // When the next packet arrives; drivers::kNever: none is on the way.
  [[nodiscard]] std::int64_t next_arrival_ns() const noexcept;
  // Takes the next packet that has arrived by now; false: none has.
  [[nodiscard]] bool take(std::int64_t now_ns, std::vector<std::uint8_t>& packet);

  struct Stats {
    std::uint64_t packets_in = 0, bytes_in = 0, packets_out = 0, bytes_out = 0;
    std::uint64_t dropped = 0;  // by the queue
    std::uint64_t lost = 0;     // by loss
    std::uint64_t cut = 0;      // by a cut or a flap
    std::uint64_t reordered = 0, damaged = 0;
    std::uint64_t bytes_carried = 0;  // by the bottleneck, in busy_ns
    std::int64_t busy_ns = 0;
    std::int64_t least_delay_ns = 0, most_delay_ns = 0;  // of what came out, as planned
    double sum_delay_ns = 0;
    std::size_t most_waiting = 0;
    [[nodiscard]] double mean_delay_ms() const;
    [[nodiscard]] double busy_Mbit_per_s() const;
  };
  [[nodiscard]] const Stats& stats() const noexcept { return stats_; }

 private:
  struct Packet {
    std::int64_t due, offered;
    std::uint64_t number;
    std::vector<std::uint8_t> bytes;
    bool operator>(const Packet& o) const noexcept {
      return due != o.due ? due > o.due : number > o.number;
    }
  };
  struct Waiting {
    std::int64_t carried;
    std::size_t bytes;
  };
  [[nodiscard]] std::int64_t arrival(std::int64_t carried_ns);

  RoadConfig config_;
  drivers::LineSchedule line_;
  rt::Random random_;
  std::int64_t cut_at_ns_ = drivers::kNever, damage_from_ns_;
  std::int64_t loss_from_ns_, loss_until_ns_;
  std::int64_t carried_until_ns_ = 0, last_due_ns_ = 0;
  std::queue<Waiting> queue_;
  std::size_t waiting_ = 0;
  std::priority_queue<Packet, std::vector<Packet>, std::greater<>> on_the_way_;
  Stats stats_;
};

}  // namespace teletact
