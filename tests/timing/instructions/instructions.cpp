// One task with an empty body on one executor, for callgrind to count: what a job costs is the
// executor's own path and nothing else.
//
//   instructions real|virtual JOBS [planned]
//
// Prints the number of jobs served; exit code 75 when the machine was so late that releases were
// dropped (the count then says nothing). planned: with a fault plan that is asked at every job and
// fires at none of them.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "rt/fault/planned.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/real_executor.hpp"
#include "rt/sched/virtual_executor.hpp"

// The kernel's text in schedstat has as many digits as the moment gives it, and parsing them takes
// as many rounds of a loop. Every read that the executors make gets the same text.
extern "C" ssize_t pread(int, void* buffer, std::size_t size, off_t) {
  static constexpr char kText[] = "1234567890 1234567 1234\n";
  const std::size_t n = size < sizeof kText - 1 ? size : sizeof kText - 1;
  std::memcpy(buffer, kText, n);
  return static_cast<ssize_t>(n);
}

namespace {

class Empty final : public rt::TaskBody {
 public:
  void latch(const rt::Tick&, rt::JobRecord&) noexcept override {}
  rt::Health step(const rt::Tick&, rt::JobRecord&) noexcept override { return rt::Health::ok(); }
  void commit(const rt::Tick&, rt::JobRecord&) noexcept override {}
};

class OneMicrosecond final : public rt::CostModel {
 public:
  rt::Nanos cost(std::uint16_t, std::uint64_t, int) noexcept override { return rt::Nanos{1000}; }
};

constexpr std::int64_t kHz = 50;
constexpr rt::Nanos kPeriod{1000000000 / kHz};

rt::PlacedTask task(Empty& body, rt::Rate rate) {
  rt::PlacedTask t;
  t.spec.name = "empty";
  t.spec.rate = rate;
  t.spec.deadline = rt::Nanos{60000000000};  // no job counts as a miss, however late it comes
  t.spec.budget = rt::Nanos{1000};
  t.body = &body;
  t.priority = 80;
  return t;
}

template <class Faults>
rt::TaskTotals run_virtual(const rt::PlacedTask& t, const Faults& faults, rt::Nanos duration) {
  OneMicrosecond costs;
  rt::VirtualExecutor<Faults> executor({t}, costs, faults, [](const rt::JobRecord&) {});
  rt::RunPlan plan;
  plan.duration = duration;
  executor.run(plan);
  return executor.totals().front();
}

template <class Faults>
rt::TaskTotals run_real(rt::PlacedTask t, const Faults& faults, rt::Nanos duration) {
  rt::Startup startup;
  rt::RealOptions options;
  options.fifo = options.sentinel = options.lock_memory = options.hold_dma_latency = false;
  options.hang_limit = rt::Nanos{60000000000};
  t.core = rt::affinity_cpus().front();
  rt::RealExecutor<Faults> executor(
      startup.token(), {t}, faults, [](const rt::JobRecord&) {}, [](const rt::SentinelRecord&) {},
      options);
  rt::RunPlan plan;
  plan.epoch_host_ns = rt::monotonic_ns() + 50000000;
  plan.duration = duration;
  executor.run(plan);
  return executor.totals().front();
}

}  // namespace

int main(int argc, char** argv) {
  const std::string clock = argc > 1 ? argv[1] : "";
  const long jobs = argc > 2 ? std::atol(argv[2]) : 0;
  const bool planned = argc > 3 && std::strcmp(argv[3], "planned") == 0;
  if ((clock != "real" && clock != "virtual") || jobs < 1 || argc > 4 || (argc > 3 && !planned)) {
    std::fprintf(stderr, "usage: instructions real|virtual JOBS [planned]\n");
    return 2;
  }
  if (planned && !rt::kFaultsBuilt) {
    std::fprintf(stderr, "instructions: this build has no planned executor\n");
    return 2;
  }
  rt::FaultPlan plan;
  plan.entries.push_back(
      {rt::FaultKind::kExtraCpu, "empty", 1000000000, 1, 1, 1.0, 0, rt::Nanos{1000}});
  rt::TaskTotals totals;
  rt::with_faults(planned ? &plan : nullptr, {"empty"}, [&](const auto& faults) {
    Empty body;
    const rt::Nanos duration = kPeriod * jobs;
    if (clock == "virtual") {
      totals = run_virtual(task(body, {kHz, 1}), faults, duration);
      return;
    }
    // One job first: what runs for the first time is slow under an instrumenting machine, and the
    // releases after it would be late.
    run_real(task(body, {1, 1}), faults, kPeriod);
    totals = run_real(task(body, {kHz, 1}), faults, duration);
  });
  std::printf("%llu jobs\n", static_cast<unsigned long long>(totals.completed));
  if (totals.completed == static_cast<std::uint64_t>(jobs) && totals.skipped == 0) return 0;
  std::fprintf(stderr, "instructions: %llu of %ld jobs, %llu skipped\n",
               static_cast<unsigned long long>(totals.completed), jobs,
               static_cast<unsigned long long>(totals.skipped));
  return 75;
}
