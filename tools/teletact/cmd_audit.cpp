// teletact audit FILE: who was late in a run, and why.
#include <CLI/CLI.hpp>
#include <filesystem>

#include "rt/audit/blame.hpp"
#include "rt/audit/histogram.hpp"
#include "rt/audit/run_file.hpp"
#include "tools/teletact/black_box.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/host_info.hpp"
#include "tools/teletact/metrics_json.hpp"
#include "tools/teletact/run_results.hpp"

namespace teletact {

namespace {

// Prints one task; true when the run kept its budget: no miss of the task's own making.
bool print_task(const rt::RunLog& log, const rt::TaskLog& t, Metrics& metrics) {
  const rt::TaskBlame b = rt::blame(log, t);
  rt::Histogram late, cpu, response;
  for (const auto& j : t.jobs) {
    late.record(j.lateness_ns());
    cpu.record(j.cpu_ns);
    response.record(j.end_ns - j.release_ns);
  }
  const auto us = [](const rt::Histogram& h, double q) {
    return static_cast<double>(h.quantile(q)) * 1e-3;
  };
  std::printf("%-18s %8zu %8.1f %8.1f %8.1f | %8.1f %8.1f %8.1f | %6llu", t.spec.name.c_str(),
              t.jobs.size(), us(cpu, 0.5), us(cpu, 0.99),
              static_cast<double>(t.spec.budget_of(t.level).count()) * 1e-3, us(late, 0.5),
              us(late, 0.99), us(late, 0.999), static_cast<unsigned long long>(b.miss_total));
  for (const auto n : b.misses) std::printf(" %6llu", static_cast<unsigned long long>(n));
  std::printf("\n");
  const std::string name = t.spec.name;
  metrics.add(name + ".jobs", static_cast<double>(t.jobs.size()), "1");
  metrics.add(name + ".cpu_p99_us", us(cpu, 0.99), "us");
  metrics.add(name + ".late_p999_us", us(late, 0.999), "us");
  metrics.add(name + ".response_max_us", static_cast<double>(response.max()) * 1e-3, "us");
  metrics.add(name + ".miss_total", static_cast<double>(b.miss_total), "1");
  for (int c = 0; c < rt::kCauses; ++c) {
    metrics.add(name + ".miss_" + std::string(rt::name_of(static_cast<rt::Cause>(c))),
                static_cast<double>(b.misses[static_cast<std::size_t>(c)]), "1");
  }
  return b.misses[static_cast<std::size_t>(rt::Cause::kOwn)] == 0;
}

void add_black_box(const rt::BlackBox& box, Metrics& metrics) {
  const bool op = !box.log.tasks.empty() && box.log.tasks[0].spec.box == rt::Box::kOperator;
  const std::string name = std::string("blackbox.") + (op ? "operator" : "robot");
  metrics.add(name + ".stop", box.stop, "text");
  metrics.add(name + ".seconds", seconds_of(box), "s");
  metrics.add(name + ".records", static_cast<double>(box.records), "1");
  metrics.add(name + ".missing", static_cast<double>(box.missing), "1");
  metrics.add(name + ".events", static_cast<double>(events_of(box).size()), "1");
}

}  // namespace

int cmd_audit(int argc, char** argv) {
  CLI::App app{
      "Reads the log of a run (report/raw/*.run) or what a stop left (*.blackbox): table, "
      "histograms, trace. Exit 0: no miss of a task's own making; 1: there was one; 2: bad input."};
  std::vector<std::string> files;
  std::string html, trace, csv, json;
  app.add_option("FILE", files, "run logs or black boxes, one or both boxes")->required();
  app.add_option("--html", html, "folder for a report with the histograms");
  app.add_option("--trace", trace, "Chrome/Perfetto trace file");
  app.add_option("--csv", csv, "one line a job");
  app.add_option("--json", json, "write the figures to this file");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  OperatorHalf op;
  RobotHalf robot;
  std::vector<rt::RunLog> logs;
  std::vector<std::pair<std::string, rt::BlackBox>> boxes;
  for (const auto& f : files) {
    if (rt::is_black_box(f)) {
      auto box = rt::read_black_box(f);
      if (!box) throw std::runtime_error(box.error());
      boxes.emplace_back(f, std::move(box).value());
      logs.push_back(boxes.back().second.log);
      continue;
    }
    auto log = rt::read_run_file(f);
    if (!log) throw std::runtime_error(log.error());
    logs.push_back(std::move(log).value());
  }
  Metrics metrics("audit");
  for (const auto& [file, box] : boxes) {
    print_black_box(file, box);
    std::printf("\n");
    add_black_box(box, metrics);
  }
  std::printf("%-18s %8s %8s %8s %8s | %8s %8s %8s | %6s %6s %6s %6s %6s %6s %6s\n", "task", "jobs",
              "cpu p50", "p99", "budget", "late p50", "p99", "p99.9", "misses", "carry", "platf",
              "queue", "own", "charg", "unkn");
  bool kept = true;
  std::vector<const rt::RunLog*> pointers;
  for (const auto& log : logs) {
    pointers.push_back(&log);
    for (const auto& t : log.tasks) kept = print_task(log, t, metrics) && kept;
    for (const auto& note : log.not_realtime) std::printf("NOT REAL-TIME: %s\n", note.c_str());
  }
  if (!trace.empty()) write_trace(trace, pointers);
  if (!csv.empty()) write_csv(csv, pointers);
  if (!json.empty()) metrics.write(json);
  if (!html.empty()) {
    op.log = logs[0];
    if (logs.size() > 1) robot.log = logs[1];
    RunInfo info;
    info.command = "teletact audit";
    info.host = host_rows();
    write_report(html, make_report(info, op, robot, metrics));
    std::printf("histograms: %s/report.html\n", html.c_str());
  }
  return kept ? 0 : 1;
}

}  // namespace teletact
