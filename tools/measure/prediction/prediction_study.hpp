// teletact accuracy prediction: error against thread CPU of every method, and of the linear model
// over its order and ridge, at horizons of 100, 200 and 400 ms.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>

#include "tools/measure/accuracy/study.hpp"

namespace teletact {

struct PredictionStudyOptions {
  std::string folder;  // of the logs; empty: none
  std::uint64_t seed = 4;
  double length_s = 60;
};
[[nodiscard]] Study study_prediction(std::ostream& progress, const PredictionStudyOptions&);

}  // namespace teletact
