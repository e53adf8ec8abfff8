// The figures of `teletact bench console` against their limits, as text, metrics and page.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>

#include "rt/quantile.hpp"
#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/paired.hpp"
#include "tools/measure/bench/tree_commit.hpp"

namespace teletact {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr const char* kNotRun = "it was not run";
constexpr double kTask_ms = 50, kSlowTask_ms = 130, kAnswer_ms = 200, kMesh_ms = 100, kFps = 5;
constexpr double kFusionOver = 1.10, kServerShare = 0.05, kGrowth = 0.02, kPageGrowth = 0.05;

double p95(const std::vector<double>& values) { return rt::quantile_or_nan(values, 0.95); }

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? kNaN : sum / static_cast<double>(values.size());
}

// Why nothing of a part counts; empty: it does.
template <class Part>
std::string why_not(const std::optional<Part>& part, bool of_time = true) {
  if (!part) return kNotRun;
  if (!part->problem.empty()) return part->problem;
  return of_time ? part->busy : std::string();
}

std::string either(const std::string& first, const std::string& second) {
  return first.empty() ? second : first;
}

const ActTimes* act_of(const std::optional<ActsPart>& part, const char* name) {
  if (!part) return nullptr;
  for (const ActTimes& a : part->acts)
    if (a.act == name) return &a;
  return nullptr;
}

void stop_limits(const std::optional<StopPart>& part, Limits& all) {
  const std::string why = why_not(part);
  const StopPart none, &s = part ? *part : none;
  const auto in_time = std::count_if(s.stops.begin(), s.stops.end(),
                                     [&](const StopSeen& one) { return s.in_time(one); });
  // Without any there would be nothing to miss.
  all.add("stop: of all stops, those in time", static_cast<double>(in_time),
          ">=", static_cast<double>(std::max<std::size_t>(1, s.stops.size())), why);
  all.add("stop: intents a second before it", part ? s.notes_per_s : kNaN, ">=", 900,
          why_not(part));
  all.add("stop: of them refused for their speed", static_cast<double>(s.refused), ">=", 1,
          why_not(part, false));
}

void acts_limits(const std::optional<ActsPart>& part, Limits& all) {
  const std::string browser = part ? part->no_browser : std::string();
  const std::string why = either(browser, why_not(part));
  std::vector<double> answers;
  for (const char* name : {"hand", "draw", "undo", "hold", "go_to"}) {
    const ActTimes* a = act_of(part, name);
    const bool slow = std::string(name) == "go_to";
    const std::string task = a != nullptr ? a->task : slow ? "planning" : "task";
    all.add("acts: " + std::string(name) + ", pointer to " + task + " p95, ms",
            a != nullptr ? p95(a->task_ms) : kNaN, "<=", slow ? kSlowTask_ms : kTask_ms, why);
    if (a != nullptr) answers.insert(answers.end(), a->answer_ms.begin(), a->answer_ms.end());
  }
  all.add("acts: pointer to the answer on the page p95, ms", p95(answers), "<=", kAnswer_ms, why);
  all.add("acts: fusion's mesh to the page's scene p95, ms", part ? p95(part->mesh_ms) : kNaN,
          "<=", kMesh_ms, why);
  all.add("acts: frames a second, software, 640x360", part ? part->fps : kNaN, ">=", kFps,
          either(part ? part->no_recording : std::string(), why));
}

void cost_limits(const std::optional<CostPart>& part, Limits& all) {
  const std::string why = why_not(part);
  const CostPart none, &c = part ? *part : none;
  const std::string counted = either(c.not_counted, why_not(part, false));
  // That nobody looks has to be asked, a handful of instructions a job: more than one in a million
  // is more than the question.
  all.add("cost: nobody looks, added to fusion, of a million", 1e6 * (c.with / c.without - 1),
          "<=", 1, counted);
  const bool known = !c.sched_with.empty() && !c.log_with.empty();
  const bool same = c.sched_with == c.sched_without && c.log_with == c.log_without;
  all.add("cost: nobody looks, hashes of the run are equal", known && same ? 1 : 0, ">=", 1,
          counted);
  all.add("cost: one viewer, fusion's CPU over that without",
          mean(c.fusion_open_ms) / mean(c.fusion_closed_ms), "<=", kFusionOver, why);
  all.add("cost: one viewer, views and server, of a core", part ? c.server_share : kNaN,
          "<=", kServerShare, why);
  all.add("cost: misses of the tasks' own", static_cast<double>(c.own_misses), "<=", 0, why);
}

