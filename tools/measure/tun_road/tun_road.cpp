#include "tools/measure/tun_road/tun_road.hpp"

#include <poll.h>
#include <sched.h>
#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "tools/measure/tun_road/tun_device.hpp"

namespace teletact {

namespace {

constexpr std::int64_t kLook_ns = 50000000;  // for a request to stop
constexpr int kPriority = 50;                // of the road: other work must not look like jitter

// Lateness in steps of 2^(1/8) from 1 us on; bounded memory for a run of any length.
class LateCount {
 public:
  void add(std::int64_t late_ns) {
    const double us = std::max(1.0, 1e-3 * static_cast<double>(late_ns));
    const auto i = static_cast<std::size_t>(8 * std::log2(us));
    ++counts_[std::min(i, counts_.size() - 1)];
    ++all_;
    max_us_ = std::max(max_us_, 1e-3 * static_cast<double>(late_ns));
  }
  [[nodiscard]] double quantile_us(double q) const {
    const std::uint64_t rank = rt::quantile_rank(q, all_);
    if (rank == 0) return 0;
    std::uint64_t below = 0;
    std::size_t i = 0;
    while (i + 1 < counts_.size() && (below += counts_[i]) < rank) ++i;
    return std::exp2(static_cast<double>(i + 1) / 8);
  }
  [[nodiscard]] double max_us() const noexcept { return max_us_; }

 private:
  std::array<std::uint64_t, 256> counts_{};
  std::uint64_t all_ = 0;
  double max_us_ = 0;
};

// A real-time priority where the rights are there; a road without one still works, less exactly.
void be_punctual() {
  sched_param p{};
  p.sched_priority = kPriority;
  (void)::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &p);
  (void)::mlockall(MCL_CURRENT | MCL_FUTURE);
}

struct RoadEnd {
  TunDevice& from;
  TunDevice& to;
  PacketRoad road;
};

nlohmann::json figures(const PacketRoad::Stats& s) {
  return {{"packets_in", s.packets_in},
          {"bytes_in", s.bytes_in},
          {"packets_out", s.packets_out},
          {"bytes_out", s.bytes_out},
          {"dropped_by_queue", s.dropped},
          {"lost", s.lost},
          {"cut", s.cut},
          {"reordered", s.reordered},
          {"damaged", s.damaged},
          {"busy_s", 1e-9 * static_cast<double>(s.busy_ns)},
          {"busy_Mbit_per_s", s.busy_Mbit_per_s()},
          {"delay_ms_min", 1e-6 * static_cast<double>(s.least_delay_ns)},
          {"delay_ms_mean", s.mean_delay_ms()},
          {"delay_ms_max", 1e-6 * static_cast<double>(s.most_delay_ns)},
          {"queue_bytes_max", s.most_waiting}};
}

}  // namespace

rt::Result<TunRoadResult> run_tun_road(const TunRoadOptions& options, const std::atomic<bool>& stop,
                                       const std::function<void()>& ready) {
  auto left = TunDevice::open(options.left, options.device, options.left_address, 30);
  if (!left) return rt::Error{left.error()};
  auto right = TunDevice::open(options.right, options.device, options.right_address, 30);
  if (!right) return rt::Error{right.error()};
  be_punctual();
  const std::int64_t epoch = rt::monotonic_ns();
  std::array<RoadEnd, 2> ends{
      RoadEnd{left.value(), right.value(), {options.road, drivers::Way::kToRobot, epoch}},
      RoadEnd{right.value(), left.value(), {options.road, drivers::Way::kToOperator, epoch}}};
  TunRoadResult out;
  LateCount late;
  std::vector<std::uint8_t> packet;
  const std::int64_t end = options.seconds > 0
                               ? epoch + static_cast<std::int64_t>(options.seconds * 1e9)
                               : drivers::kNever;
  if (ready) ready();
  while (!stop.load()) {
    std::int64_t now = rt::monotonic_ns();
    if (now >= end) break;
    for (RoadEnd& e : ends) {
      for (auto got = e.from.read(); !got.empty(); got = e.from.read())
        e.road.offer(rt::monotonic_ns(), got);
    }
    now = rt::monotonic_ns();
    std::int64_t next = now + kLook_ns;
    for (RoadEnd& e : ends) {
      for (std::int64_t due = e.road.next_arrival_ns(); e.road.take(now, packet);
           due = e.road.next_arrival_ns()) {
        late.add(rt::monotonic_ns() - due);
        if (!e.to.write(packet)) ++out.not_written;
      }
      next = std::min(next, e.road.next_arrival_ns());
    }
    const std::int64_t wait = std::max<std::int64_t>(0, next - rt::monotonic_ns());
    const timespec timeout{wait / 1000000000, wait % 1000000000};
    std::array<pollfd, 2> wake{pollfd{ends[0].from.fd(), POLLIN, 0},
                               pollfd{ends[1].from.fd(), POLLIN, 0}};
    (void)::ppoll(wake.data(), wake.size(), &timeout, nullptr);
  }
  out.to_right = ends[0].road.stats();
  out.to_left = ends[1].road.stats();
  out.late_p50_us = late.quantile_us(0.5);
  out.late_p95_us = late.quantile_us(0.95);
  out.late_max_us = late.max_us();
  out.seconds = 1e-9 * static_cast<double>(rt::monotonic_ns() - epoch);
  return out;
}

std::string road_json(const TunRoadResult& r) {
  const nlohmann::json j{
      {"to_right", figures(r.to_right)},
      {"to_left", figures(r.to_left)},
      {"late_us", {{"p50", r.late_p50_us}, {"p95", r.late_p95_us}, {"max", r.late_max_us}}},
      {"not_written", r.not_written},
      {"seconds", r.seconds}};
  return j.dump(2);
}

}  // namespace teletact
