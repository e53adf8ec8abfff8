#include "perception/segmentation/outline_correction.hpp"

#include <algorithm>
#include <cmath>

namespace perception {

OutlineCorrection::OutlineCorrection(int max_width, int max_height, int max_clicks) {
  const auto n = static_cast<std::size_t>(max_width * max_height);
  for (auto& d : distance_) d.resize(n);
  field_.resize(n);
  column_.resize(n);
  const auto most = static_cast<std::size_t>(max_clicks);
  clicks_.reserve(most);
  matrix_.resize(most * (most + 1));
}

// Exact within the reach: by column first, then the least over each row.
void OutlineCorrection::set_answer(std::size_t k, ImageView<const std::uint8_t> image,
                                   const CorrectionConfig& config) noexcept {
  const int w = box_.width, h = box_.height, reach = config.reach_px;
  const auto mask = [&](int x, int y) { return image.at(box_.u0 + x, box_.v0 + y) != 0; };
  for (int x = 0; x < w; ++x) {
    int since = reach;
    for (int y = 0; y < h; ++y) {
      since = y > 0 && mask(x, y) != mask(x, y - 1) ? 1 : std::min(reach, since + 1);
      column_[static_cast<std::size_t>(y * w + x)] = static_cast<std::uint8_t>(since);
    }
    since = reach;
    for (int y = h - 1; y >= 0; --y) {
      since = y + 1 < h && mask(x, y) != mask(x, y + 1) ? 1 : std::min(reach, since + 1);
      std::uint8_t& c = column_[static_cast<std::size_t>(y * w + x)];
      c = static_cast<std::uint8_t>(std::min<int>(c, since));
    }
  }
  for (int y = 0; y < h; ++y) {
    const std::uint8_t* column = column_.data() + static_cast<std::ptrdiff_t>(y) * w;
    float* out = distance_[k].data() + static_cast<std::ptrdiff_t>(y) * w;
    for (int x = 0; x < w; ++x) {
      const bool in = mask(x, y);
      int best = column[x] * column[x];
      for (int far = 1; far < reach && far * far < best; ++far) {
        for (const int q : {x - far, x + far}) {
          if (q < 0 || q >= w) continue;
          const int d = mask(q, y) != in ? 0 : column[q];
          best = std::min(best, far * far + d * d);
        }
      }
      const float d = std::sqrt(static_cast<float>(best)) - 0.5F;
      out[x] = in ? d : -d;
    }
  }
}

float OutlineCorrection::at(std::size_t k, int u, int v) const noexcept {
  const int x = std::clamp(u - box_.u0, 0, box_.width - 1);
  const int y = std::clamp(v - box_.v0, 0, box_.height - 1);
  return distance_[k][static_cast<std::size_t>(y * box_.width + x)];
}

OutlineCorrection::Place OutlineCorrection::look(int u, int v,
                                                 const CorrectionConfig& c) const noexcept {
  constexpr int kApart = 3;  // px: the direction of an outline that is not smooth
  Place p;
  p.u = u, p.v = v;
  p.s0 = at(0, u, v);
  p.near = std::max(0.0F, 1 - std::abs(p.s0) / static_cast<float>(c.reach_px));
  const float du = at(0, u + kApart, v) - at(0, u - kApart, v);
  const float dv = at(0, u, v + kApart) - at(0, u, v - kApart);
  const float n = std::sqrt(du * du + dv * dv);
  if (n > 0) p.nu = du / n, p.nv = dv / n;
  for (std::size_t k = 1; k < kAnswers; ++k) {
    const float w = k + 1 == kAnswers ? c.parted_weight : c.answer_weight;
    p.other[k - 1] = w * (at(k, u, v) - p.s0);
  }
  return p;
}

// Covariance of the correction at two places.
float OutlineCorrection::likeness(const Place& a, const Place& b,
                                  const CorrectionConfig& c) noexcept {
  float k =
      a.near * b.near *
      (c.shift_px * c.shift_px + c.direction_px * c.direction_px * (a.nu * b.nu + a.nv * b.nv));
  for (std::size_t i = 0; i < a.other.size(); ++i) k += a.other[i] * b.other[i];
  const auto du = static_cast<float>(a.u - b.u), dv = static_cast<float>(a.v - b.v);
  const float r2 = (du * du + dv * dv) / (2 * c.local_reach_px * c.local_reach_px);
  constexpr float kNothing = 12;  // e^-12 of a pixel or two moves no outline
  if (r2 < kNothing) k += c.local_px * c.local_px * std::exp(-r2);
  return k;
}

float OutlineCorrection::corrected(const Place& p, const CorrectionConfig& c) const noexcept {
  float s = p.s0;
  for (std::size_t i = 0; i < taken_; ++i) s += clicks_[i].weight * likeness(p, clicks_[i], c);
  return s;
}

// Elimination. The slack on the diagonal makes the matrix positive definite.
void OutlineCorrection::solve(const CorrectionConfig& c) noexcept {
  const std::size_t n = taken_, row = n + 1;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j)
      matrix_[i * row + j] = static_cast<double>(likeness(clicks_[i], clicks_[j], c));
    matrix_[i * row + i] += static_cast<double>(c.slack_px * c.slack_px);
    matrix_[i * row + n] = static_cast<double>(clicks_[i].target - clicks_[i].s0);
  }
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t i = k + 1; i < n; ++i) {
      const double f = matrix_[i * row + k] / matrix_[k * row + k];
      for (std::size_t j = k; j <= n; ++j) matrix_[i * row + j] -= f * matrix_[k * row + j];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    double x = matrix_[k * row + n];
    for (std::size_t j = k + 1; j < n; ++j)
      x -= matrix_[k * row + j] * static_cast<double>(clicks_[j].weight);
    clicks_[k].weight = static_cast<float>(x / matrix_[k * row + k]);
  }
}

