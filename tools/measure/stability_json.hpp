// The result of `teletact stability` as a file: its metrics, and under "checks" every check of
// every run.
#pragma once

#include <memory>
#include <string>

#include "tools/files/metrics_json.hpp"
#include "tools/measure/stability/gates.hpp"
#include "tools/measure/stability_table.hpp"

namespace teletact {

class StabilityRecord {
 public:
  StabilityRecord();
  ~StabilityRecord();
  void take(const stability::Case& c, const stability::Setting& s, const stability::Gated& gated);
  // {"command", ..., "metrics": [...], "checks": [{case, run, ..., check, value, limit, optimum,
  // met, alone, alone_optimum, field_bound}]}; an optimum that does not exist is null, and so is
  // `alone` where we are nowhere farther over the limit than the optimum thereabouts.
  [[nodiscard]] std::string json(const Metrics& metrics) const;

 private:
  struct Rows;
  std::unique_ptr<Rows> rows_;
};

// stability.case<n>.*, and stability.case<n>.<method>.* of the methods beside.
void add_metrics(Metrics& metrics, int id, const StabilityTally& t);
void add_beside(Metrics& metrics, int id, const std::string& method, bool layer,
                const StabilityTally& t);

}  // namespace teletact
