// teletact accuracy fusion: error of the fusion task against its CPU time, over voxel size, ICP
// iterations and pixel step, on synthetic scenes with exact truth (scenes.hpp) and on a recording
// with poses.
//
//   ate_mm      RMS translation error over claimed frames, aligned by the first claimed pose
//   worst_mm    the largest of them
//   claimed     share of the frames
//   surface_*   distance of the mesh's vertices to the true solids, poses as estimated
//               (surface_error.hpp)
//   true_*      the same of a map that was given the true poses
//   cpu_ms      thread CPU of a frame from decoded images to pose, patch and cost map; median from
//               frame 10 on
#pragma once

#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include "tasks/fusion/fusion_task.hpp"
#include "tools/measure/accuracy/study.hpp"
#include "tools/measure/accuracy/surface_error.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

struct FusionRun {
  double ate_mm = 0, worst_mm = 0, claimed = 0, cpu_ms = 0;
  std::int64_t blocks_refused = 0;
  perception::Mesh mesh;  // in the frame of the truth; without one in the first camera's
};
// The task over the sequence. Its map is in the frame of the first camera, as that of `teletact
// fuse`: no wall lies along the voxels' grid, where noise would show less than it is. Without a
// truth the errors are NaN. `at_end`: is shown the task with all its images seen, and its map's
// frame in that of the truth.
using FusionAtEnd = std::function<void(FusionFeed& feed, const perception::Pose& X_WM)>;
[[nodiscard]] FusionRun run_fusion(rt::NonRealtime& nrt, const FusionSequence& sequence,
                                   const tasks::FusionConfig& config,
                                   const FusionAtEnd& at_end = nullptr);
// The sequence fused at its true poses, in the same way.
[[nodiscard]] perception::Mesh fuse_at_truth(rt::NonRealtime& nrt, const FusionSequence& sequence,
                                             const perception::TsdfConfig& config);
// The task's configuration with voxels of this size and room for the blocks that they take.
[[nodiscard]] tasks::FusionConfig fusion_with_voxel(double voxel_m);

struct FusionStudyOptions {
  // The voxel's size varies in each of them, the other knobs in the first.
  std::vector<std::string> scenes{"room", "stairs", "turn", "sixth", "near"};
  int frames = 200;
  double incidence = 0;  // camera.noise.incidence of the synthetic ones
  std::vector<double> voxels_mm{80, 40, 20, 13.3, 10, 7, 5};
  std::vector<int> pixel_steps{1, 2, 4};
  std::vector<std::array<int, 3>> iterations{
      {1, 1, 2}, {2, 2, 5}, {2, 3, 8}, {4, 5, 15}, {8, 10, 30}};
  std::string rgbd;       // recording with true poses, used for judging alone; empty: none
  int rgbd_frames = 150;  // at most
  std::optional<drivers::TumOptions::Pinhole> pinhole =
      std::nullopt;  // of the recording, if it does not say
};

// Throws std::runtime_error on an unknown scene or a recording without poses.
[[nodiscard]] Study study_fusion(std::ostream& progress, const FusionStudyOptions& options);

// Figures of a row that were measured; the trajectory's error only with a claimed share of at least
// 0.98: what a tracker loses costs it nothing.
[[nodiscard]] std::vector<BenchMetric> counted_figures(const StudyRow& row);

}  // namespace teletact
