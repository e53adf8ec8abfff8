// The figures of `teletact bench link` against their limits, as text, metrics and page.
#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>

#include "rt/quantile.hpp"
#include "tools/measure/bench/link/link_bench.hpp"
#include "tools/measure/bench/paired.hpp"
#include "tools/measure/bench/tree_commit.hpp"

namespace teletact {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr const char* kNotRun = "it was not run";
// docs/faults.md: a silent road stops the base within 300 ms and the way.
constexpr double kStandsWithin_ms = 300 + 95;
// Of goals the robot's box knows when the last new one came; it is sent again for up to 100 ms.
constexpr double kStandsAfterGoal_ms = 300 + 100;

class Judge {
 public:
  explicit Judge(const LinkBenchResult& result) : result_(result) {}

  [[nodiscard]] const LinkRow* row(const std::string& name) const {
    const auto at = result_.rows.find(name);
    return at == result_.rows.end() ? nullptr : &at->second;
  }
  // Why nothing of this run counts; empty: it does.
  [[nodiscard]] std::string why_not(const std::string& name, bool of_time) const {
    if (!result_.refusal.empty()) return "the road " + result_.refusal;
    const LinkRow* r = row(name);
    if (r == nullptr) return kNotRun;
    if (!r->problem.empty()) return r->problem;
    return of_time ? r->busy : std::string();
  }
  template <class Of>
  void add(Limits& all, const std::string& what, const std::string& run, const char* sense,
           double limit, const Of& of, bool of_time = true, std::string why = {}) const {
    const LinkRow* r = row(run);
    const std::string not_here = why_not(run, of_time);
    all.add(what, r == nullptr ? kNaN : of(*r), sense, limit, not_here.empty() ? why : not_here);
  }
  // The tasks' own misses, and the work of a tick of the hand: the road may add neither.
  void pairs(Limits& all) const {
    const LinkPairs none, &p = result_.pairs ? *result_.pairs : none;
    std::string why = !result_.refusal.empty() ? "the road " + result_.refusal
                      : !result_.pairs         ? kNotRun
                                               : p.problem;
    all.add("pairs: misses of the tasks' own",
            static_cast<double>(p.idle.own_misses + p.saturated.own_misses), "<=", 0,
            why.empty() ? p.busy : why);
    if (result_.pairs) why = p.not_counted;
    all.add("pairs: instructions of the median tick, saturated over idle",
            std::abs(p.saturated.tick_instructions - p.idle.tick_instructions), "<=", 0, why);
  }

 private:
  const LinkBenchResult& result_;
};

double ratio(const LinkRow* of, const LinkRow* to) {
  if (of == nullptr || to == nullptr) return kNaN;
  return of->drive.time_s / to->drive.time_s;
}

std::string congestion_text(const LinkRow& r) {
  return r.robot_congestion == r.operator_congestion
             ? r.robot_congestion
             : r.robot_congestion + " / " + r.operator_congestion;
}

void print_stages(std::ostream& out, const std::map<std::string, LinkRow>& rows) {
  const auto rest = rows.find("rest");
  if (rest == rows.end() || rest->second.felt_stages.empty()) return;
  const auto& all = rest->second.felt_stages;
  out << "rest: from an exposure to the force that it causes, p50 and p95 of each stage, ms:\n";
  for (std::size_t i = 0; i < kStages; ++i) {
    std::vector<double> ms;
    for (const Stages_ms& one : all) ms.push_back(one[i]);
    char line[80];
    std::snprintf(line, sizeof line, "  %-20s %6.1f %6.1f\n", kStageNames[i], rt::quantile(ms, 0.5),
                  rt::quantile(ms, 0.95));
    out << line;
  }
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? kNaN : sum / static_cast<double>(values.size());
}

void print_pairs(std::ostream& out, const LinkPairs& p) {
  char line[200];
  std::snprintf(line, sizeof line,
                "pairs: idle %.1f fps, %.2f Mbit/s; saturated %.1f fps, %.2f Mbit/s; others used "
                "%.2f of a core at most\n",
                mean(p.idle.fps), mean(p.idle.mbit_s), mean(p.saturated.fps),
                mean(p.saturated.mbit_s), p.others_cores);
  out << line;
  for (std::size_t t = 0; t < kPairedTasks.size(); ++t) {
    const auto &idle = p.idle.late_us[t], &saturated = p.saturated.late_us[t];
    const PairedDifference d = paired(saturated, idle);
    std::snprintf(line, sizeof line,
                  "  %-9s p99 over the sentinel, idle %.1f us; saturated - idle: %d pairs, median "
                  "%+.1f us, [%+.1f, %+.1f] holds it with %.1f %%\n",
                  kPairedTasks[t], rt::quantile_or_nan(idle, 0.5), d.pairs, d.median, d.low, d.high,
                  100 * d.coverage);
    out << line;
  }
  std::snprintf(line, sizeof line,
                "  own misses %llu idle, %llu saturated; median tick of the hand %.0f and %.0f "
                "instructions\n",
                static_cast<unsigned long long>(p.idle.own_misses),
                static_cast<unsigned long long>(p.saturated.own_misses), p.idle.tick_instructions,
                p.saturated.tick_instructions);
  out << line;
}

void add_drives(const Judge& j, Limits& all) {
  for (const char* name : {"drive", "drive_loss", "drive_stall"}) {
    const std::string what = name;
    j.add(all, what + ": arrived, engaged once", what, ">=", 1,
          [](const LinkRow& r) { return r.drive.arrived ? 1.0 : 0.0; });
    if (what == "drive") continue;
    const std::string clean = j.why_not("drive", true);
    j.add(
        all, what + ": time over the clean road's", what, "<=", 1.5,
        [&](const LinkRow& r) { return ratio(&r, j.row("drive")); }, true, clean);
  }
  const LinkRow* lossy = j.row("drive_loss");
  j.add(
      all, "drive_loss: base moves after the last goal before a gap, ms", "drive_loss",
      "<=", kStandsAfterGoal_ms, [](const LinkRow& r) { return r.drive.gaps.stands_ms; }, false,
      lossy != nullptr && lossy->drive.gaps.driving > 0 ? ""
                                                        : "no goal was held up while it drove");
  const LinkRow* stalled = j.row("drive_stall");
  const bool drove = stalled != nullptr && stalled->drive.silence.driving > 0;
  j.add(
      all, "drive_stall: base moves after the road is silent, ms", "drive_stall",
      "<=", kStandsWithin_ms, [](const LinkRow& r) { return r.drive.silence.stands_ms; }, false,
      drove ? "" : "the base stood at every stall");
}

}  // namespace

