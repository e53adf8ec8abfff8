// One figure a case: force and proxy of one of its runs, with the other methods and the field
// optimum beside.
#pragma once

#include <string>
#include <vector>

#include "tools/measure/stability/cases.hpp"

namespace teletact {

struct StabilityTrace {
  std::string method;
  std::vector<double> t, force_N, raw_N, x_mm, z_mm;  // of the proxy
};

struct StabilityDrawing {
  std::string title;
  std::vector<StabilityTrace> traces;  // the first is the one that is judged
  StabilityTrace optimum;
  std::vector<double> hand_t, hand_x_mm, hand_z_mm;

  // A new drawing, of this run.
  void begin(const stability::Case& c, const std::string& method, const stability::Run& run);
  void beside(const std::string& method, const stability::Run& run);
  // SVG: force, proxy height, and the proxy's path from the side where the hand goes along x.
  [[nodiscard]] std::string svg() const;
};

}  // namespace teletact
