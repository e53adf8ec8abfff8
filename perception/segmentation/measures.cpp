#include "perception/segmentation/measures.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace perception {
namespace {

// Lower envelope of the parabolas f[i] + (x - i)^2 along one line of n values.
void transform_line(const double* f, int n, double* out, int* centre, double* start) {
  int k = 0;
  centre[0] = 0;
  start[0] = -1e30;
  start[1] = 1e30;
  for (int q = 1; q < n; ++q) {
    double s = 0;
    for (;; --k) {
      const int p = centre[k];
      s = ((f[q] + double(q) * q) - (f[p] + double(p) * p)) / (2.0 * (q - p));
      if (s > start[k]) break;
    }
    ++k;
    centre[k] = q;
    start[k] = s;
    start[k + 1] = 1e30;
  }
  k = 0;
  for (int x = 0; x < n; ++x) {
    while (start[k + 1] < x) ++k;
    const double d = x - centre[k];
    out[x] = d * d + f[centre[k]];
  }
}

std::vector<std::uint32_t> boundary_pixels(LabelView l) {
  std::vector<std::uint32_t> found;
  for (int v = 0; v < l.height; ++v) {
    for (int u = 0; u < l.width; ++u) {
      const int left = std::max(u - 1, 0), right = std::min(u + 1, l.width - 1);
      const int above = std::max(v - 1, 0), below = std::min(v + 1, l.height - 1);
      if (l.at(left, v) != l.at(right, v) || l.at(u, above) != l.at(u, below)) {
        found.push_back(static_cast<std::uint32_t>(v * l.width + u));
      }
    }
  }
  if (!found.empty()) return found;
  for (int v = 0; v < l.height; ++v) {
    for (int u = 0; u < l.width; ++u) {
      if (u == 0 || v == 0 || u == l.width - 1 || v == l.height - 1) {
        found.push_back(static_cast<std::uint32_t>(v * l.width + u));
      }
    }
  }
  return found;
}

double pairs(double n) { return 0.5 * n * (n - 1); }

}  // namespace

std::vector<float> squared_distance(const std::vector<std::uint8_t>& set, int width, int height) {
  constexpr double kFar = 1e20;
  const auto n = static_cast<std::size_t>(std::max(width, height));
  std::vector<double> field(set.size()), line(n), out(n), start(n + 1);
  std::vector<int> centre(n);
  for (std::size_t i = 0; i < set.size(); ++i) field[i] = set[i] ? 0 : kFar;
  for (int u = 0; u < width; ++u) {
    for (int v = 0; v < height; ++v) line[v] = field[static_cast<std::size_t>(v * width + u)];
    transform_line(line.data(), height, out.data(), centre.data(), start.data());
    for (int v = 0; v < height; ++v) field[static_cast<std::size_t>(v * width + u)] = out[v];
  }
  std::vector<float> distance(set.size());
  for (int v = 0; v < height; ++v) {
    transform_line(&field[static_cast<std::size_t>(v * width)], width, out.data(), centre.data(),
                   start.data());
    for (int u = 0; u < width; ++u) {
      distance[static_cast<std::size_t>(v * width + u)] = static_cast<float>(out[u]);
    }
  }
  return distance;
}

ScoredMap::ScoredMap(LabelView labels) : width_(labels.width), height_(labels.height) {
  std::vector<std::uint32_t> name(65536, ~0U);
  ids_.reserve(static_cast<std::size_t>(width_ * height_));
  for (int v = 0; v < height_; ++v) {
    for (int u = 0; u < width_; ++u) {
      std::uint32_t& id = name[labels.at(u, v)];
      if (id == ~0U) {
        id = static_cast<std::uint32_t>(sizes_.size());
        sizes_.push_back(0);
      }
      ++sizes_[id];
      ids_.push_back(id);
    }
  }
  boundary_ = boundary_pixels(labels);
  std::vector<std::uint8_t> set(ids_.size(), 0);
  for (const std::uint32_t i : boundary_) set[i] = 1;
  distance_px_ = squared_distance(set, width_, height_);
  for (float& d : distance_px_) d = std::sqrt(d);
}

SegmentationScores compare(const ScoredMap& a, const ScoredMap& b) {
  if (a.width_ != b.width_ || a.height_ != b.height_ || a.ids_.empty()) {
    throw std::invalid_argument("label maps of different or no size can not be compared");
  }
  const std::size_t nb = b.sizes_.size();
  // Only cells that occur: a map of many crumbs against another would not fit as a dense table.
  std::vector<std::uint64_t> keys(a.ids_.size());
  for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = std::uint64_t{a.ids_[i]} * nb + b.ids_[i];
  std::sort(keys.begin(), keys.end());

  const auto n = static_cast<double>(keys.size());
  double together = 0, in_a = 0, in_b = 0, joint_bits = 0, a_to_b = 0, b_to_a = 0;
  for (std::size_t i = 0; i < keys.size();) {
    std::size_t j = i;
    while (j < keys.size() && keys[j] == keys[i]) ++j;
    const auto c = static_cast<double>(j - i);
    const auto sa = static_cast<double>(a.sizes_[keys[i] / nb]);
    const auto sb = static_cast<double>(b.sizes_[keys[i] % nb]);
    together += pairs(c);
    joint_bits -= c / n * (std::log2(c / sa) + std::log2(c / sb));
    a_to_b += c * (sa - c) / sa;
    b_to_a += c * (sb - c) / sb;
    i = j;
  }
  for (const auto s : a.sizes_) in_a += pairs(static_cast<double>(s));
  for (const auto s : b.sizes_) in_b += pairs(static_cast<double>(s));

  SegmentationScores s;
  const double all = pairs(n);
  s.pri = all > 0 ? 1 - (in_a + in_b - 2 * together) / all : 1;
  s.voi_bits = std::max(0.0, joint_bits);
  s.gce = std::min(a_to_b, b_to_a) / n;
  double to_b = 0, to_a = 0;
  for (const auto i : a.boundary_) to_b += static_cast<double>(b.distance_px_[i]);
  for (const auto i : b.boundary_) to_a += static_cast<double>(a.distance_px_[i]);
  s.bde_px = 0.5 * (to_b / static_cast<double>(a.boundary_.size()) +
                    to_a / static_cast<double>(b.boundary_.size()));
  return s;
}

void RegionRatio::add(int regions, std::vector<int> people) {
  if (people.empty() || regions <= 0) throw std::invalid_argument("a region count of nothing");
  std::sort(people.begin(), people.end());
  // Of an even number the mean of the two in the middle: rt::quantile() has the lower.
  const std::size_t m = people.size() / 2;
  const double median = people.size() % 2 ? people[m] : 0.5 * (people[m - 1] + people[m]);
  log_sum_ += std::log(regions / median);
  ++images_;
}

double RegionRatio::value() const noexcept { return images_ ? std::exp(log_sum_ / images_) : 0; }

}  // namespace perception
