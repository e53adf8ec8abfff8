// teletact bench fusion --peer: the same frames through ours, OpenCV's rgbd parts and Open3D, in
// one run.
//
//   volume      a cube of 5.12 m at 10 mm, truncation 50 mm, depth to 5 m, every pixel
//   iterations  4, 5, 15, fine to coarse
//   threads     one each; the runs take turns by slices of frames, and nobody runs while another
//               does
//   CPU         ours: the whole step of the fusion task; theirs: track, integrate, ray cast, all of
//               the process's threads. Median, p95, max of the frames from `first_frame` on
//   filter      OpenCV filters depth, as ours does; Open3D's Debian build can not, so ours runs a
//               second time without filter beside it
//   error       RMS of the translation over the frames tracked (ours: claimed), first pose aligned
//
//   target      its CPU at least 30 (OpenCV), 9 (Open3D) times ours with the same filter; our error
//               not above its
//
// A peer that is not installed is named with its package, and its figures are not there.
#pragma once

#include <array>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "drivers/camera/tum_reader.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct FusionPeerOptions {
  std::string rgbd;  // folder of the recording; empty: only the synthetic room
  std::optional<drivers::TumOptions::Pinhole> pinhole =
      std::nullopt;  // of the recording, if it does not say
  bool synthetic = true, peers = false;
  int frames = 60, first_frame = 10, slice = 10;
};

struct FusionPeerRow {
  std::string sequence, name;
  bool filter = false;
  std::string absent;  // why there is no figure
  double p50_ms = 0, p95_ms = 0, max_ms = 0;
  int tracked = 0, frames = 0;
  double ate_mm = 0;  // NaN: no truth
  double ratio = 0;   // of its CPU to ours with the same filter, medians; ours: 1
  double ours_ate_mm =
      0;  // with the same filter; NaN: no truth, or fewer than 98 % of the frames claimed
  [[nodiscard]] double least_ratio() const;  // 0: no target, the row is ours
};

struct FusionPeerResult {
  std::vector<FusionPeerRow> rows;
  double other_load = 0;  // cores
  [[nodiscard]] bool measured() const { return other_load <= kOtherLoadLimit; }
  // Of each peer the CPU and the error; those of one that is not there are not measured.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// Throws std::runtime_error naming what is wrong with the recording.
[[nodiscard]] FusionPeerResult bench_fusion_peer(std::ostream& progress,
                                                 const FusionPeerOptions& options);

}  // namespace teletact
