#include "tools/measure/bench/rings.hpp"
#include "rt/quantile.hpp"
#include "tools/measure/bench/other_load.hpp"

#ifndef NDEBUG
#error "bench rings compares queues as shipped: build it with NDEBUG"
#endif

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <memory>
#include <thread>

// The peers are there to compare with; nobody needs them to run the program.
#if __has_include(<boost/lockfree/spsc_queue.hpp>) && \
    __has_include(<readerwriterqueue/readerwriterqueue.h>)
#include <readerwriterqueue/readerwriterqueue.h>

#include <boost/lockfree/spsc_queue.hpp>
#define TELETACT_BENCH_PEERS 1
#else
#define TELETACT_BENCH_PEERS 0
#endif

#include "rt/channel/latest.hpp"
#include "rt/channel/ring.hpp"
#include "tools/measure/bench/core_pair.hpp"

namespace teletact {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t kCapacity = 1024;
constexpr double kNearBelow_ns = 250;  // one shared cache: 80 to 130 ns; across: above 400 ns
constexpr int kNeeded = 7;
constexpr int kBatch = 16;

template <std::size_t kBytes>
struct Payload {
  std::array<std::uint64_t, kBytes / 8> w{};
};

// One interface over the three; each call is inlined.
template <class T>
struct Own {
  rt::Ring<T, kCapacity> q;
  bool push(const T& v) { return q.try_push(v); }
  bool pop(T& v) { return q.try_pop(v); }
};
#if TELETACT_BENCH_PEERS
template <class T>
struct Boost {
  boost::lockfree::spsc_queue<T, boost::lockfree::capacity<kCapacity>> q;
  bool push(const T& v) { return q.push(v); }
  bool pop(T& v) { return q.pop(v); }
};
template <class T>
struct Moodycamel {
  moodycamel::ReaderWriterQueue<T> q{kCapacity};
  bool push(const T& v) { return q.try_enqueue(v); }
  bool pop(T& v) { return q.try_dequeue(v); }
};
#endif

double median(const std::vector<double>& v) { return rt::quantile(v, 0.5); }

double ns_between(Clock::time_point a, Clock::time_point b) {
  return std::chrono::duration<double, std::nano>(b - a).count();
}

// p50 of one round trip, measured over `batches` batches: exchange(n) makes the n-th.
template <class Exchange>
double median_trip_ns(int batches, Exchange&& exchange) {
  std::vector<double> each(static_cast<std::size_t>(batches));
  std::uint64_t n = 0;
  for (double& ns : each) {
    const auto from = Clock::now();
    for (int i = 0; i < kBatch; ++i) exchange(++n);
    ns = ns_between(from, Clock::now()) / kBatch;
  }
  return median(each);
}

void pause_once() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

// Round trip of a bare cache line. 64 lines in turn, since the time depends on the address (which
// slice of the shared cache is its home).
template <bool kPause>
double line_trip_ns(CorePair& pair) {
  struct alignas(rt::kLinePair) Line {
    std::atomic<std::uint64_t> turn{0};
  };
  constexpr std::uint64_t kLines = 64, kBatches = 64;
  const auto lines = std::make_unique<Line[]>(kLines);
  const auto wait_for = [&](std::uint64_t n, std::uint64_t turn) {
    while (lines[n % kLines].turn.load(std::memory_order_acquire) != turn) {
      if constexpr (kPause) pause_once();
    }
  };
  const auto set = [&](std::uint64_t n, std::uint64_t turn) {
    lines[n % kLines].turn.store(turn, std::memory_order_release);
  };
  double ns = 0;
  pair.run(
      [&] {
        ns = median_trip_ns(kBatches, [&](std::uint64_t n) {
          set(n, 2 * n - 1);
          wait_for(n, 2 * n);
        });
      },
      [&] {
        for (std::uint64_t n = 1; n <= kBatches * kBatch; ++n) {
          wait_for(n, 2 * n - 1);
          set(n, 2 * n);
        }
      });
  return ns;
}

struct Trips {
  double line_before = 0, line_after = 0;  // plain retry loops, as round the queues
  double best_before = 0, best_after = 0;  // the better of plain and with a pause
  [[nodiscard]] bool mixed() const {
    return (line_before < kNearBelow_ns) != (line_after < kNearBelow_ns);
  }
  [[nodiscard]] RingsResult::Placement placement() const {
    return line_before < kNearBelow_ns ? RingsResult::kNear : RingsResult::kFar;
  }
  [[nodiscard]] double line() const { return (line_before + line_after) / 2; }
  [[nodiscard]] double best() const { return (best_before + best_after) / 2; }
};

template <class Burst>
Trips enclosed(CorePair& pair, Burst&& burst) {
  Trips t;
  t.line_before = line_trip_ns<false>(pair);
  t.best_before = std::min(t.line_before, line_trip_ns<true>(pair));
  burst();
  t.line_after = line_trip_ns<false>(pair);
  t.best_after = std::min(t.line_after, line_trip_ns<true>(pair));
  // The rest of the machine gets its turn between bursts.
  std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return t;
}

struct Samples {
  std::vector<double> Mops[RingsResult::kPlacements], rtt[RingsResult::kPlacements],
      over_line[RingsResult::kPlacements], over_best[RingsResult::kPlacements];
};

struct Lines {
  std::vector<double> plain[RingsResult::kPlacements], best[RingsResult::kPlacements];
  void add(const Trips& t) {
    plain[t.placement()].push_back(t.line());
    best[t.placement()].push_back(t.best());
  }
};

// Queues of one kind and size, kept for the whole bench so that their pages are touched. Several
// pairs take turns, since the time depends on the addresses.
template <class Q, class T>
class Contestant {
 public:
  static constexpr std::size_t kPairs = 4;
  Contestant() {
    for (std::size_t i = 0; i < kPairs; ++i) {
      there_all_[i] = std::make_unique<Q>();
      back_all_[i] = std::make_unique<Q>();
    }
  }

