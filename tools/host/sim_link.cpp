#include "tools/host/sim_link.hpp"
#include "rt/effect_count.hpp"

#include <algorithm>

namespace teletact {

namespace {
constexpr std::int64_t kTransportPoll = 1000000;  // as the TCP transport's loop
constexpr std::int64_t kBareDelay = 100000;       // loopback without a shaper: never in no time
}  // namespace

SimLink::SimLink(End op, End robot, const drivers::LinkShapeConfig& shape,
                 std::int64_t start_host_ns)
    : to_robot_{op, robot, drivers::LinkShaper(shape, 0), shape.any(), {}, {}, {}},
      to_operator_{robot, op, drivers::LinkShaper(shape, 1), shape.any(), {}, {}, {}},
      next_poll_(start_host_ns) {
  if (shape.any()) rt::effect_built(rt::Effect::kLinkShape);
}

void SimLink::emulate(const drivers::NetworkConfig& network, std::int64_t epoch_host_ns) {
  if (!network.any()) return;
  rt::effect_built(rt::Effect::kLinkNetwork);
  to_robot_.road.emplace(network, drivers::Way::kToRobot, epoch_host_ns);
  to_operator_.road.emplace(network, drivers::Way::kToOperator, epoch_host_ns);
}

std::size_t SimLink::held_bytes() const noexcept {
  std::size_t held = 0;
  for (const auto* d : {&to_robot_, &to_operator_}) {
    for (const Packet& p : d->queue) held += p.bytes.size();
    if (d->road) held += d->road->held() + d->reader.held();
  }
  return held;
}

const drivers::StreamEmulator* SimLink::road(drivers::Way way) const noexcept {
  const Direction& d = way == drivers::Way::kToRobot ? to_robot_ : to_operator_;
  return d.road ? &d.road->road() : nullptr;
}

std::int64_t SimLink::next_host_ns() const noexcept {
  std::int64_t t = next_poll_;
  for (const auto* d : {&to_robot_, &to_operator_}) {
    if (d->road && !cut_ && !ended_) t = std::min(t, d->road->next_arrival_ns());
    if (!d->queue.empty()) t = std::min(t, d->queue.front().due);
  }
  return t;
}

void SimLink::send(Direction& d, std::span<const std::uint8_t> message, std::int64_t host_ns) {
  hash_.bytes(message.data(), message.size());
  if (cut_ || ended_) return;
  if (d.road) {
    rt::effect_ran(rt::Effect::kLinkNetwork);
    d.road->send(message, host_ns);
    return;
  }
  if (d.shaped) rt::effect_ran(rt::Effect::kLinkShape);
  const std::int64_t due =
      d.shaped ? d.shaper.deliver_at(host_ns, message.size()) : host_ns + kBareDelay;
  d.queue.push_back({due, {message.begin(), message.end()}});
}

bool SimLink::receive(Direction& d, Direction& back, std::span<const std::uint8_t> message,
                      std::int64_t host_ns) {
  const bool taken =
      d.to.endpoint->receive(message, d.to.clock.from_host(host_ns),
                             [&](std::span<const std::uint8_t> m) { send(back, m, host_ns); });
  // Damage is no refusal: another connection may carry what it should.
  if (!taken && !(d.road && d.to.endpoint->hello_ok())) d.to.status->refused.store(true);
  note(d, host_ns);
  return taken;
}

// Over TCP too a side that can not read on closes the connection, and the other one sees its end.
void SimLink::end_connection(std::int64_t host_ns) {
  ended_ = true;
  ended_at_ = host_ns;
  for (auto* d : {&to_robot_, &to_operator_}) d->to.status->closed.store(true);
}

void SimLink::connect_again(std::int64_t host_ns) {
  if (host_ns < ended_at_ + kAgain_ns) return;
  for (auto* d : {&to_robot_, &to_operator_}) {
    if (d->to.status->refused.load() || !d->road->passable(host_ns)) return;
  }
  for (auto* d : {&to_robot_, &to_operator_}) {
    d->road->renew(host_ns);
    d->reader.renew();
    d->to.endpoint->renew();
  }
  ended_ = false;
  ++connections_;
}

void SimLink::deliver_road(Direction& d, Direction& back, std::int64_t host_ns) {
  const auto bytes = d.road->arrived(host_ns);
  const auto status = d.reader.feed(bytes, [&](std::span<const std::uint8_t> message) {
    return receive(d, back, message, host_ns);
  });
  d.road->take(bytes.size());
  if (status != drivers::WireStatus::kOk || d.reader.stopped() || d.road->ended(host_ns))
    end_connection(host_ns);
}

void SimLink::deliver(Direction& d, Direction& back, std::int64_t host_ns) {
  if (d.road) {
    if (!cut_ && !ended_) deliver_road(d, back, host_ns);
    return;
  }
  while (!d.queue.empty() && d.queue.front().due <= host_ns) {
    const Packet packet = std::move(d.queue.front());
    d.queue.pop_front();
    if (cut_) continue;
    (void)receive(d, back, packet.bytes, host_ns);
  }
}

void SimLink::note(Direction& d, std::int64_t host_ns) {
  const auto& e = *d.to.endpoint;
  if (e.ever_heard()) d.to.status->last_heard_ns.store(rt::ns_of(e.last_heard()));
  d.to.status->round_trip_ns.store(e.round_trip().count());
  if (d.road && e.ready()) {
    d.to.status->session.store(connections_);
    d.to.status->closed.store(false);
  }
  if (e.clock().valid()) {
    d.to.status->uncertainty_ns.store(e.clock().uncertainty(d.to.clock.from_host(host_ns)).count());
  }
}

void SimLink::act(std::int64_t host_ns) {
  const std::int64_t begin = rt::thread_cpu_ns();
  turn(host_ns);
  cpu_ns_ += rt::thread_cpu_ns() - begin;
}

void SimLink::turn(std::int64_t host_ns) {
  deliver(to_robot_, to_operator_, host_ns);
  deliver(to_operator_, to_robot_, host_ns);
  if (next_poll_ > host_ns) return;
  next_poll_ += kTransportPoll;
  if (ended_) connect_again(host_ns);
  if (ended_) return;
  for (auto* d : {&to_robot_, &to_operator_}) {
    const bool line_free = d->road     ? d->road->line_free(host_ns)
                           : d->shaped ? !d->shaper.busy(host_ns)
                                       : d->queue.empty();
    const rt::Nanos busy_for = d->road     ? d->road->busy_for(host_ns)
                               : d->shaped ? d->shaper.busy_for(host_ns)
                                           : rt::Nanos::max();
    d->from.endpoint->poll(
        d->from.clock.from_host(host_ns), line_free,
        [&](std::span<const std::uint8_t> m) { send(*d, m, host_ns); }, busy_for);
  }
}

bool SimLink::handshake(std::int64_t from_host_ns, std::int64_t to_host_ns) {
  next_poll_ = from_host_ns;
  for (std::int64_t t = next_host_ns(); t < to_host_ns; t = next_host_ns()) act(t);
  return to_robot_.from.endpoint->ready() && to_operator_.from.endpoint->ready();
}

}  // namespace teletact
