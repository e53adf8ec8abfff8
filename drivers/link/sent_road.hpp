// What one end of a link sends, over the network that its scene names (drivers/emulator): whole
// messages in, bytes as they arrive out. What the network does not take yet waits here, as it would
// before a socket that takes no more.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/emulator/stream_emulator.hpp"

namespace drivers {

class SentRoad {
 public:
  SentRoad(const NetworkConfig& c, Way way, std::int64_t epoch_ns);

  void send(std::span<const std::uint8_t> message, std::int64_t now_ns);
  // Lets go on what waits. Returns all that has arrived by now and was not taken yet.
  [[nodiscard]] std::span<const std::uint8_t> arrived(std::int64_t now_ns);
  void take(std::size_t bytes);

  // Whether bulk may go out: nothing waits here or before the bottleneck.
  [[nodiscard]] bool line_free(std::int64_t now_ns) const noexcept;
  [[nodiscard]] rt::Nanos busy_for(std::int64_t now_ns) const noexcept;
  // True once the network has ended the connection that was made last.
  [[nodiscard]] bool ended(std::int64_t now_ns) const noexcept;
  [[nodiscard]] bool passable(std::int64_t now_ns) const noexcept { return road_.passable(now_ns); }
  // Nothing waits and nothing is on the way.
  [[nodiscard]] bool empty() const noexcept;
  // A new connection.
  void renew(std::int64_t now_ns);
  [[nodiscard]] std::int64_t next_arrival_ns() const noexcept { return road_.next_arrival_ns(); }
  [[nodiscard]] std::size_t waiting() const noexcept { return waiting_.size() - sent_; }
  // Bytes of memory that it uses for what waits, is on the way, or has arrived.
  [[nodiscard]] std::size_t held() const noexcept;
  [[nodiscard]] const StreamEmulator& road() const noexcept { return road_; }

 private:
  void offer(std::int64_t now_ns);

  StreamEmulator road_;
  std::vector<std::uint8_t> waiting_, arrived_;
  std::size_t sent_ = 0, taken_ = 0;  // from the front of these
  std::uint64_t ends_ = 0;
};

}  // namespace drivers
