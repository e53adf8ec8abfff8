#include "tools/scene/host_info.hpp"

#include <cstdio>
#include <fstream>

#include "rt/audit/blame.hpp"
#include "rt/sched/admission.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/files/build_info.hpp"
#include "tools/files/whole_file.hpp"

namespace teletact {

std::vector<std::pair<std::string, std::string>> host_rows() {
  std::string cpus;
  for (const int c : rt::affinity_cpus()) cpus += (cpus.empty() ? "" : ", ") + std::to_string(c);
  std::string load;
  std::getline(std::ifstream("/proc/loadavg"), load);
  return {{"machine", tasks::host_id()},
          {"CPUs of this process", cpus},
          {"load at the end", load},
          {"teletact", kVersion},
          {"build", std::string(kBuildType) + ", " + kCompiler}};
}

void write_trace(const std::string& path, const std::vector<const rt::RunLog*>& logs) {
  WholeFile f(path);
  std::fprintf(f.get(), "{\"displayTimeUnit\":\"ns\",\"traceEvents\":[\n");
  int pid = 0;
  bool first = true;
  for (const auto* log : logs) {
    ++pid;
    for (const auto& t : log->tasks) {
      std::fprintf(f.get(),
                   "%s{\"ph\":\"M\",\"name\":\"thread_name\",\"pid\":%d,\"tid\":%u,\"args\":{"
                   "\"name\":\"%s\"}}",
                   first ? "" : ",\n", pid, t.id, t.spec.name.c_str());
      first = false;
      for (const auto& j : t.jobs) {
        std::fprintf(f.get(),
                     ",\n{\"ph\":\"X\",\"name\":\"%s\",\"pid\":%d,\"tid\":%u,\"ts\":%.3f,\"dur\":%."
                     "3f,\"args\":{\"k\":%llu,"
                     "\"late_us\":%.3f,\"cpu_us\":%.3f,\"skipped\":%u,\"level\":%u}}",
                     j.outcome == rt::Outcome::kAborted ? "aborted" : t.spec.name.c_str(), pid,
                     t.id, static_cast<double>(j.start_ns) * 1e-3,
                     static_cast<double>(j.end_ns - j.start_ns) * 1e-3,
                     static_cast<unsigned long long>(j.k),
                     static_cast<double>(j.lateness_ns()) * 1e-3,
                     static_cast<double>(j.cpu_ns) * 1e-3, j.skipped, j.level);
      }
    }
  }
  std::fprintf(f.get(), "\n]}\n");
  f.finish();
}

void write_csv(const std::string& path, const std::vector<const rt::RunLog*>& logs) {
  WholeFile f(path);
  std::fprintf(f.get(),
               "task,k,release_ns,start_ns,end_ns,cpu_ns,twin_cpu_ns,run_delay_ns,minor_faults,"
               "major_faults,involuntary,"
               "voluntary,skipped,level,outcome,work,late_cause,miss_cause\n");
  for (const auto* log : logs) {
    for (const auto& t : log->tasks) {
      const rt::TaskBlame b = rt::blame(*log, t);
      for (std::size_t i = 0; i < t.jobs.size(); ++i) {
        const auto& j = t.jobs[i];
        const auto late =
            b.jobs[i].late_start ? rt::name_of(b.jobs[i].late_cause) : std::string_view{};
        const auto miss = b.jobs[i].missed ? rt::name_of(b.jobs[i].miss_cause) : std::string_view{};
        std::fprintf(f.get(),
                     "%s,%llu,%lld,%lld,%lld,%lld,%lld,%lld,%u,%u,%u,%u,%u,%u,%s,%llu,%.*s,%.*s\n",
                     t.spec.name.c_str(), static_cast<unsigned long long>(j.k),
                     static_cast<long long>(j.release_ns), static_cast<long long>(j.start_ns),
                     static_cast<long long>(j.end_ns), static_cast<long long>(j.cpu_ns),
                     static_cast<long long>(j.twin_cpu_ns), static_cast<long long>(j.run_delay_ns),
                     j.minor_faults, j.major_faults, j.involuntary, j.voluntary, j.skipped, j.level,
                     j.outcome == rt::Outcome::kAborted ? "aborted" : "completed",
                     static_cast<unsigned long long>(j.work), static_cast<int>(late.size()),
                     late.data(), static_cast<int>(miss.size()), miss.data());
      }
    }
  }
  f.finish();
}

}  // namespace teletact
