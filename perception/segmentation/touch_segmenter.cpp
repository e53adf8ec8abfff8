#include "perception/segmentation/touch_segmenter.hpp"

#include <algorithm>
#include <cmath>

#include "perception/segmentation/four_neighbours.hpp"
#include "perception/segmentation/region_grow.hpp"

namespace perception {
namespace {

// At pixel (u, v) of the half-resolution image.
bool is_seed(const TouchSegmenter::Seed& seed, int u, int v) noexcept {
  const std::uint8_t value = seed.image.at(2 * seed.step * u, 2 * seed.step * v);
  return seed.id == 0 ? value != 0 : value == seed.id;
}

float colour_difference(const Lab& p, const Lab& q) noexcept {
  const float dL = 0.5F * (p.L - q.L), da = p.a - q.a, db = p.b - q.b;
  return std::sqrt(dL * dL + da * da + db * db);
}

}  // namespace

TouchSegmenter::TouchSegmenter(int max_width, int max_height, const TouchConfig& config)
    : config_(config),
      patches_(max_width, max_height),
      graph_(max_width, max_height),
      outline_(max_width, max_height),
      split_(max_width, max_height) {
  const auto half = static_cast<std::size_t>((max_width + 1) / 2 * ((max_height + 1) / 2));
  inside_.resize(half);
  chosen_.resize(half);
  queue_.resize(half);
  covered_.resize(half);
}

void TouchSegmenter::set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                               const Intrinsics& k, float mm_per_unit) noexcept {
  set_frame(rgb, depth, k, mm_per_unit, {0, 0, rgb.width / 2, rgb.height / 2});
}

void TouchSegmenter::set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                               const Intrinsics& k, float mm_per_unit,
                               const HalfWindow& window) noexcept {
  rgb_ = rgb;
  depth_ = depth;
  mm_per_unit_ = mm_per_unit;
  patches_.set(rgb, depth, k, mm_per_unit, window, config_.patches);
}

TouchSegmenter::Colour TouchSegmenter::colour_near(int u, int v) const noexcept {
  const int w = patches_.window().width, h = patches_.window().height;
  Lab sum;
  float n = 0;
  for (int y = std::max(0, v - 1); y <= std::min(h - 1, v + 1); ++y) {
    for (int x = std::max(0, u - 1); x <= std::min(w - 1, u + 1); ++x) {
      if (!patches_.lab().coloured(y * w + x)) continue;
      const Lab c = patches_.lab().at(y * w + x);
      sum.L += c.L, sum.a += c.a, sum.b += c.b, n += 1;
    }
  }
  if (n == 0) return {};
  return {{sum.L / n, sum.a / n, sum.b / n}, true};
}

// Among the pixels round (u, v) that belong to a region: least of distance plus difference of
// colour, of distance alone where one has none.
int TouchSegmenter::nearest_region(int u, int v) const noexcept {
  constexpr int kReach = 12;
  const int w = patches_.window().width, h = patches_.window().height;
  const Colour here = colour_near(u, v);
  int best = ObjectGraph::kNone;
  float least = 1e9F;
  for (int y = std::max(0, v - kReach); y <= std::min(h - 1, v + kReach); ++y) {
    for (int x = std::max(0, u - kReach); x <= std::min(w - 1, u + kReach); ++x) {
      const int i = y * w + x;
      const int r = graph_.region(patches_.labels()[static_cast<std::size_t>(i)]);
      if (r < 0) continue;
      const bool known = here.known && patches_.lab().coloured(i);
      const float d = 2 * std::hypot(static_cast<float>(x - u), static_cast<float>(y - v)) +
                      (known ? colour_difference(here, patches_.lab().at(i)) : 0.0F);
      if (d < least) least = d, best = r;
    }
  }
  return best;
}

void TouchSegmenter::select_region(int region) noexcept {
  for (int i = 0; i < patches_.count(); ++i) {
    if (graph_.region(i) == region) chosen_[static_cast<std::size_t>(i)] = 1;
  }
}

