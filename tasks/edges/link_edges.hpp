// An edge between the boxes at its link endpoint: the row's code and period, the message's field list.
#pragma once

#include <span>

#include "drivers/link/endpoint.hpp"
#include "drivers/link/wire.hpp"
#include "tasks/edges/edge_cells.hpp"
#include "tasks/edges/message_values.hpp"

namespace tasks {

// Its instants into local time.
template <class M>
void to_local(M& m, const drivers::LinkEndpoint& endpoint) noexcept {
  rt::for_each_field(m, [&endpoint]<class T>(T& v, const auto&) {
    if constexpr (std::same_as<T, rt::Time>) v = endpoint.to_local(rt::ns_of(v));
  });
}

struct NobodyLooks {
  template <class M>
  void operator()(const M&, std::int64_t, std::size_t) const noexcept {}
};

// `seen` is told of each value that was taken, when it was made on the sender's own clock, and the
// size of its body.
template <EdgeId E, rt::Box B, class Seen = NobodyLooks>
void receive_edge(EdgeCells<B>& cells, drivers::LinkEndpoint& endpoint, Seen seen = {}) {
  endpoint.add_incoming(kEdge<E>.row.wire.code,
                        [&cells, &endpoint, seen](std::span<const std::uint8_t> body, rt::Time) {
                          MessageOf<E> m;
                          if (!drivers::decode(body, m)) return false;
                          const std::int64_t made_ns = rt::ns_of(edge::datum(m));
                          to_local(m, endpoint);
                          cells.template begin_write<E>() = m;
                          cells.template publish<E>(endpoint.arrived(), endpoint.unsure());
                          seen(m, made_ns, body.size());
                          return true;
                        });
}

template <EdgeId E, rt::Box B>
void send_edge(EdgeCells<B>& cells, drivers::LinkEndpoint& endpoint) {
  constexpr Wire wire = kEdge<E>.row.wire;
  endpoint.add_outgoing(wire.code, std::chrono::milliseconds{wire.period_ms}, wire.bulk,
                        [&cells](std::span<std::uint8_t> out) -> std::size_t {
                          const auto m = cells.template read_by_link<E>();
                          return m ? drivers::encode(*m, out) : 0;
                        });
}

}  // namespace tasks
