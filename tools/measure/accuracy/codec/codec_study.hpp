// teletact accuracy codec: what fusion makes of depth and colour that went through the link's
// codecs, against the same images without loss.
//
//   at rest    a camera that stands before a seeded room (bench/codec/codec_film.hpp, nothing
//              moves): surface, lossless, faithful, quiet; RMS over all vertices of the distance to
//              the true solids
//   moving     carried by hand: trajectory and surface, lossless and moving
//              and, in both, the force on a hand that presses into the fused map at 1000 N/m,
//              against the true solid's (press_error.hpp)
//   recording  lossless and moving at the rate of the road, where a recording is given
//
// Poses are estimated by the fusion task as ever. Trajectory: RMS over claimed frames, the first
// one aligned.
#pragma once

#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "drivers/codec/depth_stream.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

struct CodecStudyOptions {
  int seeds = 5, rest_frames = 60, moving_frames = 90;
  std::vector<drivers::DepthMode> rest_modes{drivers::DepthMode::kFaithful,
                                             drivers::DepthMode::kQuiet};
  double voxel_mm = 10;
  int presses = 100;  // places pressed on a map; 0: none
  std::string rgbd;   // empty: none
  int rgbd_frames = 150;
  std::optional<drivers::TumOptions::Pinhole> pinhole = std::nullopt;
  double rate_mbit_s = 8.8;  // of the recording: depth and colour
};

struct CodecStudyRow {
  std::string data, mode;  // "rest", "moving", "recording"; of depth
  std::uint64_t seed = 0;
  int frames = 0, claimed = 0;
  double mbit_s = 0, encode_ms = 0, decode_ms = 0;  // depth; median thread CPU
  double ate_mm = 0, rmse_mm = 0, p95_mm = 0;       // NaN: nothing to hold it against
  double force_p95_N = 0;                           // likewise
  int pressed = 0;
};

struct CodecStudy {
  std::vector<CodecStudyRow> rows;
  std::string not_run;  // of the recording

  // Of all rows of that data and mode.
  [[nodiscard]] double mean(const std::string& data, const std::string& mode,
                            double CodecStudyRow::*figure) const;
  [[nodiscard]] Limits limits() const;
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// The sequence as the other end has it, and what coding it took.
struct CodedSequence {
  FusionSequence sequence;
  double mbit_s = 0, encode_ms = 0, decode_ms = 0;
};
[[nodiscard]] CodedSequence through_codec(rt::NonRealtime& nrt, const FusionSequence& sequence,
                                          drivers::DepthMode mode, double rate_mbit_s);

// Throws std::runtime_error for a recording that can not be read.
[[nodiscard]] CodecStudy study_codec(std::ostream& progress, const CodecStudyOptions& options);

}  // namespace teletact