void TouchSegmenter::add_occluded_parts(int region, const ObjectGraphConfig& graph) noexcept {
  for (int i = 0; i < patches_.count(); ++i) {
    const int other = graph_.region(i);
    if (other != i || other == region || graph_.area_cm2(other) < config_.occluded_cm2) continue;
    if (graph_.same_behind_occluder(patches_, region, other, graph)) select_region(other);
  }
}

// Pixels connected to the touched one that are more like it than like the support.
void TouchSegmenter::select_flat(int pixel) noexcept {
  const int w = patches_.window().width, n = w * patches_.window().height;
  const Colour here = colour_near(pixel % w, pixel / w);
  const Lab rest = graph_.support_colour();
  const float reach = 0.5F * colour_difference(here, rest);
  int head = 0, tail = 0;
  queue_[static_cast<std::size_t>(tail++)] = pixel;
  inside_[static_cast<std::size_t>(pixel)] = 1;
  while (head < tail) {
    const int i = queue_[static_cast<std::size_t>(head++)];
    for (const int j : four_neighbours(i, w, n)) {
      if (j < 0 || inside_[static_cast<std::size_t>(j)]) continue;
      if (graph_.region(patches_.labels()[static_cast<std::size_t>(j)]) >= 0) continue;
      if (!patches_.lab().coloured(j) || colour_difference(patches_.lab().at(j), here) > reach)
        continue;
      inside_[static_cast<std::size_t>(j)] = 1;
      queue_[static_cast<std::size_t>(tail++)] = j;
    }
  }
}

int TouchSegmenter::pixel_of(int u, int v) const noexcept {
  const HalfWindow& win = patches_.window();
  const int x = std::clamp(u / 2 - win.u0, 0, win.width - 1);
  const int y = std::clamp(v / 2 - win.v0, 0, win.height - 1);
  return y * win.width + x;
}

void TouchSegmenter::choose_others(std::span<const SplitSeed> others) noexcept {
  for (const SplitSeed& s : others) {
    if (!s.of_object) continue;
    const auto pixel = static_cast<std::size_t>(pixel_of(s.u, s.v));
    const int region = graph_.region(patches_.labels()[pixel]);
    if (region >= 0) select_region(region);
  }
}

bool TouchSegmenter::touch(int u, int v) noexcept {
  return touch(u, v, config_.graph, config_.outline, {}, {});
}

bool TouchSegmenter::touch(int u, int v, const ObjectGraphConfig& graph,
                           const OutlineConfig& outline, std::span<const SplitSeed> others,
                           const SplitConfig& split) noexcept {
  const HalfWindow& win = patches_.window();
  const int pixel = pixel_of(u, v), n = win.width * win.height;
  const int x = pixel % win.width, y = pixel / win.width;
  std::fill_n(inside_.begin(), n, std::uint8_t{0});
  std::fill_n(chosen_.begin(), patches_.count(), std::uint8_t{0});
  const int seen = nearest_reading(patches_.z_m().data(), win.width, win.height, pixel);
  const int piece = patches_.labels()[static_cast<std::size_t>(pixel)];
  bool found = seen >= 0;
  plane_ = {};
  named_support_ = false;
  if (found) {
    plane_ =
        graph_.find_support(patches_, patches_.point(seen % win.width, seen / win.width), graph);
    graph_.build(patches_, plane_, graph);
    int region = graph_.region(piece);
    if (region == ObjectGraph::kNone) region = nearest_region(x, y);
    const Colour here = colour_near(x, y);
    if (region == ObjectGraph::kSupport && here.known && graph_.support_has_colour() &&
        colour_difference(here, graph_.support_colour()) > config_.flat_colour) {
      select_flat(pixel);
    } else if (region != ObjectGraph::kNone) {
      select_region(region);
      named_support_ = region == ObjectGraph::kSupport;
      if (region >= 0) add_occluded_parts(region, graph);
    }
    choose_others(others);
  }
  if (graph_.region(piece) == ObjectGraph::kNone) chosen_[static_cast<std::size_t>(piece)] = 1;
  inside_[static_cast<std::size_t>(pixel)] = 1;
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    inside_[k] |= chosen_[static_cast<std::size_t>(patches_.labels()[k])];
  }
  if (!others.empty()) split_.split(patches_, {u, v, true}, others, split, inside_);
  outline_.refine(rgb_, depth_, mm_per_unit_, patches_, plane_, graph, inside_, u, v, outline);
  return found;
}

