// Admission at start: which variants of the tasks run on this host, where, with which voxel size,
// and which modes it has room for. The same for both clocks.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rt/audit/run_log.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/mode_table.hpp"
#include "rt/sched/task.hpp"
#include "tasks/graph/host_request.hpp"
#include "tasks/graph/static_choices.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

struct HostPlan {
  std::vector<rt::TaskSpec> specs;    // by task id (of one box: its own), static choices settled
  std::vector<rt::TaskSpec> workers;  // of fusion's pool: the rows behind the tasks'
  std::vector<std::uint16_t> ids;     // of each row: its task's; of a worker, behind all tasks'
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

// What ordinary threads of both boxes are declared to take, with a page or without.
[[nodiscard]] tasks::BestEffortShares declared_shares(const Scene& scene,
                                                      const tasks::Calibration& calibration,
                                                      bool page);

// Of them the link's threads, of a core. What it takes to decode the scene's pictures is included:
// as measured, or as declared where the calibration has it not, or without such codecs.
[[nodiscard]] double declared_link_share(const Scene& scene, const tasks::Calibration& calibration);

// `only_choice`: the one static choice to take ("20 mm"), for calibration; empty: the best that
// fits.
[[nodiscard]] HostPlan admit_host(const Scene& scene, const tasks::Calibration& calibration,
                                  const std::vector<int>& cpus, tasks::BestEffortShares shares,
                                  const std::string& only_choice = {});

// Of one box whose other half runs on another host: its tasks, its platform tasks and its share of
// the ordinary threads. `voxel_m` is 0 where fusion is not among them. The phase of fusion stays at
// zero: the boxes have no common epoch.
[[nodiscard]] HostPlan admit_box(const Scene& scene, const tasks::Calibration& calibration,
                                 const std::vector<int>& cpus, tasks::BestEffortShares shares,
                                 rt::Box box);

// Steps, rows, cores and modes, for people.
[[nodiscard]] std::string admission_text(const HostPlan& plan);

// Where a row runs, for an executor, by its place among tasks and then workers; its body is not
// set.
[[nodiscard]] rt::PlacedTask placed_task(const HostPlan& plan, std::size_t task);

// Tasks of one box as the header of its run log, with calibration's range of the work count.
[[nodiscard]] rt::RunLog log_header(const std::vector<rt::PlacedTask>& placed, rt::Box box,
                                    const tasks::Calibration& calibration);

}  // namespace teletact
