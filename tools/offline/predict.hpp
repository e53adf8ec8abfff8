// Where a ground robot is, told only what was known a delay ago, for each row of a log: what
// `teletact predict` does. Its options are told in tools/teletact/cmd_predict.cpp.
#pragma once

#include <string>

#include "tasks/prediction/motion_predictor.hpp"

namespace teletact {

struct PredictOptions {
  std::string log, method = tasks::MotionPredictorConfig{}.method, out, json;
  double delay_s = 0, hand_back_s = 0;
};

// The options are in their ranges. Writes all outputs or none. Throws std::runtime_error with one
// line.
void predict_log(const PredictOptions& o);

}  // namespace teletact
