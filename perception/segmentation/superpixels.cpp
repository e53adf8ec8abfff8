#include "perception/segmentation/superpixels.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "perception/segmentation/four_neighbours.hpp"
#include "perception/segmentation/superpixel_kernel.hpp"

namespace perception {
namespace {

constexpr int kSeedSums = Superpixels::kMaxPlanes + 4;  // planes, u, v, count, count of colours
constexpr std::size_t kColours = 3;                     // planes
constexpr int kMinSpacing = 3;

// One row into the sums of its seeds, run by run of pixels with the same one: a sum is fetched and
// put back once a run.
template <std::size_t N, bool kAllKnown>
void add_row(std::span<const float* const> planes, const float* known, const std::int32_t* nearest,
             int v, int width, double* sums) noexcept {
  constexpr std::size_t kPlanes = Superpixels::kMaxPlanes;
  const float* row[N];
  for (std::size_t k = 0; k < N; ++k) row[k] = planes[k] + static_cast<std::ptrdiff_t>(v) * width;
  for (int u = 0; u < width;) {
    const std::int32_t s = nearest[u];
    const int first = u;
    double run[N] = {}, coloured = 0;
    for (; u < width && nearest[u] == s; ++u) {
      if (!kAllKnown) coloured += static_cast<double>(known[u]);
      for (std::size_t k = 0; k < N; ++k) {
        if (kAllKnown || k >= kColours || known[u] != 0) run[k] += static_cast<double>(row[k][u]);
      }
    }
    if (s < 0) continue;
    double* sum = sums + static_cast<std::ptrdiff_t>(s) * kSeedSums;
    const int n = u - first;
    for (std::size_t k = 0; k < N; ++k) sum[k] += run[k];
    sum[kPlanes] += 0.5 * n * (first + u - 1);
    sum[kPlanes + 1] += static_cast<double>(n) * v;
    sum[kPlanes + 2] += n;
    sum[kPlanes + 3] += kAllKnown ? n : coloured;
  }
}

}  // namespace

Superpixels::Superpixels(int max_width, int max_height) {
  const auto n = static_cast<std::size_t>(max_width * max_height);
  const auto seeds =
      static_cast<std::size_t>((max_width / kMinSpacing + 1) * (max_height / kMinSpacing + 1));
  seeds_.resize(seeds);
  sums_.resize(seeds * kSeedSums);
  best_.resize(n);
  nearest_.resize(n);
  labels_.resize(n);
  queue_.resize(n);
}

void Superpixels::run(std::span<const float* const> planes, int width, int height,
                      const SuperpixelConfig& config, const float* known) noexcept {
  width_ = width;
  known_ = known;
  height_ = height;
  count_ = 0;
  if (width <= 0 || height <= 0) return;
  place_seeds(planes, config);
  for (int i = 0; i < config.iterations; ++i) {
    assign(planes, config);
    move_seeds(planes);
  }
  const int g = std::max(config.spacing_px, kMinSpacing);
  connect(planes, std::max(1, static_cast<int>(config.min_share * static_cast<float>(g * g))));
}

void Superpixels::place_seeds(std::span<const float* const> planes,
                              const SuperpixelConfig& config) noexcept {
  const int g = std::max(config.spacing_px, kMinSpacing);
  const int nx = std::max(1, width_ / g), ny = std::max(1, height_ / g);
  seeds_used_ = nx * ny;
  for (int j = 0; j < ny; ++j) {
    for (int i = 0; i < nx; ++i) {
      const int u = (2 * i + 1) * width_ / (2 * nx), v = (2 * j + 1) * height_ / (2 * ny);
      Seed& s = seeds_[static_cast<std::size_t>(j * nx + i)];
      s.u = static_cast<float>(u);
      s.v = static_cast<float>(v);
      s.known = known_ == nullptr ? 1.0F : known_[v * width_ + u];
      for (std::size_t k = 0; k < planes.size(); ++k) s.plane[k] = planes[k][v * width_ + u];
    }
  }
}

void Superpixels::assign(std::span<const float* const> planes,
                         const SuperpixelConfig& config) noexcept {
  const int g = std::max(config.spacing_px, kMinSpacing);
  const int reach = g + 1 + g / config.reach_divisor;
  const float beta = config.compactness / static_cast<float>(g);
  const auto n = static_cast<std::size_t>(width_ * height_);
  std::fill_n(best_.begin(), n, std::numeric_limits<float>::max());
  std::fill_n(nearest_.begin(), n, -1);
  for (int s = 0; s < seeds_used_; ++s) {
    const Seed& seed = seeds_[static_cast<std::size_t>(s)];
    const int cu = static_cast<int>(seed.u), cv = static_cast<int>(seed.v);
    const int u0 = std::max(0, cu - reach), u1 = std::min(width_, cu + reach + 1);
    const int v0 = std::max(0, cv - reach), v1 = std::min(height_, cv + reach + 1);
    SeedWindow window{};
    std::copy(planes.begin(), planes.end(), window.planes);
    std::copy_n(seed.plane, kMaxPlanes, window.plane);
    window.plane_count = static_cast<int>(planes.size());
    window.stride = width_;
    window.u0 = u0, window.v0 = v0, window.u1 = u1, window.v1 = v1;
    window.u = seed.u, window.v = seed.v, window.beta = beta;
    window.known = known_, window.seed_known = seed.known;
    window.id = s;
    window.best = best_.data(), window.nearest = nearest_.data();
    try_seed(window);
  }
}

void Superpixels::move_seeds(std::span<const float* const> planes) noexcept {
  std::fill_n(sums_.begin(), seeds_used_ * kSeedSums, 0.0);
  for (int v = 0; v < height_; ++v) {
    const std::int32_t* nearest = nearest_.data() + static_cast<std::ptrdiff_t>(v) * width_;
    const float* known =
        known_ == nullptr ? nullptr : known_ + static_cast<std::ptrdiff_t>(v) * width_;
    const auto add = known != nullptr ? (planes.size() == 3 ? add_row<3, false> : add_row<4, false>)
                                      : (planes.size() == 3 ? add_row<3, true> : add_row<4, true>);
    add(planes, known, nearest, v, width_, sums_.data());
  }
  for (int s = 0; s < seeds_used_; ++s) {
    const double* sum = &sums_[static_cast<std::size_t>(s * kSeedSums)];
    const double n = sum[kMaxPlanes + 2];
    if (n <= 0) continue;
    Seed& seed = seeds_[static_cast<std::size_t>(s)];
    const double coloured = sum[kMaxPlanes + 3];
    seed.known = coloured > 0 ? 1.0F : 0.0F;
    for (std::size_t k = 0; k < planes.size(); ++k) {
      const double of = k < kColours ? coloured : n;
      if (of > 0) seed.plane[k] = static_cast<float>(sum[k] / of);
    }
    seed.u = static_cast<float>(sum[kMaxPlanes] / n);
    seed.v = static_cast<float>(sum[kMaxPlanes + 1] / n);
  }
}

// Pieces in raster order; one that is too small joins the piece it touches before it whose pixel is
// most alike in the planes.
void Superpixels::connect(std::span<const float* const> planes, int min_pixels) noexcept {
  const int n = width_ * height_;
  std::fill_n(labels_.begin(), n, -1);
  const auto difference = [&](int i, int j) {
    float d2 = 0;
    const bool coloured = known_ == nullptr || known_[i] * known_[j] != 0;
    for (std::size_t k = coloured ? 0 : kColours; k < planes.size(); ++k)
      d2 += (planes[k][i] - planes[k][j]) * (planes[k][i] - planes[k][j]);
    return d2;
  };
  for (int first = 0; first < n; ++first) {
    if (labels_[static_cast<std::size_t>(first)] >= 0) continue;
    const int seed = nearest_[static_cast<std::size_t>(first)];
    int head = 0, tail = 0, join = -1;
    float join_d2 = std::numeric_limits<float>::max();
    queue_[static_cast<std::size_t>(tail++)] = first;
    labels_[static_cast<std::size_t>(first)] = count_;
    while (head < tail) {
      const int i = queue_[static_cast<std::size_t>(head++)];
      for (const int j : four_neighbours(i, width_, n)) {
        if (j < 0) continue;
        const auto k = static_cast<std::size_t>(j);
        if (labels_[k] < 0 && nearest_[k] == seed) {
          labels_[k] = count_;
          queue_[static_cast<std::size_t>(tail++)] = j;
        } else if (labels_[k] >= 0 && labels_[k] != count_ && tail < min_pixels) {
          const float d2 = difference(i, j);
          if (d2 < join_d2) join_d2 = d2, join = labels_[k];
        }
      }
    }
    if (tail < min_pixels && join >= 0) {
      for (int q = 0; q < tail; ++q) {
        labels_[static_cast<std::size_t>(queue_[static_cast<std::size_t>(q)])] = join;
      }
    } else {
      ++count_;
    }
  }
}

}  // namespace perception
