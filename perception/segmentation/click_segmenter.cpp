#include "perception/segmentation/click_segmenter.hpp"

#include <algorithm>
#include <cmath>

namespace perception {
namespace {

constexpr std::size_t kPlain = 0, kParted = OutlineCorrection::kAnswers - 1;

bool before(const Click& a, const Click& b) noexcept {
  return a.v != b.v ? a.v < b.v : a.u != b.u ? a.u < b.u : a.add < b.add;
}
bool same_pixel(const Click& a, const Click& b) noexcept { return a.u == b.u && a.v == b.v; }

// Answer k of 1 .. kParted - 1: whom it believes.
void change(std::size_t k, ObjectGraphConfig& graph, OutlineConfig& outline) noexcept {
  // chosen on: mosd_learn, tabletop, ycb_video; judged on: drawn clutter
  switch (k) {
    case 1:  // depth, down to the support
      graph.support_m = 0.004F;
      outline.inside_px = outline.outside_px = 1;
      outline.grow_px = 4;
      outline.sure_heights = 1;
      break;
    case 2:  // colour
      outline.inside_px = outline.outside_px = 8;
      outline.grow_px = 0;
      break;
    case 3:  // smaller regions
      graph.stop = 0.25F;
      break;
    default:  // larger ones
      graph.stop = 0.7F;
      break;
  }
}

}  // namespace

const char* reason(ClickAnswer answer) noexcept {
  switch (answer) {
    case ClickAnswer::kDone:
      return "done";
    case ClickAnswer::kNoDepth:
      return "no depth was measured near the first touch";
    case ClickAnswer::kNothingAdded:
      return "no touch says what the object is";
    case ClickAnswer::kOutside:
      return "a click is outside the image";
    case ClickAnswer::kContradiction:
      return "one pixel is said to be of the object and not of it";
    case ClickAnswer::kTooMany:
      return "too many clicks";
  }
  return "unknown";
}

ClickSegmenter::ClickSegmenter(int max_width, int max_height, const ClickConfig& config)
    : config_(config),
      touch_(max_width, max_height, config.touch),
      correction_(max_width, max_height, config.max_clicks) {
  const auto n = static_cast<std::size_t>(max_width) * static_cast<std::size_t>(max_height);
  mask_.resize(n);
  for (auto& a : answers_) a.resize(n);
  const auto most = static_cast<std::size_t>(config.max_clicks);
  clicks_.reserve(most);
  seeds_.reserve(most);
}

void ClickSegmenter::set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                               const Intrinsics& k, float mm_per_unit) noexcept {
  width_ = rgb.width, height_ = rgb.height;
  answered_ = 0;
  std::fill(mask_.begin(), mask_.end(), std::uint8_t{0});
  touch_.set_frame(rgb, depth, k, mm_per_unit);
}

ClickAnswer ClickSegmenter::check(std::span<const Click> clicks, Click& first) noexcept {
  if (clicks.size() > static_cast<std::size_t>(config_.max_clicks)) return ClickAnswer::kTooMany;
  for (const Click& k : clicks)
    if (!mask().contains(k.u, k.v)) return ClickAnswer::kOutside;
  const auto added =
      std::find_if(clicks.begin(), clicks.end(), [](const Click& k) { return k.add; });
  if (added == clicks.end()) return ClickAnswer::kNothingAdded;
  first = *added;
  clicks_.assign(clicks.begin(), clicks.end());
  std::sort(clicks_.begin(), clicks_.end(), before);
  const auto twice = [](const Click& a, const Click& b) {
    return same_pixel(a, b) && a.add == b.add;
  };
  clicks_.erase(std::unique(clicks_.begin(), clicks_.end(), twice), clicks_.end());
  if (std::adjacent_find(clicks_.begin(), clicks_.end(), same_pixel) != clicks_.end())
    return ClickAnswer::kContradiction;
  return ClickAnswer::kDone;
}

// What the touch answered, as a mask of the whole image.
void ClickSegmenter::keep(std::size_t k) noexcept {
  std::fill_n(answers_[k].begin(), width_ * height_, std::uint8_t{0});
  const OutlineRefiner::Box& b = touch_.box();
  for (int v = b.v0; v < b.v0 + b.height; ++v)
    for (int u = b.u0; u < b.u0 + b.width; ++u)
      answers_[k][static_cast<std::size_t>(v * width_ + u)] = touch_.in(u, v) ? 1 : 0;
}

