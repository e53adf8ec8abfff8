// Moves an outline so that every click lies on its side of it, and with it what the same cause
// moved wrongly.
//
// Several answers for one object are given, as masks. s_0, s_1, ... are their signed distances,
// px: positive inside,
// at most reach_px in size. The object is where s_0(x) + c(x) > 0. c is a sum of
//   w_k (s_k - s_0)           as far as another answer is the better one
//   b + (bu, bv) . n(x)       the whole outline is too wide, or shifted; n: where it faces. Only
//   near the outline
//   g(x)                      beside a click, smooth, falling with the distance from it
// with the least weights (squared, over the variances of the configuration) with which s_0 + c
// has the targets at
// the clicks: a Gaussian process, one linear system of the size of the clicks.
//
// Targets: people click in the middle of what is wrong, so a click that lies d on the wrong side
// asks for d on the
// right one. Clicks are taken up one after the other, the one that is most wrong first; a click
// that is right asks
// for nothing. So their order does not matter, and neither do repetitions.
//
// Nothing allocates or throws after construction. Same input, same bytes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/geometry/image.hpp"
#include "perception/segmentation/click.hpp"

namespace perception {

struct CorrectionConfig {
  // chosen on: mosd_learn, tabletop, ycb_video; judged on: drawn clutter
  int reach_px = 8;
  // Standard deviations of the weights: of another answer, of the one that was parted by the
  // clicks.
  float answer_weight = 0.2F, parted_weight = 0.3F;
  float shift_px = 0.3F, direction_px = 0.3F;
  float local_px = 2, local_reach_px = 10;
  float slack_px = 0.3F;  // that a click may be missed by
  int smooth_rounds = 1;  // of the corrected distance, 1-2-1 in both directions
};

class OutlineCorrection {
 public:
  static constexpr std::size_t kAnswers = 6;  // the last one: parted by the clicks

  OutlineCorrection(int max_width, int max_height, int max_clicks);

  struct Box {
    int u0 = 0, v0 = 0, width = 0, height = 0;  // within the image
  };
  // Outside the box no answer has a pixel. It must be set first.
  void set_box(const Box& box) noexcept { box_ = box; }
  void set_answer(std::size_t k, ImageView<const std::uint8_t> mask,
                  const CorrectionConfig& config) noexcept;

  // Of all answers set. `clicks`: at most max_clicks, no pixel twice. Writes 0 and 1 into the
  // box's part of `mask`.
  void correct(std::span<const Click> clicks, const CorrectionConfig& config,
               ImageView<std::uint8_t> mask) noexcept;

 private:
  struct Place {
    int u = 0, v = 0;
    float s0 = 0, near = 0;                   // near: 1 at the plain outline, 0 at reach_px from it
    float nu = 0, nv = 0;                     // where the outline faces
    std::array<float, kAnswers - 1> other{};  // w_k (s_k - s_0)
    float sign = 1, target = 0, weight = 0;   // of a click
  };
  [[nodiscard]] float at(std::size_t k, int u, int v) const noexcept;
  [[nodiscard]] Place look(int u, int v, const CorrectionConfig& config) const noexcept;
  [[nodiscard]] static float likeness(const Place& a, const Place& b,
                                      const CorrectionConfig& config) noexcept;
  [[nodiscard]] float corrected(const Place& p, const CorrectionConfig& config) const noexcept;
  void take_up(const CorrectionConfig& config) noexcept;
  void solve(const CorrectionConfig& config) noexcept;
  void smooth() noexcept;

  Box box_;
  std::array<std::vector<float>, kAnswers> distance_;  // of the box
  std::vector<float> field_;
  std::vector<std::uint8_t> column_;  // by column: px to the nearest pixel of the other kind
  std::vector<Place> clicks_;         // those taken up come first
  std::size_t taken_ = 0;
  std::vector<double> matrix_;
};

}  // namespace perception
