// teletact bench link: the built `robot` and `operator` over a road of 10 Mbit/s and 75 to 95 ms
// each way, real TCP with TLS, H.264 colour on. Each run has both boxes with all their tasks, in
// two network namespaces of this machine (link_rig.hpp).
//
//   rest       the base stands, for a minute; depth against the truth
//   own_clock  at rest, the camera with a clock of its own: 18 ms of drift a minute
//   strict     the base drives rounds; pictures count while it moves. Depth codec `moving`
//   lenient    the same under the lenient noise model
//   saturated  lossless depth: more pictures than the road carries, all the time
//   stall      400 ms in which nothing crosses, every 4 s
//   rate       10 to 4 to 10 Mbit/s, told to nobody
//   loss       .5 % of the packets
//   drive      the default mark; again with .5 % loss; again with the stalls
//   pairs      ten times idle and saturated in turn: what the road does to the tasks of 1 kHz
//
// What others do on this machine's cores makes pictures rarer and older than the road does: above
// .05 of a core figures of time are printed and count as not measured.
#pragma once

#include <map>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"
#include "tools/measure/bench/link/link_pairs.hpp"
#include "tools/measure/bench/link/link_stages.hpp"
#include "tools/measure/bench/link/link_window.hpp"

namespace teletact {

struct LinkBenchOptions {
  std::vector<std::string> only;  // of the runs' names; empty: all
  double seconds = 60;            // of rest, strict and lenient; the others last a third to a half
};
[[nodiscard]] const std::vector<std::string>& link_run_names();

struct LinkDrive {
  bool arrived = false;  // with one engage: the person at the desk does not press again
  double time_s = 0;     // from the mark to the arrival
  Silence silence;       // drive_stall: after the road fell silent
  Silence gaps;          // after the last goal before a gap in them
  std::string missed{};  // why it did not arrive, as the operator's box says it
};

// One run, as far as it came.
struct LinkRow {
  std::string problem;  // it did not come to its end: nothing of it is measured
  std::string busy;     // others took too much of the machine for figures of time
  LinkWindow window;
  double others_cores = 0, road_busy_Mbit_per_s = 0, road_late_p95_us = 0;
  std::string robot_congestion, operator_congestion;
  double depth_over_sensor = 0;  // rest, strict, lenient
  std::string depth_problem;     // it was not measured
  double over_stall_ms = 0;      // stall
  double after_rate_p95_ms = 0;  // rate: from 3 s after each change on, the worse of both
  double thin_spared = 0, wide_spared = 0;  // rate: pictures with anything lowered, there
  double felt_p95_ms = 0;              // rest: from an exposure to the first force that knows it
  int felt = 0;                        // images that were felt
  std::vector<Stages_ms> felt_stages;  // rest: where that time went, of each
  double link_cpu = 0, link_declared = 0;  // of a core: the link's threads of both boxes
  LinkDrive drive;
};

struct LinkBenchResult {
  std::string refusal;  // no road can be made here: nothing was measured
  std::string host;
  std::vector<std::string> congestion;  // that a socket of this kernel takes
  std::map<std::string, LinkRow> rows;  // by the name of the run
  std::optional<LinkPairs> pairs;       // none: it was not run

  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
  [[nodiscard]] std::string page(const std::string& command) const;  // of docs/measured
};

// Without the rights: a result with the refusal. Throws std::runtime_error where it can not start.
[[nodiscard]] LinkBenchResult bench_link(std::ostream& progress, const LinkBenchOptions& options);

}  // namespace teletact