std::vector<Limit> LinkBenchResult::limits() const {
  const Judge j(*this);
  Limits all;
  const auto fps = [](const LinkRow& r) { return r.window.fps; };
  const auto age = [](const LinkRow& r) { return r.window.age_p95_ms; };
  const bool bbr = !congestion.empty() && congestion.front() == "bbr";
  j.add(all, "rest: pictures a second", "rest", ">=", 29, fps);
  const LinkRow* rest = j.row("rest");
  j.add(
      all, "rest: depth error over the sensor's own", "rest", "<", 1,
      [](const LinkRow& r) { return r.depth_over_sensor; }, false,
      rest != nullptr ? rest->depth_problem : "");
  j.add(all, "rest: picture age p95, ms", "rest", "<=", 200, age);
  // The road's one way, with all of its jitter, and what both boxes may take.
  j.add(
      all, "rest: exposure to the force it causes p95, ms", "rest", "<=", 95 + 45,
      [](const LinkRow& r) { return r.felt_p95_ms; }, true,
      rest != nullptr && rest->felt == 0 ? "the hand touched nothing" : "");
  j.add(all, "own_clock: pictures a second", "own_clock", ">=", 29, fps);
  // Frames wait for capture as long as where the phase is known; by chance it is up to a period.
  j.add(
      all, "own_clock: picture age p95 over that at rest, ms", "own_clock", "<=", 12,
      [&](const LinkRow& r) {
        return rest == nullptr ? kNaN : r.window.age_p95_ms - rest->window.age_p95_ms;
      },
      true, j.why_not("rest", true));
  j.add(all, "moving, strict noise: pictures a second", "strict", ">=", 24, fps);
  j.add(all, "moving, lenient noise: pictures a second", "lenient", ">=", 29, fps);
  j.add(all, "moving, strict noise: picture age p95, ms", "strict", "<=", 200, age);
  j.add(all, "moving, lenient noise: picture age p95, ms", "lenient", "<=", 200, age);
  j.add(all, "saturated: robot state age p95, ms", "saturated", "<=", 150,
        [](const LinkRow& r) { return r.window.state_p95_ms; });
  j.add(all, "stall: picture beyond stall, path and itself, ms", "stall", "<=", 50,
        [](const LinkRow& r) { return r.over_stall_ms; });
  j.add(all, "rate 10, 4, 10: picture age p95 after 3 s, ms", "rate", "<=", 400,
        [](const LinkRow& r) { return r.after_rate_p95_ms; });
  j.add(all, "rate 4: pictures with anything lowered, of 1", "rate", ">=", 0.5,
        [](const LinkRow& r) { return r.thin_spared; });
  j.add(all, "rate 10 again: likewise, less than in 4", "rate", "<=", 0,
        [](const LinkRow& r) { return r.wide_spared - r.thin_spared; });
  j.add(all, "loss .5 %: pictures a second", "loss", ">=", 25, fps, true,
        bbr ? "" : "this kernel has no bbr");
  for (const char* name : {"rest", "strict", "lenient", "saturated"})
    j.add(all, std::string(name) + ": CPU of the link's threads over its declared share", name,
          "<=", 1, [](const LinkRow& r) { return r.link_cpu / r.link_declared; });
  add_drives(j, all);
  j.pairs(all);
  return all.all();
}

