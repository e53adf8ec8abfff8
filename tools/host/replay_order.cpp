#include <algorithm>
#include <queue>
#include <tuple>

#include "rt/random.hpp"
#include "tools/host/replay.hpp"

namespace teletact {

namespace {

using Node = std::uint32_t;
constexpr Node kNone = ~Node{0};
constexpr std::uint64_t kMostAtOnce = 1024;  // publications of one cell by one commit

// Nodes are the ops, then the messages.
class Order {
 public:
  explicit Order(const Recording& r)
      : r_(r),
        ops_(static_cast<Node>(r.ops.size())),
        nodes_(static_cast<Node>(r.ops.size() + r.messages.size())),
        used_(nodes_, true) {}

  // Empty: fine; else what is wrong.
  std::string build() {
    for (int task = 0; task < tasks::kTaskCount; ++task) {
      if (auto wrong = chain(task); !wrong.empty()) return wrong;
    }
    for (Node m = ops_; m < nodes_; ++m) {
      if (m > ops_) edge(m - 1, m);
      if (auto wrong = publish(m, kLinkWriter, r_.messages[m - ops_].head.published);
          !wrong.empty()) {
        return wrong;
      }
    }
    for (const auto& row : read_table()) {
      if (auto wrong = read(row); !wrong.empty()) return wrong;
    }
    return read_touch();
  }

  [[nodiscard]] std::vector<ReplayStep> sort(std::uint64_t seed) const {
    std::vector<std::vector<Node>> next(nodes_);
    std::vector<Node> waits(nodes_, 0);
    for (const auto& [from, to] : edges_) {
      next[from].push_back(to);
      ++waits[to];
    }
    using Key = std::tuple<std::uint64_t, Node>;  // smaller first
    std::priority_queue<Key, std::vector<Key>, std::greater<>> ready;
    const auto offer = [&](Node n) {
      const std::int64_t at = n < ops_ ? r_.ops[n].at_ns : r_.messages[n - ops_].head.at_ns;
      ready.emplace(seed == 0 ? static_cast<std::uint64_t>(at) ^ (1ULL << 63U) : rt::mix64(seed, n),
                    n);
    };
    for (Node n = 0; n < nodes_; ++n) {
      if (used_[n] && waits[n] == 0) offer(n);
    }
    std::vector<ReplayStep> out;
    while (!ready.empty()) {
      const Node n = std::get<1>(ready.top());
      ready.pop();
      out.push_back({n >= ops_, n < ops_ ? n : n - ops_});
      for (const Node to : next[n]) {
        if (--waits[to] == 0) offer(to);
      }
    }
    return out;
  }
  [[nodiscard]] std::size_t count() const {
    return static_cast<std::size_t>(std::count(used_.begin(), used_.end(), true));
  }

 private:
  struct Use {
    Node latch;
    std::uint64_t n;
    bool before_next;  // it would have taken n + 1
  };
  static std::string name(int task) {
    return std::string(tasks::kTaskTable[static_cast<std::size_t>(task)].name);
  }
  std::string job(Node n) const {
    return name(r_.ops[n].task) + " job " + std::to_string(r_.ops[n].k);
  }
  void edge(Node from, Node to) { edges_.emplace_back(from, to); }

  std::string chain(int task) {
    Node before = kNone;
    for (Node n = 0; n < ops_; ++n) {
      const JobOp& op = r_.ops[n];
      if (op.task != task) continue;
      const bool latch = op.kind == JobOp::Kind::kLatch;
      const bool open = before != kNone && r_.ops[before].kind == JobOp::Kind::kLatch;
      if (latch == open || (open && r_.ops[before].k != op.k) ||
          (!open && before != kNone && r_.ops[before].k >= op.k)) {
        return job(n) + ": out of order";
      }
      if (before != kNone) edge(before, n);
      before = n;
      if (latch) continue;
      if (auto wrong = publish(n, task, op.get<Ended>().published); !wrong.empty()) return wrong;
    }
    // Under way at the end: nobody saw what it would have done.
    if (before != kNone && r_.ops[before].kind == JobOp::Kind::kLatch) {
      used_[before] = false;
      if (!edges_.empty() && edges_.back().second == before) edges_.pop_back();
    }
    return {};
  }

  std::string publish(Node n, int writer, const Seqs& newest) {
    for (const auto& row : cell_table()) {
      if (row.writer != writer) continue;
      auto& by = publishers_[static_cast<std::size_t>(row.cell)];
      const std::uint64_t v = newest[static_cast<std::size_t>(row.slot)];
      if (v < by.size() || v - by.size() > kMostAtOnce)
        return "publications of " + row.name + " out of order";
      by.resize(v, n);
    }
    return {};
  }

  std::string use(int cell, const Use& u) {
    const auto& by = publishers_[static_cast<std::size_t>(cell)];
    if (u.n > by.size()) {
      return job(u.latch) + ": used number " + std::to_string(u.n) + " of " +
             row_of_cell(cell)->name + ", which was never published";
    }
    if (u.n > 0) edge(by[u.n - 1], u.latch);
    if (u.before_next && u.n < by.size()) edge(u.latch, by[u.n]);
    return {};
  }

  std::string read(const ReadRow& row) {
    bool seen = false;
    for (Node n = 0; n < ops_; ++n) {
      const JobOp& op = r_.ops[n];
      if (op.task != static_cast<std::uint16_t>(row.reader) || op.kind != JobOp::Kind::kLatch ||
          !used_[n]) {
        continue;
      }
      const std::uint64_t v = op.seq[static_cast<std::size_t>(row.input)];
      if (v == 0 && row.may_not_ask && seen) continue;
      seen = seen || v > 0;
      if (auto wrong = use(row.cell, {n, v, true}); !wrong.empty()) return wrong;
    }
    return {};
  }

  std::string read_touch() {
    for (Node n = 0; n < ops_; ++n) {
      const JobOp& op = r_.ops[n];
      if (op.task != static_cast<std::uint16_t>(tasks::TaskId::kPlanning) ||
          op.kind != JobOp::Kind::kLatch || !used_[n]) {
        continue;
      }
      const auto in = op.get<TouchInput>();
      if (auto wrong = use(cell_of(tasks::EdgeId::kTouch), {n, in.taken, in.full == 0});
          !wrong.empty())
        return wrong;
    }
    return {};
  }

  const Recording& r_;
  Node ops_, nodes_;
  std::vector<bool> used_;
  std::vector<std::pair<Node, Node>> edges_;
  std::array<std::vector<Node>, kCells> publishers_;  // [n - 1] published number n
};

}  // namespace

rt::Result<std::vector<ReplayStep>> replay_order(const Recording& recording, std::uint64_t seed) {
  Order order(recording);
  if (auto wrong = order.build(); !wrong.empty()) return rt::Error{recording.path + ": " + wrong};
  auto steps = order.sort(seed);
  if (steps.size() != order.count())
    return rt::Error{recording.path + ": the jobs' inputs contradict each other"};
  return steps;
}

}  // namespace teletact