void OutlineCorrection::take_up(const CorrectionConfig& c) noexcept {
  constexpr float kLeast = 1;  // px
  taken_ = 0;
  while (taken_ < clicks_.size()) {
    std::size_t worst = taken_;
    float most = -1e9F;
    for (std::size_t i = taken_; i < clicks_.size(); ++i) {
      const float wrong = -clicks_[i].sign * corrected(clicks_[i], c);
      if (wrong > most) most = wrong, worst = i;
    }
    if (!(most > 0)) return;
    Place taken = clicks_[worst];
    taken.target = taken.sign * std::clamp(most, kLeast, static_cast<float>(c.reach_px));
    // The order of those that wait stays, so that equals are taken in it.
    for (std::size_t i = worst; i > taken_; --i) clicks_[i] = clicks_[i - 1];
    clicks_[taken_++] = taken;
    solve(c);
  }
}

void OutlineCorrection::smooth() noexcept {
  const int w = box_.width, h = box_.height;
  const auto along = [](float* p, int n, std::ptrdiff_t step) {
    float before = p[0];
    for (int i = 1; i + 1 < n; ++i) {
      float& q = p[i * step];
      const float here = q;
      q = 0.5F * here + 0.25F * (before + p[(i + 1) * step]);
      before = here;
    }
  };
  for (int y = 0; y < h; ++y) along(field_.data() + static_cast<std::ptrdiff_t>(y) * w, w, 1);
  for (int x = 0; x < w; ++x) along(field_.data() + x, h, w);
}

void OutlineCorrection::correct(std::span<const Click> clicks, const CorrectionConfig& c,
                                ImageView<std::uint8_t> mask) noexcept {
  clicks_.clear();
  for (const Click& k : clicks) {
    clicks_.push_back(look(k.u, k.v, c));
    clicks_.back().sign = k.add ? 1.0F : -1.0F;
  }
  take_up(c);
  const int w = box_.width, h = box_.height;
  const auto reach = static_cast<float>(c.reach_px);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      field_[static_cast<std::size_t>(y * w + x)] =
          std::clamp(corrected(look(box_.u0 + x, box_.v0 + y, c), c), -reach, reach);
  for (int i = 0; i < c.smooth_rounds; ++i) smooth();
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      mask.at(box_.u0 + x, box_.v0 + y) = field_[static_cast<std::size_t>(y * w + x)] > 0 ? 1 : 0;
  for (const Click& k : clicks) mask.at(k.u, k.v) = k.add ? 1 : 0;
}

}  // namespace perception
