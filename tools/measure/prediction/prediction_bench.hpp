// teletact bench prediction: every predictor on the same traces in the same run, against its limits
// (docs/prediction.md).
//
// Simple ones, of which the best of a trace is what `own` is held against: constant_velocity, ridge
// (N 20, m 3, 0.02), kalman, singer (0.3 s). The oracle takes at each instant the method that turns
// out best: no choice among them goes below it.
#pragma once

#include <map>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"
#include "tools/measure/prediction/motion_trace.hpp"
#include "tools/measure/prediction/prediction_judge.hpp"

namespace teletact {

// What the published system reports.
inline constexpr double kPaper100_cm = 2.34, kPaper200_cm = 3.47, kPaperMax_cm = 7.0;

struct MethodFigures {
  std::string method;
  double mean_cm = 0, p95_cm = 0, max_cm = 0;
};

struct TraceResult {
  std::string name;
  double delay_min_s = 0, delay_max_s = 0;
  std::vector<MethodFigures> methods;                             // the oracle last
  [[nodiscard]] double mean_cm(const std::string& method) const;  // NaN: it was not run
  [[nodiscard]] double best_simple_cm() const;
  [[nodiscard]] double best_without_commands_cm() const;
  [[nodiscard]] double published_cm() const;  // at the smallest delay
};

struct PredictionResult {
  std::vector<TraceResult> traces;
  std::map<std::string, int> look_ahead;  // method: predictions that later rows changed
  std::map<std::string, double> cpu_us;   // of a target
  std::string no_logs;                    // why the logs were not run
  std::string drawings[2];                // error over time at 100 and 200 ms, SVG

  void print(std::ostream& out) const;
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  // The table of docs/measured/.
  [[nodiscard]] std::string page(const std::string& command) const;
};

[[nodiscard]] PredictionResult bench_prediction(std::ostream& progress, const TraceSetOptions&);

}  // namespace teletact
