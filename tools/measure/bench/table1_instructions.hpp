// teletact bench table1 --instructions: instructions of a fusion frame, by callgrind, and what the
// watch for moving things adds to it on input in which nothing moves.
//
// Counted are both parts of FusionTask::step over the first images of a sequence, the first one
// included, each setting in a run of its own; valgrind knows no AVX-512, so these are the AVX2
// kernels. A count has no noise: what other processes do is not in it.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"
#include "tools/measure/bench/table1.hpp"

namespace teletact {

struct InstructionsRow {
  std::string sequence;
  double voxel_m = 0;
  int level = 0;
  double frame = 0, frame_without = 0;  // instructions, with the watch and without
  [[nodiscard]] double added() const noexcept { return frame / frame_without - 1; }
};

struct InstructionsResult {
  std::vector<InstructionsRow> rows;
  int frames = 0;
  std::string not_counted;  // why, in words; empty: counted
  // The watch adds at most 3 % to a frame.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// Of `options`: rgbd, synthetic, pinhole. 20 and 10 mm; the first level, at 20 mm the last too.
// Throws std::runtime_error.
[[nodiscard]] InstructionsResult count_table1(std::ostream& progress, const Table1Options& options,
                                              int frames = 20);

}  // namespace teletact