void growth_limits(const std::optional<GrowthPart>& part, Limits& all) {
  const std::string why = either(part ? part->no_browser : std::string(), why_not(part, false));
  const GrowthPart none, &g = part ? *part : none;
  all.add("growth: server's memory, last tenth over second", growth(g.server_MB).share(),
          "<=", kGrowth, why);
  all.add("growth: page's heap, likewise", growth(g.heap_MB).share(), "<=", kPageGrowth, why);
  all.add("growth: its drawing process, likewise", growth(g.renderer_MB).share(), "<=", kPageGrowth,
          why);
}

void line(std::ostream& out, const char* form, auto... values) {
  char text[240];
  std::snprintf(text, sizeof text, form, values...);
  out << text << "\n";
}

void state(std::ostream& out, const char* name, const ConsolePart& part) {
  line(out, "%s: others used %.2f of a core%s%s", name, part.others_cores,
       part.problem.empty() ? "" : "; ", part.problem.c_str());
}

void print_stop(std::ostream& out, const StopPart& s) {
  state(out, "stop", s);
  if (s.stops.empty()) return;
  std::vector<double> falls, over, stands;
  for (const StopSeen& one : s.stops) {
    falls.push_back(one.falls_ms);
    over.push_back(one.ramp_over(4));
    stands.push_back(one.stands_ms);
  }
  const auto seen = [](std::vector<double>& v) {
    std::erase_if(v, [](double x) { return std::isnan(x); });
  };
  seen(falls), seen(over), seen(stands);
  line(out, "  %zu stops, %zu seen to fall; %.0f ms on the way", s.stops.size(), falls.size(),
       s.one_way_ms);
  line(out, "  press to first falling setpoint  p50 %.1f  max %.1f ms",
       rt::quantile_or_nan(falls, 0.5), rt::quantile_or_nan(falls, 1));
  line(out, "  ramp over v / (4 m/s2)           p50 %.3f  max %.3f", rt::quantile_or_nan(over, 0.5),
       rt::quantile_or_nan(over, 1));
  line(out, "  press to standing                p50 %.0f  max %.0f ms",
       rt::quantile_or_nan(stands, 0.5), rt::quantile_or_nan(stands, 1));
  line(out, "  %llu intents before them, %.0f a second; %llu refused for their speed",
       static_cast<unsigned long long>(s.notes), s.notes_per_s,
       static_cast<unsigned long long>(s.refused));
}

void print_acts(std::ostream& out, const ActsPart& a) {
  state(out, "acts", a);
  if (!a.no_browser.empty()) line(out, "  %s", a.no_browser.c_str());
  if (a.acts.empty()) return;
  line(out, "  %-8s %-12s %5s %5s %9s %9s %11s", "act", "task", "n", "lost", "task p50", "task p95",
       "answer p95");
  for (const ActTimes& t : a.acts)
    line(out, "  %-8s %-12s %5zu %5d %9.1f %9.1f %11.1f", t.act.c_str(), t.task.c_str(),
         t.task_ms.size(), t.lost, rt::quantile_or_nan(t.task_ms, 0.5), p95(t.task_ms),
         p95(t.answer_ms));
  line(out, "  mesh to scene: %zu pieces, p50 %.1f  p95 %.1f ms; to pixels p50 %.1f  p95 %.1f ms",
       a.mesh_ms.size(), rt::quantile_or_nan(a.mesh_ms, 0.5), p95(a.mesh_ms),
       rt::quantile_or_nan(a.pixels_ms, 0.5), p95(a.pixels_ms));
  line(out, "  frames a second %.1f, pictures sent %.1f a second; %s", a.fps, a.pictures_per_s,
       a.renderer.c_str());
  line(out, "  box alone: intent to task p95 %.1f ms, mesh to server p95 %.1f ms", a.intent_p95_ms,
       a.to_server_p95_ms);
  line(out,
       "  picture's border, Chromium on the box's cores: live %.1f %%, late %.1f %%, frozen %.1f "
       "%% of "
       "the time",
       100 * a.live_share, 100 * a.late_share, 100 * (1 - a.live_share - a.late_share));
  line(out, "  ms from the pointer event; the page's clock is known within %.2f ms",
       a.clock_within_ms);
}

