#include "tools/measure/haptic/bench_haptic.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>

#include "rt/clock/box_time.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/quantile.hpp"
#include "rt/random.hpp"
#include "tasks/haptic/force_shading.hpp"
#include "tools/measure/bench/callgrind.hpp"
#include "tools/measure/bench/other_load.hpp"
#include "tools/measure/haptic/table_run.hpp"
#include "tools/touch/tick_rerun.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;

using rt::quantile;

double median(const std::vector<double>& v) { return quantile(v, 0.5); }

class Folder {
 public:
  explicit Folder(const std::string& asked) : path_(asked), mine_(asked.empty()) {
    if (!mine_) {
      fs::create_directories(path_);
      return;
    }
    std::string name = (fs::temp_directory_path() / "teletact_haptic_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error(name + ": can not be made");
    path_ = name;
  }
  ~Folder() {
    std::error_code ec;
    if (mine_) fs::remove_all(path_, ec);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string file(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
  bool mine_;
};

TableRun record(rt::NonRealtime& nrt, int edge, std::size_t ticks, const std::string& path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "wbe"),
                                                             &std::fclose);
  if (!file) throw std::runtime_error(path + ": can not be written");
  const TableRun run = record_table_run(nrt, edge, ticks, file.get());
  if (std::fflush(file.get()) != 0) throw std::runtime_error(path + ": can not be written");
  return run;
}

HapticMethodRow time_method(rt::NonRealtime& nrt, const std::string& path,
                            const std::string& method, int passes) {
  HapticMethodRow row;
  row.method = method;
  std::vector<double> p50, p99, free_p50, free_p99;
  for (int pass = 0; pass < passes; ++pass) {
    OpenHapticRun run(path);
    tasks::HapticConfig config = run.reader->header().config;
    config.method = method;
    HapticRerun replay(nrt, *run.reader, config);
    std::vector<double> contact, free;
    while (replay.next()) {
      const auto& t = replay.out().telemetry;
      if (!t.in_contact) {
        free.push_back(replay.cpu_us());
      } else if (t.blend < 1) {
        contact.push_back(replay.cpu_us());
      }
    }
    row.contact = contact.size();
    p50.push_back(quantile(contact, 0.5));
    p99.push_back(quantile(contact, 0.99));
    row.max_us = std::max(row.max_us, quantile(contact, 1));
    free_p50.push_back(quantile(free, 0.5));
    free_p99.push_back(quantile(free, 0.99));
  }
  row.p50_us = median(p50), row.p99_us = median(p99);
  row.free_p50_us = median(free_p50), row.free_p99_us = median(free_p99);
  return row;
}

double clock_cost_us() {
  std::vector<double> us;
  for (int i = 0; i < 2000; ++i) {
    const std::int64_t before = rt::thread_cpu_ns();
    us.push_back(1e-3 * static_cast<double>(rt::thread_cpu_ns() - before));
  }
  return median(us);
}

void time_reduction(HapticBenchResult& r) {
  tasks::SurfacePoints s;
  s.resize(std::size_t{512} * 424);
  rt::Random random(1);
  const auto point = [&] {
    return perception::Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
  };
  for (std::size_t i = 0; i < s.count; ++i) s.set(i, point(), perception::Vec3::UnitZ());
  std::vector<double> us;
  std::size_t sum = 0;
  for (int k = 0; k < 400; ++k) {
    const perception::Vec3 goal = point();
    const std::int64_t before = rt::thread_cpu_ns();
    sum += tasks::nearest_index(s, goal);
    us.push_back(1e-3 * static_cast<double>(rt::thread_cpu_ns() - before));
  }
  if (sum == 0) throw std::logic_error("the reduction found one point for every goal");
  r.reduction_p50_us = quantile(us, 0.5);
  r.reduction_p99_us = quantile(us, 0.99);
}

// ---- callgrind

// Instructions inside of HapticTask::step over the first `ticks` ticks.
double counted(const Folder& folder, const std::string& program, const std::string& run, long ticks,
               const std::string& effect) {
  return callgrind_count(program, {run, std::to_string(ticks), effect}, "*HapticTask::step*",
                         folder.file("."));
}

double per_tick(const Folder& folder, const std::string& program, const std::string& run, long n,
                const std::string& effect) {
  const double a = counted(folder, program, run, n, effect),
               b = counted(folder, program, run, 2 * n, effect);
  const double each = (b - a) / static_cast<double>(n);
  if (!(each > 100)) throw std::runtime_error("callgrind of " + program + " counted nothing");
  return each;
}

void run_guarded(const Folder& folder, const std::string& program, const std::string& run, long n,
                 HapticBenchResult& r) {
  const std::string text = folder.file("guard.txt");
  const std::string command = shell_quoted(program) + " " + shell_quoted(run) + " " +
                              std::to_string(n) + " >" + shell_quoted(text);
  if (std::system(command.c_str()) != 0) throw std::runtime_error(program + " failed");
  std::ifstream in(text);
  std::string line;
  std::getline(in, line);
  long ticks = 0, contact = 0;
  unsigned long long allocations = 0, locks = 0;
  int linked = 0;
  if (std::sscanf(line.c_str(), "%ld ticks %ld contact %llu allocations %llu locks %d guard",
                  &ticks, &contact, &allocations, &locks, &linked) != 5) {
    throw std::runtime_error(program + " said: " + line);
  }
  r.guarded = linked != 0;
  r.allocations = static_cast<double>(allocations);
  r.locks = static_cast<double>(locks);
}

void count_instructions(std::ostream& progress, const Folder& folder, const std::string& large,
                        const std::string& small, const HapticBenchOptions& options,
                        HapticBenchResult& r) {
  const std::string beside = options.programs.empty() ? own_folder() : options.programs;
  const std::string program = beside + "/teletact_haptic_count",
                    plain = beside + "/teletact_haptic_count_plain";
  const long n = options.count_ticks;
  if (!fs::exists(program) || !fs::exists(plain)) {
    r.not_counted = "the counting programs are not beside this one";
    return;
  }
  run_guarded(folder, program, large, 2 * n, r);
  if (!have_valgrind()) {
    r.not_counted = "valgrind is not installed";
    return;
  }
  progress << "callgrind, " << n << " and " << 2 * n << " ticks\n";
  r.instructions_512 = per_tick(folder, program, large, n, "none");
  r.instructions_64 = per_tick(folder, program, small, n, "none");
  r.instructions_p99 = quantile(tick_instructions(beside, large, 2 * n, folder.file(".")), 0.99);
  r.none_over_plain = r.instructions_512 - per_tick(folder, plain, large, n, "none");
  for (const char* effect : {"friction", "texture", "bump_normal", "viscosity", "materials"}) {
    r.effects[effect] = per_tick(folder, program, large, n, effect) - r.instructions_512;
  }
}

}  // namespace

