// A piece of a run for its report: samples outside of it go, counters that run on begin at its
// start, and figures that are known of the whole run alone are left out.
#pragma once

#include <string>
#include <vector>

#include "rt/store/read_store.hpp"
#include "tools/host/run_results.hpp"

namespace teletact {

// Returns the names of the metrics that can not be told of the piece: those of the whole run, and
// those of samples that had gone before it began. A name that ends with '.' is of all that begin
// so.
[[nodiscard]] std::vector<std::string> crop_to(const rt::StorePiece& piece, OperatorHalf& op,
                                               RobotHalf& robot);
// `all` without these.
[[nodiscard]] Metrics without(const Metrics& all, const std::string& command,
                              const std::vector<std::string>& left_out);

}  // namespace teletact
