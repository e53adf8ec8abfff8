#include "perception/segmentation/seed_split.hpp"

#include <algorithm>
#include <cmath>

#include "perception/segmentation/four_neighbours.hpp"

namespace perception {
namespace {

constexpr std::uint8_t kObject = 1, kRest = 2;
constexpr std::int32_t kFar = 1 << 30, kNone = -1, kSettled = -2;
constexpr float kUnits = 4;  // of a pixel's way
constexpr float kMostPixels = 250;

}  // namespace

SeedSplit::SeedSplit(int max_width, int max_height) {
  const auto half = static_cast<std::size_t>((max_width + 1) / 2 * ((max_height + 1) / 2));
  way_.resize(half), next_.resize(half), previous_.resize(half);
  seed_.resize(half);
  first_.resize(kLevels);
}

int SeedSplit::pass(const SurfacePatches& patches, int i, int j, const SplitConfig& c) noexcept {
  const auto k = static_cast<std::size_t>(i), l = static_cast<std::size_t>(j);
  float px = 1;
  const float zi = patches.z_m()[k], zj = patches.z_m()[l];
  if (zi > 0 && zj > 0) {
    const float z = std::min(zi, zj);
    if (std::abs(zi - zj) > c.step_m + c.step_per_m2 * z * z) px += c.step_px;
  }
  const int a = patches.labels()[k], b = patches.labels()[l];
  if (a != b) {
    const SurfacePiece &p = patches.piece(a), &q = patches.piece(b);
    if (p.coloured > 0 && q.coloured > 0) {
      const float dL = 0.5F * (p.L - q.L), da = p.a - q.a, db = p.b - q.b;
      const float d = std::sqrt(dL * dL + da * da + db * db);
      px += c.colour_px * (1 - std::exp(-d / c.colour_scale));
    }
    if (p.has_plane() && q.has_plane() && (p.normal - q.normal).dot(p.centre - q.centre) < 0) {
      const float deg = 57.29578F * std::acos(std::clamp(p.normal.dot(q.normal), -1.0F, 1.0F));
      px += c.valley_px * std::min(1.0F, deg / c.crease_deg);
    }
  }
  return static_cast<int>(kUnits * std::min(px, kMostPixels));
}

// A pixel waits once, in the list of its shortest way so far.
void SeedSplit::push(int pixel, int way, std::uint8_t seed) noexcept {
  const auto k = static_cast<std::size_t>(pixel);
  // Of equal ways the object's is taken, whichever came first.
  if (way > way_[k] || (way == way_[k] && seed >= seed_[k] && seed_[k] != 0)) return;
  if (way == way_[k] && seed_[k] != 0) {
    seed_[k] = seed;
    return;
  }
  if (way_[k] != kFar) {  // out of its list
    const int before = previous_[k], after = next_[k];
    if (before == kNone) {
      first_[static_cast<std::size_t>(way_[k] % kLevels)] = after;
    } else {
      next_[static_cast<std::size_t>(before)] = after;
    }
    if (after != kNone) previous_[static_cast<std::size_t>(after)] = before;
  }
  way_[k] = way, seed_[k] = seed;
  int& first = first_[static_cast<std::size_t>(way % kLevels)];
  next_[k] = first, previous_[k] = kNone;
  if (first != kNone) previous_[static_cast<std::size_t>(first)] = pixel;
  first = pixel;
}

void SeedSplit::split(const SurfacePatches& patches, const SplitSeed& touched,
                      std::span<const SplitSeed> others, const SplitConfig& c,
                      std::span<std::uint8_t> inside) noexcept {
  const HalfWindow& win = patches.window();
  const int w = win.width, n = w * win.height;
  std::fill_n(way_.begin(), n, kFar);
  std::fill_n(seed_.begin(), n, std::uint8_t{0});
  std::fill(first_.begin(), first_.end(), kNone);
  const auto start = [&](const SplitSeed& s, std::uint8_t seed) {
    const int x = std::clamp(s.u / 2 - win.u0, 0, w - 1);
    const int y = std::clamp(s.v / 2 - win.v0, 0, win.height - 1);
    push(y * w + x, 0, seed);
  };
  start(touched, kObject);
  for (std::size_t k = 0; k < others.size(); ++k)
    start(others[k], others[k].of_object ? kObject : static_cast<std::uint8_t>(kRest + k));
  const auto longest = [&](std::uint8_t seed) {
    const float px = seed < kRest ? 0.0F : others[seed - kRest].most_px;
    return px > 0 ? static_cast<int>(0.5F * kUnits * px) : kFar;
  };
  // Every pass costs less than kLevels, so a turn of the circle without a way is the end.
  for (int way = 0, idle = 0; idle < kLevels; ++way) {
    int& first = first_[static_cast<std::size_t>(way % kLevels)];
    ++idle;
    while (first != kNone) {
      idle = 0;
      const int i = first;
      const auto k = static_cast<std::size_t>(i);
      first = next_[k];
      if (first != kNone) previous_[static_cast<std::size_t>(first)] = kNone;
      next_[k] = kSettled;
      for (const int j : four_neighbours(i, w, n)) {
        if (j < 0 || inside[static_cast<std::size_t>(j)] == 0) continue;
        if (way_[static_cast<std::size_t>(j)] <= way) continue;
        const int there = way + pass(patches, i, j, c);
        if (there <= longest(seed_[k])) push(j, there, seed_[k]);
      }
    }
  }
  for (int i = 0; i < n; ++i)
    if (seed_[static_cast<std::size_t>(i)] >= kRest) inside[static_cast<std::size_t>(i)] = 0;
}

}  // namespace perception
