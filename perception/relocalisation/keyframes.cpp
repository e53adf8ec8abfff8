#include "perception/relocalisation/keyframes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>

#include "perception/geometry/no_colour.hpp"
#include "perception/simd/clones.hpp"

namespace perception {

namespace {

constexpr double kAhead_m = 2;                     // what a camera looks at
constexpr int kDepthCut = 24, kDepthMissing = 12;  // codes
constexpr int kGreyCut = 48;
constexpr int kShift = 6;       // largest shift tried, cells: about a sixth of the image
constexpr int kShiftStep = 2;   // between shifts
constexpr int kShortList = 12;  // entries that shifts are tried on
constexpr int kCrowd = 3;       // of which this many may lie about a place
constexpr double kCrowdedSpacings = 2;
constexpr double kNearSpacings = 5;
constexpr int kLeastCells = 64;  // fewer cells in common say nothing

std::uint8_t depth_code(float z_m) noexcept {
  if (!(z_m > 0)) return 0;
  const double code = 1 + std::log(static_cast<double>(z_m) / 0.3) / std::log(1.012);
  return static_cast<std::uint8_t>(std::clamp(std::lround(code), 1L, 255L));
}

constexpr int kNoGrey = -1;

// Mean brightness of those of 3 x 3 pixels spread over the cell that have colour.
int cell_grey(ImageView<const Rgb> colour, int i, int j) noexcept {
  int sum = 0, coloured = 0;
  for (int b = 0; b < 3; ++b) {
    for (int a = 0; a < 3; ++a) {
      const int u = cell_to_pixel(3 * i + a, 3 * Thumbnail::kWidth, colour.width);
      const int v = cell_to_pixel(3 * j + b, 3 * Thumbnail::kHeight, colour.height);
      const Rgb c = colour.at(u, v);
      sum += 2 * c.r + 5 * c.g + c.b;
      coloured += has_colour(c) ? 1 : 0;
    }
  }
  return coloured == 0 ? kNoGrey : sum / (8 * coloured);
}

void fill_grey(ImageView<const Rgb> colour, Thumbnail& out) noexcept {
  std::array<int, Thumbnail::kCells> raw;
  std::int64_t sum = 0, squares = 0;
  int cells = 0;
  for (int j = 0; j < Thumbnail::kHeight; ++j) {
    for (int i = 0; i < Thumbnail::kWidth; ++i) {
      const int g = cell_grey(colour, i, j);
      raw[static_cast<std::size_t>(j * Thumbnail::kWidth + i)] = g;
      if (g == kNoGrey) continue;
      ++cells;
      sum += g;
      squares += std::int64_t{g} * g;
    }
  }
  if (cells == 0) return;
  const double mean = static_cast<double>(sum) / cells;
  const double variance = static_cast<double>(squares) / cells - mean * mean;
  if (variance < 4) return;  // a blank picture shows no place
  const double gain = 40 / std::sqrt(variance);
  for (std::size_t k = 0; k < raw.size(); ++k) {
    if (raw[k] == kNoGrey) continue;
    out.grey[k] =
        static_cast<std::uint8_t>(std::clamp(std::lround(128 + gain * (raw[k] - mean)), 1L, 255L));
  }
}

}  // namespace

double thumbnail_depth(std::uint8_t code) noexcept {
  return code == 0 ? 0 : 0.3 * std::pow(1.012, code - 1);
}

Thumbnail make_thumbnail(const DepthLevel& depth, ImageView<const Rgb> colour) noexcept {
  Thumbnail t;
  for (int j = 0; j < Thumbnail::kHeight; ++j) {
    const float* row = depth.depth.row(cell_to_pixel(j, Thumbnail::kHeight, depth.depth.height()));
    for (int i = 0; i < Thumbnail::kWidth; ++i) {
      t.depth[static_cast<std::size_t>(j * Thumbnail::kWidth + i)] =
          depth_code(row[cell_to_pixel(i, Thumbnail::kWidth, depth.depth.width())]);
    }
  }
  if (colour.data != nullptr) fill_grey(colour, t);
  return t;
}

TELETACT_CLONES int thumbnail_distance(const Thumbnail& seen, const Thumbnail& kept, int du, int dv,
                                       int below) noexcept {
  constexpr int kW = Thumbnail::kWidth;
  const int u0 = std::max(0, -du), u1 = kW - std::max(0, du);
  const int v0 = std::max(0, -dv), v1 = Thumbnail::kHeight - std::max(0, dv);
  const int most_cells = (u1 - u0) * (v1 - v0);
  // Whole rows of known length, so that the compiler vectorises them. Cells outside of the other
  // image are unknown.
  alignas(64) std::array<std::uint8_t, kW> in{}, kept_depth{}, kept_grey{};
  std::fill(in.begin() + u0, in.begin() + u1, std::uint8_t{1});
  int cost = 0, common = 0, cells = 0;
  for (int v = v0; v < v1; ++v) {
    const std::uint8_t* sd = seen.depth.data() + v * kW;
    const std::uint8_t* sg = seen.grey.data() + v * kW;
    const std::ptrdiff_t at = (v + dv) * kW + du + u0;
    std::copy_n(kept.depth.data() + at, u1 - u0, kept_depth.data() + u0);
    std::copy_n(kept.grey.data() + at, u1 - u0, kept_grey.data() + u0);
    for (std::size_t u = 0; u < kW; ++u) {
      const int a = sd[u], b = kept_depth[u], g = sg[u], h = kept_grey[u];
      const int has_a = a != 0 ? 1 : 0, has_b = b != 0 ? 1 : 0;
      const int both = has_a & has_b, any = (has_a | has_b) & in[u];
      cost += both * std::min(std::abs(a - b), kDepthCut) + (any - both) * kDepthMissing;
      cost += (g != 0 ? 1 : 0) * (h != 0 ? 1 : 0) * (std::min(std::abs(g - h), kGreyCut) / 2);
      common += both;
      cells += any;
    }
    if (256 * cost / most_cells >= below) return std::numeric_limits<int>::max();
  }
  if (common < kLeastCells) return std::numeric_limits<int>::max();
  return 256 * cost / cells;
}

void KeyframeConfig::describe(config::Section& s) {
  s.integer("max_keyframes", max_keyframes, 1, Keyframes::kMax, "views kept")
      .number("spacing_m", spacing_m, 0.01, 10, "a view this far from all others is kept")
      .number("spacing_deg", spacing_deg, 1, 180, "one turned this far from all others too");
}

Keyframes::Keyframes(rt::NonRealtime&, const KeyframeConfig& config) : config_(config) {
  config_.max_keyframes = std::clamp(config_.max_keyframes, 1, kMax);
  entries_.reserve(static_cast<std::size_t>(config_.max_keyframes));
}

// 1 where two poses are a spacing apart, in way or in turn; smaller where they are nearer.
double Keyframes::nearness(const Pose& a, const Pose& b) const noexcept {
  const double way = (a.translation() - b.translation()).norm() / config_.spacing_m;
  const double cosine = 0.5 * ((a.linear().transpose() * b.linear()).trace() - 1);
  const double turn =
      std::acos(std::clamp(cosine, -1.0, 1.0)) / (config_.spacing_deg * std::numbers::pi / 180);
  return std::max(way, turn);
}

bool Keyframes::is_new(const Pose& X_WC) const noexcept {
  return std::none_of(entries_.begin(), entries_.end(),
                      [&](const Entry& e) { return nearness(e.X_WC, X_WC) < 1; });
}

bool Keyframes::near(const Pose& X_WC) const noexcept {
  return std::any_of(entries_.begin(), entries_.end(),
                     [&](const Entry& e) { return nearness(e.X_WC, X_WC) < kNearSpacings; });
}

int Keyframes::looking_at(const Pose& X_WC) const noexcept {
  const Vec3 ahead(0, 0, kAhead_m), target = X_WC * ahead;
  int best = -1;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < size(); ++i) {
    const Pose& X = at(i).X_WC;
    const double off =
        (X * ahead - target).norm() + 0.5 * (X.translation() - X_WC.translation()).norm();
    if (off < least) least = off, best = i;
  }
  return best;
}

