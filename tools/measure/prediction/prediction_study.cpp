#include "tools/measure/prediction/prediction_study.hpp"

#include <cstdio>
#include <vector>

#include "tools/measure/prediction/motion_trace.hpp"
#include "tools/measure/prediction/prediction_judge.hpp"

namespace teletact {

namespace {

struct Setting {
  std::string knob, name, label;
  tasks::MotionPredictorConfig config;
};

std::vector<Setting> settings() {
  std::vector<Setting> all;
  for (const std::string& m : tasks::MotionPredictorConfig::methods()) {
    if (m == "hold") continue;  // another name of constant_velocity
    Setting s{"method", m, m, {}};
    s.config.method = m;
    all.push_back(std::move(s));
  }
  for (const int order : {1, 2, 4, 6}) {
    Setting s{"order", "ridge_m" + std::to_string(order), "ridge, m " + std::to_string(order), {}};
    s.config.method = "ridge";
    s.config.order = order;
    all.push_back(std::move(s));
  }
  struct Ridge {
    double value;
    const char *name, *label;
  };
  for (const Ridge& r :
       {Ridge{0.0002, "ridge_2e_4", "ridge 0.0002"}, Ridge{0.002, "ridge_2e_3", "ridge 0.002"},
        Ridge{0.2, "ridge_2e_1", "ridge 0.2"}, Ridge{2, "ridge_2", "ridge 2"}}) {
    Setting s{"ridge", r.name, r.label, {}};
    s.config.method = "ridge";
    s.config.ridge = r.value;
    all.push_back(std::move(s));
  }
  for (const int n : {10, 40}) {
    Setting s{"rows", "ridge_n" + std::to_string(n), "ridge, N " + std::to_string(n), {}};
    s.config.method = "ridge";
    s.config.training_samples = n;
    all.push_back(std::move(s));
  }
  return all;
}

}  // namespace

Study study_prediction(std::ostream& progress, const PredictionStudyOptions& o) {
  Study study;
  study.name = "accuracy.prediction";
  std::vector<MotionTrace> traces;
  MotionTrace paths = robot_trace({2, 20, false, o.length_s, o.seed});
  paths.name = "paths";
  paths.judged_from = 3;
  traces.push_back(std::move(paths));
  if (!o.folder.empty()) {
    MotionTrace log = log_trace(o.folder + "/tuc_lecture_hall.csv", "tuc");
    log.judged_from = 0.5 * (log.rows.front().t + log.rows.back().t);
    traces.push_back(std::move(log));
  }
  for (MotionTrace& trace : traces) {
    for (const int horizon_ms : {100, 200, 400}) {
      const std::string data = trace.name + "_" + std::to_string(horizon_ms) + "ms";
      progress << "\r" << data << "        " << std::flush;
      trace.delay_min_s = trace.delay_max_s = 1e-3 * horizon_ms;
      for (const Setting& s : settings()) {
        const MotionErrors e = judge(trace, {s.name, s.config, false});
        study.rows.push_back({data,
                              s.knob,
                              s.name,
                              s.label,
                              s.name == tasks::MotionPredictorConfig{}.method,
                              {{"mean_cm", e.mean_cm(), "cm"},
                               {"p95_cm", e.p95_cm(), "cm"},
                               {"max_cm", e.max_cm(), "cm"},
                               {"condition", e.condition_p50(), "1"},
                               {"cpu_us", e.cpu_us, "us"}}});
      }
      study.plots.push_back(
          {"accuracy_prediction_" + data,
           "Prediction across " + std::to_string(horizon_ms) + " ms, " + trace.name, data,
           "mean_cm", "mean error, cm", "cpu_us", "thread CPU of a prediction, us"});
    }
  }
  progress << "\r                    \r";
  return study;
}

}  // namespace teletact