// Chooses the regions that the seed covers for the most part.
bool TouchSegmenter::choose_covered(const Seed& seed) noexcept {
  const HalfWindow& win = patches_.window();
  std::fill_n(chosen_.begin(), patches_.count(), std::uint8_t{0});
  std::fill_n(covered_.begin(), patches_.count(), 0.0F);
  std::fill_n(queue_.begin(), patches_.count(), 0);
  for (int v = 0; v < win.height; ++v) {
    for (int u = 0; u < win.width; ++u) {
      const int piece = patches_.labels()[static_cast<std::size_t>(v * win.width + u)];
      const int r = graph_.region(piece);
      if (r < 0) continue;
      ++queue_[static_cast<std::size_t>(r)];
      if (is_seed(seed, win.u0 + u, win.v0 + v)) covered_[static_cast<std::size_t>(r)] += 1;
    }
  }
  bool found = false;
  for (int i = 0; i < patches_.count(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const auto pixels = static_cast<float>(queue_[k]);
    if (pixels == 0 || covered_[k] < config_.follow_share * pixels) continue;
    select_region(i);
    found = true;
  }
  return found;
}

bool TouchSegmenter::follow(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                            const Intrinsics& k, float mm_per_unit,
                            ImageView<const std::uint8_t> seed) noexcept {
  SeedBox box{seed.width, seed.height, -1, -1};
  for (int v = 0; v < seed.height; ++v) {
    const std::uint8_t* row = seed.row(v);
    for (int u = 0; u < seed.width; ++u) {
      if (!row[u]) continue;
      box.u0 = std::min(box.u0, u), box.u1 = std::max(box.u1, u);
      box.v0 = std::min(box.v0, v), box.v1 = std::max(box.v1, v);
    }
  }
  return follow(rgb, depth, k, mm_per_unit, Seed{seed, 0, 1}, box);
}

bool TouchSegmenter::follow(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                            const Intrinsics& k, float mm_per_unit, const Seed& seed,
                            const SeedBox& box) noexcept {
  const auto [u0, v0, u1, v1] = box;
  if (u1 < u0 || v1 < v0) return false;
  const int margin = config_.follow_margin_px;
  HalfWindow win;
  win.u0 = std::max(0, u0 - margin) / 2;
  win.v0 = std::max(0, v0 - margin) / 2;
  win.width = std::min(rgb.width / 2, (u1 + margin) / 2 + 1) - win.u0;
  win.height = std::min(rgb.height / 2, (v1 + margin) / 2 + 1) - win.v0;
  if (win.width < 2 || win.height < 2) return false;
  set_frame(rgb, depth, k, mm_per_unit, win);

  Vec3f centre(0, 0, 0);
  float points = 0;
  for (int v = 0; v < win.height; ++v) {
    for (int u = 0; u < win.width; ++u) {
      if (!is_seed(seed, win.u0 + u, win.v0 + v)) continue;
      const Vec3f p = patches_.point(u, v);
      if (p.z() > 0) centre += p, points += 1;
    }
  }
  if (points < 4) return false;
  plane_ = graph_.find_support(patches_, centre / points, config_.graph);
  graph_.build(patches_, plane_, config_.graph);
  return also(seed);
}

bool TouchSegmenter::also(const Seed& seed) noexcept {
  if (!choose_covered(seed)) return false;
  const int n = patches_.window().width * patches_.window().height;
  for (int i = 0; i < n; ++i) {
    const auto j = static_cast<std::size_t>(i);
    inside_[j] = chosen_[static_cast<std::size_t>(patches_.labels()[j])];
  }
  outline_.refine(rgb_, depth_, mm_per_unit_, patches_, plane_, config_.graph, inside_, -1, -1,
                  config_.outline);
  return true;
}

}  // namespace perception
