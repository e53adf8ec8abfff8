// The figures of the rings bench, by name and as text.
#include <algorithm>
#include <iomanip>

#include "tools/measure/bench/rings.hpp"

namespace teletact {
namespace {

constexpr const char* kQueueNames[] = {"own", "boost", "moodycamel"};
constexpr const char* kSizeNames[] = {"8B", "256B"};

}  // namespace

double RingsResult::own_over_best(Size size, Placement placement) const {
  const double best =
      std::max(queue[kBoost][size][placement].Mops, queue[kMoodycamel][size][placement].Mops);
  return best > 0 ? queue[kOwn][size][placement].Mops / best : 0;
}

std::vector<Limit> RingsResult::limits() const {
  const std::string why_not = measured         ? disturbed(other_load)
                              : remark.empty() ? "too few rounds on near cores"
                                               : remark;
  Limits all;
  for (const Size s : {k8B, k256B}) {
    all.add(std::string("own / best of the others, ") + kSizeNames[s], own_over_best(s, kNear),
            ">=", 0.95, why_not);
  }
  all.add("round trip of 8B, bare lines", queue[kOwn][k8B][kNear].rtt_over_line, "<=", 1.3,
          why_not);
  all.add("a read of Latest, ns", latest[kNear].read_ns, "<=", 600, why_not);
  const bool any = latest[kNear].rounds + latest[kFar].rounds > 0;
  all.add("torn reads", static_cast<double>(latest_torn), "<=", 0, any ? "" : why_not);
  return all.all();
}

std::vector<BenchMetric> RingsResult::metrics() const {
  std::vector<BenchMetric> m;
  for (int q = 0; q < kQueues; ++q) {
    for (int s = 0; s < kSizes; ++s) {
      const std::string name = std::string("ring.") + kQueueNames[q] + '.' + kSizeNames[s];
      m.push_back({name + ".Mops", queue[q][s][kNear].Mops, "1e6/s"});
      m.push_back({name + ".rtt_ns", queue[q][s][kNear].rtt_ns, "ns"});
      m.push_back({name + ".rtt_over_line", queue[q][s][kNear].rtt_over_line, "1"});
      m.push_back({name + ".rtt_over_best_line", queue[q][s][kNear].rtt_over_best_line, "1"});
      if (queue[q][s][kFar].rounds == 0) continue;
      m.push_back({name + ".far_Mops", queue[q][s][kFar].Mops, "1e6/s"});
      m.push_back({name + ".far_rtt_ns", queue[q][s][kFar].rtt_ns, "ns"});
    }
  }
  for (const Size s : {k8B, k256B}) {
    m.push_back({std::string("ring.own_over_best.") + kSizeNames[s], own_over_best(s, kNear), "1"});
  }
  m.push_back({"ring.line_ns", line_ns[kNear], "ns"});
  m.push_back({"ring.line_best_ns", line_best_ns[kNear], "ns"});
  m.push_back({"ring.bursts_near", static_cast<double>(bursts[kNear]), "1"});
  m.push_back({"ring.bursts_far", static_cast<double>(bursts[kFar]), "1"});
  m.push_back({"ring.bursts_mixed", static_cast<double>(bursts_mixed), "1"});
  m.push_back({"ring.fifo", fifo ? 1.0 : 0.0, "1"});
  m.push_back({"ring.measured", measured ? 1.0 : 0.0, "1"});
  m.push_back({"latest.4KB.read_ns", latest[kNear].read_ns, "ns"});
  m.push_back({"latest.4KB.writes_per_read", latest[kNear].writes_per_read, "1"});
  m.push_back({"latest.4KB.torn", static_cast<double>(latest_torn), "1"});
  if (latest[kFar].rounds > 0) m.push_back({"latest.4KB.far_read_ns", latest[kFar].read_ns, "ns"});
  return m;
}

void RingsResult::print(std::ostream& out) const {
  const auto flags = out.flags();
  out << std::fixed << std::setprecision(1);
  const char* const placements[] = {"near", "far"};
  for (int p = 0; p < kPlacements; ++p) {
    if (bursts[p] == 0) continue;
    out << "cores " << placements[p] << ": bare line " << line_ns[p] << " ns a round trip ("
        << line_best_ns[p] << " when waited for with a pause), " << bursts[p] << " bursts\n";
    for (int s = 0; s < kSizes; ++s) {
      for (int q = 0; q < kQueues; ++q) {
        const Figures& f = queue[q][s][p];
        out << "  " << std::setw(10) << kQueueNames[q] << std::setw(6) << kSizeNames[s]
            << std::setw(8) << f.Mops << " M items/s, round trip " << std::setw(6) << f.rtt_ns
            << " ns = " << std::setprecision(2) << f.rtt_over_line << " lines, "
            << f.rtt_over_best_line << " paused ones (" << f.rounds << " rounds)\n"
            << std::setprecision(1);
      }
      out << "        own / best of the others" << std::setw(6) << kSizeNames[s] << ": "
          << std::setprecision(2) << own_over_best(static_cast<Size>(s), static_cast<Placement>(p))
          << '\n'
          << std::setprecision(1);
    }
    out << "  Latest of 4 KB under a flat-out writer: " << latest[p].read_ns << " ns a read, "
        << latest[p].writes_per_read << " writes a read (" << latest[p].rounds << " rounds)\n";
  }
  out << "torn reads " << latest_torn << ", bursts thrown away " << bursts_mixed
      << (fifo ? ", SCHED_FIFO" : ", not SCHED_FIFO") << '\n';
  if (!remark.empty()) out << remark << '\n';
  teletact::print(out, limits());
  out.flags(flags);
}

}  // namespace teletact
