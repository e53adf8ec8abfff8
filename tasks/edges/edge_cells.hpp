// The cells of one box, made from the rows of kEdges (tasks/contract/table.hpp): a channel with its
// fault gate for each edge that this box reads or sends. A reader that the edge's row does not name
// does not compile.
//
//     cells.take<EdgeId::kPatch, TaskId::kHaptic>(record)   newest value, by reference (rt::Latest); its number noted
//     cells.read<EdgeId::kMode, kConsole>()                 the same, by an ordinary thread
//     cells.begin_write<EdgeId::kPatch>() ... cells.publish<EdgeId::kPatch>(now)
//     cells.ring<EdgeId::kTouch, TaskId::kPlanning>()   for its one reader
//     cells.push<EdgeId::kTouch>(event, gap)            for its one writer
//
// An edge between the boxes has a cell at both ends. The sender's cell is read by the link alone.
// The receiver's cell holds what arrived; its fault gate counts messages after the wire's own
// checks.
#pragma once

#include <memory>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "drivers/link/encoded_frame.hpp"
#include "rt/channel/latest.hpp"
#include "rt/channel/ring.hpp"
#include "rt/sched/job_record.hpp"
#include "tasks/contract/fields.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/edges/edge_faults.hpp"

namespace tasks {

enum class EdgeEnd : std::uint8_t { kNone, kBoth, kSends, kReads };

// The end or ends of an edge that lie in box `b`.
[[nodiscard]] constexpr EdgeEnd end_in(EdgeId id, rt::Box b) {
  const EdgeRow& row = kEdgeTable[index_of(id)];
  const bool here = box_of(row.from) == b;
  if (row.kind == EdgeKind::kRemote) return here ? EdgeEnd::kSends : EdgeEnd::kReads;
  return here ? EdgeEnd::kBoth : EdgeEnd::kNone;
}

template <EdgeId E, EdgeEnd End>
struct LatestCell {
  using Message = std::conditional_t<End == EdgeEnd::kSends, SentMessageOf<E>, MessageOf<E>>;

  LatestCell(rt::NonRealtime& nrt, const rt::FaultPlan& faults)
      : cell(nrt, holds()), gate(faults, kEdge<E>.row.name) {}
  rt::Latest<Message> cell;
  EdgeGate gate;  // not of what is sent: that is counted where it arrives

 private:
  static std::vector<int> holds() {
    if (End == EdgeEnd::kSends) return {1};  // the link
    std::vector<int> counts;
    for (const Reader& r : kEdge<E>.readers) counts.push_back(r.holds);
    return counts;
  }
};

template <EdgeId E>
struct RingCell {
  RingCell(rt::NonRealtime&, const rt::FaultPlan& faults) : gate(faults, kEdge<E>.row.name) {}
  static_assert(kEdge<E>.readers.size() == 1);
  rt::Ring<MessageOf<E>, std::size_t{kEdge<E>.row.room}> cell;
  EdgeGate gate;
};

template <rt::Box B>
class EdgeCells {
 public:
  // asked(edge): false for an optional edge that this run's scene does not ask for. No cell is made
  // for it.
  template <class Asked>
  EdgeCells(rt::NonRealtime& nrt, const rt::FaultPlan& faults, Asked&& asked) {
    make(nrt, faults, asked, std::make_index_sequence<kEdgeCount>{});
  }

