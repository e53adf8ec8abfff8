// What a run leaves: the logs of both boxes and what their consoles saw. A process of the demo
// saves its half into the report folder while it runs; the parent (or the virtual run) reads both
// halves and makes metrics and report from them.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "rt/audit/blame.hpp"
#include "rt/audit/run_log.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/executor.hpp"
#include "rt/sched/mode_table.hpp"
#include "rt/store/read_store.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/host/console.hpp"
#include "tools/record/recording_truth.hpp"
#include "tools/report/report.hpp"
#include "tools/touch/force_check.hpp"

namespace teletact {

struct BoxTotals {
  std::uint16_t task = 0;
  rt::TaskTotals totals;
};

// Thread CPU of a process's ordinary threads, from the epoch on. span 0: not measured.
struct OrdinaryCpu {
  std::int64_t link_ns = 0, console_ns = 0, camera_twin_ns = 0;
  std::int64_t span_ns = 0;  // of the wall, that it was spent in
};

struct OperatorHalf {
  rt::RunLog log;
  OperatorView view;
  LinkSeen link;
  std::vector<BoxTotals> totals;
  std::int64_t epoch_ns = 0;  // operator box clock
  std::uint64_t dropped_records = 0, hangs = 0;
  std::int64_t link_round_trip_ns = 0, link_uncertainty_ns = 0;
  ForceCheck force_check;
  OrdinaryCpu ordinary;
  bool complete = false;  // false: the process ended early
};

struct RobotHalf {
  rt::RunLog log;
  RobotView view;
  std::vector<BoxTotals> totals;
  std::int64_t epoch_ns = 0;  // robot box clock
  std::int64_t camera_twin_cpu_ns = 0;
  OrdinaryCpu ordinary;
  std::uint64_t dropped_records = 0, hangs = 0;
  bool complete = false;
};

// <folder>/operator.view, robot.view: raw records of this build, read back on this host only.
// False: the disk refused it, and the one that was saved before stays.
bool save_half(const std::string& folder, const OperatorHalf& half);
// The same, with what a console and the link still hold in place of the half's own: no copy.
bool save_half(const std::string& folder, const OperatorHalf& half, const OperatorView& view,
               const LinkSeen& link);
bool save_half(const std::string& folder, const RobotHalf& half);
bool save_half(const std::string& folder, const RobotHalf& half, const RobotView& view);
// Of the job records a report holds the newest five minutes whole: what a page and a trace can
// show.
inline constexpr rt::StorePiece kOfReport{0, std::numeric_limits<double>::infinity(), 300};
// Missing or torn parts stay empty, `complete` false.
void load_half(const std::string& folder, OperatorHalf& half,
               const rt::StorePiece& piece = kOfReport);
void load_half(const std::string& folder, RobotHalf& half, const rt::StorePiece& piece = kOfReport);
// The hand's visits, and what came of them.
[[nodiscard]] TouchedPlaces touched_of(const OperatorHalf& op);

// Effects constructed by a process: <folder>/<box>.effects, one "name<TAB>key" a line.
void save_effects(const std::string& folder, const std::string& box, const Effects& effects);
[[nodiscard]] Effects load_effects(const std::string& folder);

struct RunInfo {
  std::string command, calibration_text, config_toml, started, folder;
  bool virtual_clock = false, stub_bodies = false, recording = false;
  bool piece = false;  // the halves hold a piece of the run (tools/audit/run_piece.hpp)
  // Paced runs: the duration on the real clock, and the time by which the run stayed behind it.
  bool paced = false;
  double wall_s = 0, lag_s = 0;
  std::string
      not_real_time;  // one line: why the real clock was not taken, and what gives it; empty: it was, or not wanted
  std::string give_rights;         // real clock without a right: the command that gives it
  std::vector<std::string> notes;  // of the report, no problem
  // haptic.method, and its spring in the scene, K / scale; empty: not known.
  std::string touch_method;
  double touch_N_per_m = 0;
  double seconds = 0;
  std::string stopped_early;  // empty: not stopped; else one line that says when
  Effects effects;
  rt::Admission admission;
  rt::ModeTable modes;
  std::vector<rt::BestEffortLoad> best_effort;  // declared shares of ordinary threads, both boxes
  std::vector<std::pair<std::string, std::string>> host, seeds;
  std::uint64_t sched_hash = 0, log_hash = 0;
  std::vector<std::string> problems;  // each makes the exit code non-zero
  std::vector<std::string> files;
  RecordingFigures recorded;      // of a recording, against its own poses
  double ate_first_pose_mm = -1;  // of rendered images, against the twin; below 0: not known
};

// Share of a core that ordinary threads took, both boxes together, beside their declared share.
// Empty if nothing was measured (virtual clock, a process that ended early).
struct OrdinaryShare {
  std::string name;
  double share = 0, declared = 0;
};
[[nodiscard]] std::vector<OrdinaryShare> ordinary_shares(const RunInfo&, const OperatorHalf&,
                                                         const RobotHalf&);

// CPU that they took beyond the declared shares, if the spare share of the admitted cores does not
// cover it: then admission promised more than this machine has. One line; empty: covered, or
// nothing was admitted or measured.
[[nodiscard]] std::string beyond_admission(const RunInfo&, const OperatorHalf&, const RobotHalf&);

// Why the timing of this run is not valid for the tasks (run.measured 0); empty: it is. `metrics`
// holds platform.late_share.
[[nodiscard]] std::string not_measured(const RunInfo&, const OperatorHalf&, const RobotHalf&,
                                       const Metrics& metrics);

// Figures of the run under their documented names (docs/metrics.md).
void add_metrics(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                 Metrics& metrics);
// One task's figures and histograms; `totals` may be empty: then they are counted from the records.
[[nodiscard]] ReportTask report_task(const rt::RunLog& log, const rt::TaskLog& task,
                                     const std::vector<BoxTotals>& totals, bool virtual_clock);
// What went well in the run and what did not: the first lines of its report. `d` has its tasks.
void add_verdicts(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                  const Metrics& metrics, ReportData& d);
[[nodiscard]] ReportData make_report(const RunInfo& info, const OperatorHalf& op,
                                     const RobotHalf& robot, const Metrics& metrics);

}  // namespace teletact
