#include "tools/measure/tun_road/packet_road.hpp"

#include <algorithm>
#include <cmath>

namespace teletact {

void RoadConfig::describe(config::Section& s) {
  network.describe(s);
  s.number("loss", loss, 0, 1, "share of the packets that is lost behind the bottleneck");
  s.number("loss_from_s", loss_from_s, 0, 864000, "from when on it is lost");
  s.number("loss_for_s", loss_for_s, 0, 864000, "and for how long; 0: to the end");
  s.number("reorder", reorder, 0, 1, "share of the packets that others overtake");
  s.number("reorder_ms", reorder_ms, 0.1, 1000, "how much later these come");
}

double PacketRoad::Stats::mean_delay_ms() const {
  return packets_out > 0 ? 1e-6 * sum_delay_ns / static_cast<double>(packets_out) : 0;
}

double PacketRoad::Stats::busy_Mbit_per_s() const {
  return busy_ns > 0 ? 8e3 * static_cast<double>(bytes_carried) / static_cast<double>(busy_ns) : 0;
}

PacketRoad::PacketRoad(const RoadConfig& c, drivers::Way way, std::int64_t epoch_ns)
    : config_(c),
      line_(c.network, epoch_ns),
      random_(c.network.seed, way == drivers::Way::kToRobot ? 0 : 1),
      damage_from_ns_(epoch_ns + static_cast<std::int64_t>(c.network.corrupt_from_s * 1e9)),
      loss_from_ns_(epoch_ns + static_cast<std::int64_t>(c.loss_from_s * 1e9)),
      loss_until_ns_(c.loss_for_s > 0
                         ? loss_from_ns_ + static_cast<std::int64_t>(c.loss_for_s * 1e9)
                         : drivers::kNever) {
  for (const drivers::CutConfig& cut : c.network.cuts) {
    if (cut.of(way))
      cut_at_ns_ = std::min(cut_at_ns_, epoch_ns + static_cast<std::int64_t>(cut.at_s * 1e9));
  }
}

// Of a packet that the bottleneck has carried by then.
std::int64_t PacketRoad::arrival(std::int64_t carried_ns) {
  const drivers::NetworkConfig& n = config_.network;
  std::int64_t due = carried_ns + static_cast<std::int64_t>(n.delay_ms * 1e6);
  if (n.jitter_ms > 0) due += static_cast<std::int64_t>(random_.uniform() * n.jitter_ms * 1e6);
  due = std::max(due, last_due_ns_);
  if (config_.reorder > 0 && random_.uniform() < config_.reorder) {
    ++stats_.reordered;
    return due + static_cast<std::int64_t>(config_.reorder_ms * 1e6);
  }
  last_due_ns_ = due;
  return due;
}

void PacketRoad::offer(std::int64_t now_ns, std::span<const std::uint8_t> packet) {
  const drivers::NetworkConfig& n = config_.network;
  ++stats_.packets_in;
  stats_.bytes_in += packet.size();
  while (!queue_.empty() && queue_.front().carried <= now_ns) {
    waiting_ -= queue_.front().bytes;
    queue_.pop();
  }
  if (waiting_ > 0 && waiting_ + packet.size() > static_cast<std::size_t>(n.queue_kB * 1000)) {
    ++stats_.dropped;
    return;
  }
  const std::int64_t begin = std::max(now_ns, carried_until_ns_);
  carried_until_ns_ = line_.carried_at(begin, packet.size());
  stats_.bytes_carried += packet.size();
  stats_.busy_ns += carried_until_ns_ - begin;
  if (carried_until_ns_ > now_ns) {
    queue_.push({carried_until_ns_, packet.size()});
    waiting_ += packet.size();
    stats_.most_waiting = std::max(stats_.most_waiting, waiting_);
  }
  if (config_.loss > 0 && now_ns >= loss_from_ns_ && now_ns < loss_until_ns_ &&
      random_.uniform() < config_.loss) {
    ++stats_.lost;
    return;
  }
  const std::int64_t due = arrival(carried_until_ns_);
  const auto flap = line_.flap_at(now_ns);
  if (flap.down || due >= flap.next_begin_ns || due >= cut_at_ns_) {
    ++stats_.cut;
    return;
  }
  Packet p{due, now_ns, stats_.packets_in, {packet.begin(), packet.end()}};
  if (n.corrupt_per_MB > 0 && now_ns >= damage_from_ns_ && !p.bytes.empty()) {
    const double whole = std::exp(-1e-6 * n.corrupt_per_MB * static_cast<double>(p.bytes.size()));
    if (random_.uniform() > whole) {
      const auto at = random_.integer(0, static_cast<std::int64_t>(p.bytes.size()) - 1);
      p.bytes[static_cast<std::size_t>(at)] ^= static_cast<std::uint8_t>(random_.integer(1, 255));
      ++stats_.damaged;
    }
  }
  on_the_way_.push(std::move(p));
}

std::int64_t PacketRoad::next_arrival_ns() const noexcept {
  return on_the_way_.empty() ? drivers::kNever : on_the_way_.top().due;
}

bool PacketRoad::take(std::int64_t now_ns, std::vector<std::uint8_t>& packet) {
  if (on_the_way_.empty() || on_the_way_.top().due > now_ns) return false;
  const Packet& p = on_the_way_.top();
  packet = p.bytes;
  const std::int64_t delay = p.due - p.offered;
  stats_.least_delay_ns = stats_.packets_out == 0 ? delay : std::min(stats_.least_delay_ns, delay);
  stats_.most_delay_ns = std::max(stats_.most_delay_ns, delay);
  stats_.sum_delay_ns += static_cast<double>(delay);
  ++stats_.packets_out;
  stats_.bytes_out += packet.size();
  on_the_way_.pop();
  return true;
}

}  // namespace teletact
