// teletact bench table1: the fusion task, frame by frame, beside Table 1 of the paper (KinectFusion
// and segmentation on a GTX 670; ms a frame).
//
//   row          a cube of 5.12 m with N voxels an edge: voxel 5.12 m / N, truncation max(50 mm,
//                2.1 voxels)
//   second table for information: the voxel stays at 10 mm, and the volume is a cube of N x 10 mm
//   in front of the
//                first camera, nothing kept outside; a pool no larger than what the cube can hold, no reading farther
//                than its edge. Little of what the camera sees lies in the small ones: "claimed"
//                says where it was lost
//   frame CPU    thread CPU from the decoded images to published pose, patch and cost map: filter,
//                pyramid, ICP, allocation, depth and colour integration, tracking ray cast, patch
//                copy, cost map; neither file decoding nor the view. Median, p95, max over frames
//                `first_frame` .. `frames` - 1; of each the median over the runs
//   with object  the same with one object touched and followed: whenever none was seen for half a
//                second, the surface in the middle of the image is touched, and where that is
//                refused (it is what things stand on) other places of the image, one a frame. Only
//                frames in which a mask was made count
//   two threads  the same frames with one pool worker beside. Wall ("wall2") = the way through:
//                over all stages the CPU of the thread that took longest, plus the measured fork
//                and join of each fork (of empty parts, at a real-time priority where that is
//                permitted, as the product has it); real wall time beside it, which holds whatever
//                else the machine did
//   memory       bytes that the map (pool, hash, colours, labels, free space), the keyframes and
//                four patches hold; RSS: what the whole bench held at the end of the pass, less the
//                images of the sequence
//   sequences    the recording (a folder in TUM layout, brought to 512 x 424), and a synthetic room
//                as a Kinect v2 sees it (512 x 424, f 365, axial and lateral noise, edge drop-out,
//                flying pixels)
//
// Other processes disturb: their share of a core is measured over each run, and above 5 % the row
// says "not measured" beside its figures.
//
// Limits, of the first table and the first instruction set (table1_limits.cpp); times of a
// disturbed row are neither met nor missed:
//   512^3     frame CPU, median and p95: recording 15 and 22 ms, synthetic 17 and 24; an object 3.3
//             ms more, both what its stages took and the median of the differences, each frame with
//             it less the same frame of a pass without: the two kinds of pass take turns, so that
//             neither the choice of frames nor a machine that slows down between them counts
//   each row  two threads' wall, with an object where one was followed, below the paper's
//             segmentation and fusion; 64 MiB; 98 % of the frames claimed and no block refused, or
//             the times say nothing
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "drivers/camera/tum_reader.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct Table1Options {
  std::string rgbd;         // folder of the recording; empty: only the synthetic room
  bool synthetic = true;    // the synthetic room too
  bool fixed_voxel = true;  // the second table
  std::vector<int> edges{64, 128, 256, 384, 512};
  std::optional<drivers::TumOptions::Pinhole> pinhole =
      std::nullopt;                              // of the recording, if it does not say
  int frames = 150, first_frame = 10, runs = 3;  // a shorter recording: as many as it has
  bool two_threads = true;
  // Instruction sets; the first one for all rows, the others for the largest cube, one run each.
  std::vector<std::string> isas{"auto", "avx2", "scalar"};
};

struct Table1Row {
  static constexpr double kFixedVoxel_m = 0.01;
  static constexpr double kClaimedShare = 0.98;  // below it neither time nor error says anything
  static constexpr int kStages = 11;
  static const std::array<const char*, kStages> kStageNames;
  struct Figures {
    double p50 = 0, p95 = 0, max = 0;  // ms
  };
  std::string sequence, isa;
  int edge = 0;              // N
  bool fixed_voxel = false;  // of the second table
  Figures frame;
  Figures with_object;  // frames in which an object was segmented, all of the frame
  Figures object;       // of it, segmentation and votes
  Figures object_more;  // the frame less the same one without, of two passes after each other
  int followed = 0, touches = 0;  // frames that count; touches among all frames
  std::array<Figures, kStages> stages;
  struct TwoThreads {
    Figures wall, real_wall;              // of a frame
    Figures own_cpu, worker_cpu;          // of it
    Figures wall_with_object;             // frames in which an object was segmented
    std::array<Figures, kStages> stages;  // the way through, without fork and join
    double forks = 0;                     // a frame, p50
    double fork_us = 0;                   // an empty one, there and back
    bool real_time = false;               // ... measured at a real-time priority
  } two;
  int claimed = 0, frames = 0;
  double ate_mm = 0;  // NaN: no truth, or fewer than 98 % of the frames claimed
  double memory_MiB = 0, keyframes_MiB = 0;  // all; of it keyframes
  double rss_MiB = 0;
  int blocks = 0;
  std::int64_t refused = 0;  // blocks that found the pool full
  bool beside = false;       // another instruction set
  double other_load = 0;     // cores
  [[nodiscard]] bool measured() const { return other_load <= kOtherLoadLimit; }
  [[nodiscard]] double voxel_mm() const {
    return 1e3 * (fixed_voxel ? kFixedVoxel_m : 5.12 / edge);
  }
};

// The paper's row of N: ms a frame on a GTX 670. Null: it has none.
struct Table1Paper {
  int edge;
  double total_ms, fusion_ms;  // of it segmentation and fusion
};
[[nodiscard]] const Table1Paper* table1_paper(int edge);

struct Table1Result {
  std::vector<Table1Row> rows;
  [[nodiscard]] std::vector<Limit> limits() const;
  // Limits of the rows that this run did not have, in words; empty: it had all.
  [[nodiscard]] std::string not_run() const;
  [[nodiscard]] int count(Limit::State state) const { return teletact::count(limits(), state); }
  [[nodiscard]] int missed() const { return count(Limit::State::kMissed); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
  void print_limits(std::ostream& out) const;
};

// Throws std::runtime_error naming what is wrong with the recording.
[[nodiscard]] Table1Result bench_table1(std::ostream& progress, const Table1Options& options);

}  // namespace teletact
