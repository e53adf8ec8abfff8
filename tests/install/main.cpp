// What a user of the installed core does: describe three tasks, ask whether they fit, check the
// answer by the response-time recurrence worked out by hand, pass records through a Ring, read a
// setting.
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "config/schema.hpp"
#include "rt/channel/ring.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/analysis.hpp"

namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

int g_failed = 0;

void check(bool ok, const char* what) {
  std::printf("%-58s %s\n", what, ok ? "ok" : "FAILED");
  if (!ok) ++g_failed;
}

rt::TaskSpec spec(const char* name, std::int64_t rate_hz, rt::Nanos budget) {
  rt::TaskSpec s;
  s.name = name;
  s.rate = {rate_hz, 1};
  s.budget = budget;
  return s;
}

// Three tasks on one core, no switch cost, deadlines as periods. By hand: R1 = 1; R2 = 2 + 1 = 3;
// the third is the least w with w = 5 + ceil(w / 4) 1 + ceil(w / 10) 2: 8, 9, 10, 10.
void response_times() {
  const rt::AnalysisTask tasks[3] = {
      {milliseconds{1}, milliseconds{4}, milliseconds{4}, rt::Nanos{0}, rt::Nanos{0}, 0},
      {milliseconds{2}, milliseconds{10}, milliseconds{10}, rt::Nanos{0}, rt::Nanos{0}, 1},
      {milliseconds{5}, milliseconds{20}, milliseconds{20}, rt::Nanos{0}, rt::Nanos{0}, 2}};
  rt::AnalysisOptions options;
  options.switch_cost = rt::Nanos{0};
  const auto a = rt::analyse(tasks, options);
  check(a.tasks[0].R == milliseconds{1} && a.tasks[1].R == milliseconds{3} &&
            a.tasks[2].R == milliseconds{10},
        "response times 1, 3 and 10 ms");
  check(a.schedulable, "the set is schedulable");
}

void admission() {
  rt::AdmissionRequest request;
  request.tasks = {spec("touch", 1000, microseconds{100}), spec("map", 30, milliseconds{20}),
                   spec("plan", 10, milliseconds{10})};
  request.cpus = {0};
  const auto admitted = rt::admit(request);
  check(admitted.admitted && admitted.refusal.empty(), "three tasks are admitted on one core");
  check(admitted.tasks[0].priority > admitted.tasks[1].priority &&
            admitted.tasks[1].priority > admitted.tasks[2].priority,
        "priorities follow the rates");
  request.tasks[1].budget = milliseconds{30};
  const auto refused = rt::admit(request);
  check(!refused.admitted && !refused.refusal.empty(), "a set above 0.90 of the core is refused");
  std::printf("  %s\n", refused.refusal.c_str());
}

struct Event {
  std::uint64_t n = 0;
  bool gap = false;
};

void ring() {
  static rt::Ring<Event, 4> ring;
  int accepted = 0;
  for (std::uint64_t n = 0; n < 6; ++n) accepted += ring.try_push({n, false}) ? 1 : 0;
  check(accepted == 4 && ring.dropped() == 2, "a full ring drops the newest and counts");
  Event e;
  bool in_order = true;
  for (std::uint64_t n = 0; n < 4; ++n)
    in_order = in_order && ring.try_pop(e) && e.n == n && !e.gap;
  check(in_order && !ring.try_pop(e), "first in, first out, then empty");
  check(ring.try_push({6, false}) && ring.try_pop(e) && e.gap,
        "the next event carries the gap flag");
}

void settings() {
  double stiffness = 1000;
  config::Section s;
  s.number("stiffness_N_per_m", stiffness, 1, 14500, "spring at the device");
  check(config::effective(s).find("stiffness_N_per_m") != std::string::npos,
        "a setting shows in the effective config");
}

}  // namespace

int main() {
  response_times();
  admission();
  ring();
  settings();
  return g_failed == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
