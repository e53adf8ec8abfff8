#include "perception/segmentation/click_segmenter.hpp"

#include <algorithm>
#include <cmath>

namespace perception {
namespace {

bool before(const Click& a, const Click& b) noexcept {
  return a.v != b.v ? a.v < b.v : a.u != b.u ? a.u < b.u : a.add < b.add;
}

}  // namespace

ClickSegmenter::ClickSegmenter(int max_width, int max_height, const ClickConfig& config)
    : config_(config), touch_(max_width, max_height, config.touch) {
  const auto n = static_cast<std::size_t>(max_width * max_height);
  mask_.resize(n);
  for (auto& a : answer_) a.resize(n);
  for (auto& d : distance_) d.resize(n);
  column_.resize(n);
  crop_.resize(n);
  const auto most = static_cast<std::size_t>(config.max_clicks);
  clicks_.reserve(most);
  sided_.reserve(most);
  points_.reserve(most);
  active_.reserve(most);
  matrix_.resize(most * (most + 1));
}

void ClickSegmenter::set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                               const Intrinsics& k, float mm_per_unit) noexcept {
  width_ = rgb.width, height_ = rgb.height;
  first_u_ = first_v_ = -1;
  touch_.set_frame(rgb, depth, k, mm_per_unit);
}

void ClickSegmenter::signed_distance(const std::uint8_t* mask, float* out) noexcept {
  const int w = box_.width, h = box_.height, reach = config_.reach_px;
  // By column, then along the row; kinds alternate in the sign.
  for (int x = 0; x < w; ++x) {
    int since = reach;
    for (int y = 0; y < h; ++y) {
      const bool turn = y > 0 && mask[y * w + x] != mask[(y - 1) * w + x];
      since = turn ? 1 : std::min(reach, since + 1);
      column_[static_cast<std::size_t>(y * w + x)] = static_cast<std::uint8_t>(since);
    }
    since = reach;
    for (int y = h - 1; y >= 0; --y) {
      const bool turn = y + 1 < h && mask[y * w + x] != mask[(y + 1) * w + x];
      since = turn ? 1 : std::min(reach, since + 1);
      auto& c = column_[static_cast<std::size_t>(y * w + x)];
      c = static_cast<std::uint8_t>(std::min<int>(c, since));
    }
  }
  for (int y = 0; y < h; ++y) {
    const std::uint8_t* m = mask + y * w;
    const std::uint8_t* c = column_.data() + y * w;
    for (int x = 0; x < w; ++x) {
      int best = c[x] * c[x];
      for (int k = 1; k < reach && k * k < best; ++k) {
        for (const int q : {x - k, x + k}) {
          if (q < 0 || q >= w) continue;
          const int d = m[q] != m[x] ? 0 : c[q];
          best = std::min(best, k * k + d * d);
        }
      }
      const float d = std::sqrt(static_cast<float>(best)) - 0.5F;
      out[y * w + x] = m[x] != 0 ? d : -d;
    }
  }
}

void ClickSegmenter::look(Point& p) const noexcept {
  const auto at = [&](std::size_t k, int u, int v) {
    u = std::clamp(u - box_.u0, 0, box_.width - 1), v = std::clamp(v - box_.v0, 0, box_.height - 1);
    return distance_[k][static_cast<std::size_t>(v * box_.width + u)];
  };
  for (std::size_t k = 0; k < kOutlines; ++k) p.s[k] = at(k, p.u, p.v);
  const float du = at(0, p.u + 3, p.v) - at(0, p.u - 3, p.v);
  const float dv = at(0, p.u, p.v + 3) - at(0, p.u, p.v - 3);
  const float n = std::sqrt(du * du + dv * dv);
  p.nu = n > 0 ? du / n : 0, p.nv = n > 0 ? dv / n : 0;
}

float ClickSegmenter::kernel(const Point& a, const Point& b) const noexcept {
  const ClickConfig& c = config_;
  float k = c.shift_px * c.shift_px + c.direction_px * c.direction_px * (a.nu * b.nu + a.nv * b.nv);
  for (std::size_t i = 1; i < kOutlines; ++i) {
    const float w = i + 1 == kOutlines ? c.seeded_weight : c.outline_weight;
    k += w * w * (a.s[i] - a.s[0]) * (b.s[i] - b.s[0]);
  }
  const auto du = static_cast<float>(a.u - b.u), dv = static_cast<float>(a.v - b.v);
  const float r2 = (du * du + dv * dv) / (2 * c.local_reach_px * c.local_reach_px);
  if (r2 < 12) k += c.local_px * c.local_px * std::exp(-r2);
  return k;
}

