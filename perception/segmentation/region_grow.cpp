#include "perception/segmentation/region_grow.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "perception/segmentation/four_neighbours.hpp"

namespace perception {

PointImage::PointImage(int max_width, int max_height) {
  const auto n = static_cast<std::size_t>(max_width * max_height);
  x_.resize(n);
  y_.resize(n);
  z_.resize(n);
}

void PointImage::set(ImageView<const std::uint16_t> depth, const Intrinsics& k,
                     float mm_per_unit) noexcept {
  const auto ifx = static_cast<float>(1 / k.fx), ify = static_cast<float>(1 / k.fy);
  const auto cx = static_cast<float>(k.cx), cy = static_cast<float>(k.cy);
  for (int v = 0; v < depth.height; ++v) {
    const std::uint16_t* row = depth.row(v);
    const auto first = static_cast<std::size_t>(v * depth.width);
    float *x = &x_[first], *y = &y_[first], *z = &z_[first];
    const float ry = (static_cast<float>(v) - cy) * ify;
    for (int u = 0; u < depth.width; ++u) {
      const float d = row[u] == 65535 ? 0.0F : static_cast<float>(row[u]) * mm_per_unit;
      x[u] = (static_cast<float>(u) - cx) * ifx * d;
      y[u] = ry * d;
      z[u] = d;
    }
  }
}

int nearest_reading(const float* z_mm, int width, int height, int i) noexcept {
  if (z_mm[i] > 0) return i;
  const int u0 = i % width, v0 = i / width;
  int best = -1;
  std::int64_t best_d2 = 0;
  // Square rings; one more than the first hit needs, since a corner is farther than a side.
  for (int r = 1; r <= std::max(width, height); ++r) {
    if (best >= 0 && std::int64_t{r} * r > best_d2) break;
    for (int v = std::max(0, v0 - r); v <= std::min(height - 1, v0 + r); ++v) {
      const bool rim = v == v0 - r || v == v0 + r;
      for (int u = u0 - r; u <= u0 + r; u += rim ? 1 : 2 * r) {
        if (u < 0 || u >= width || !(z_mm[v * width + u] > 0)) continue;
        const std::int64_t d2 = std::int64_t{u - u0} * (u - u0) + std::int64_t{v - v0} * (v - v0);
        if (best < 0 || d2 < best_d2) best = v * width + u, best_d2 = d2;
      }
    }
  }
  return best;
}

RegionGrower::RegionGrower(int max_width, int max_height) {
  const auto n = static_cast<std::size_t>(max_width * max_height);
  heap_.reserve(n);
  seen_.resize(n);
  members_.reserve(n);
  distances_.reserve(n);
}

void RegionGrower::place(int i, double p[3]) const noexcept {
  if (points_ == nullptr) {
    p[0] = i % width_;
    const int row = i / width_;
    p[1] = row;
    p[2] = 0;
    return;
  }
  const int k = i == seed_ ? seed_place_ : i;
  p[0] = static_cast<double>(points_->x_mm()[k]);
  p[1] = static_cast<double>(points_->y_mm()[k]);
  p[2] = static_cast<double>(points_->z_mm()[k]);
}

float RegionGrower::distance(int i) const noexcept {
  const Lab c = lab_->at(i);
  double p[3];
  place(i, p);
  const double s = 1 / mean_.n;
  const double dx = p[0] - mean_.x * s, dy = p[1] - mean_.y * s, dz = p[2] - mean_.z * s;
  const double place = beta_ * std::sqrt(dx * dx + dy * dy + dz * dz);
  if (!(mean_.coloured > 0) || !coloured(i)) return static_cast<float>(place);
  const double sc = 1 / mean_.coloured;
  const double dL = static_cast<double>(c.L) - mean_.L * sc,
               da = static_cast<double>(c.a) - mean_.a * sc,
               db = static_cast<double>(c.b) - mean_.b * sc;
  return static_cast<float>(std::sqrt(dL * dL + da * da + db * db) + place);
}

void RegionGrower::join(int i, float d) noexcept {
  const Lab c = lab_->at(i);
  double p[3];
  place(i, p);
  if (coloured(i)) {
    mean_.L += static_cast<double>(c.L);
    mean_.a += static_cast<double>(c.a);
    mean_.b += static_cast<double>(c.b);
    mean_.coloured += 1;
  }
  mean_.x += p[0];
  mean_.y += p[1];
  mean_.z += p[2];
  mean_.n += 1;
  members_.push_back(i);
  distances_.push_back(d);
}

int RegionGrower::grow(const LabImage& lab, const PointImage* points, int seed,
                       const GrowConfig& config) noexcept {
  lab_ = &lab;
  points_ = points;
  width_ = lab.width();
  size_ = width_ * lab.height();
  seed_ = seed_place_ = seed;
  beta_ = static_cast<double>(config.m / (points != nullptr ? config.g_mm : config.g_px));
  mean_ = {};
  heap_.clear();
  members_.clear();
  distances_.clear();
  if (points != nullptr) {
    seed_place_ = nearest_reading(points->z_mm(), width_, lab.height(), seed);
    if (seed_place_ < 0) return 0;
  }
  std::fill_n(seen_.begin(), size_, std::uint8_t{0});
  seen_[static_cast<std::size_t>(seed)] = 1;
  join(seed, 0);
  reach(seed);
  join_nearest(points != nullptr ? config.threshold : config.threshold_flat);
  return static_cast<int>(members_.size());
}

// The neighbours of a member wait to join.
void RegionGrower::reach(int i) noexcept {
  for (const int j : four_neighbours(i, width_, size_)) {
    if (j < 0 || seen_[static_cast<std::size_t>(j)]) continue;
    seen_[static_cast<std::size_t>(j)] = 1;
    if (points_ != nullptr && !(points_->z_mm()[j] > 0)) continue;
    heap_.push_back({distance(j), j});
    std::push_heap(heap_.begin(), heap_.end());
  }
}

// The region's means have moved: the distances of all that wait are taken anew.
void RegionGrower::refresh() noexcept {
  for (Waiting& other : heap_) other.d = distance(other.i);
  std::make_heap(heap_.begin(), heap_.end());
}

// The nearest one joins, until none is nearer than the threshold.
void RegionGrower::join_nearest(float threshold) noexcept {
  // Between two refreshes the region grows by a twentieth, so its means hardly move.
  std::size_t next_refresh = 2;
  while (!heap_.empty()) {
    if (members_.size() >= next_refresh) {
      refresh();
      next_refresh = members_.size() + 1 + members_.size() / 20;
    }
    std::pop_heap(heap_.begin(), heap_.end());
    const Waiting next = {distance(heap_.back().i), heap_.back().i};
    heap_.pop_back();
    if (!heap_.empty() && next.d > heap_.front().d) {
      heap_.push_back(next);
      std::push_heap(heap_.begin(), heap_.end());
      if (heap_.front().i != next.i) continue;
      std::pop_heap(heap_.begin(), heap_.end());
      heap_.pop_back();
    }
    if (next.d > threshold) {
      // One of the others may be near enough by now.
      heap_.push_back(next);
      refresh();
      if (heap_.front().d > threshold) break;
      continue;
    }
    join(next.i, next.d);
    reach(next.i);
  }
}

}  // namespace perception
