// An edge between the boxes at its link endpoint: the row's code and period, the message's field
// list.
#pragma once

#include <span>

#include "drivers/link/endpoint.hpp"
#include "drivers/link/wire_body.hpp"
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
  static_assert(drivers::InSchema<MessageOf<E>>, "kSchema of drivers/link/wire_body.hpp lists it");
  endpoint.add_incoming(kEdge<E>.row.wire.code,
                        [&cells, &endpoint, seen](std::span<const std::uint8_t> body, rt::Time) {
                          MessageOf<E> m;
                          if (!drivers::decode(body, m)) return false;
                          const std::int64_t made_ns = rt::ns_of(edge::datum(m));
                          to_local(m, endpoint);
                          // Readers know age and order by it: what is newest for ever ends both.
                          if (endpoint.from_ahead(edge::datum(m))) return false;
                          if constexpr (requires { m.made; })  // and by it that the sender lives
                            if (endpoint.from_ahead(m.made)) return false;
                          cells.template begin_write<E>() = m;
                          cells.template publish<E>(endpoint.arrived(), endpoint.unsure());
                          seen(m, made_ns, body.size());
                          return true;
                        });
}

template <EdgeId E, rt::Box B>
void send_edge(EdgeCells<B>& cells, drivers::LinkEndpoint& endpoint) {
  static_assert(drivers::InSchema<SentMessageOf<E>>,
                "kSchema of drivers/link/wire_body.hpp lists it");
  constexpr Wire wire = kEdge<E>.row.wire;
  endpoint.add_outgoing(wire.code, std::chrono::milliseconds{wire.period_ms}, wire.bulk,
                        [&cells](std::span<std::uint8_t> out) -> std::size_t {
                          const auto m = cells.template read_by_link<E>();
                          return m ? drivers::encode(*m, out) : 0;
                        });
}

// Its values cross as they are. Between the ends of the others stand the codecs (picture_link.hpp)
// or the gate (command_edges.hpp).
[[nodiscard]] constexpr bool crosses_as_it_is(const EdgeRow& row) noexcept {
  return row.kind == EdgeKind::kRemote && row.id != EdgeId::kFrame && row.id != EdgeId::kGoal;
}

// Both directions, all such edges, in the order of their rows.
template <rt::Box B, class Seen = NobodyLooks>
void bind_edges(EdgeCells<B>& cells, drivers::LinkEndpoint& endpoint, const Seen& seen = {}) {
  const auto bind = [&]<std::size_t I>(std::integral_constant<std::size_t, I>) {
    constexpr EdgeId id = static_cast<EdgeId>(I);
    if constexpr (crosses_as_it_is(kEdge<id>.row)) {
      if constexpr (end_in(id, B) == EdgeEnd::kSends)
        send_edge<id>(cells, endpoint);
      else
        receive_edge<id>(cells, endpoint, seen);
    }
  };
  [&]<std::size_t... I>(std::index_sequence<I...>) {
    (bind(std::integral_constant<std::size_t, I>{}), ...);
  }
  (std::make_index_sequence<kEdgeCount>{});
}

}  // namespace tasks
