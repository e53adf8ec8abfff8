// What each variant of each task costs on a host: measured by `teletact calibrate`, read at start.
// budget = max(1.2 p99.9, p99.9 + 10 us).
//
// File (TOML):   host = "..."          which machine measured it
//                [[task]] name, level, p50_us, p99_us, p999_us, work_min, work_max, quantiles_us[33]
// A variant that is not in the table keeps its declared budget.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "rt/result.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/cost_model.hpp"
#include "rt/sched/task_spec.hpp"
#include "tasks/graph/table.hpp"

namespace tasks {

struct CalibrationRow {
  static constexpr std::size_t kQuantiles = 33;
  std::string name;
  int level = 0;
  double p50_us = 0, p99_us = 0, p999_us = 0;
  double work_min = 0, work_max = 0;
  std::array<double, kQuantiles> quantiles_us{};  // of the CPU of a job, i / 32
  void describe(config::Section& s);
  [[nodiscard]] rt::Nanos budget() const noexcept;
};

struct Calibration {
  std::string host;
  std::deque<CalibrationRow> rows;
  void describe(config::Section& s);
  [[nodiscard]] const CalibrationRow* find(std::string_view name, int level) const noexcept;
};

// Identity of this machine as far as timing goes: CPU model, cores, kernel.
[[nodiscard]] std::string host_id();
[[nodiscard]] rt::Result<Calibration> load_calibration(const std::string& path);
// Whole or not at all. Throws std::runtime_error naming the file.
void save_calibration(const std::string& path, const Calibration& calibration);

// The task table as specs, budgets from the calibration where it has them.
[[nodiscard]] std::vector<rt::TaskSpec> make_specs(const Calibration& calibration);

// Costs for the virtual clock: each variant's measured distribution, scaled so that its 99.9 %
// quantile is that of the budget (budget / 1.2); a variant without a row costs 0.3 .. 0.8 of its budget.
[[nodiscard]] std::vector<std::vector<rt::CostQuantiles>> make_costs(
    const Calibration& calibration, const std::vector<rt::TaskSpec>& specs);

// Admission request of the demo: both boxes, sentinels, watchdogs, declared ordinary threads.
struct BestEffortShares {
  double camera_twin = 0, link = 0.03, console = 0.02;
};
[[nodiscard]] rt::AdmissionRequest make_request(const std::vector<rt::TaskSpec>& specs,
                                                const std::vector<int>& cpus,
                                                const BestEffortShares& shares);

}  // namespace tasks
