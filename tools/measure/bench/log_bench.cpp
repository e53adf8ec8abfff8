#include "tools/measure/bench/log_bench.hpp"

#include <malloc.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <iomanip>
#include <memory>

#include "rt/audit/rt_log.hpp"
#include "rt/quantile.hpp"
#include "tools/measure/bench/other_load.hpp"

namespace teletact {
namespace {

using Clock = std::chrono::steady_clock;
constexpr int kRecords = 512;

rt::Time now() {
  return rt::time_from_ns(
      std::chrono::duration_cast<rt::Nanos>(Clock::now().time_since_epoch()).count());
}

template <class Write>
double mean_ns(Write&& write) {
  const auto from = Clock::now();
  for (int i = 0; i < kRecords; ++i) write(i);
  return std::chrono::duration<double, std::nano>(Clock::now() - from).count() / kRecords;
}

}  // namespace

LogBenchResult bench_log(int rounds) {
  rt::Startup startup;
  rt::LogSites sites;
  const auto site = sites.add<double, double, int, std::uint64_t>(
      startup.token(), rt::LogLevel::kInfo, "force {:.3f} N, depth {:.6f} m, {} of {}");
  const auto log = std::make_unique<rt::RtLog>();
  const auto full = std::make_unique<rt::RtLog>();
  while (full->write(site, now(), 0.0, 0.0, 0, 0)) {
  }
  const std::size_t count = static_cast<std::size_t>(std::max(rounds, 1));
  std::vector<double> plain(count), refused(count), clocked(count);

  const OtherLoad others;
  rusage before{}, after{};
  getrusage(RUSAGE_THREAD, &before);
  const auto heap_before = mallinfo2().uordblks;
  const auto empty = [&] {
    rt::LogRecord record;
    while (log->try_pop(record)) {
    }
  };
  for (std::size_t r = 0; r < count; ++r) {
    const rt::Time at = now();
    plain[r] = mean_ns([&](int i) { log->write(site, at, 0.5 * i, 1e-6 * i, i, 512); });
    empty();
    refused[r] = mean_ns([&](int i) { full->write(site, at, 0.5 * i, 1e-6 * i, i, 512); });
    clocked[r] = mean_ns([&](int i) { log->write(site, now(), 0.5 * i, 1e-6 * i, i, 512); });
    empty();
  }
  LogBenchResult result;
  result.other_load = others.cores();
  result.heap_bytes = static_cast<long>(mallinfo2().uordblks) - static_cast<long>(heap_before);
  getrusage(RUSAGE_THREAD, &after);
  result.voluntary_switches = after.ru_nvcsw - before.ru_nvcsw;
  result.record_ns = rt::quantile(plain, 0.5);
  result.record_p99_ns = rt::quantile(plain, 0.99);
  result.full_ns = rt::quantile(refused, 0.5);
  result.with_clock_ns = rt::quantile(clocked, 0.5);
  return result;
}

std::vector<Limit> LogBenchResult::limits() const {
  Limits all;
  all.add("log record, ns", record_ns, "<=", 100, disturbed(other_load));
  all.add("heap of all records, B", static_cast<double>(heap_bytes), "<=", 0);
  all.add("voluntary switches of the writer", static_cast<double>(voluntary_switches), "<=", 0);
  return all.all();
}

std::vector<BenchMetric> LogBenchResult::metrics() const {
  return {{"log.record_ns", record_ns, "ns"},
          {"log.record_p99_ns", record_p99_ns, "ns"},
          {"log.full_ns", full_ns, "ns"},
          {"log.record_with_clock_ns", with_clock_ns, "ns"},
          {"log.heap_bytes", static_cast<double>(heap_bytes), "B"},
          {"log.voluntary_switches", static_cast<double>(voluntary_switches), "1"}};
}

void LogBenchResult::print(std::ostream& out) const {
  const auto flags = out.flags();
  out << std::fixed << std::setprecision(1) << "log: " << record_ns << " ns a record (p99 "
      << record_p99_ns << "), " << full_ns << " when full, " << with_clock_ns
      << " with a clock reading; heap " << heap_bytes << " B, voluntary switches "
      << voluntary_switches << '\n';
  out.flags(flags);
  teletact::print(out, limits());
}

}  // namespace teletact
