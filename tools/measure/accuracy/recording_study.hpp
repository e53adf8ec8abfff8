// teletact accuracy recording: does tracking work on a recording from any first frame and in both
// directions?
//
//   forwards, backwards, every second frame; begun at frame 1, 21, 41 ... of that order; voxels of
//   20 and 10 mm voxels of 20 to 5 mm at the levels 0 to 2 of fusion, forwards from the first frame
//
// A pose is compared with the recording's own, aligned by the first claimed one. It is wrong if it
// is claimed and more than `wrong_mm` off. A frame that is not claimed is reported, and is not
// wrong.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

enum class Order { kForwards, kBackwards, kEverySecond };
[[nodiscard]] const char* name_of(Order order) noexcept;

struct RecordingStudyOptions {
  std::vector<double> voxels_mm{20, 10};                  // of each order and start
  std::vector<double> level_voxels_mm{20, 13, 10, 7, 5};  // of each level
  std::vector<int> levels{0, 1, 2};
  int start_step = 20;    // frames between two starts ...
  int least_frames = 20;  // ... as long as so many are left in the order
  double wrong_mm = 60;
};

struct RecordingRow {
  double voxel_mm = 0;
  int level = 0;
  Order order = Order::kForwards;
  int start = 1;  // frame of the order, counted from 1
  int frames = 0, claimed = 0, lost = 0, wrong = 0;
  double ate_mm = 0, worst_mm = 0;  // of claimed frames; NaN: none has a true pose
};

struct RecordingStudy {
  std::vector<RecordingRow> starts, levels;
  double wrong_mm = 0;

  void print(std::ostream& out) const;
  [[nodiscard]] Limits limits() const;
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
};

// Indices of the images in that order, from its frame `start` (from 1) on.
[[nodiscard]] std::vector<int> images_of(Order order, int start, int size);

// Throws std::runtime_error when no frame has a true pose.
[[nodiscard]] RecordingStudy study_recording(std::ostream& progress, const FusionSequence& sequence,
                                             const RecordingStudyOptions& options);

}  // namespace teletact