float ClickSegmenter::corrected(const Point& p) const noexcept {
  float c = p.s[0];
  for (const int i : active_) {
    const Point& q = points_[static_cast<std::size_t>(i)];
    c += q.weight * kernel(p, q);
  }
  return c;
}

// Gauss with the active clicks: few, positive definite by the slack.
void ClickSegmenter::solve() noexcept {
  const std::size_t n = active_.size(), row = n + 1;
  for (std::size_t i = 0; i < n; ++i) {
    const Point& p = points_[static_cast<std::size_t>(active_[i])];
    for (std::size_t j = 0; j < n; ++j)
      matrix_[i * row + j] = kernel(p, points_[static_cast<std::size_t>(active_[j])]);
    matrix_[i * row + i] += config_.slack_px * config_.slack_px;
    matrix_[i * row + n] = p.target - p.s[0];
  }
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t i = k + 1; i < n; ++i) {
      const double f = matrix_[i * row + k] / matrix_[k * row + k];
      for (std::size_t j = k; j <= n; ++j) matrix_[i * row + j] -= f * matrix_[k * row + j];
    }
  for (std::size_t k = n; k-- > 0;) {
    double x = matrix_[k * row + n];
    for (std::size_t j = k + 1; j < n; ++j)
      x -= matrix_[k * row + j] *
           static_cast<double>(points_[static_cast<std::size_t>(active_[j])].weight);
    points_[static_cast<std::size_t>(active_[k])].weight =
        static_cast<float>(x / matrix_[k * row + k]);
  }
}

void ClickSegmenter::keep(std::size_t k) noexcept {
  std::fill_n(answer_[k].begin(), width_ * height_, std::uint8_t{0});
  const auto& b = touch_.box();
  std::uint8_t* to = answer_[k].data();
  for (int v = b.v0; v < b.v0 + b.height; ++v)
    for (int u = b.u0; u < b.u0 + b.width; ++u) to[v * width_ + u] = touch_.in(u, v) ? 1 : 0;
}

