// The report of a run: a folder with report.html (self-contained: no network, no script, pictures
// inline) and report.json. Plain data in; the caller fills what it has, empty parts are left out.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "tools/files/metrics_json.hpp"
#include "tools/report/svg.hpp"

namespace teletact {

struct ReportVerdict {
  enum class State : std::uint8_t { kGood, kNote, kBad };
  State state = State::kGood;
  std::string text;  // one line, figures included
};

struct ReportTask {
  std::string name, box, task_class, policy;
  double rate_hz = 0;
  int core = 0, priority = 0;
  double budget_us = 0;
  std::string level;  // variant in force at the end
  std::uint64_t releases = 0, completed = 0, skipped = 0, aborted = 0;
  // Misses by cause; the causes add up to `misses`.
  std::uint64_t misses = 0, own = 0, queued = 0, platform = 0, carried = 0, charged = 0,
                unknown = 0;
  struct Quantiles {
    double p50 = 0, p99 = 0, p999 = 0, max = 0;
  };
  Quantiles cpu_us, lateness_us, response_us;
  struct Slack {  // deadline - end: the small ones matter, a negative one is a miss
    double p50 = 0, p1 = 0, p01 = 0, least = 0;
  };
  Slack slack_us;
  // Heap allocations of a job, by libraries; none of it counted: -1.
  double allocations_p50 = -1, allocations_max = -1;
  double analysis_response_us = 0;  // R of admission; 0: not analysed
  // us; several: e.g. task and sentinel, slack left and deadline passed
  std::vector<plot::Bins> cpu_histogram, lateness_histogram, response_histogram, slack_histogram;
};

struct ReportSeries {
  std::vector<double> t_s, force_N, penetration_mm;  // one length
};

struct ReportMap {  // top view, frame M of the cost map turned into W by the caller
  int width = 0, height = 0;
  double x0_m = 0, y0_m = 0, resolution_m = 0.05;
  std::vector<std::uint8_t> cost;  // CostMap cells, iy * width + ix
  struct Moving {
    std::size_t cell = 0;  // of `cost`
    double age_s = 0;      // since its last sight
  };
  std::vector<Moving> moving;
  struct Line {
    std::string label;
    std::vector<double> x_m, y_m;
  };
  std::vector<Line> planned;  // published paths
  Line driven;                // robot by its own odometry
  Line truth;                 // robot in the simulated world; may be empty
  std::vector<double> mark_x_m, mark_y_m;
  std::vector<double> goal_x_m, goal_y_m;
};

struct ReportPicture {
  std::string title, caption;
  plot::Picture image;
  std::vector<plot::Overlay> overlays;  // pixels
};

struct ReportData {
  std::string title, version, command, started;           // started: ISO 8601, given by the caller
  std::vector<std::pair<std::string, std::string>> host;  // name, value
  std::vector<std::pair<std::string, std::string>> seeds;
  std::vector<ReportVerdict> verdicts;
  std::string config_toml;                  // effective configuration
  std::string calibration;                  // file or "declared", with the host's id
  std::string admission;                    // text of the admission, preformatted
  std::vector<std::string> choices, steps;  // static choices and levels: which, and why
  struct Mode {
    std::string name, refusal;  // empty: admitted
    double utilisation = 0, slack_ms = 0;
  };
  std::vector<Mode> modes;
  std::vector<ReportTask> tasks;
  ReportSeries touch;
  ReportMap map;
  ReportMap moving_map;  // when most of it moved; empty: nothing did
  double moving_map_at_s = 0;
  std::vector<ReportPicture> pictures;
  std::vector<std::pair<std::string, std::string>> effects;   // constructed: name, by which key
  std::vector<std::pair<std::string, std::uint64_t>> faults;  // code and text, count
  std::vector<std::string> files;  // other files of the folder, e.g. trace.json
  Metrics metrics{"demo"};
  bool timing_only = false;  // from records alone: nothing is known of effects and faults
};

[[nodiscard]] std::string report_html(const ReportData& data);
[[nodiscard]] std::string report_json(const ReportData& data);
// Makes `folder` if needed and writes both files, each whole or not at all. Throws
// std::runtime_error naming the file.
void write_report(const std::string& folder, const ReportData& data);

}  // namespace teletact
