// teletact bench console: the operator's page beside the box that serves it (docs/console.md, The
// bench). Boxes are the built `teletact demo` on the real clock; pages are a WebSocket client of
// this program where an exact instant or a steady load is wanted, and Chromium, headless and
// drawing in software, where it is the page's own time or memory.
//
//   stop    50 stops with 1,000 intents a second queued before each
//   acts    from a pointer event to the task that takes it, to the answer on the page; from a piece
//           of mesh to the page's scene; frames a second on a played recording
//   cost    no viewer: fusion's instructions; one viewer: fusion's CPU, the server's, misses,
//           lateness, page open and hammered beside closed
//   growth  view messages as fast as they are taken, two viewers, reloads: memory
//
// Above .05 of a core by others, figures of time are printed and count as not measured.
#pragma once

#include <cstdint>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/console/console_figures.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct ConsoleBenchOptions {
  std::vector<std::string> only;  // of console_parts(); empty: all
  double seconds = 0;             // about so long each part; 0: its own length
  bool long_run = false;          // growth: 108,000 messages and 200 reloads
  std::string recording;          // for frames a second; empty or not there: not measured
};
[[nodiscard]] const std::vector<std::string>& console_parts();

// Of every part.
struct ConsolePart {
  std::string problem;  // it did not come to its end: nothing of it is measured
  std::string busy;     // others took too much of the machine for figures of time
  double others_cores = 0;
};

struct StopPart : ConsolePart {
  double one_way_ms = 0;
  std::vector<StopSeen> stops;  // in turn by the WebSocket and by POST
  std::uint64_t notes = 0;      // said before the stops
  std::uint64_t refused = 0;    // of them, for their speed
  double notes_per_s = 0;
  [[nodiscard]] bool in_time(const StopSeen& s) const;
};

struct ActTimes {
  std::string act, task;
  std::vector<double> task_ms;    // from the pointer event to the start of the job that takes it
  std::vector<double> answer_ms;  // to the answer on the page; empty: this act is not answered
  int lost = 0;                   // refused, or not found again
};
struct ActsPart : ConsolePart {
  std::string no_browser;
  std::vector<ActTimes> acts;
  std::vector<double> mesh_ms, pixels_ms;  // from fusion's piece to scene, to frame
  double clock_within_ms = 0;              // how well the page's clock is known
  std::string renderer;
  double live_share = 0, late_share = 0;  // of the time: the picture's border says so; else frozen
  // Played recording.
  std::string no_recording;
  double fps = 0, pictures_per_s = 0;
  double intent_p95_ms = 0, to_server_p95_ms = 0;  // of the box's own figures
};

struct CostPart : ConsolePart {
  std::string not_counted;       // why there are no instructions
  double without = 0, with = 0;  // of fusion's jobs of the virtual run
  std::string sched_without, sched_with, log_without, log_with;  // hashes of that run
  // Real clock: means of the windows, in turn closed and open.
  std::vector<double> fusion_open_ms, fusion_closed_ms;
  std::vector<double> late_open_us, late_closed_us;  // haptic, p99 over the sentinel
  double server_share = 0;
  std::uint64_t own_misses = 0;
  std::uint64_t views = 0;
  double megabytes = 0;
};

struct GrowthPart : ConsolePart {
  std::string no_browser;
  std::uint64_t messages = 0;  // taken by all viewers
  int reloads = 0;
  double seconds = 0;
  std::vector<double> server_MB, heap_MB, renderer_MB;  // a second or two apart
};

struct ConsoleBenchResult {
  std::string host;
  std::optional<StopPart> stop;
  std::optional<ActsPart> acts;
  std::optional<CostPart> cost;
  std::optional<GrowthPart> growth;

  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
  [[nodiscard]] std::string page(const std::string& command) const;  // of docs/measured
};

[[nodiscard]] ConsoleBenchResult bench_console(std::ostream& progress,
                                               const ConsoleBenchOptions& options);

// The parts. Each throws std::runtime_error with one line where it can not come to its end.
void measure_stop(std::ostream& progress, const ConsoleBenchOptions& options, StopPart& out);
void measure_acts(std::ostream& progress, const ConsoleBenchOptions& options, ActsPart& out);
void measure_cost(std::ostream& progress, const ConsoleBenchOptions& options, CostPart& out);
void measure_growth(std::ostream& progress, const ConsoleBenchOptions& options, GrowthPart& out);

}  // namespace teletact