void ClickSegmenter::answer_otherwise(const Click& first) noexcept {
  for (; answered_ < kParted; ++answered_) {
    ObjectGraphConfig graph = config_.touch.graph;
    OutlineConfig outline = config_.touch.outline;
    change(answered_, graph, outline);
    touch_.touch(first.u, first.v, graph, outline, {}, {});
    keep(answered_);
  }
}

// From a pixel to the nearest one of the other kind in the plain answer, px; the image's rim is
// none.
float ClickSegmenter::depth_in_plain_px(const Click& k) const noexcept {
  const ImageView<const std::uint8_t> plain = answer(kPlain);
  const bool in = plain.at(k.u, k.v) != 0;
  int best = width_ * width_ + height_ * height_;
  for (int v = 0; v < height_; ++v) {
    const int dv = (v - k.v) * (v - k.v);
    if (dv >= best) continue;
    for (int u = 0; u < width_; ++u)
      if ((plain.at(u, v) != 0) != in) best = std::min(best, dv + (u - k.u) * (u - k.u));
  }
  return std::sqrt(static_cast<float>(best));
}

// Between clicks that are deep on the wrong side and those that are right. Shallow ones move the
// outline only.
void ClickSegmenter::answer_parted(const Click& first) noexcept {
  seeds_.clear();
  bool deep = false;
  for (const Click& k : clicks_) {
    const bool right = (answer(kPlain).at(k.u, k.v) != 0) == k.add;
    const float depth = right ? 0.0F : depth_in_plain_px(k);
    deep = deep || depth > config_.deep_px;
    if (depth > config_.deep_px || (k.add && right))
      seeds_.push_back({k.u, k.v, k.add, config_.parted_reach * depth});
  }
  if (deep) {
    touch_.touch(first.u, first.v, config_.touch.graph, config_.touch.outline, seeds_,
                 config_.split);
    keep(kParted);
  } else {
    std::copy_n(answers_[kPlain].begin(), width_ * height_, answers_[kParted].begin());
  }
}

// With a margin in which no answer has a pixel, as far as the image has one.
OutlineCorrection::Box ClickSegmenter::box_of_answers() const noexcept {
  int u0 = width_, v0 = height_, u1 = -1, v1 = -1;
  const auto hold = [&](int u, int v) {
    u0 = std::min(u0, u), u1 = std::max(u1, u), v0 = std::min(v0, v), v1 = std::max(v1, v);
  };
  for (const Click& k : clicks_) hold(k.u, k.v);
  for (const auto& a : answers_)
    for (int v = 0; v < height_; ++v) {
      const auto row = a.begin() + static_cast<std::ptrdiff_t>(v) * width_;
      const auto found = std::find(row, row + width_, std::uint8_t{1});
      if (found == row + width_) continue;
      hold(static_cast<int>(found - row), v);
      for (int u = width_ - 1; u > u1; --u)
        if (row[u] != 0) u1 = u;
    }
  const int margin = config_.correction.reach_px + 1;
  u0 = std::max(0, u0 - margin), v0 = std::max(0, v0 - margin);
  u1 = std::min(width_ - 1, u1 + margin), v1 = std::min(height_ - 1, v1 + margin);
  return {u0, v0, u1 - u0 + 1, v1 - v0 + 1};
}

ClickAnswer ClickSegmenter::segment(std::span<const Click> clicks) noexcept {
  std::fill(mask_.begin(), mask_.end(), std::uint8_t{0});
  Click first;
  if (const ClickAnswer wrong = check(clicks, first); wrong != ClickAnswer::kDone) return wrong;
  if (answered_ == 0 || !same_pixel(first, first_)) {
    first_ = first;
    found_ = touch_.touch(first.u, first.v);
    named_support_ = touch_.named_support();
    keep(kPlain);
    answered_ = 1;
  }
  const auto pixel = [&](const Click& k) -> std::uint8_t& {
    return mask_[static_cast<std::size_t>(k.v * width_ + k.u)];
  };
  if (clicks_.size() == 1 || !found_) {
    if (clicks_.size() == 1) std::copy_n(answers_[kPlain].begin(), width_ * height_, mask_.begin());
    for (const Click& k : clicks_) pixel(k) = k.add ? 1 : 0;
    return found_ ? ClickAnswer::kDone : ClickAnswer::kNoDepth;
  }
  answer_otherwise(first);
  answer_parted(first);
  const CorrectionConfig& c = config_.correction;
  correction_.set_box(box_of_answers());
  for (std::size_t k = 0; k <= kParted; ++k) correction_.set_answer(k, answer(k), c);
  correction_.correct(clicks_, c, {mask_.data(), width_, height_, width_});
  return ClickAnswer::kDone;
}

}  // namespace perception
