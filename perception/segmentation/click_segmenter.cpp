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
  level_.resize(n);
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
void ClickSegmenter::keep(std::vector<std::uint8_t>& to) noexcept {
  std::fill_n(to.begin(), width_ * height_, std::uint8_t{0});
  const OutlineRefiner::Box& b = touch_.box();
  for (int v = b.v0; v < b.v0 + b.height; ++v)
    for (int u = b.u0; u < b.u0 + b.width; ++u)
      to[static_cast<std::size_t>(v * width_ + u)] = touch_.in(u, v) ? 1 : 0;
}

void ClickSegmenter::answer_otherwise(const Click& first) noexcept {
  for (; answered_ < kParted; ++answered_) {
    ObjectGraphConfig graph = config_.touch.graph;
    OutlineConfig outline = config_.touch.outline;
    change(answered_, graph, outline);
    touch_.touch(first.u, first.v, graph, outline, {}, {});
    keep(answers_[answered_]);
  }
}

// From a click's pixel to the nearest one that is on the other side, px; the image's rim is none.
template <class In>
float ClickSegmenter::to_rim_px(const Click& k, const In& in) const noexcept {
  const bool here = in(k.v * width_ + k.u);
  int best = width_ * width_ + height_ * height_;
  // Rows from the click's outwards: those beyond the best so far are not read.
  for (int far = 0; far < height_ && far * far < best; ++far) {
    for (const int v : {k.v - far, k.v + far}) {
      if (v < 0 || v >= height_) continue;
      for (int u = 0; u < width_; ++u) {
        const int d = far * far + (u - k.u) * (u - k.u);
        if (d < best && in(v * width_ + u) != here) best = d;
      }
    }
  }
  return std::sqrt(static_cast<float>(best));
}

// Those that part the object: deep on the wrong side, or rightly of the object. Shallow ones move
// the outline only. False when none is deep.
bool ClickSegmenter::choose_seeds() noexcept {
  const std::vector<std::uint8_t>& plain = answers_[kPlain];
  const auto in = [&](int i) { return plain[static_cast<std::size_t>(i)] != 0; };
  seeds_.clear();
  bool deep = false;
  for (const bool add : {true, false}) {
    for (const Click& k : clicks_) {
      if (k.add != add) continue;
      const bool right = in(k.v * width_ + k.u) == add;
      const float depth = right ? 0.0F : to_rim_px(k, in);
      deep = deep || depth > config_.deep_px;
      if (depth > config_.deep_px || (add && right))
        seeds_.push_back({k.u, k.v, add, config_.parted_reach * depth});
    }
    if (add) added_ = seeds_.size();
  }
  return deep;
}

// People click in the middle of what is wrong. Of what a level adds to the plain answer, or takes
// from it: by how much its radius (of a disc as large) exceeds what its clicks ask for.
float ClickSegmenter::unexplained_px(bool add) const noexcept {
  const auto changed = [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    return (answers_[kPlain][k] != 0) != add && (level_[k] != 0) == add;
  };
  float area = 0, asked = 0;
  for (int i = 0; i < width_ * height_; ++i) area += changed(i) ? 1.0F : 0.0F;
  if (!(area > 0)) return 0;
  for (const Click& k : clicks_) {
    if (k.add != add || !changed(k.v * width_ + k.u)) continue;
    const float r = config_.explained_spread * to_rim_px(k, changed);
    asked += r * r;
  }
  return std::max(0.0F, std::sqrt(area / 3.14159265F) - std::sqrt(asked));
}

float ClickSegmenter::level_score() const noexcept {
  const auto in = [&](int i) { return level_[static_cast<std::size_t>(i)] != 0; };
  float score = config_.unexplained_weight * (unexplained_px(true) + unexplained_px(false));
  for (const Click& k : clicks_)
    if (in(k.v * width_ + k.u) != k.add) score += to_rim_px(k, in);
  return score;
}

// How far pieces are joined before the clicks part them. Where the plain answer is several things,
// finer regions part all of a neighbour, not only what is near the click.
ObjectGraphConfig ClickSegmenter::choose_level(const Click& first) noexcept {
  ObjectGraphConfig graph = config_.touch.graph, best = graph;
  float least = 0;
  for (int level = 0; level < config_.levels; ++level) {
    touch_.touch(first.u, first.v, graph, config_.touch.outline, added(), config_.split);
    keep(level_);
    const float score = level_score() + (level > 0 ? config_.level_px : 0.0F);
    if (level == 0 || score < least) least = score, best = graph;
    graph.stop *= config_.level_factor;
  }
  return best;
}

void ClickSegmenter::answer_parted(const Click& first) noexcept {
  if (!choose_seeds()) {
    std::copy_n(answers_[kPlain].begin(), width_ * height_, answers_[kParted].begin());
    return;
  }
  touch_.touch(first.u, first.v, choose_level(first), config_.touch.outline, seeds_, config_.split);
  keep(answers_[kParted]);
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
    keep(answers_[kPlain]);
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
