// An edge between the boxes at its link endpoint: the row's code and period, the message's field list.
#pragma once

#include <span>

#include "drivers/link/endpoint.hpp"
#include "drivers/link/wire.hpp"
#include "tasks/edges/edge_cells.hpp"

namespace tasks {

// Its instants into local time.
template <class M>
void to_local(M& m, const drivers::LinkEndpoint& endpoint) noexcept {
  rt::for_each_field(m, [&endpoint]<class T>(T& v, const auto&) {
    if constexpr (std::same_as<T, rt::Time>) v = endpoint.to_local(rt::ns_of(v));
  });
}

template <EdgeId E, rt::Box B>
void receive_edge(EdgeCells<B>& cells, drivers::LinkEndpoint& endpoint) {
  endpoint.add_incoming(kEdge<E>.row.wire.code,
                        [&cells, &endpoint](std::span<const std::uint8_t> body, rt::Time) {
                          MessageOf<E> m;
                          if (!drivers::decode(body, m)) return false;
                          to_local(m, endpoint);
                          cells.template begin_write<E>() = m;
                          cells.template publish<E>(endpoint.arrived(), endpoint.unsure());
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
