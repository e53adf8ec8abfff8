#include "tools/measure/days.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>

#include "tasks/graph/calibration.hpp"
#include "tools/cli/options.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/host/run_results.hpp"
#include "tools/host/task_times.hpp"
#include "tools/measure/bench/tree_commit.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;
constexpr double kMiB = 1024 * 1024;
constexpr double kGrowth = 1.02, kReport_s = 30;

double resident_MiB() {
  std::ifstream statm("/proc/self/statm");
  double size = 0, resident = 0;
  statm >> size >> resident;
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / kMiB;
}

double seconds_since(std::chrono::steady_clock::time_point from) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count();
}

class OwnFolder {
 public:
  explicit OwnFolder(const std::string& asked) : asked_(!asked.empty()), path_(asked) {
    if (asked_) {
      fs::create_directories(path_);
      return;
    }
    std::string name = (fs::temp_directory_path() / "teletact_days_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error(name + ": can not be made");
    path_ = name;
  }
  ~OwnFolder() {
    std::error_code ignored;
    if (!asked_) fs::remove_all(path_, ignored);
  }
  OwnFolder(const OwnFolder&) = delete;
  OwnFolder& operator=(const OwnFolder&) = delete;
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  bool asked_;
  std::string path_;
};

double stores_MiB(const std::string& folder) {
  return static_cast<double>(rt::store_bytes(folder + "/operator.run") +
                             rt::store_bytes(folder + "/robot.run")) /
         kMiB;
}

// From the stores alone, as after a run.
void time_report(const DemoOptions& o, const VirtualRun& run, DaysResult& out) {
  const auto from = std::chrono::steady_clock::now();
  OperatorHalf op;
  RobotHalf robot;
  if (o.store_folder.empty()) {
    op.log = run.op.log;
    robot.log = run.robot.log;
  } else {
    load_half(o.store_folder, op);
    load_half(o.store_folder, robot);
  }
  op.totals = run.op.totals;
  robot.totals = run.robot.totals;
  RunInfo info;
  info.virtual_clock = info.stub_bodies = true;
  Metrics metrics("days");
  add_metrics(info, op, robot, metrics);
  const std::string folder = o.report + "/report";
  fs::create_directories(folder);
  write_report(folder, make_report(info, op, robot, metrics));
  out.report_s = seconds_since(from);
  for (const auto* log : {&op.log, &robot.log}) {
    for (const rt::TaskLog& t : log->tasks) {
      out.whole += t.jobs.size();
      out.jobs += jobs_of(t);
    }
  }
  std::uint64_t ran = 0;
  for (const auto* totals : {&run.op.totals, &run.robot.totals}) {
    for (const BoxTotals& b : *totals) ran += b.totals.completed + b.totals.aborted;
  }
  out.lost = ran - std::min(ran, out.jobs);
}

}  // namespace

DaysResult bench_days(std::ostream& progress, const DaysOptions& options) {
  DaysResult out;
  out.hours = options.hours;
  out.cap_MiB = 2 * static_cast<double>(options.cap_bytes) / kMiB;
  out.host = tasks::host_id();
  const OwnFolder folder(options.folder);
  auto scene = load_scene(find_config("scenes", "default_room"), {});
  DemoOptions o;
  o.virtual_clock = o.stub_bodies = o.quiet = true;
  o.cores = 2;
  o.seconds = 3600 * options.hours;
  o.report = folder.path();
  o.store.cap_bytes = options.cap_bytes;
  if (!options.in_memory) o.store_folder = folder.path();
  o.each_minute = [&](std::int64_t ns) {
    out.minutes_MiB.push_back(resident_MiB());
    out.disk_MiB = std::max(out.disk_MiB, stores_MiB(folder.path()));
    if (out.minutes_MiB.size() % 60 == 1 || ns < 0) {
      char line[120];
      std::snprintf(line, sizeof line, "%6.2f h: %.1f MiB resident, stores %.1f MiB\n",
                    1e-9 * static_cast<double>(ns) / 3600, out.minutes_MiB.back(), out.disk_MiB);
      progress << line << std::flush;
    }
  };
  rt::Startup startup;
  const auto from = std::chrono::steady_clock::now();
  const VirtualRun run = run_virtual(startup.token(), *scene, o, reference_calibration());
  out.wall_s = seconds_since(from);
  out.disk_MiB = std::max(out.disk_MiB, stores_MiB(folder.path()));
  if (!out.minutes_MiB.empty()) {
    out.first_MiB = out.minutes_MiB.front();
    out.last_MiB = out.minutes_MiB.back();
    out.most_MiB = *std::max_element(out.minutes_MiB.begin(), out.minutes_MiB.end());
  }
  time_report(o, run, out);
  return out;
}

std::vector<Limit> DaysResult::limits() const {
  Limits all;
  all.add("resident memory at the end over that after the first minute", last_MiB / first_MiB,
          "<=", kGrowth);
  all.add("bytes of the stores over their caps", disk_MiB / cap_MiB, "<=", 1);
  all.add("records neither whole nor counted", static_cast<double>(lost), "<=", 0);
  all.add("report, s", report_s, "<=", kReport_s);
  return all.all();
}

std::vector<BenchMetric> DaysResult::metrics() const {
  return {{"days.hours", hours, "h"},
          {"days.wall_s", wall_s, "s"},
          {"days.jobs", static_cast<double>(jobs), "1"},
          {"days.rss_first_minute_MiB", first_MiB, "MiB"},
          {"days.rss_end_MiB", last_MiB, "MiB"},
          {"days.rss_max_MiB", most_MiB, "MiB"},
          {"days.disk_max_MiB", disk_MiB, "MiB"},
          {"days.cap_MiB", cap_MiB, "MiB"},
          {"days.report_s", report_s, "s"}};
}

void DaysResult::print(std::ostream& out) const {
  char text[400];
  std::snprintf(text, sizeof text,
                "%.2f h of simulated time in %.0f s: %llu jobs, %llu of them whole\n"
                "resident: %.1f MiB after the first minute, %.1f at the end, %.1f at most\n"
                "disk, both boxes: %.1f MiB at most, cap %.0f MiB\n"
                "report: %.1f s\n",
                hours, wall_s, static_cast<unsigned long long>(jobs),
                static_cast<unsigned long long>(whole), first_MiB, last_MiB, most_MiB, disk_MiB,
                cap_MiB, report_s);
  out << text;
  teletact::print(out, limits());
}

std::string DaysResult::page(const std::string& command) const {
  char text[1000];
  std::snprintf(text, sizeof text,
                "# Runs for days\n\n"
                "Command: `%s`. Commit: %s. Machine: %s.\n"
                "Method and limits: `docs/storage.md`.\n\n"
                "| figure | value | limit |\n|---|---|---|\n"
                "| simulated time | %.2f h | |\n"
                "| it took | %.0f s | |\n"
                "| jobs, both boxes | %llu | |\n"
                "| of them whole in the report | %llu | |\n"
                "| neither whole nor counted | %llu | 0 |\n"
                "| resident after the first minute | %.1f MiB | |\n"
                "| resident at the end | %.1f MiB | 2 %% more |\n"
                "| stores of both boxes at most | %.1f MiB | %.0f MiB |\n"
                "| report | %.1f s | 30 s |\n",
                command.c_str(), tree_commit().c_str(), host.c_str(), hours, wall_s,
                static_cast<unsigned long long>(jobs), static_cast<unsigned long long>(whole),
                static_cast<unsigned long long>(lost), first_MiB, last_MiB, disk_MiB, cap_MiB,
                report_s);
  return text;
}

}  // namespace teletact
