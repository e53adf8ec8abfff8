#include "tools/audit/audit_tables.hpp"

#include <cstdio>

#include "rt/audit/blame.hpp"
#include "tools/files/build_info.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/host/run_results.hpp"
#include "tools/host/task_times.hpp"
#include "tools/scene/host_info.hpp"

namespace teletact {

namespace {

double us(std::int64_t ns) { return static_cast<double>(ns) * 1e-3; }

void print_task(const AuditedTask& a, const TaskTimes& times, const rt::TaskBlame& b) {
  const rt::TaskLog& t = *a.task;
  const int level = last_level_of(t);
  std::printf("%-18s %8llu %8.1f %8.1f %8.1f | %8.1f %8.1f %8.1f | %6llu", a.name.c_str(),
              static_cast<unsigned long long>(jobs_of(t)), us(times.cpu.quantile(0.5)),
              us(times.cpu.quantile(0.99)), us(t.spec.budget_of(level).count()),
              us(times.lateness.quantile(0.5)), us(times.lateness.quantile(0.99)),
              us(times.lateness.quantile(0.999)), static_cast<unsigned long long>(b.miss_total));
  for (const auto n : b.misses) std::printf(" %6llu", static_cast<unsigned long long>(n));
  std::printf("\n");
}

void print_ends(const AuditedTask& a, const TaskTimes& times) {
  const auto& r = times.response;
  const auto& s = times.slack;
  std::printf("%-18s %8.1f %8.1f %8.1f %8.1f | %8.1f %8.1f %8.1f %8.1f\n", a.name.c_str(),
              us(r.quantile(0.5)), us(r.quantile(0.99)), us(r.quantile(0.999)), us(r.max()),
              us(s.quantile(0.5)), us(s.quantile(0.01)), us(s.quantile(0.001)), us(s.least()));
}

void add_task(const AuditedTask& a, const TaskTimes& times, const rt::TaskBlame& b,
              Metrics& metrics) {
  const std::string& name = a.name;
  metrics.add(name + ".jobs", static_cast<double>(jobs_of(*a.task)), "1");
  metrics.add(name + ".cpu_p99_us", us(times.cpu.quantile(0.99)), "us");
  metrics.add(name + ".late_p999_us", us(times.lateness.quantile(0.999)), "us");
  metrics.add(name + ".response_p50_us", us(times.response.quantile(0.5)), "us");
  metrics.add(name + ".response_p99_us", us(times.response.quantile(0.99)), "us");
  metrics.add(name + ".response_p999_us", us(times.response.quantile(0.999)), "us");
  metrics.add(name + ".response_max_us", us(times.response.max()), "us");
  metrics.add(name + ".slack_p50_us", us(times.slack.quantile(0.5)), "us");
  metrics.add(name + ".slack_p1_us", us(times.slack.quantile(0.01)), "us");
  metrics.add(name + ".slack_p01_us", us(times.slack.quantile(0.001)), "us");
  metrics.add(name + ".slack_min_us", us(times.slack.least()), "us");
  metrics.add(name + ".miss_total", static_cast<double>(b.miss_total), "1");
  for (int c = 0; c < rt::kCauses; ++c) {
    metrics.add(name + ".miss_" + std::string(rt::name_of(static_cast<rt::Cause>(c))),
                static_cast<double>(b.misses[static_cast<std::size_t>(c)]), "1");
  }
}

// What speaks against the task, one line each; empty: it kept its budget and missed nothing by
// itself.
std::vector<std::string> complaints(const AuditedTask& a, const rt::TaskBlame& b,
                                    Metrics& metrics) {
  std::vector<std::string> out;
  if (const auto own = b.misses[static_cast<std::size_t>(rt::Cause::kOwn)]; own > 0)
    out.push_back(a.name + ": " + std::to_string(own) + " misses of its own making");
  for (const BudgetCheck& c : check_budget(*a.task, b)) {
    const std::string name = a.name + ".level" + std::to_string(c.level);
    metrics.add(name + ".cpu_p999_us", us(c.cpu_p999_ns), "us");
    metrics.add(name + ".budget_us", us(c.budget_ns), "us");
    metrics.add(name + ".charged", static_cast<double>(c.charged), "1");
    if (c.kept()) continue;
    char text[200];
    std::snprintf(text, sizeof text,
                  "%s, level %d: CPU p99.9 %.1f us is over the budget of %.1f us (%llu jobs, %llu "
                  "charged ones left out)",
                  a.name.c_str(), c.level, us(c.cpu_p999_ns), us(c.budget_ns),
                  static_cast<unsigned long long>(c.jobs),
                  static_cast<unsigned long long>(c.charged));
    out.emplace_back(text);
  }
  return out;
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

void print_note(const rt::RunLog& log) {
  for (const auto& note : log.not_realtime) std::printf("NOT REAL-TIME: %s\n", note.c_str());
  for (const auto& told : log.told) std::printf("JOB RECORDS: %s\n", told.c_str());
}

}  // namespace

std::vector<std::string> print_tasks(const std::vector<AuditedTask>& tasks, Metrics& metrics) {
  std::printf("%-18s %8s %8s %8s %8s | %8s %8s %8s | %6s %6s %6s %6s %6s %6s %6s\n", "task", "jobs",
              "cpu p50", "p99", "budget", "late p50", "p99", "p99.9", "misses", "carry", "platf",
              "queue", "own", "charg", "unkn");
  std::vector<TaskTimes> times;
  std::vector<std::string> against;
  for (const auto& a : tasks) {
    times.push_back(times_of(*a.task));
    const rt::TaskBlame b = rt::blame(*a.log, *a.task);
    print_task(a, times.back(), b);
    add_task(a, times.back(), b, metrics);
    for (auto& line : complaints(a, b, metrics)) against.push_back(std::move(line));
  }
  std::printf("\n%-18s %8s %8s %8s %8s | %8s %8s %8s %8s\n", "us", "resp p50", "p99", "p99.9",
              "max", "slack p50", "p1", "p0.1", "least");
  for (std::size_t i = 0; i < tasks.size(); ++i) print_ends(tasks[i], times[i]);
  return against;
}

void print_boxes(const AuditInput& in, Metrics& metrics) {
  for (const auto& [file, box] : in.boxes) {
    print_black_box(file, box);
    std::printf("\n");
    add_black_box(box, metrics);
  }
}

void print_notes(const std::vector<rt::RunLog>& logs, Metrics& metrics) {
  std::uint64_t dropped = 0;
  for (const auto& log : logs) {
    dropped += log.dropped;
    print_note(log);
  }
  metrics.add("audit.dropped", static_cast<double>(dropped), "1");
  if (dropped > 0) {
    std::printf("AUDIT INCOMPLETE: %llu records lost, a ring was full\n",
                static_cast<unsigned long long>(dropped));
  }
}

ReportData audit_report(const std::string& command, const std::vector<AuditedTask>& tasks,
                        const std::vector<rt::RunLog>& logs,
                        const std::vector<std::string>& against, const Metrics& metrics) {
  using State = ReportVerdict::State;
  ReportData d;
  d.title = "teletact audit";
  d.version = kVersion;
  d.command = command;
  d.host = host_rows();
  d.metrics = metrics;
  d.timing_only = true;
  for (const auto& line : against) d.verdicts.push_back({State::kBad, line});
  if (against.empty())
    d.verdicts.push_back({State::kGood, "every task kept its budget; no miss of a task's own"});
  for (const auto& log : logs) {
    for (const auto& note : log.not_realtime)
      d.verdicts.push_back({State::kNote, "NOT REAL-TIME: " + note});
    for (const auto& told : log.told) d.verdicts.push_back({State::kNote, "job records: " + told});
  }
  for (const auto& a : tasks) {
    d.tasks.push_back(report_task(*a.log, *a.task, {},
                                  a.log->sentinels.empty() && a.log->past_sentinels.empty()));
    d.tasks.back().name = a.name;
  }
  return d;
}

void write_events(const std::string& path, const std::vector<AuditedTask>& tasks,
                  const std::vector<rt::StoreEvent>& box_events) {
  WholeFile f(path);
  std::fprintf(f.get(), "what,k,release_ns,end_ns,deadline_ns,cpu_ns,skipped,level,fault,text\n");
  for (const auto& a : tasks) {
    if (!a.task->past) continue;
    for (const rt::JobRecord& r : a.task->past->events) {
      std::fprintf(f.get(), "%s,%llu,%lld,%lld,%lld,%lld,%u,%u,%u,\n", a.name.c_str(),
                   static_cast<unsigned long long>(r.k), static_cast<long long>(r.release_ns),
                   static_cast<long long>(r.end_ns), static_cast<long long>(r.deadline_ns),
                   static_cast<long long>(r.cpu_ns), r.skipped, r.level, r.fault);
    }
    if (const auto n = a.task->past->events_left_out; n > 0)
      std::fprintf(f.get(), "%s,,,,,,,,,%llu more\n", a.name.c_str(),
                   static_cast<unsigned long long>(n));
  }
  for (const rt::StoreEvent& e : box_events)
    std::fprintf(f.get(), "box,,%lld,,,,,,,%s\n", static_cast<long long>(e.time_ns),
                 e.text.c_str());
  f.finish();
}

}  // namespace teletact
