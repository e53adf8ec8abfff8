// teletact bench rings: our Ring beside the two packaged single-producer queues, and Latest.
//
// Capacity 1024, payloads of 8 and 256 bytes, one binary built with NDEBUG (without it moodycamel's
// re-entrancy check cuts its rate by five). Each round runs every queue once in rotating order;
// each burst is enclosed by two measurements of the bare cache line's round trip, which tell
// whether the two cores are near (a shared cache) or far; a burst whose ends differ is thrown away.
// Figures are medians over rounds; near and far placements are never mixed.
//
//   Mops      items through the queue a second, both sides retrying without a pause
//   rtt       one item there and one back through a second queue; p50 over batches of 16
//   line      a bare cache line there and back, retried like the queues; beside it the better of
//             that and a loop with a pause instruction, which is nearer to the physical limit
//   limits    near: own / best of the others >= .95 of both sizes; own round trip of 8 bytes <= 1.3
//             bare lines (aimed at: 1.15; 256 bytes are four lines); a read of Latest <= 600 ns;
//             not measured without 7 near rounds or beside others. Torn reads: none, ever
//   Latest    4 KB, the writer fills and publishes without rest, the reader takes the newest and
//             reads every word; a read whose words differ is torn (there is no retry to count)
#pragma once

#include <array>
#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct RingsResult {
  enum Queue { kOwn = 0, kBoost, kMoodycamel, kQueues };
  enum Size { k8B = 0, k256B, kSizes };
  enum Placement { kNear = 0, kFar, kPlacements };

  struct Figures {  // medians; 0 where the placement was not met
    int rounds = 0;
    double Mops = 0;
    double rtt_ns = 0;
    // Medians of the ratios to the lines measured around the same burst.
    double rtt_over_line = 0;
    double rtt_over_best_line = 0;
  };
  Figures queue[kQueues][kSizes][kPlacements];
  double line_ns[kPlacements] = {0, 0};       // waited for in the loop the queues are retried in
  double line_best_ns[kPlacements] = {0, 0};  // the better of that and waiting with a pause
  int bursts[kPlacements] = {0, 0};
  int bursts_mixed = 0;  // the placement changed within the burst: thrown away

  struct LatestFigures {
    int rounds = 0;
    double read_ns = 0;
    double writes_per_read = 0;
  };
  LatestFigures latest[kPlacements];
  std::uint64_t latest_torn = 0;

  double other_load = 0;  // cores, meanwhile
  bool fifo = false;
  bool measured = false;  // enough near rounds of everything
  std::string remark;     // why not, or what was missing

  [[nodiscard]] double own_over_best(Size size, Placement placement) const;
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// `rounds` near rounds are aimed at, with at most four times as many tried; at least 7 of them are
// needed for `measured`.
[[nodiscard]] RingsResult bench_rings(std::ostream& progress, int rounds);

}  // namespace teletact