std::vector<BenchMetric> LinkBenchResult::metrics() const {
  const Judge j(*this);
  std::vector<BenchMetric> all;
  const auto of_run = [&](const std::string& prefix, const char* run) {
    const LinkRow* r = j.row(run);
    if (r == nullptr || !r->problem.empty()) return;
    all.push_back({prefix + ".fps", r->window.fps, "1/s"});
    all.push_back({prefix + ".age_p95_ms", r->window.age_p95_ms, "ms"});
    all.push_back({prefix + ".state_age_p95_ms", r->window.state_p95_ms, "ms"});
    all.push_back({prefix + ".mbit_s", r->window.mbit_s, "Mbit/s"});
    all.push_back({prefix + ".cpu_share", r->link_cpu, "1"});
    if (!std::isnan(r->depth_over_sensor))
      all.push_back({prefix + ".depth_err_over_sensor", r->depth_over_sensor, "1"});
  };
  of_run("link.rest", "rest");
  of_run("link.own_clock", "own_clock");
  of_run("link.moving", "strict");
  of_run("link.moving_lenient", "lenient");
  of_run("link.saturated", "saturated");
  of_run("link.loss", "loss");
  const auto one = [&](const char* name, const char* run, double value, const char* unit) {
    const LinkRow* r = j.row(run);
    if (r != nullptr && r->problem.empty() && !std::isnan(value))
      all.push_back({name, value, unit});
  };
  const LinkRow *stall = j.row("stall"), *rate = j.row("rate"), *drive = j.row("drive");
  const LinkRow* rest = j.row("rest");
  one("link.exposure_to_felt_p95_ms", "rest", rest != nullptr ? rest->felt_p95_ms : kNaN, "ms");
  one("link.stall.over_bound_ms", "stall", stall != nullptr ? stall->over_stall_ms : kNaN, "ms");
  one("link.rate.age_p95_ms", "rate", rate != nullptr ? rate->after_rate_p95_ms : kNaN, "ms");
  one("link.drive_s", "drive", drive != nullptr ? drive->drive.time_s : kNaN, "s");
  one("link.loss.drive_time_ratio", "drive_loss", ratio(j.row("drive_loss"), drive), "1");
  if (pairs && pairs->problem.empty()) {
    for (std::size_t t = 0; t < kPairedTasks.size(); ++t)
      all.push_back({std::string("link.pairs.") + kPairedTasks[t] + "_late_us",
                     paired(pairs->saturated.late_us[t], pairs->idle.late_us[t]).median, "us"});
  }
  one("link.stall.drive_time_ratio", "drive_stall", ratio(j.row("drive_stall"), drive), "1");
  return all;
}

void LinkBenchResult::print(std::ostream& out) const {
  if (!refusal.empty()) {
    out << "not measured: the road " << refusal << "\n";
    teletact::print(out, limits());
    return;
  }
  char line[240];
  std::snprintf(line, sizeof line, "%-12s %8s %6s %8s %8s %8s %8s %8s %7s %7s %7s  %s\n", "run",
                "s", "fps", "age p50", "age p95", "age max", "state95", "Mbit/s", "spared", "CPU",
                "others", "congestion");
  out << line;
  for (const auto& [name, r] : rows) {
    const LinkWindow& w = r.window;
    std::snprintf(line, sizeof line,
                  "%-12s %8.1f %6.1f %8.0f %8.0f %8.0f %8.0f %8.2f %7.2f %7.3f %7.2f  %s\n",
                  name.c_str(), w.seconds, w.fps, w.age_p50_ms, w.age_p95_ms, w.age_max_ms,
                  w.state_p95_ms, w.mbit_s, w.spared_share, r.link_cpu, r.others_cores,
                  congestion_text(r).c_str());
    out << line;
    if (!r.problem.empty()) out << "             " << r.problem << "\n";
  }
  for (const char* name : {"drive", "drive_loss", "drive_stall"}) {
    const auto at = rows.find(name);
    if (at == rows.end()) continue;
    const LinkDrive& d = at->second.drive;
    std::snprintf(
        line, sizeof line,
        "%s: %s, %.1f s; at %d silences it drove, and moved on for %.0f ms at most; at %d "
        "gaps in the goals, for %.0f ms\n",
        name, d.arrived ? "arrived" : "did not arrive", d.time_s, d.silence.driving,
        d.silence.stands_ms, d.gaps.driving, d.gaps.stands_ms);
    out << line;
    if (!d.missed.empty()) out << "             " << d.missed << "\n";
  }
  print_stages(out, rows);
  if (pairs) print_pairs(out, *pairs);
  out << "ages in ms; CPU: of the link's threads of both boxes, of a core; others: cores that "
         "other work took; congestion: read back by both boxes\n";
  teletact::print(out, limits());
}

std::string LinkBenchResult::page(const std::string& command) const {
  std::ostringstream text;
  text << "# The link over a road of packets\n\nCommand: `" << command
       << "`. Commit: " << tree_commit() << ". Machine: " << host
       << ".\nMethod and limits: `docs/network.md`, The bench. Made by `--write`.\n\n```\n";
  print(text);
  text << "```\n";
  return text.str();
}

}  // namespace teletact
