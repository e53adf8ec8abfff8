// What each variant of each task costs on a host: measured by `teletact calibrate`, read at start.
// budget = max(1.2 p99.9, p99.9 + 10 us), of fusion with the p99.9 of the images in which somebody
// moves where that is larger, except for a task with policy abort: it is admitted with its declared
// budget, which the abort enforces; its row tells what it takes when nobody ends it, and decides
// nothing.
//
// File (TOML):   host = "..."          which machine measured it
//                build = "..."         which program
//                config = "..."        hash of the configuration that it measured
//                recording = "..."     folder of recorded images; none: the scene's own camera
//                ray_cast = true       measured with haptic.method = "force_shading"; none: without
//                pictures = "..."      codecs it was measured with; none: lossless, JPEG
//                camera_twin_share = ...  of a core, the camera's twin; none: not measured
//                link_share = ...      likewise, both ends of the link; none: not measured
//                [[task]] name, choice, level, p50_us, p99_us, p999_us, work_min, work_max, quantiles_us[33],
//                         of fusion also still_p50_us, still_p999_us, moving_p50_us, moving_p999_us,
//                         tracked_share, claimed_share and, where the truth is known, off_mm
// Rows "fusion_worker": the sum over a job's forks of the largest share that a worker had; "fusion"
// is then its own CPU.
// `choice` is the static choice that the row was measured with ("20 mm"); a task without choices
// has none. A variant that is not in the table keeps its declared budget.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "rt/result.hpp"
#include "rt/sched/cost_model.hpp"
#include "rt/sched/task_spec.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/graph/static_choices.hpp"

namespace tasks {

inline constexpr std::string_view kWorkerRow = "fusion_worker";

struct CalibrationRow {
  static constexpr std::size_t kQuantiles = 33;
  std::string name, choice;
  int level = 0;
  double p50_us = 0, p99_us = 0, p999_us = 0;
  double work_min = 0, work_max = 0;
  std::array<double, kQuantiles> quantiles_us{};  // of the CPU of a job, i / 32
  // Of fusion: images before somebody walks into the view, and from then on. Below 0: not told
  // apart.
  double still_p50_us = -1, still_p999_us = -1, moving_p50_us = -1, moving_p999_us = -1;
  // Of fusion, on the stored images: frames that were not lost, frames claimed, and the largest
  // error of a claimed pose, the first one aligned. Below 0: not measured.
  double tracked_share = -1, claimed_share = -1, off_mm = -1;
  void describe(config::Section& s);
  // 99.9 % of the jobs, and 99.9 % of those in which something moves, take no longer.
  [[nodiscard]] double worst_us() const noexcept { return std::max(p999_us, moving_p999_us); }
  // By the rule above; of a task with policy abort the declared one.
  [[nodiscard]] rt::Nanos budget() const noexcept;
};

// chosen on: not recorded; judged on: not recorded
// A variant tracks by luck that loses more than this, claims this much less than the best of its
// task on the same images, or claims a pose that is silently wrong by definition. What the best one
// does not claim the scene does not constrain.
inline constexpr double kLeastTrackedShare = 0.5;
inline constexpr double kMostClaimsLess = 0.05;
inline constexpr double kMostOff_mm = 50;  // no data: by definition
// chosen on: recording; judged on: nothing else
// A recording's reference is a KinectFusion's own, good to about 2 cm a metre.
inline constexpr double kMostOffReference_mm = 60;

// What a calibration holds for. Costs differ with each of them.
struct CalibrationOrigin {
  std::string host, build, config, recording;
};

struct Calibration : CalibrationOrigin {
  std::deque<CalibrationRow> rows;
  bool ray_cast = false;  // its rows have the cost of the published method of touch in them
  std::string pictures;   // PictureConfig::dialect() of what capture's rows were measured with
  // Of a core, on the simulated clock; below 0: not measured.
  double camera_twin_share = -1, link_share = -1;
  void describe(config::Section& s);
  [[nodiscard]] const CalibrationRow* find(std::string_view name, std::string_view choice,
                                           int level) const noexcept;
  // Empty: this variant of fusion tracks, or nobody looked. Else why it must not be admitted.
  [[nodiscard]] std::string does_not_track(const CalibrationRow& row) const;
  // Of the variant that a settled spec has at this level.
  [[nodiscard]] const CalibrationRow* find(const rt::TaskSpec& spec, int level) const noexcept {
    return find(spec.is_worker() ? kWorkerRow : std::string_view(spec.name), spec.choice, level);
  }
  // Empty if it was measured here and now, and every variant that may run has a row; else in words
  // what is different or missing.
  [[nodiscard]] std::string lacks(const CalibrationOrigin& wanted,
                                  const std::vector<rt::TaskSpec>& specs) const;
  [[nodiscard]] bool covers(const CalibrationOrigin& wanted,
                            const std::vector<rt::TaskSpec>& specs) const {
    return lacks(wanted, specs).empty();
  }
};

// For a scene that asks for the ray cast of the published method, which then costs a job of fusion
// `job_us`: where the rows were measured without it, that is added to those of fusion and its
// workers, and the reduction to haptic's. What was measured with it stays; 0: nobody asks.
[[nodiscard]] Calibration with_ray_cast(Calibration calibration, std::int64_t job_us);

// The same for a scene with picture codecs (PictureConfig::dialect()) that capture's rows were not
// measured with: `encode_us` more a job. What was measured with such codecs stays.
[[nodiscard]] Calibration with_pictures(Calibration calibration, const std::string& dialect,
                                        std::int64_t encode_us);

// Identity of this machine as far as timing goes: CPU model, cores, kernel.
[[nodiscard]] std::string host_id();
// Refused with one line (file, key, value, what is allowed): values out of range, tasks or levels
// that do not exist, a variant twice, quantiles that do not rise.
[[nodiscard]] rt::Result<Calibration> load_calibration(const std::string& path);
// The same for text; `name` stands for the file.
[[nodiscard]] rt::Result<Calibration> read_calibration(const std::string& text,
                                                       const std::string& name);
// Whole or not at all. Throws std::runtime_error naming the file.
void save_calibration(const std::string& path, const Calibration& calibration);

// The task table as specs, budgets from the calibration where it has them. Fusion has its voxel
// sizes as static choices (static_choices.hpp); one whose best level does not track is ruled out,
// and a level that does not ends its levels.
[[nodiscard]] std::vector<rt::TaskSpec> make_specs(const Calibration& calibration,
                                                   const ChoiceLimits& limits = {});

// Costs for the virtual clock: each variant's measured distribution, scaled so that its 99.9 %
// quantile is that of the budget (budget / 1.2); of a task with policy abort as measured, at most
// budget / 1.2; a variant without a row costs 0.3 .. 0.8 of its budget.
// `settled`: specs with their static choices settled.
[[nodiscard]] std::vector<std::vector<rt::CostQuantiles>> make_costs(
    const Calibration& calibration, const std::vector<rt::TaskSpec>& settled);

}  // namespace tasks
