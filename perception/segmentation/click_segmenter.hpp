// An object named by several clicks: add (of the object) and take away (not of it). With one add
// click alone it is
// the touch of touch_segmenter.hpp, byte for byte.
//
//   answers     the touch answers several times, with other beliefs in depth against colour and
//               other ends of joining; once parted by the clicks that are deep on the wrong side
//               (seed_split.hpp), of regions as large as the clicks allow
//   correction  moves the plain answer's outline towards the clicks, by what explains them
//               (outline_correction.hpp)
//
// The first add click names the object. The others are a set: their order and repetitions change
// no bit. The pixel
// of an add click is always inside, that of a take-away click always outside. A click where there
// is no depth is as
// good as any, except the first add click: without depth near it nothing is named (kNoDepth; its
// pixel alone, and
// those of the other add clicks).
//
// Bounded: at most max_clicks clicks, a fixed number of answers. Answers that do not depend on
// further clicks are
// kept until the frame or the first add click changes. Nothing allocates or throws after
// construction. Same frame
// and clicks, same bytes, whatever was asked before.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/segmentation/click.hpp"
#include "perception/segmentation/outline_correction.hpp"
#include "perception/segmentation/touch_segmenter.hpp"

namespace perception {

struct ClickConfig {
  TouchConfig touch;
  CorrectionConfig correction;
  SplitConfig split;
  int max_clicks = 32;
  // chosen on: mosd_learn, tabletop, ycb_video; judged on: drawn clutter
  float deep_px = 6;  // so far on the wrong side of the plain outline a click is of another region
  float parted_reach = 4;  // times that distance: the longest way from a click that takes away
  // chosen on: clutter 200 to 211, tabletop, ycb_video; judged on: clutter 100 to 109
  // Levels of joining that the parted answer may start from, each a finer one. The clicks choose:
  // score = px by which they are on the wrong side + level_px below the first
  //         + unexplained_weight * (radius of the level's change - that the clicks ask for).
  int levels = 6;
  float level_factor = 0.7F;  // of the end of joining, from level to level
  float level_px = 10;
  float unexplained_weight = 2;
  float explained_spread = 1.5F;  // times a click's distance from the rim of what changes round it
};

enum class ClickAnswer {
  kDone,
  kNoDepth,  // as touch(): nothing near the first add click was measured
  // Refused, with an empty mask.
  kNothingAdded,
  kOutside,
  kContradiction,
  kTooMany,
};
[[nodiscard]] constexpr bool refused(ClickAnswer a) noexcept {
  return a != ClickAnswer::kDone && a != ClickAnswer::kNoDepth;
}
[[nodiscard]] const char* reason(ClickAnswer answer) noexcept;

class ClickSegmenter {
 public:
  ClickSegmenter(int max_width, int max_height, const ClickConfig& config = {});

  // The images must outlive the calls of segment(). depth in units of mm_per_unit.
  void set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                 const Intrinsics& k, float mm_per_unit) noexcept;

  ClickAnswer segment(std::span<const Click> clicks) noexcept;

  // Of the last segment(): 1 for the object's pixels. False outside the image.
  [[nodiscard]] bool in(int u, int v) const noexcept {
    return mask().contains(u, v) && mask().at(u, v) != 0;
  }
  [[nodiscard]] ImageView<const std::uint8_t> mask() const noexcept {
    return {mask_.data(), width_, height_, width_};
  }
  // The first add click named the support itself: nothing stands there.
  [[nodiscard]] bool named_support() const noexcept { return named_support_; }

 private:
  [[nodiscard]] ClickAnswer check(std::span<const Click> clicks, Click& first) noexcept;
  void keep(std::vector<std::uint8_t>& to) noexcept;
  void answer_otherwise(const Click& first) noexcept;
  template <class In>
  [[nodiscard]] float to_rim_px(const Click& k, const In& in) const noexcept;
  [[nodiscard]] std::span<const SplitSeed> added() const noexcept {
    return {seeds_.data(), added_};
  }
  bool choose_seeds() noexcept;
  [[nodiscard]] float unexplained_px(bool add) const noexcept;
  [[nodiscard]] float level_score() const noexcept;
  [[nodiscard]] ObjectGraphConfig choose_level(const Click& first) noexcept;
  void answer_parted(const Click& first) noexcept;
  [[nodiscard]] OutlineCorrection::Box box_of_answers() const noexcept;
  [[nodiscard]] ImageView<const std::uint8_t> answer(std::size_t k) const noexcept {
    return {answers_[k].data(), width_, height_, width_};
  }

  ClickConfig config_;
  TouchSegmenter touch_;
  OutlineCorrection correction_;
  int width_ = 0, height_ = 0;
  Click first_{-1, -1, true};  // that the answers are of
  std::size_t answered_ = 0;
  bool found_ = false, named_support_ = false;
  std::vector<Click> clicks_;     // sorted, each once
  std::vector<SplitSeed> seeds_;  // those that add come first
  std::size_t added_ = 0;         // so many
  std::vector<std::uint8_t> mask_;
  std::vector<std::uint8_t> level_;  // the answer of a level
  std::array<std::vector<std::uint8_t>, OutlineCorrection::kAnswers> answers_;
};

}  // namespace perception