ClickSegmenter::Answer ClickSegmenter::segment(std::span<const Click> clicks) noexcept {
  const ClickConfig& c = config_;
  std::fill_n(mask_.begin(), width_ * height_, std::uint8_t{0});
  const Click* first = nullptr;
  if (clicks.size() > static_cast<std::size_t>(c.max_clicks)) return Answer::kTooMany;
  for (const Click& k : clicks) {
    if (k.u < 0 || k.v < 0 || k.u >= width_ || k.v >= height_) return Answer::kOutside;
    if (first == nullptr && k.add) first = &k;
  }
  if (first == nullptr) return Answer::kNothingAdded;
  clicks_.assign(clicks.begin(), clicks.end());
  std::sort(clicks_.begin(), clicks_.end(), before);
  clicks_.erase(std::unique(clicks_.begin(), clicks_.end(),
                            [](const Click& a, const Click& b) {
                              return a.u == b.u && a.v == b.v && a.add == b.add;
                            }),
                clicks_.end());
  for (std::size_t i = 1; i < clicks_.size(); ++i)
    if (clicks_[i].u == clicks_[i - 1].u && clicks_[i].v == clicks_[i - 1].v)
      return Answer::kContradiction;

  const bool again = first->u == first_u_ && first->v == first_v_;
  if (!again) {
    first_u_ = first->u, first_v_ = first->v;
    found_ = touch_.touch(first->u, first->v);
    for (auto& a : answer_) std::fill_n(a.begin(), width_ * height_, std::uint8_t{0});
    keep(0);
    answered_ = 1;
  }
  if (clicks_.size() == 1) {
    std::copy_n(answer_[0].begin(), width_ * height_, mask_.begin());
    mask_[static_cast<std::size_t>(first->v * width_ + first->u)] = 1;
    return found_ ? Answer::kDone : Answer::kNoDepth;
  }
  sided_.clear();
  for (const Click& k : clicks_) sided_.push_back({k.u, k.v, k.add ? 1 : -1});
  const auto variant = [&](std::size_t k, auto change, bool seeded) {
    ObjectGraphConfig graph = c.touch.graph;
    OutlineConfig outline = c.touch.outline;
    change(graph, outline);
    touch_.touch(first->u, first->v, graph, outline,
                 seeded ? std::span<const TouchSegmenter::Sided>(sided_)
                        : std::span<const TouchSegmenter::Sided>());
    keep(k);
  };
  if (answered_ == 1) {
  variant(1, [](ObjectGraphConfig& g, OutlineConfig& o) {
    g.support_m = 0.004F;
    o.inside_px = o.outside_px = 1;
    o.grow_px = 4;
    o.sure_heights = 1;
  }, false);
  variant(2, [](ObjectGraphConfig&, OutlineConfig& o) {
    o.inside_px = o.outside_px = 8;
    o.grow_px = 0;
  }, false);
  variant(3, [](ObjectGraphConfig& g, OutlineConfig&) { g.stop = 0.25F; }, false);
  variant(4, [](ObjectGraphConfig& g, OutlineConfig&) { g.stop = 0.7F; }, false);
  answered_ = 5;
  }
  variant(5, [](ObjectGraphConfig&, OutlineConfig&) {}, true);
  // The box that holds all of it.
  int u0 = width_, v0 = height_, u1 = -1, v1 = -1;
  const auto hold = [&](int u, int v) {
    u0 = std::min(u0, u), u1 = std::max(u1, u), v0 = std::min(v0, v), v1 = std::max(v1, v);
  };
  for (const Click& k : clicks_) hold(k.u, k.v);
  for (int v = 0; v < height_; ++v)
    for (int u = 0; u < width_; ++u) {
      bool any = false;
      for (const auto& a : answer_) any = any || a[static_cast<std::size_t>(v * width_ + u)] != 0;
      if (any) hold(u, v);
    }
  const int margin = c.reach_px + 1;
  u0 = std::max(0, u0 - margin), v0 = std::max(0, v0 - margin);
  u1 = std::min(width_ - 1, u1 + margin), v1 = std::min(height_ - 1, v1 + margin);
  box_ = {u0, v0, u1 - u0 + 1, v1 - v0 + 1};
  for (std::size_t k = 0; k < kOutlines; ++k) {
    const auto& a = answer_[k];
    for (int y = 0; y < box_.height; ++y)
      std::copy_n(a.begin() + (v0 + y) * width_ + u0, box_.width, crop_.begin() + y * box_.width);
    signed_distance(crop_.data(), distance_[k].data());
  }
  points_.clear();
  for (const Click& k : clicks_) {
    Point p{};
    p.u = k.u, p.v = k.v, p.sign = k.add ? 1.0F : -1.0F;
    look(p);
    points_.push_back(p);
  }
  active_.clear();
  for (std::size_t round = 0; round < points_.size(); ++round) {
    int worst = -1;
    float most = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (std::find(active_.begin(), active_.end(), static_cast<int>(i)) != active_.end()) continue;
      const float wrong = -points_[i].sign * corrected(points_[i]);
      if (wrong > most) most = wrong, worst = static_cast<int>(i);
    }
    if (worst < 0) break;
    points_[static_cast<std::size_t>(worst)].target =
        points_[static_cast<std::size_t>(worst)].sign *
        std::clamp(most, 1.0F, static_cast<float>(c.reach_px));
    active_.push_back(worst);
    solve();
  }
  for (int y = 0; y < box_.height; ++y)
    for (int x = 0; x < box_.width; ++x) {
      Point p{};
      p.u = u0 + x, p.v = v0 + y;
      look(p);
      mask_[static_cast<std::size_t>(p.v * width_ + p.u)] = corrected(p) > 0 ? 1 : 0;
    }
  for (const Click& k : clicks_)
    mask_[static_cast<std::size_t>(k.v * width_ + k.u)] = k.add ? 1 : 0;
  return found_ ? Answer::kDone : Answer::kNoDepth;
}

}  // namespace perception
