#include "tools/measure/bench/audit_bench.hpp"

#include <cstdio>
#include <memory>

#include "rt/audit/histogram.hpp"
#include "rt/channel/ring.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "rt/sched/job_record.hpp"
#include "rt/sched/thread_probe.hpp"
#include "tools/measure/bench/other_load.hpp"

namespace teletact {

namespace {

constexpr int kBatch = 256;

// Mean over a batch of f(), ns of thread CPU; the loop itself is in it.
template <class F>
double mean_ns(const F& f) {
  const std::int64_t t0 = rt::thread_cpu_ns();
  for (int i = 0; i < kBatch; ++i) f();
  return static_cast<double>(rt::thread_cpu_ns() - t0) / kBatch;
}

}  // namespace

AuditBenchResult bench_audit(int rounds) {
  const OtherLoad others;
  rt::SchedStat stat;
  stat.open_here();
  auto ring = std::make_unique<rt::Ring<rt::JobRecord, 4096>>();
  rt::ThreadCounters before = rt::counters(stat);
  std::vector<double> whole, parts[4];
  volatile std::int64_t sink = 0;
  rt::JobRecord popped;
  for (int round = 0; round < rounds; ++round) {
    // The same readings in the same order as RealExecutor::serve().
    whole.push_back(mean_ns([&] {
      rt::JobRecord r{};
      r.start_ns = rt::monotonic_ns();
      const std::int64_t cpu0 = rt::thread_cpu_ns();
      r.cpu_ns = rt::thread_cpu_ns() - cpu0;
      const rt::ThreadCounters after = rt::counters(stat);
      r.run_delay_ns = after.run_delay_ns - before.run_delay_ns;
      r.minor_faults = static_cast<std::uint32_t>(after.minor_faults - before.minor_faults);
      r.major_faults = static_cast<std::uint16_t>(after.major_faults - before.major_faults);
      r.involuntary = static_cast<std::uint32_t>(after.involuntary - before.involuntary);
      r.voluntary = static_cast<std::uint32_t>(after.voluntary - before.voluntary);
      before = after;
      r.end_ns = rt::monotonic_ns();
      ring->try_push(r);
    }));
    while (ring->try_pop(popped)) {
    }
    parts[0].push_back(mean_ns([&] { sink = rt::monotonic_ns(); }));
    parts[1].push_back(mean_ns([&] { sink = rt::thread_cpu_ns(); }));
    parts[2].push_back(mean_ns([&] {
      rusage u{};
      getrusage(RUSAGE_THREAD, &u);
      sink = u.ru_minflt;
    }));
    parts[3].push_back(mean_ns([&] { sink = stat.run_delay_ns(); }));
  }
  AuditBenchResult r;
  r.other_load = others.cores();
  r.job_ns = rt::quantile(whole, 0.5);
  for (int i = 0; i < 4; ++i) r.parts_ns[i] = rt::quantile(parts[i], 0.5);
  return r;
}

std::vector<Limit> AuditBenchResult::limits() const {
  Limits all;
  all.add("audit of a job, ns", job_ns, "<=", 2000, disturbed(other_load));
  return all.all();
}

std::vector<BenchMetric> AuditBenchResult::metrics() const {
  return {{"audit.job_ns", job_ns, "ns"}};
}

void AuditBenchResult::print(std::ostream& out) const {
  char text[240];
  std::snprintf(text, sizeof text,
                "audit of a job: %.0f ns (clock %.0f, thread CPU clock %.0f, getrusage %.0f, "
                "schedstat %.0f; two, two, one, one)\n",
                job_ns, parts_ns[0], parts_ns[1], parts_ns[2], parts_ns[3]);
  out << text;
  teletact::print(out, limits());
}

}  // namespace teletact
