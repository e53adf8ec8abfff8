#include "tools/measure/prediction/prediction_bench.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

#include "tools/report/svg.hpp"

namespace teletact {

namespace {

constexpr std::array kMethods{
    "none", "constant_velocity", "ridge", "kalman", "singer", "lsq", "paper", "own"};
constexpr std::array kSimple{"constant_velocity", "ridge", "kalman", "singer"};
constexpr const char* kWithCommands = "own_commands";

JudgedMethod method_of(const std::string& name) {
  JudgedMethod m;
  m.method = name;
  m.commands = name == kWithCommands;
  m.config.method = m.commands ? "own" : name;
  return m;
}

MethodFigures figures(const MotionErrors& e) {
  return {e.method, e.mean_cm(), e.p95_cm(), e.max_cm()};
}

std::string drawing(const MotionTrace& trace, const std::vector<MotionErrors>& all,
                    double published_cm) {
  plot::Figure f;
  char title[160];
  std::snprintf(title, sizeof title,
                "Prediction across %.0f ms: error on %s, and the published figures",
                1e3 * trace.delay_min_s, trace.name.c_str());
  f.title = title;
  f.x_label = "time, s";
  f.y_label = "error, cm";
  f.height_px = 400;
  for (const char* method : {"paper", "own", kWithCommands}) {
    for (const MotionErrors& e : all) {
      if (e.method != method) continue;
      plot::Series s;
      char name[80];
      std::snprintf(name, sizeof name, "%s, mean %.2f cm", method, e.mean_cm());
      s.name = name;
      s.x = e.t_s;
      for (const double v : e.error_m) s.y.push_back(100 * v);
      f.series.push_back(std::move(s));
    }
  }
  char label[80];
  std::snprintf(label, sizeof label, "published mean %.2f cm", published_cm);
  f.rules.push_back({published_cm, false, label, "#b03a2e"});
  f.rules.push_back({kPaperMax_cm, false, "published maximum 7.0 cm", "#7b241c"});
  return plot::line_plot(f);
}

}  // namespace

double TraceResult::mean_cm(const std::string& method) const {
  for (const MethodFigures& m : methods)
    if (m.method == method) return m.mean_cm;
  return std::numeric_limits<double>::quiet_NaN();
}

double TraceResult::best_simple_cm() const {
  double best = std::numeric_limits<double>::infinity();
  for (const char* m : kSimple) best = std::min(best, mean_cm(m));
  return best;
}

double TraceResult::best_without_commands_cm() const {
  return std::min({best_simple_cm(), mean_cm("own"), mean_cm("lsq"), mean_cm("paper")});
}

double TraceResult::published_cm() const {
  return delay_min_s < 0.15 ? kPaper100_cm : kPaper200_cm;
}

PredictionResult bench_prediction(std::ostream& progress, const TraceSetOptions& options) {
  PredictionResult result;
  std::size_t judged = 0;
  for (const MotionTrace& trace : trace_set(options)) {
    progress << "\r" << trace.name << "          " << std::flush;
    TraceResult r;
    r.name = trace.name;
    r.delay_min_s = trace.delay_min_s;
    r.delay_max_s = trace.delay_max_s;
    std::vector<MotionErrors> all;
    for (const char* m : kMethods) {
      all.push_back(judge(trace, method_of(m)));
      result.cpu_us[m] += all.back().cpu_us;
    }
    const MotionErrors oracle = best_of_each_instant(all);
    if (!trace.commands.empty()) {
      all.push_back(judge(trace, method_of(kWithCommands)));
      result.cpu_us[kWithCommands] += all.back().cpu_us;
    }
    for (const MotionErrors& e : all) r.methods.push_back(figures(e));
    r.methods.push_back(figures(oracle));
    if (!trace.wheels.empty()) r.methods.push_back(figures(wheels_known(trace)));
    if (trace.name == "paths_a2_20hz_d100") result.drawings[0] = drawing(trace, all, kPaper100_cm);
    if (trace.name == "paths_a2_20hz_d200") {
      result.drawings[1] = drawing(trace, all, kPaper200_cm);
      for (const char* m : kMethods)
        result.look_ahead[m] = changed_by_the_future(trace, method_of(m));
      result.look_ahead[kWithCommands] = changed_by_the_future(trace, method_of(kWithCommands));
    }
    if (!trace.commands.empty()) ++judged;
    result.traces.push_back(std::move(r));
  }
  for (auto& [method, us] : result.cpu_us)
    us /= static_cast<double>(method == kWithCommands ? judged : result.traces.size());
  progress << "\r                                  \r";
  return result;
}

}  // namespace teletact
