// Admission at start: which variants of the tasks run on this host, where, with which voxel size,
// and which modes it has room for. The same for both clocks.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rt/sched/admission.hpp"
#include "rt/sched/mode_table.hpp"
#include "rt/sched/task.hpp"
#include "tasks/graph/host_request.hpp"
#include "tasks/graph/static_choices.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

struct HostPlan {
  std::vector<rt::TaskSpec> specs;    // by task id, static choices settled
  std::vector<rt::TaskSpec> workers;  // of fusion's pool: the rows behind the tasks'
  rt::AdmissionRequest request;       // of both
  rt::Admission admission;
  rt::ModeTable modes;
  rt::AdmissionRequest
      held;  // what the registry gets: the dearest of all modes that may be entered
  rt::Admission held_rows;
  double voxel_m = 0;
  std::string refusal;  // empty: it may start
};

// Declared cost of the published method's ray cast for a job of fusion; 0: the scene does not ask
// for it.
[[nodiscard]] std::int64_t ray_cast_us(const Scene& scene);

// What was measured, with what the scene asks for beside it as declared.
[[nodiscard]] tasks::Calibration as_asked(const tasks::Calibration& given, const Scene& scene);

// What the scene leaves open: fusion.tsdf.voxel_size_m where it is named, else the touch window.
[[nodiscard]] tasks::ChoiceLimits choice_limits(const Scene& scene);

// `only_choice`: the one static choice to take ("20 mm"), for calibration; empty: the best that fits.
[[nodiscard]] HostPlan admit_host(const Scene& scene, const tasks::Calibration& calibration,
                                  const std::vector<int>& cpus, tasks::BestEffortShares shares,
                                  const std::string& only_choice = {});

// Steps, rows, cores and modes, for people.
[[nodiscard]] std::string admission_text(const HostPlan& plan);

// Where a row runs, for an executor, by its place among tasks and then workers; its body is not set.
[[nodiscard]] rt::PlacedTask placed_task(const HostPlan& plan, std::size_t task);

}  // namespace teletact