  void round(CorePair& pair, RingsResult& result, Lines& lines, Samples& samples) {
    there_ = there_all_[turn_ % kPairs].get();
    back_ = back_all_[turn_ % kPairs].get();
    ++turn_;
    double Mops = 0, rtt = 0;
    auto keep = [&](const Trips& t, std::vector<double>* to, double value) {
      if (t.mixed()) {
        ++result.bursts_mixed;
        return false;
      }
      ++result.bursts[t.placement()];
      lines.add(t);
      to[t.placement()].push_back(value);
      return true;
    };
    const Trips flow = enclosed(pair, [&] { Mops = flow_Mops(pair); });
    keep(flow, samples.Mops, Mops);
    const Trips trip = enclosed(pair, [&] { rtt = trip_ns(pair); });
    if (keep(trip, samples.rtt, rtt)) {
      samples.over_line[trip.placement()].push_back(rtt / trip.line());
      samples.over_best[trip.placement()].push_back(rtt / trip.best());
    }
  }

 private:
  double flow_Mops(CorePair& pair) {
    constexpr std::uint64_t kItems = sizeof(T) == 8 ? 1'000'000 : 150'000;
    Clock::time_point from, to;
    std::uint64_t sum = 0;
    pair.run(
        [&] {
          T item{};
          from = Clock::now();
          for (std::uint64_t n = 0; n < kItems; ++n) {
            item.w[0] = n;
            while (!there_->push(item)) {
            }
          }
        },
        [&] {
          T item;
          for (std::uint64_t n = 0; n < kItems; ++n) {
            while (!there_->pop(item)) {
            }
            sum += item.w[0];
          }
          to = Clock::now();
        });
    const bool complete = sum == kItems * (kItems - 1) / 2;
    return complete ? static_cast<double>(kItems) / ns_between(from, to) * 1e3 : 0;
  }

  double trip_ns(CorePair& pair) {
    constexpr int kBatches = 256;
    double ns = 0;
    pair.run(
        [&] {
          T item{};
          ns = median_trip_ns(kBatches, [&](std::uint64_t n) {
            item.w[0] = n;
            while (!there_->push(item)) {
            }
            while (!back_->pop(item)) {
            }
          });
        },
        [&] {
          T item;
          for (int n = 0; n < kBatches * kBatch; ++n) {
            while (!there_->pop(item)) {
            }
            while (!back_->push(item)) {
            }
          }
        });
    return ns;
  }

  std::unique_ptr<Q> there_all_[kPairs], back_all_[kPairs];
  Q *there_ = nullptr, *back_ = nullptr;
  std::size_t turn_ = 0;
};

struct Page {
  std::array<std::uint64_t, 512> w{};
};

struct LatestRound {
  double read_ns = 0, writes_per_read = 0;
  std::uint64_t torn = 0;
};

LatestRound latest_round(CorePair& pair, rt::Latest<Page>& cell) {
  constexpr int kBatches = 200;
  std::atomic<bool> done{false};
  LatestRound r;
  const std::uint64_t first = cell.latest_seq();
  pair.run(
      [&] {
        std::uint64_t n = first;
        while (!done.load(std::memory_order_relaxed)) {
          cell.begin_write().w.fill(++n);
          cell.publish();
        }
      },
      [&] {
        while (cell.latest_seq() == first) {
        }
        r.read_ns = median_trip_ns(kBatches, [&](std::uint64_t) {
          const auto view = cell.acquire(0);
          std::uint64_t differ = 0;
          for (const std::uint64_t w : view->w) differ |= w ^ view.seq;
          r.torn += differ != 0 ? 1U : 0U;
        });
        done.store(true, std::memory_order_relaxed);
      });
  r.writes_per_read = static_cast<double>(cell.latest_seq() - first) / (kBatches * kBatch);
  return r;
}

template <std::size_t kBytes>
struct Field {
  using T = Payload<kBytes>;
  Contestant<Own<T>, T> own;
#if TELETACT_BENCH_PEERS
  Contestant<Boost<T>, T> boost;
  Contestant<Moodycamel<T>, T> moodycamel;
#endif

