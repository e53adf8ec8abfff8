// teletact audit FILE: who was late in a run, and why.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "tools/audit/audit_tables.hpp"
#include "tools/cli/options.hpp"
#include "tools/host/run_results.hpp"
#include "tools/scene/host_info.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/piece_options.hpp"

namespace teletact {

int cmd_audit(int argc, char** argv) {
  CLI::App app{
      "Reads the log of a run (report/raw/*.run) or what a stop left (*.blackbox): table, "
      "histograms, trace. Of a long run the older records are counts and histograms. Exit 0: every "
      "task kept its budget (CPU p99.9 of each level, without "
      "jobs that the machine charged) and none missed by itself; 1: one did not; 2: bad input."};
  std::vector<std::string> files;
  std::string html, trace, csv, json, events;
  app.add_option("FILE", files, "run logs or black boxes; any number")->required();
  app.add_option("--html", html, "folder for a report with the histograms");
  app.add_option("--trace", trace, "Chrome/Perfetto trace file");
  app.add_option("--csv", csv, "one line a job");
  app.add_option("--json", json, "write the figures to this file");
  app.add_option(
      "--events", events,
      "one line a miss, overrun, fault or change of level among the older records, and an "
      "event of the box");
  const PieceOptions asked(app);
  if (!parse_options(app, argc, argv)) return 0;
  const rt::StorePiece piece = asked.piece();
  check_outputs({{"--trace", trace}, {"--csv", csv}, {"--json", json}, {"--events", events}},
                files);
  const AuditInput in = read_files(files, piece);
  if (!html.empty()) make_output_folder("--html", html);
  Metrics metrics("audit");
  print_boxes(in, metrics);
  const std::vector<AuditedTask> tasks = tasks_of(in.logs);
  const std::vector<std::string> against = print_tasks(tasks, metrics);
  print_notes(in.logs, metrics);
  for (const auto& line : against) std::printf("AGAINST: %s\n", line.c_str());
  std::vector<const rt::RunLog*> pointers;
  for (const auto& log : in.logs) pointers.push_back(&log);
  std::string command;
  for (int i = 0; i < argc; ++i) command += (i == 0 ? "teletact " : " ") + std::string(argv[i]);
  write_outputs({{trace, [&](const auto& path) { write_trace(path, pointers); }},
                 {csv, [&](const auto& path) { write_csv(path, pointers); }},
                 {json, [&](const auto& path) { metrics.write(path); }},
                 {events, [&](const auto& path) { write_events(path, tasks, in.events); }},
                 {html, [&](const auto& folder) {
                    write_report(folder, audit_report(command, tasks, in.logs, against, metrics));
                    std::printf("histograms: %s/report.html\n", folder.c_str());
                  }}});
  return against.empty() ? 0 : 1;
}

}  // namespace teletact
