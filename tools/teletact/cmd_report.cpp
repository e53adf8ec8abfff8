// teletact report FOLDER: the report of a run, or of a piece of it, from the files that it left.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <vector>

#include "tools/audit/audit_input.hpp"
#include "tools/audit/run_piece.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/host/run_results.hpp"
#include "tools/scene/host_info.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/piece_options.hpp"

namespace teletact {

namespace {

bool no_sentinels(const rt::RunLog& log) {
  return log.sentinels.empty() && log.past_sentinels.empty();
}

// Of both boxes, or of one that ran by itself.
std::vector<std::string> stores_in(const std::string& raw) {
  std::vector<std::string> stores;
  for (const char* box : {"/operator.run", "/robot.run"}) {
    if (std::filesystem::exists(raw + box)) stores.push_back(raw + box);
  }
  if (stores.empty())
    throw std::runtime_error(
        raw +
        ": neither operator.run nor robot.run is there; FOLDER is the folder raw of a run's "
        "report");
  return stores;
}

// What the machine refused once the threads were there; the records' header knows of the rest.
void add_rights(const std::string& raw, rt::RunLog& log) {
  std::ifstream missing(raw + "/not_realtime");
  for (std::string line; std::getline(missing, line);) log.not_realtime.push_back(line);
}

void add_notes(const rt::StorePiece& piece, const OperatorHalf& op, const RobotHalf& robot,
               const std::vector<std::string>& left_out, RunInfo& info) {
  if (!piece.all()) {
    char text[120], until[32] = "the end";
    if (piece.to_s < std::numeric_limits<double>::infinity())
      std::snprintf(until, sizeof until, "%.6g s", piece.to_s);
    std::snprintf(text, sizeof text, "a piece of the run: from %.6g s to %s; ", piece.from_s,
                  until);
    info.notes.push_back(text + std::to_string(left_out.size()) +
                         " figures are left out: they are known of the whole run alone, or of "
                         "newer samples");
  }
  if (op.log.tasks.empty() || robot.log.tasks.empty())
    info.notes.push_back(std::string("of the ") + (robot.log.tasks.empty() ? "operator" : "robot") +
                         "'s box alone: the other box has a report of its own");
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
  const auto stores = stores_in(raw);
  make_output_folder("--report", folder);
  OperatorHalf op;
  RobotHalf robot;
  const rt::StorePiece piece{ends.from_s, ends.to_s, ends.all() ? kOfReport.whole_s : ends.whole_s};
  load_half(raw, op, piece);
  load_half(raw, robot, piece);
  const std::size_t read = (op.log.tasks.empty() ? 0 : 1) + (robot.log.tasks.empty() ? 0 : 1);
  if (read < stores.size())
    throw std::runtime_error(raw + ": the job records can not be read; teletact audit says why");
  check_piece(stores, {&op.log, &robot.log}, ends);
  add_rights(raw, op.log.tasks.empty() ? robot.log : op.log);
  RunInfo info;
  info.piece = !piece.all();
  const auto left_out = info.piece ? crop_to(piece, op, robot) : std::vector<std::string>{};
  for (int i = 0; i < argc; ++i)
    info.command += (i == 0 ? "teletact " : " ") + std::string(argv[i]);
  info.folder = folder;
  info.host = host_rows();
  info.virtual_clock = no_sentinels(op.log) && no_sentinels(robot.log);
  info.effects = load_effects(raw);
  add_notes(piece, op, robot, left_out, info);
  Metrics all("report");
  add_metrics(info, op, robot, all);
  const Metrics metrics = without(all, "report", left_out);
  write_report(folder, make_report(info, op, robot, metrics));
  if (!json.empty()) metrics.write(json);
  for (const auto* log : {&op.log, &robot.log}) {
    for (const auto& told : log->told) std::printf("JOB RECORDS: %s\n", told.c_str());
  }
  std::printf("report: %s/report.html\n", folder.c_str());
  return 0;
}

}  // namespace teletact
