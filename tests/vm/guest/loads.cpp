// The scheduler on loads: jobs that do nothing but take CPU time.
//
//   vm_loads --case admitted [--seconds S] [--costs FILE]
//       The task table of both boxes, admitted on this guest's one processor. FILE has lines
//       "TASK LEVEL MICROSECONDS": measured p99.9 of CPU, which is what a job then takes, and of
//       which admission makes the budget as tasks/graph/calibration.hpp says. What it does not name
//       has its declared budget, and a job takes budget / 1.2. No job may be late, dropped or
//       aborted.
//   vm_loads --case overrun
//       A job of a 1 kHz task takes 2 ms more than it should, once for each miss policy: what was
//       late, dropped, aborted and lowered has to be exactly what docs/timing.md says.
#include <algorithm>
#include <deque>
#include <fstream>
#include <map>
#include <vector>

#include "rt/sched/admission.hpp"
#include "rt/sched/real_executor.hpp"
#include "tasks/contract/table.hpp"
#include "tests/vm/guest/burn.hpp"
#include "tests/vm/guest/say.hpp"

namespace {

constexpr double kCostOfBudget = 1 / 1.2;

class Load final : public rt::TaskBody {
 public:
  Load(const vm::Burner& burner, std::vector<rt::Nanos> cost_of_level)
      : burner_(burner), cost_(std::move(cost_of_level)) {}
  // Job k takes so much more, or ends when its token says so.
  void overrun_at(std::uint64_t k, rt::Nanos by) { at_ = k, by_ = by; }
  void latch(const rt::Tick&, rt::JobRecord&) noexcept override {}
  rt::Health step(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    burner_.burn(cost_[static_cast<std::size_t>(tick.level)]);
    if (tick.k != at_) return rt::Health::ok();
    constexpr rt::Nanos kPiece = std::chrono::microseconds{20};
    for (rt::Nanos done{0}; done < by_ && !tick.cancelled(); done += kPiece) burner_.burn(kPiece);
    return rt::Health::ok();
  }
  void commit(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    committed += tick.k == at_ ? 1 : 0;
  }
  void abandon(const rt::Tick&) noexcept override { ++abandoned; }
  std::uint64_t committed = 0, abandoned = 0;  // committed: the job that overran alone