void print_cost(std::ostream& out, const CostPart& c) {
  state(out, "cost", c);
  if (c.not_counted.empty())
    line(out, "  fusion in a virtual run: %.0f instructions without a page, %.0f with", c.without,
         c.with);
  else
    line(out, "  instructions: %s", c.not_counted.c_str());
  if (c.fusion_open_ms.empty()) return;
  line(out, "  fusion's job: %.2f ms closed, %.2f ms open; server %.4f of a core",
       mean(c.fusion_closed_ms), mean(c.fusion_open_ms), c.server_share);
  const PairedDifference d = paired(c.late_open_us, c.late_closed_us);
  line(out,
       "  haptic p99 over the sentinel, open - closed: %d pairs, median %+.1f us, "
       "[%+.1f, %+.1f] holds it with %.1f %%",
       d.pairs, d.median, d.low, d.high, 100 * d.coverage);
  line(out, "  %llu views, %.1f MB taken; own misses %llu",
       static_cast<unsigned long long>(c.views), c.megabytes,
       static_cast<unsigned long long>(c.own_misses));
}

void print_growth(std::ostream& out, const GrowthPart& g) {
  state(out, "growth", g);
  if (!g.no_browser.empty()) line(out, "  %s", g.no_browser.c_str());
  if (g.server_MB.empty()) return;
  line(out, "  %llu views in %.0f s, two viewers, %d reloads",
       static_cast<unsigned long long>(g.messages), g.seconds, g.reloads);
  const auto row = [&](const char* what, const std::vector<double>& v) {
    const Growth now = growth(v);
    line(out, "  %-18s %8.2f MB in the second tenth, %8.2f MB in the last: %+.2f %%", what,
         now.first, now.last, 100 * now.share());
    std::string each;
    for (const double tenth : tenths(v)) {
      char text[32];
      std::snprintf(text, sizeof text, " %.1f", tenth);
      each += text;
    }
    line(out, "    by tenths:%s", each.c_str());
  };
  row("server", g.server_MB);
  row("page's heap", g.heap_MB);
  row("drawing process", g.renderer_MB);
}

}  // namespace

std::vector<Limit> ConsoleBenchResult::limits() const {
  Limits all;
  stop_limits(stop, all);
  acts_limits(acts, all);
  cost_limits(cost, all);
  growth_limits(growth, all);
  return all.all();
}

std::vector<BenchMetric> ConsoleBenchResult::metrics() const {
  std::vector<BenchMetric> all;
  const auto add = [&](const char* name, double value, const char* unit) {
    if (!std::isnan(value)) all.push_back({name, value, unit});
  };
  if (acts && acts->problem.empty() && acts->no_browser.empty()) {
    std::vector<double> task_ms;
    for (const ActTimes& a : acts->acts)
      if (a.task != "planning") task_ms.insert(task_ms.end(), a.task_ms.begin(), a.task_ms.end());
    add("console.intent_p95_ms", p95(task_ms), "ms");
    add("console.mesh_p95_ms", p95(acts->mesh_ms), "ms");
    if (acts->no_recording.empty()) add("console.fps", acts->fps, "1/s");
  }
  if (cost && cost->problem.empty()) add("console.server_share", cost->server_share, "1");
  return all;
}

void ConsoleBenchResult::print(std::ostream& out) const {
  if (stop) print_stop(out, *stop);
  if (acts) print_acts(out, *acts);
  if (cost) print_cost(out, *cost);
  if (growth) print_growth(out, *growth);
  teletact::print(out, limits());
}

std::string ConsoleBenchResult::page(const std::string& command) const {
  std::ostringstream text;
  text << "# The operator's page beside its box\n\nCommand: `" << command
       << "`. Commit: " << tree_commit() << ". Machine: " << host
       << ".\nMethod and limits: `docs/console.md`, The bench. Made by `--write`.\n\n```\n";
  print(text);
  text << "```\n";
  return text.str();
}

}  // namespace teletact
