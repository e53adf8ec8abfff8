#include "rt/audit/run_file.hpp"

#include <algorithm>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace rt {

std::string run_header_lines(const RunLog& header) {
  std::ostringstream out;
  for (const auto& t : header.tasks) {
    out << "task " << t.id << ' ' << t.spec.name << ' ' << static_cast<int>(t.spec.box) << ' '
        << static_cast<int>(t.spec.task_class) << ' ' << t.spec.rate.num << ' ' << t.spec.rate.den
        << ' ' << t.spec.relative_deadline().count() << ' ' << static_cast<int>(t.spec.policy)
        << ' ' << t.core << ' ' << t.priority << ' ' << t.level << ' ' << t.work_min << ' '
        << t.work_max;
    for (int level = 0; level < t.spec.levels(); ++level)
      out << ' ' << t.spec.budget_of(level).count();
    out << '\n';
  }
  if (header.epoch_ns != 0) out << "epoch " << header.epoch_ns << '\n';
  for (std::string note : header.not_realtime) {
    std::replace(note.begin(), note.end(), '\n', ' ');
    out << "note " << note << '\n';
  }
  return out.str();
}

RunFileWriter::RunFileWriter(const std::string& path, const RunLog& header)
    : file_(std::fopen(path.c_str(), "wb")) {
  if (!file_) throw std::runtime_error(path + ": can not be written");
  std::fprintf(file_.get(), "teletact-run 3 %zu %zu\n%s\n", sizeof(JobRecord),
               sizeof(SentinelRecord), run_header_lines(header).c_str());
  std::fflush(file_.get());
}

void RunFileWriter::add(const JobRecord& record) noexcept {
  std::fputc('J', file_.get());
  std::fwrite(&record, sizeof record, 1, file_.get());
}

void RunFileWriter::add(const SentinelRecord& record) noexcept {
  std::fputc('S', file_.get());
  std::fwrite(&record, sizeof record, 1, file_.get());
}

void RunFileWriter::finish(const std::vector<RunFileTotals>& totals,
                           std::uint64_t dropped) noexcept {
  for (const RunFileTotals& t : totals) {
    std::fputc('T', file_.get());
    std::fwrite(&t, sizeof t, 1, file_.get());
  }
  std::fputc('D', file_.get());
  std::fwrite(&dropped, sizeof dropped, 1, file_.get());
}

void RunFileWriter::flush() noexcept { std::fflush(file_.get()); }

bool parse_run_header_line(const std::string& line, RunLog& log) {
  std::istringstream in(line);
  std::string word;
  in >> word;
  if (word == "note") {
    log.not_realtime.push_back(line.size() > 5 ? line.substr(5) : std::string{});
    return true;
  }
  if (word == "epoch") return static_cast<bool>(in >> log.epoch_ns) && log.epoch_ns > 0;
  if (word != "task") return false;
  TaskLog t;
  int box = 0, task_class = 0, policy = 0;
  long long deadline = 0;
  in >> t.id >> t.spec.name >> box >> task_class >> t.spec.rate.num >> t.spec.rate.den >>
      deadline >> policy >> t.core >> t.priority >> t.level >> t.work_min >> t.work_max;
  // Beyond these bounds a period in nanoseconds would not fit its integer.
  constexpr std::int64_t kMaxRate = 1000000000;
  const auto in_range = [](std::int64_t v, std::int64_t lo, std::int64_t hi) {
    return v >= lo && v <= hi;
  };
  if (!in || !in_range(t.spec.rate.num, 1, kMaxRate) || !in_range(t.spec.rate.den, 1, kMaxRate) ||
      deadline <= 0 || !in_range(box, 0, 1) || !in_range(task_class, 0, 1) ||
      !in_range(policy, 0, 3)) {
    return false;
  }
  t.spec.box = static_cast<Box>(box);
  t.spec.task_class = static_cast<TaskClass>(task_class);
  t.spec.policy = static_cast<MissPolicy>(policy);
  t.spec.deadline = Nanos{deadline};
  for (long long budget = 0; in >> budget;) {
    t.spec.variants.push_back({"level" + std::to_string(t.spec.variants.size()), Nanos{budget}});
  }
  const auto levels = static_cast<std::int64_t>(t.spec.variants.size());
  if (!in.eof() || !in_range(t.level, 0, levels - 1) || log.find(t.id) != nullptr) return false;
  t.spec.budget = t.spec.variants.front().budget;
  log.tasks.push_back(std::move(t));
  return true;
}

void sort_jobs(RunLog& log) {
  for (auto& t : log.tasks) {
    std::stable_sort(t.jobs.begin(), t.jobs.end(),
                     [](const auto& a, const auto& b) { return a.k < b.k; });
  }
}

Result<RunLog> read_run_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return Error{path + ": can not be read"};
  RunLog log;
  std::string line;
  std::getline(in, line);
  std::ostringstream expected;
  expected << "teletact-run 3 " << sizeof(JobRecord) << ' ' << sizeof(SentinelRecord);
  if (line != expected.str()) return Error{path + ":1: not a run log of this version"};
  for (int number = 2; std::getline(in, line) && !line.empty(); ++number) {
    if (!parse_run_header_line(line, log))
      return Error{path + ":" + std::to_string(number) + ": not a header line"};
  }
  JobRecord job;
  SentinelRecord sample;
  RunFileTotals totals;
  std::uint64_t dropped = 0;
  for (int tag = in.get(); tag != EOF; tag = in.get()) {
    if (tag == 'J' && in.read(reinterpret_cast<char*>(&job), sizeof job)) {
      if (TaskLog* t = log.find(job.task); t != nullptr && job.level < t->spec.levels())
        t->jobs.push_back(job);
    } else if (tag == 'S' && in.read(reinterpret_cast<char*>(&sample), sizeof sample)) {
      log.sentinels.push_back(sample);
    } else if (tag == 'T' && in.read(reinterpret_cast<char*>(&totals), sizeof totals)) {
      if (TaskLog* t = log.find(totals.task); t != nullptr) t->totals = totals.totals;
    } else if (tag == 'D' && in.read(reinterpret_cast<char*>(&dropped), sizeof dropped)) {
      log.dropped = dropped;
    } else if (in.eof()) {
      break;  // torn by a kill: what came before holds
    } else {
      return Error{path + ": damaged at byte " + std::to_string(in.tellg())};
    }
  }
  sort_jobs(log);
  return log;
}

}  // namespace rt
