// teletact report FOLDER: the report of a run, or of a piece of it, from the files that it left.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <stdexcept>

#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/host/run_results.hpp"
#include "tools/scene/host_info.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/piece_options.hpp"

namespace teletact {

namespace {

// Samples of the consoles outside the piece go, and the figures of those that are gone.
class Crop {
 public:
  Crop(const rt::StorePiece& piece, std::int64_t epoch_ns) : piece_(piece), epoch_ns_(epoch_ns) {}
  template <class T>
  void operator()(std::vector<T>& samples) const {
    std::erase_if(samples, [&](const T& s) {
      const double at_s = 1e-9 * static_cast<double>(rt::ns_of(s.stamp) - epoch_ns_);
      return at_s < piece_.from_s || at_s >= piece_.to_s;
    });
  }

 private:
  rt::StorePiece piece_;
  std::int64_t epoch_ns_;
};

void crop(const rt::StorePiece& piece, OperatorHalf& op, RobotHalf& robot) {
  if (piece.all()) return;
  const Crop of_op(piece, op.epoch_ns), of_robot(piece, robot.epoch_ns);
  of_op(op.view.haptic);
  of_op(op.view.fusion);
  of_op(op.view.haptic_thin.kept);
  of_robot(robot.view.robot);
  of_robot(robot.view.truth);
  of_robot(robot.view.robot_past.kept);
  of_robot(robot.view.truth_past.kept);
  op.view.haptic_past = {};
  op.view.fusion_past = {};
  op.view.touched_past.clear();
  op.totals.clear();
  robot.totals.clear();
}

bool no_sentinels(const rt::RunLog& log) {
  return log.sentinels.empty() && log.past_sentinels.empty();
}

}  // namespace

int cmd_report(int argc, char** argv) {
  CLI::App app{
      "Makes the report of a run, or of a piece of it, from the folder that the run left "
      "(REPORT/raw). Samples of the consoles are whole for the newest minutes only; job records as "
      "teletact audit has them."};
  std::string raw, folder, json;
  app.add_option("FOLDER", raw, "REPORT/raw of a run")->required();
  app.add_option("--report", folder, "folder for the report")->required();
  app.add_option("--json", json, "write the figures to this file");
  const PieceOptions asked(app);
  if (!parse_options(app, argc, argv)) return 0;
  const rt::StorePiece ends = asked.piece();
  check_outputs({{"--json", json}}, {});
  for (const char* box : {"/operator.run", "/robot.run"}) {
    if (!std::filesystem::exists(raw + box))
      throw std::runtime_error(raw + box +
                               ": not there; FOLDER is the folder raw of a run's report");
  }
  make_output_folder("--report", folder);
  OperatorHalf op;
  RobotHalf robot;
  const rt::StorePiece piece{ends.from_s, ends.to_s, ends.all() ? kOfReport.whole_s : ends.whole_s};
  load_half(raw, op, piece);
  load_half(raw, robot, piece);
  if (op.log.tasks.empty() || robot.log.tasks.empty())
    throw std::runtime_error(raw + ": the job records can not be read; teletact audit says why");
  crop(piece, op, robot);
  RunInfo info;
  for (int i = 0; i < argc; ++i)
    info.command += (i == 0 ? "teletact " : " ") + std::string(argv[i]);
  info.folder = folder;
  info.host = host_rows();
  info.virtual_clock = no_sentinels(op.log) && no_sentinels(robot.log);
  info.effects = load_effects(raw);
  if (!piece.all()) {
    char text[120];
    std::snprintf(text, sizeof text, "a piece of the run: from %.6g s to %.6g s", piece.from_s,
                  piece.to_s);
    info.notes.emplace_back(text);
  }
  Metrics metrics("report");
  add_metrics(info, op, robot, metrics);
  write_report(folder, make_report(info, op, robot, metrics));
  if (!json.empty()) metrics.write(json);
  for (const auto* log : {&op.log, &robot.log}) {
    for (const auto& told : log->told) std::printf("JOB RECORDS: %s\n", told.c_str());
  }
  std::printf("report: %s/report.html\n", folder.c_str());
  return 0;
}

}  // namespace teletact