 private:
  const vm::Burner& burner_;
  std::vector<rt::Nanos> cost_;
  std::uint64_t at_ = ~std::uint64_t{0};
  rt::Nanos by_{0};
};

struct Outcome {
  std::vector<rt::TaskTotals> totals;
  std::vector<std::vector<rt::JobRecord>> jobs;  // by task
  std::vector<std::string> missing;
};

Outcome run(rt::NonRealtime& nrt, const std::vector<rt::PlacedTask>& tasks, double seconds) {
  Outcome out;
  out.jobs.resize(tasks.size());
  for (std::size_t i = 0; i < tasks.size(); ++i)
    out.jobs[i].reserve(static_cast<std::size_t>(seconds * 1000) + 16);
  rt::RealExecutor<rt::Plain> executor(
      nrt, tasks, rt::Plain{}, [&](const rt::JobRecord& r) { out.jobs[r.task].push_back(r); },
      [](const rt::SentinelRecord&) {});
  rt::RunPlan plan;
  plan.epoch_host_ns = rt::monotonic_ns() + 1'000'000'000;
  plan.duration = rt::Nanos{static_cast<std::int64_t>(seconds * 1e9)};
  executor.run(plan);
  out.totals = executor.totals();
  out.missing = executor.missing();
  return out;
}

rt::PlatformTask above(const char* name, rt::PlatformWakes wakes, int priority,
                       std::int64_t budget_us) {
  rt::PlatformTask p;
  p.spec.name = name;
  p.spec.rate = {100, 1};
  p.spec.budget = std::chrono::microseconds{budget_us};
  p.priority = priority;
  p.wakes = wakes;
  return p;
}

using Costs = std::map<std::pair<std::string, int>, double>;  // us

Costs read_costs(const std::string& path) {
  Costs costs;
  std::ifstream file(path);
  std::string task;
  int level = 0;
  double us = 0;
  while (file >> task >> level >> us) costs[{task, level}] = us;
  return costs;
}

rt::Nanos microseconds(double us) { return rt::Nanos{static_cast<std::int64_t>(1e3 * us)}; }

rt::Nanos budget_of(double cost_us) {
  return microseconds(std::max(cost_us / kCostOfBudget, cost_us + 10));
}

// What a job takes; the budget of a task with policy abort stays the declared one.
rt::Nanos cost_of(const Costs& costs, const rt::TaskSpec& spec, int level) {
  const auto measured = costs.find({spec.name, level});
  const auto declared = static_cast<double>(spec.budget_of(level).count());
  if (measured == costs.end() || spec.policy == rt::MissPolicy::kAbort)
    return rt::Nanos{static_cast<std::int64_t>(kCostOfBudget * declared)};
  return microseconds(measured->second);
}

rt::AdmissionRequest whole_table(const Costs& costs) {
  rt::AdmissionRequest request;
  for (const tasks::TaskRow& row : tasks::kTaskTable) {
    rt::TaskSpec spec;
    spec.name = row.name;
    spec.task_class = row.task_class;
    spec.rate = {row.rate_hz, 1};
    spec.policy = row.policy;
    for (const auto& v : row.variants) {
      if (v.name.empty()) continue;
      spec.variants.emplace_back(std::string(v.name), std::chrono::microseconds{v.budget_us});
    }
    for (int level = 0; level < spec.levels(); ++level) {
      const auto measured = costs.find({spec.name, level});
      if (measured == costs.end() || spec.policy == rt::MissPolicy::kAbort) continue;
      spec.variants[static_cast<std::size_t>(level)].budget = budget_of(measured->second);
    }
    spec.budget = spec.variants.front().budget;
    request.tasks.push_back(spec);
  }
  request.platform = {above("sentinel", rt::PlatformWakes::kAtReleases, rt::kSentinelPriority, 10),
                      above("watchdog", rt::PlatformWakes::kOnceABox, rt::kWatchdogPriority, 20)};
  request.cpus = {rt::affinity_cpus().front()};
  return request;
}

int admitted(rt::NonRealtime& nrt, double seconds, const Costs& costs) {
  const rt::AdmissionRequest request = whole_table(costs);
  vm::figure("measured_costs", static_cast<double>(costs.size()), "1");
  const rt::Admission admission = rt::admit(request);
  std::printf("%s\n", rt::report_table(admission).c_str());
  if (!vm::check("the set is admitted", admission.admitted, admission.refusal)) return 0;
  const vm::Burner burner;
  std::deque<Load> loads;
  std::vector<rt::PlacedTask> placed;
  for (std::size_t i = 0; i < request.tasks.size(); ++i) {
    rt::PlacedTask task;
    task.spec = request.tasks[i];
    std::vector<rt::Nanos> cost;
    for (int level = 0; level < task.spec.levels(); ++level)
      cost.push_back(cost_of(costs, task.spec, level));
    loads.emplace_back(burner, cost);
    task.body = &loads.back();
    task.id = static_cast<std::uint16_t>(i);
    task.core = admission.tasks[i].cpu;
    task.priority = admission.tasks[i].priority;
    task.level = admission.tasks[i].level;
    task.last_level = admission.tasks[i].last_level;
    placed.push_back(task);
  }
  const Outcome o = run(nrt, placed, seconds);
  for (const auto& line : o.missing) vm::check("every right", false, line);
  std::uint64_t jobs = 0, missed = 0;
  for (std::size_t i = 0; i < placed.size(); ++i) {
    const rt::TaskTotals& t = o.totals[i];
    std::int64_t response = 0, cpu = 0;
    for (const auto& r : o.jobs[i]) {
      response = std::max(response, r.end_ns - r.release_ns);
      cpu = std::max(cpu, r.cpu_ns);
    }
    std::printf("task %-18s level %d, %llu jobs, %llu late, %llu dropped, %llu aborted\n",
                placed[i].spec.name.c_str(), placed[i].level,
                static_cast<unsigned long long>(t.completed),
                static_cast<unsigned long long>(t.late), static_cast<unsigned long long>(t.skipped),
                static_cast<unsigned long long>(t.aborted));
    vm::figure(placed[i].spec.name + ".cpu_max_us", 1e-3 * static_cast<double>(cpu), "us");
    vm::figure(placed[i].spec.name + ".response_max_us", 1e-3 * static_cast<double>(response),
               "us");
    vm::figure(placed[i].spec.name + ".response_bound_us",
               1e-3 * static_cast<double>(admission.tasks[i].R.count()), "us");
    vm::check(placed[i].spec.name + " within the response that admission computed",
              response <= admission.tasks[i].R.count(), "");
    jobs += t.completed;
    missed += t.late + t.skipped + t.aborted;
  }
  std::uint64_t releases = 0;
  for (const auto& p : placed)
    releases += static_cast<std::uint64_t>(seconds * static_cast<double>(p.spec.rate.num) + 0.5);
  vm::figure("jobs", static_cast<double>(jobs), "1");
  vm::figure("missed", static_cast<double>(missed), "1");
  vm::check("no job missed", missed == 0 && jobs == releases,
            std::to_string(jobs) + " of " + std::to_string(releases));
  return 0;
}

struct Expected {
  rt::MissPolicy policy;
  const char* name;
  std::uint64_t completed, late, aborted, skipped;
  // Jobs on the lower level, and the first of them.
  std::uint64_t lowered, first_lowered;
};

// A job at 1 kHz, 0.1 ms long, is to take 2.1 ms: it ends behind the next two releases.
//   skip      both are dropped
//   catch_up  of the two the newer one is run at once, and in time
//   abort     its token ends it at its deadline, which is the next release: that one has arrived
//             when it ends, so it is dropped; nothing of the job is committed
//   degrade   as skip; the lower level from the next boundary of 100 ms until ten clean ones
constexpr std::uint64_t kAt = 150;
constexpr std::uint64_t kReleases = 1500;
constexpr Expected kExpected[] = {
    {rt::MissPolicy::kSkip, "skip", kReleases - 2, 1, 0, 2, 0, 0},
    {rt::MissPolicy::kCatchUp, "catch_up", kReleases - 1, 1, 0, 1, 0, 0},
    {rt::MissPolicy::kAbort, "abort", kReleases - 2, 0, 1, 1, 0, 0},
    {rt::MissPolicy::kDegrade, "degrade", kReleases - 2, 1, 0, 2, 1000, 200},
};

void overrun(rt::NonRealtime& nrt, const vm::Burner& burner, const Expected& e) {
  Load victim(burner, {std::chrono::microseconds{100}, std::chrono::microseconds{50}});
  Load lower(burner, {std::chrono::microseconds{500}});
  victim.overrun_at(kAt, std::chrono::milliseconds{2});
  std::vector<rt::PlacedTask> placed(2);
  placed[0].spec.name = "overruns";
  placed[0].spec.rate = {1000, 1};
  placed[0].spec.policy = e.policy;
  placed[0].spec.catch_up_max = 1;
  placed[0].spec.ring_fed = true;
  if (e.policy == rt::MissPolicy::kDegrade)
    placed[0].spec.variants = {{"full", std::chrono::microseconds{120}},
                               {"half", std::chrono::microseconds{60}}};
  placed[0].body = &victim;
  placed[0].priority = 80;
  placed[1].spec.name = "below";
  placed[1].spec.rate = {100, 1};
  placed[1].body = &lower;
  placed[1].id = 1;
  placed[1].priority = 79;
  for (auto& p : placed) p.core = rt::affinity_cpus().front();
  const Outcome o = run(nrt, placed, static_cast<double>(kReleases) / 1000);
  const rt::TaskTotals& t = o.totals[0];
  std::uint64_t lowered = 0, first = 0;
  for (const auto& r : o.jobs[0]) {
    if (r.level == 0) continue;
    if (lowered++ == 0) first = r.k;
  }
  const std::string name = std::string(e.name) + ": ";
  const auto text = [](std::uint64_t got, std::uint64_t wanted) {
    return std::to_string(got) + " of " + std::to_string(wanted);
  };
  vm::check(name + "completed", t.completed == e.completed, text(t.completed, e.completed));
  vm::check(name + "late", t.late == e.late, text(t.late, e.late));
  vm::check(name + "aborted", t.aborted == e.aborted, text(t.aborted, e.aborted));
  vm::check(name + "dropped", t.skipped == e.skipped, text(t.skipped, e.skipped));
  vm::check(name + "an aborted job commits nothing",
            victim.abandoned == e.aborted && victim.committed == 1 - e.aborted, "");
  vm::check(name + "jobs on the lower level", lowered == e.lowered && first == e.first_lowered,
            text(lowered, e.lowered) + ", from job " + std::to_string(first));
  const rt::TaskTotals& below = o.totals[1];
  vm::check(name + "the task below misses nothing",
            below.late + below.skipped + below.aborted == 0 && below.completed == kReleases / 10,
            "");
}

}  // namespace

int main(int argc, char** argv) {
  rt::Startup startup;
  if (vm::option(argc, argv, "case", std::string("admitted")) == "admitted")
    return admitted(startup.token(), vm::option(argc, argv, "seconds", 60.0),
                    read_costs(vm::option(argc, argv, "costs", std::string())));
  const vm::Burner burner;
  for (const Expected& e : kExpected) overrun(startup.token(), burner, e);
  return 0;
}
