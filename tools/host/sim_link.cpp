#include "tools/host/sim_link.hpp"
#include "rt/effect_count.hpp"

#include <algorithm>

namespace teletact {

namespace {
constexpr std::int64_t kPoll = 1000000;      // as the TCP transport's loop
constexpr std::int64_t kBareDelay = 100000;  // loopback without a shaper: never in no time
}  // namespace

SimLink::SimLink(End op, End robot, const drivers::LinkShapeConfig& shape,
                 std::int64_t start_host_ns)
    : to_robot_{op, robot, drivers::LinkShaper(shape, 0), shape.any(), {}},
      to_operator_{robot, op, drivers::LinkShaper(shape, 1), shape.any(), {}},
      next_poll_(start_host_ns) {
  if (shape.any()) rt::effect_built(rt::Effect::kLinkShape);
}

std::int64_t SimLink::next_host_ns() const noexcept {
  std::int64_t t = next_poll_;
  for (const auto* d : {&to_robot_, &to_operator_}) {
    if (!d->queue.empty()) t = std::min(t, d->queue.front().due);
  }
  return t;
}

void SimLink::send(Direction& d, std::span<const std::uint8_t> message, std::int64_t host_ns) {
  hash_.bytes(message.data(), message.size());
  if (cut_) return;
  if (d.shaped) rt::effect_ran(rt::Effect::kLinkShape);
  const std::int64_t due =
      d.shaped ? d.shaper.deliver_at(host_ns, message.size()) : host_ns + kBareDelay;
  d.queue.push_back({due, {message.begin(), message.end()}});
}

void SimLink::deliver(Direction& d, Direction& back, std::int64_t host_ns) {
  while (!d.queue.empty() && d.queue.front().due <= host_ns) {
    const Packet packet = std::move(d.queue.front());
    d.queue.pop_front();
    if (cut_) continue;
    if (!d.to.endpoint->receive(packet.bytes, d.to.clock.from_host(host_ns),
                                [&](std::span<const std::uint8_t> m) { send(back, m, host_ns); })) {
      d.to.status->refused.store(true);
    }
    note(d, host_ns);
  }
}

void SimLink::note(Direction& d, std::int64_t host_ns) {
  const auto& e = *d.to.endpoint;
  if (e.ever_heard()) d.to.status->last_heard_ns.store(rt::ns_of(e.last_heard()));
  d.to.status->round_trip_ns.store(e.round_trip().count());
  if (e.clock().valid()) {
    d.to.status->uncertainty_ns.store(e.clock().uncertainty(d.to.clock.from_host(host_ns)).count());
  }
}

void SimLink::act(std::int64_t host_ns) {
  deliver(to_robot_, to_operator_, host_ns);
  deliver(to_operator_, to_robot_, host_ns);
  if (next_poll_ > host_ns) return;
  next_poll_ += kPoll;
  for (auto* d : {&to_robot_, &to_operator_}) {
    const bool line_free = d->shaped ? !d->shaper.busy(host_ns) : d->queue.empty();
    d->from.endpoint->poll(
        d->from.clock.from_host(host_ns), line_free,
        [&](std::span<const std::uint8_t> m) { send(*d, m, host_ns); },
        d->shaped ? d->shaper.busy_for(host_ns) : rt::Nanos::max());
  }
}

bool SimLink::handshake(std::int64_t from_host_ns, std::int64_t to_host_ns) {
  next_poll_ = from_host_ns;
  for (std::int64_t t = next_host_ns(); t < to_host_ns; t = next_host_ns()) act(t);
  return to_robot_.from.endpoint->ready() && to_operator_.from.endpoint->ready();
}

}  // namespace teletact