  template <EdgeId E>
  [[nodiscard]] bool has() const noexcept {
    return std::get<index_of(E)>(cells_) != nullptr;
  }
  template <EdgeId E, TaskId R>
  requires(names_reader(E, R) && end_in(E, B) != EdgeEnd::kSends)
      [[nodiscard]] auto read() noexcept {
    constexpr int slot = reader_slot(E, R);
    return of<E>().cell.acquire_if_new(slot);
  }
  // The same; its number goes into the job's record, at the place that the row says.
  template <EdgeId E, TaskId R>
  requires(names_reader(E, R) && end_in(E, B) != EdgeEnd::kSends)
      [[nodiscard]] auto take(rt::JobRecord& record) noexcept {
    constexpr int input = kLimitTable[find_limit_row(E, R)].input;
    static_assert(input != kUnlisted, "no task's");
    const auto view = read<E, R>();
    record.input_seq[std::size_t{input}] = view.seq;
    return view;
  }
  template <EdgeId E>
  [[nodiscard]] auto read_by_link() noexcept {
    static_assert(end_in(E, B) == EdgeEnd::kSends);
    return of<E>().cell.acquire_if_new(0);
  }
  template <EdgeId E>
  [[nodiscard]] bool fresh_for_link() noexcept {
    static_assert(end_in(E, B) == EdgeEnd::kSends);
    return of<E>().cell.fresh(0);
  }
  template <EdgeId E>
  [[nodiscard]] auto& begin_write() noexcept {
    return of<E>().cell.begin_write();
  }
  // Publishes the slot of begin_write() through the fault gate. True: it was published. `at`,
  // `unsure`: see rt::Latest.
  template <EdgeId E>
  bool publish(rt::Time at, rt::Nanos unsure = rt::Nanos{0}) noexcept {
    auto& c = of<E>();
    if constexpr (end_in(E, B) == EdgeEnd::kSends) {
      c.cell.publish(at, unsure);
      return true;
    } else {
      return tasks::publish(c.gate, c.cell, c.cell.begin_write(), at, unsure);
    }
  }
  template <EdgeId E, TaskId R>
  requires(names_reader(E, R) && kEdge<E>.row.kind == EdgeKind::kRing)
      [[nodiscard]] auto& ring() noexcept {
    return of<E>().cell;
  }
  template <EdgeId E, class... More>
  auto push(const MessageOf<E>& event, More&... gap) noexcept {
    auto& c = of<E>();
    return tasks::push(c.gate, c.cell, event, gap...);
  }
  // Number of the newest value that was published or pushed; any thread. 0: none, or no such cell
  // here.
  template <EdgeId E>
  [[nodiscard]] std::uint64_t newest() const noexcept {
    if constexpr (end_in(E, B) != EdgeEnd::kNone) {
      if (!has<E>()) return 0;
      const auto& cell = std::get<index_of(E)>(cells_)->cell;
      if constexpr (kEdge<E>.row.kind == EdgeKind::kRing)
        return cell.pushed();
      else
        return cell.latest_seq();
    } else {
      return 0;
    }
  }
  // For set-up and tests; tasks use the calls above.
  template <EdgeId E>
  [[nodiscard]] auto& of() noexcept {
    static_assert(end_in(E, B) != EdgeEnd::kNone, "this box has no end of the edge");
    return *std::get<index_of(E)>(cells_);
  }

 private:
  struct Nothing {};
  template <EdgeId E>
  using CellOf = std::conditional_t<end_in(E, B) == EdgeEnd::kNone, Nothing,
                                    std::conditional_t<kEdge<E>.row.kind == EdgeKind::kRing,
                                                       RingCell<E>, LatestCell<E, end_in(E, B)>>>;
  template <std::size_t... I>
  static auto pointers(std::index_sequence<I...>)
      -> std::tuple<std::unique_ptr<CellOf<static_cast<EdgeId>(I)>>...>;

  template <class Asked, std::size_t... I>
  void make(rt::NonRealtime& nrt, const rt::FaultPlan& faults, Asked& asked,
            std::index_sequence<I...>) {
    const auto one = [&]<std::size_t J>(std::integral_constant<std::size_t, J>) {
      constexpr EdgeId id = static_cast<EdgeId>(J);
      if constexpr (end_in(id, B) != EdgeEnd::kNone) {
        if (asked(id)) std::get<J>(cells_) = std::make_unique<CellOf<id>>(nrt, faults);
      }
    };
    (one(std::integral_constant<std::size_t, I>{}), ...);
  }

  decltype(pointers(std::make_index_sequence<kEdgeCount>{})) cells_;
};

}  // namespace tasks