std::vector<double> tick_instructions(const std::string& programs, const std::string& run,
                                      long ticks, const std::string& scratch) {
  auto each =
      callgrind_rounds(programs + "/teletact_haptic_count", {run, std::to_string(ticks), "none"},
                       "*HapticTask::step*", "*HapticRerun::next*", scratch);
  if (each.size() != static_cast<std::size_t>(ticks))
    throw std::runtime_error("callgrind of " + run + ": ticks are not told apart");
  return each;
}

HapticBenchResult bench_haptic(std::ostream& progress, const HapticBenchOptions& options) {
  rt::Startup startup;
  const Folder folder(options.folder);
  HapticBenchResult r;
  const std::string large = folder.file("table_512.run"), small = folder.file("table_64.run");
  progress << "fusing the table\n";
  r.blocks_512 = record(startup.token(), 512, 0, large).blocks;
  r.clock_us = clock_cost_us();
  const OtherLoad others;
  for (const char* method : {"constrained", "nearest", "nearest10"}) {
    progress << method << "\n";
    r.methods.push_back(time_method(startup.token(), large, method, options.passes));
  }
  time_reduction(r);
  r.other_load = others.cores();
  if (!options.instructions) {
    r.not_counted = "not asked for";
    return r;
  }
  r.blocks_64 =
      record(startup.token(), 64, static_cast<std::size_t>(2 * options.count_ticks), small).blocks;
  count_instructions(progress, folder, large, small, options, r);
  return r;
}

}  // namespace teletact
