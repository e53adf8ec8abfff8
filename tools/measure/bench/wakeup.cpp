#include "tools/measure/bench/wakeup.hpp"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <thread>

#include "rt/audit/histogram.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"

namespace teletact {

namespace {

constexpr std::int64_t kPeriod = 1000000;
constexpr std::int64_t kSpinLead = 30000;

// One slice of our loop: absolute clock_nanosleep, optionally waking early and spinning.
WakeupResult::Slice own_slice(int cpu, double seconds, std::int64_t lead, bool& fifo) {
  rt::Histogram late;
  std::thread worker([&] {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    pthread_setaffinity_np(pthread_self(), sizeof set, &set);
    sched_param param{};
    param.sched_priority = 90;
    fifo = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param) == 0;
    prctl(PR_SET_TIMERSLACK, 1UL);
    std::int64_t due = rt::monotonic_ns() + 5 * kPeriod;
    const auto jobs = static_cast<std::int64_t>(seconds * 1e3);
    for (std::int64_t i = 0; i < jobs; ++i) {
      const std::int64_t wake = due - lead;
      timespec ts{wake / 1000000000, wake % 1000000000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &ts, nullptr);
      std::int64_t now = rt::monotonic_ns();
      while (now < due) now = rt::monotonic_ns();
      late.record(now - due);
      due += kPeriod;
      while (due < now) due += kPeriod;  // skip, phase kept
    }
  });
  worker.join();
  return {static_cast<double>(late.quantile(0.5)) * 1e-3,
          static_cast<double>(late.quantile(0.99)) * 1e-3, static_cast<double>(late.max()) * 1e-3};
}

// cyclictest prints its histogram in whole microseconds: "000017 000123".
bool cyclictest_slice(int cpu, double seconds, WakeupResult::Slice& out) {
  char command[200];
  std::snprintf(command, sizeof command,
                "cyclictest -m -q -p90 -i1000 -t1 -a%d -l%d -h2000 2>/dev/null", cpu,
                static_cast<int>(seconds * 1e3));
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(::popen(command, "r"), &::pclose);
  if (!pipe) return false;
  std::vector<std::pair<int, long>> bins;
  long total = 0;
  double max_us = 0;
  std::array<char, 256> line{};
  while (std::fgets(line.data(), static_cast<int>(line.size()), pipe.get()) != nullptr) {
    int us = 0;
    long n = 0;
    if (std::sscanf(line.data(), "# Max Latencies: %lf", &max_us) == 1) continue;
    if (line[0] != '#' && std::sscanf(line.data(), "%d %ld", &us, &n) == 2 && n > 0) {
      bins.emplace_back(us, n);
      total += n;
    }
  }
  if (total == 0) return false;
  // Within its whole microsecond a sample lies anywhere: take the middle by the rank inside the
  // bin.
  const auto at = [&](double q) {
    const auto rank = static_cast<long>(rt::quantile_rank(q, static_cast<std::uint64_t>(total)));
    long seen = 0;
    for (const auto& [us, n] : bins) {
      if (seen + n >= rank) return us + static_cast<double>(rank - seen) / static_cast<double>(n);
      seen += n;
    }
    return static_cast<double>(bins.back().first);
  };
  out = {at(0.5), at(0.99), max_us};
  return true;
}

}  // namespace

WakeupResult bench_wakeup(std::ostream& progress, int rounds, double slice_s) {
  WakeupResult r;
  cpu_set_t set;
  sched_getaffinity(0, sizeof set, &set);
  int cpu = 0;
  for (int c = 0; c < CPU_SETSIZE; ++c) {
    if (CPU_ISSET(static_cast<std::size_t>(c), &set)) cpu = c;
  }
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) r.remark = "memory not locked; ";
  // As our executor does, and as cyclictest does by itself: no deep idle while this is held.
  const int dma = ::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
  const std::int32_t zero = 0;
  if (dma < 0 || ::write(dma, &zero, sizeof zero) != sizeof zero)
    r.remark += "cpu_dma_latency not held; ";
  for (int i = 0; i < rounds; ++i) {
    r.plain.push_back(own_slice(cpu, slice_s, 0, r.fifo));
    WakeupResult::Slice c;
    if (cyclictest_slice(cpu, slice_s, c)) r.cyclictest.push_back(c);
    r.spin.push_back(own_slice(cpu, slice_s, kSpinLead, r.fifo));
    progress << "wakeup: round " << i + 1 << " of " << rounds << std::endl;
  }
  ::munlockall();
  if (dma >= 0) ::close(dma);
  const auto medians = [](const std::vector<WakeupResult::Slice>& v) {
    std::vector<double> p;
    for (const auto& s : v) p.push_back(s.p50_us);
    return rt::quantile(p, 0.5);
  };
  r.p50_plain_us = medians(r.plain);
  r.p50_spin_us = medians(r.spin);
  r.p50_cyclictest_us = medians(r.cyclictest);
  if (r.cyclictest.empty()) r.remark += "cyclictest gave no figures (package rt-tests)";
  if (!r.fifo) r.remark += "no SCHED_FIFO";
  return r;
}

std::vector<Limit> WakeupResult::limits() const {
  const std::string why_not = cyclictest.empty() ? "cyclictest gave no figures"
                              : !fifo            ? "no SCHED_FIFO"
                                                 : "";
  Limits all;
  all.add("p50 to cyclictest's", p50_plain_us / p50_cyclictest_us, "<=", 1.6, why_not);
  all.add("p50 to cyclictest's, 30 us spin lead", p50_spin_us / p50_cyclictest_us, "<=", 1.6,
          why_not);
  return all.all();
}

std::vector<BenchMetric> WakeupResult::metrics() const {
  std::vector<BenchMetric> m{{"wakeup.p50_plain_us", p50_plain_us, "us"},
                             {"wakeup.p50_spin_us", p50_spin_us, "us"}};
  if (!cyclictest.empty()) {
    m.push_back({"wakeup.p50_cyclictest_us", p50_cyclictest_us, "us"});
    m.push_back({"wakeup.p50_over_cyclictest", p50_plain_us / p50_cyclictest_us, "1"});
    m.push_back({"wakeup.spin_p50_over_cyclictest", p50_spin_us / p50_cyclictest_us, "1"});
  }
  return m;
}

void WakeupResult::print(std::ostream& out) const {
  const auto row = [&](const char* name, const std::vector<Slice>& v) {
    std::vector<double> p50, p99, max;
    for (const auto& s : v) {
      p50.push_back(s.p50_us);
      p99.push_back(s.p99_us);
      max.push_back(s.max_us);
    }
    char text[160];
    std::snprintf(text, sizeof text,
                  "%-22s p50 %8.2f us   p99 %8.2f us   max %9.1f us   (%zu slices)\n", name,
                  rt::quantile(p50, 0.5), rt::quantile(p99, 0.5),
                  max.empty() ? 0.0 : *std::max_element(max.begin(), max.end()), v.size());
    out << text;
  };
  row("own, plain", plain);
  row("cyclictest", cyclictest);
  row("own, 30 us spin lead", spin);
  out << "The sentinel is off in this bench: nothing of ours but the measured thread runs.\n";
  if (!remark.empty()) out << "note: " << remark << '\n';
  teletact::print(out, limits());
}

}  // namespace teletact
