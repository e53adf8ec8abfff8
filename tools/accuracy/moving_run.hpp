// One run of the fusion task over a moving sample, and what it is judged by (docs/moving_judge.md).
#pragma once

#include <array>
#include <limits>
#include <ostream>
#include <vector>

#include "tools/accuracy/moving_film.hpp"

namespace teletact {

// plain: the same way without the mover. Odometry: none; the truth with an error inside the shares that [fusion]
// states; a lie (still while the camera moves, or the reverse of its motion).
enum class MovingVariant : std::uint8_t { kPlain, kAlone, kOdometry, kLying };
[[nodiscard]] const char* name_of(MovingVariant v);
// Is there such a run? A camera at rest can not be lied about in these ways.
[[nodiscard]] bool has_variant(const MovingSample& sample, MovingVariant v);

struct MovingSetting {
  double voxel_mm = 20;
  int level = 0;
  bool surfaces = true;  // judge the map too: ghosts, and what has come to rest
};

struct MovingRun {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  static constexpr int kNever = 999;  // frames
  double ate_mm = kNone, worst_mm = kNone;
  double claimed = 0;
  int wrong = 0, first_wrong = -1;  // claims off by more than 20 mm up to a share of .30, 50 mm above
  // Frames from the share's fall below .30 to a claim, the largest; kNone: it never was above.
  double claimed_again = kNone;
  double mask_iou = kNone;  // median over frames of at least kJudgedPixels moving pixels
  double masked_still = 0, masked_still_p95 = 0;  // share of the still pixels
  double ghost_cm3 = kNone;                       // the largest of the checks
  double ghost_cells = kNone;                     // occupied cells of the cost map where nothing is
  double rest_frames = kNone;       // from at rest to in the mesh; kNone: not to be judged
  double rest_cost = kNone;         // 1: in the cost map 20 frames after it has come to rest
  std::size_t vertices = 0;
  double cpu_ms = 0;  // of a frame, mean
};
inline constexpr int kJudgedPixels = 500;

// `debug`: a line a frame, if there is a stream.
[[nodiscard]] MovingRun run_moving(rt::NonRealtime& nrt, const MovingSample& sample,
                                   const MovingFilm& film, MovingVariant variant,
                                   const MovingSetting& setting, std::ostream* debug = nullptr);

// Error of a claimed camera position; the limit of a sample.
[[nodiscard]] inline double wrong_above_mm(double share) { return share <= 0.30 ? 20 : 50; }

// Intersection over union of mask and moving pixels; either counts in neither. NaN: fewer than kJudgedPixels.
struct MaskFigures {
  double iou = MovingRun::kNone;
  double still_masked = 0;  // share of the still pixels
  int still = 0, still_hit = 0;
};
[[nodiscard]] MaskFigures judge_mask(std::span<const std::uint8_t> mask,
                                     std::span<const std::uint8_t> truth);

}  // namespace teletact