  void round(CorePair& pair, RingsResult& result, Lines& lines,
             Samples (&samples)[RingsResult::kQueues], int shift) {
    for (int i = 0; i < RingsResult::kQueues; ++i) {
      const int q = (i + shift) % RingsResult::kQueues;
      if (q == RingsResult::kOwn) own.round(pair, result, lines, samples[q]);
#if TELETACT_BENCH_PEERS
      if (q == RingsResult::kBoost) boost.round(pair, result, lines, samples[q]);
      if (q == RingsResult::kMoodycamel) moodycamel.round(pair, result, lines, samples[q]);
#endif
    }
  }
};

void summarise(const Samples& from, RingsResult::Figures* to) {
  for (int p = 0; p < RingsResult::kPlacements; ++p) {
    to[p].rounds = static_cast<int>(std::min(from.Mops[p].size(), from.rtt[p].size()));
    to[p].Mops = median(from.Mops[p]);
    to[p].rtt_ns = median(from.rtt[p]);
    to[p].rtt_over_line = median(from.over_line[p]);
    to[p].rtt_over_best_line = median(from.over_best[p]);
  }
}

// The first lap of each queue meets untouched pages and a cold predictor: not counted.
void warm_up(CorePair& pair, Field<8>& small, Field<256>& large) {
  Samples unused[RingsResult::kQueues];
  RingsResult not_counted;
  Lines no_lines;
  for (int i = 0; i < 4; ++i) {
    small.round(pair, not_counted, no_lines, unused, i);
    large.round(pair, not_counted, no_lines, unused, i);
  }
}

// Why nothing can be measured here; empty: it can.
std::string no_rings(const CorePair& pair) {
  if (!pair.missing().empty()) return pair.missing();
  if (!TELETACT_BENCH_PEERS)
    return "built without the peers (libboost-dev, libreaderwriterqueue-dev): not measured";
  return {};
}

}  // namespace

RingsResult bench_rings(std::ostream& progress, int rounds) {
  RingsResult result;
  rt::Startup startup;
  CorePair pair;
  result.fifo = pair.missing().empty() && pair.fifo();
  if (result.remark = no_rings(pair); !result.remark.empty()) return result;
  if (!result.fifo) result.remark = "no right to SCHED_FIFO: other work may interrupt a burst; ";

  Field<8> small;
  Field<256> large;
  rt::Latest<Page> cell(startup.token(), {1});
  Samples samples[RingsResult::kSizes][RingsResult::kQueues];
  Lines lines;
  std::vector<double> read[RingsResult::kPlacements], writes[RingsResult::kPlacements];

  warm_up(pair, small, large);
  const OtherLoad others;
  const auto near_rounds = [&] {
    std::size_t least = read[RingsResult::kNear].size();
    for (const auto& of_size : samples) {
      for (const auto& s : of_size) {
        least =
            std::min({least, s.Mops[RingsResult::kNear].size(), s.rtt[RingsResult::kNear].size()});
      }
    }
    return static_cast<int>(least);
  };
  for (int tried = 0; tried < 4 * rounds && near_rounds() < rounds; ++tried) {
    small.round(pair, result, lines, samples[RingsResult::k8B], tried);
    large.round(pair, result, lines, samples[RingsResult::k256B], tried);
    LatestRound latest;
    const Trips t = enclosed(pair, [&] { latest = latest_round(pair, cell); });
    result.latest_torn += latest.torn;
    if (t.mixed()) {
      ++result.bursts_mixed;
    } else {
      ++result.bursts[t.placement()];
      read[t.placement()].push_back(latest.read_ns);
      writes[t.placement()].push_back(latest.writes_per_read);
    }
    progress << "\rrings: round " << tried + 1 << ", " << near_rounds() << " of " << rounds
             << " near" << std::flush;
  }
  progress << '\n';

  for (int s = 0; s < RingsResult::kSizes; ++s)
    for (int q = 0; q < RingsResult::kQueues; ++q) summarise(samples[s][q], result.queue[q][s]);
  for (int p = 0; p < RingsResult::kPlacements; ++p) {
    result.line_ns[p] = median(lines.plain[p]);
    result.line_best_ns[p] = median(lines.best[p]);
    result.latest[p] = {static_cast<int>(read[p].size()), median(read[p]), median(writes[p])};
  }
  result.other_load = others.cores();
  result.measured = near_rounds() >= kNeeded;
  if (!result.measured) {
    result.remark += "the cores were near in only " + std::to_string(near_rounds()) + " of " +
                     std::to_string(kNeeded) + " needed rounds: not measured";
  }
  return result;
}

}  // namespace teletact
