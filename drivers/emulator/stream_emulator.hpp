// One way of a connection over a bad network: bytes in with an instant, the same bytes out with a
// later one. Pure: no clock, no thread, no socket; the same calls give the same bytes at the same
// instants. An effect: built only where a scene names [link.network].
//
// Model, in the order in which a byte meets it:
//   queue     at most queue_kB wait before the bottleneck; write() takes no more than fits
//   rate      the bottleneck carries one byte after the other, nothing in a stall
//   delay     plus jitter, drawn for each call of write(); a stream, so no byte overtakes another
//   loss      what would arrive after a cut, or has not arrived when a flap begins, never arrives.
//             After a flap nothing arrives until renew(): the connection has ended
//   damage    bytes are changed (never to themselves), at random distances
// Bytes that are lost are taken all the same, so that a cut does not pile them up at the sender.
//
// What a real sender can see, this one says: busy() while bytes wait or the connection is dead;
// busy_for() from what waits and the present rate, Nanos::max() in a stall, which nobody foresees.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "drivers/emulator/line_schedule.hpp"
#include "drivers/emulator/network_config.hpp"
#include "rt/random.hpp"
#include "rt/time.hpp"

namespace drivers {

class StreamEmulator {
 public:
  // `epoch_ns`: the start of the run on the clock of all other arguments.
  StreamEmulator(const NetworkConfig& c, Way way, std::int64_t epoch_ns);

  // How many of the bytes were taken, from the front; the others are offered again later. Instants
  // do not fall from call to call.
  [[nodiscard]] std::size_t write(std::int64_t now_ns, std::span<const std::uint8_t> bytes);
  // Appends what has arrived by now.
  void read(std::int64_t now_ns, std::vector<std::uint8_t>& out);
  // Bytes that were taken and will arrive.
  [[nodiscard]] std::size_t on_the_way() const noexcept { return on_the_way_; }
  // When the next byte arrives; kNever: nothing is on the way.
  [[nodiscard]] std::int64_t next_arrival_ns() const noexcept;

  [[nodiscard]] bool busy(std::int64_t now_ns) const noexcept;
  [[nodiscard]] rt::Nanos busy_for(std::int64_t now_ns) const noexcept;

  // How often the network has ended the connection; whether a new one could be made now.
  [[nodiscard]] std::uint64_t ends(std::int64_t now_ns) const noexcept;
  [[nodiscard]] bool passable(std::int64_t now_ns) const noexcept;
  // A new connection: nothing of the old one is on the way.
  void renew(std::int64_t now_ns);

  struct Stats {
    std::uint64_t bytes_taken = 0, bytes_arrived = 0, bytes_lost = 0, bytes_changed = 0;
    std::size_t most_waiting = 0;
  };
  [[nodiscard]] const Stats& stats() const noexcept { return stats_; }

 private:
  struct Piece {
    std::int64_t due;
    std::vector<std::uint8_t> bytes;
  };
  struct Waiting {
    std::int64_t carried;
    std::size_t bytes;
  };
  void leave_queue(std::int64_t now_ns);
  void damage(std::span<std::uint8_t> bytes);
  [[nodiscard]] bool dead(std::int64_t now_ns) const noexcept;

  NetworkConfig config_;
  LineSchedule line_;
  rt::Random jitter_, damage_;
  std::int64_t cut_at_ns_ = kNever, damage_from_ns_ = 0;
  std::int64_t carried_until_ns_ = 0, last_due_ns_ = 0;
  std::uint64_t renewed_after_ = 0;  // flaps that had begun when the connection was made
  double to_damage_ = 0;             // bytes until the next one that is changed
  std::deque<Waiting> queue_;
  std::size_t waiting_ = 0, on_the_way_ = 0;
  std::deque<Piece> pieces_;
  Stats stats_;
};

}  // namespace drivers