std::size_t Keyframes::most_redundant() const noexcept {
  std::size_t worst = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const double d = nearness(entries_[i].X_WC, entries_[j].X_WC);
      if (d < least) least = d, worst = j;  // one of the two
    }
  }
  return worst;
}

void Keyframes::add(const Pose& X_WC, const Thumbnail& view) noexcept {
  if (entries_.size() < static_cast<std::size_t>(config_.max_keyframes)) {
    entries_.push_back({X_WC, view});
  } else {
    entries_[most_redundant()] = {X_WC, view};
  }
}

namespace {

// Keeps `list` sorted by distance, then by index; the last one falls off.
void insert_sorted(std::span<Keyframes::Candidate> list, int& count,
                   const Keyframes::Candidate& c) noexcept {
  const int room = static_cast<int>(list.size());
  int at = count;
  while (at > 0 && list[static_cast<std::size_t>(at - 1)].distance > c.distance) --at;
  if (at >= room) return;
  count = std::min(count + 1, room);
  for (int i = count - 1; i > at; --i) {
    list[static_cast<std::size_t>(i)] = list[static_cast<std::size_t>(i - 1)];
  }
  list[static_cast<std::size_t>(at)] = c;
}

}  // namespace

// The best by the unshifted images, but only a limited number from one place, so that many views of
// it do not hide others.
int Keyframes::short_list(const Thumbnail& seen, std::span<const bool> skip,
                          std::span<Candidate> out) const noexcept {
  std::array<Candidate, kMax> all;
  std::size_t listed = 0;
  for (int i = 0; i < size(); ++i) {
    if (static_cast<std::size_t>(i) < skip.size() && skip[static_cast<std::size_t>(i)]) continue;
    const int d = thumbnail_distance(seen, at(i).view, 0, 0);
    if (d < std::numeric_limits<int>::max()) all[listed++] = {i, 0, 0, d};
  }
  std::sort(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(listed),
            [](const Candidate& a, const Candidate& b) {
              return a.distance != b.distance ? a.distance < b.distance : a.index < b.index;
            });
  std::size_t count = 0;
  for (std::size_t n = 0; n < listed && count < out.size(); ++n) {
    int about = 0;
    for (std::size_t k = 0; k < count; ++k) {
      about += nearness(at(out[k].index).X_WC, at(all[n].index).X_WC) < kCrowdedSpacings ? 1 : 0;
    }
    if (about < kCrowd) out[count++] = all[n];
  }
  return static_cast<int>(count);
}

int Keyframes::rank(const Thumbnail& seen, std::span<const bool> skip,
                    std::span<Candidate> out) const noexcept {
  std::array<Candidate, kShortList> near;
  const int short_count = short_list(seen, skip, near);
  int count = 0;
  for (int k = 0; k < short_count; ++k) {
    Candidate best = near[static_cast<std::size_t>(k)];
    for (int dv = -kShift / 2; dv <= kShift / 2; dv += kShiftStep + 1) {
      for (int du = -kShift; du <= kShift; du += kShiftStep) {
        const int d = thumbnail_distance(seen, at(best.index).view, du, dv, best.distance);
        if (d < best.distance) best = {best.index, du, dv, d};
      }
    }
    insert_sorted(out, count, best);
  }
  return count;
}

}  // namespace perception
