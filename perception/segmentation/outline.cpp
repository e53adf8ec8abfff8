#include "perception/segmentation/outline.hpp"

#include <algorithm>
#include <cmath>

#include "perception/geometry/no_colour.hpp"

// No turn of the loop reads what another writes; clang does not know the pragma and does not need
// it.
#if defined(__clang__)
#define TELETACT_IVDEP
#else
#define TELETACT_IVDEP _Pragma("GCC ivdep")
#endif

namespace perception {

namespace {

// Quarter, half, quarter, along a row; where some pixel has no colour, of those that have one.
template <bool kLacking>
void smooth_along(const float* in, const std::uint8_t* known, int n, float* out) noexcept {
  if constexpr (kLacking) {
    for (int i = 0; i < n; ++i) {
      const float left = i > 0 && known[i - 1] != 0 ? in[i - 1] : in[i];
      const float right = i + 1 < n && known[i + 1] != 0 ? in[i + 1] : in[i];
      out[i] = 0.25F * (left + right) + 0.5F * in[i];
    }
  } else {
    out[0] = 0.25F * (in[0] + in[1]) + 0.5F * in[0];
    TELETACT_IVDEP
    for (int i = 1; i < n - 1; ++i) out[i] = 0.25F * (in[i - 1] + in[i + 1]) + 0.5F * in[i];
    out[n - 1] = 0.25F * (in[n - 2] + in[n - 1]) + 0.5F * in[n - 1];
  }
}

struct Rows {
  float *above, *row;  // above: as it was before it was smoothed
  const float* below;
};
struct KnownRows {  // 0: no colour; read only where some pixel has none
  const std::uint8_t *above, *below;
};
// The same from row to row, in place; `above` becomes this row as it was before.
template <bool kLacking>
void smooth_across(const Rows& rows, const KnownRows& known, int n) noexcept {
  float *above = rows.above, *row = rows.row;
  const float* below = rows.below;
  if constexpr (kLacking) {
    for (int i = 0; i < n; ++i) {
      const float here = row[i];
      const float up = known.above[i] != 0 ? above[i] : here;
      const float down = known.below[i] != 0 ? below[i] : here;
      row[i] = 0.25F * (up + down) + 0.5F * here;
      above[i] = here;
    }
  } else {
    TELETACT_IVDEP
    for (int i = 0; i < n; ++i) {
      const float here = row[i];
      row[i] = 0.25F * (above[i] + below[i]) + 0.5F * here;
      above[i] = here;
    }
  }
}

}  // namespace

struct OutlineRefiner::Half {
  int u0, v0;         // of the box in the window
  int width, height;  // of the box
  int stride;         // of the window
  [[nodiscard]] std::size_t in_window(int x, int y) const noexcept {
    return static_cast<std::size_t>((v0 + y) * stride + u0 + x);
  }
  [[nodiscard]] std::size_t in_box(int x, int y) const noexcept {
    return static_cast<std::size_t>(y * width + x);
  }
};

OutlineRefiner::OutlineRefiner(int max_width, int max_height) {
  const auto n = static_cast<std::size_t>(max_width * max_height);
  z_.resize(n);
  known_.resize(n);
  for (auto& p : lab_) p.resize(n);
  for (auto* rows : {&raw_, &above_})
    for (auto& p : *rows) p.resize(static_cast<std::size_t>(max_width));
  const auto half = static_cast<std::size_t>((max_width + 1) / 2 * ((max_height + 1) / 2));
  to_out_.resize(half);
  to_in_.resize(half);
  wanted_.resize(half);
  label_.resize(n);
  state_.resize(n);
  level_.resize(n);
  next_.resize(n);
}

// Beyond the box, which has a margin, nothing is inside.
void OutlineRefiner::distances(std::span<const std::uint8_t> inside, const Half& half) noexcept {
  constexpr std::int16_t kFar = 10000;
  const int w = half.width, h = half.height;
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const bool in = inside[half.in_window(x, y)] != 0;
      const std::size_t k = half.in_box(x, y);
      to_out_[k] = in ? kFar : std::int16_t{0};
      to_in_[k] = in ? std::int16_t{0} : kFar;
    }
  }
  const auto relax = [](std::int16_t& d, std::int16_t from) {
    d = std::min(d, static_cast<std::int16_t>(from + 1));
  };
  for (auto* d : {&to_out_, &to_in_}) {
    std::int16_t* p = d->data();
    for (int v = 0; v < h; ++v) {
      for (int u = 0; u < w; ++u) {
        const int i = v * w + u;
        if (u > 0) relax(p[i], p[i - 1]);
        if (v > 0) relax(p[i], p[i - w]);
      }
    }
    for (int v = h - 1; v >= 0; --v) {
      for (int u = w - 1; u >= 0; --u) {
        const int i = v * w + u;
        if (u + 1 < w) relax(p[i], p[i + 1]);
        if (v + 1 < h) relax(p[i], p[i + w]);
      }
    }
  }
}

// The flood compares colours of open pixels and of those beside them; smoothing looks one pixel
// farther.
void OutlineRefiner::find_wanted(const Half& half) noexcept {
  const int w = half.width, h = half.height;
  std::fill_n(wanted_.begin(), w * h, std::uint8_t{0});
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      if (label_[static_cast<std::size_t>(2 * y * box_.width + 2 * x)] != kOpen) continue;
      const int x0 = std::max(0, x - 1), x1 = std::min(w - 1, x + 1);
      for (int b = std::max(0, y - 1); b <= std::min(h - 1, y + 1); ++b)
        std::fill_n(&wanted_[half.in_box(x0, b)], x1 - x0 + 1, std::uint8_t{1});
    }
}

bool OutlineRefiner::find_lacking(ImageView<const Rgb> rgb) noexcept {
  bool any = false;
  for (int v = 0; v < rgb.height; ++v) any = any || may_lack_colour(rgb.row(v), rgb.width);
  for (int v = 0; any && v < rgb.height; ++v) {
    std::uint8_t* known = known_.data() + static_cast<std::ptrdiff_t>(v) * rgb.width;
    for (int u = 0; u < rgb.width; ++u) known[u] = has_colour(rgb.at(u, v)) ? 1 : 0;
  }
  return any;
}

// Colours, smoothed by 1-2-1 in both directions so that sensor noise makes no ridges. At the ends
// of a run of wanted pixels the mean is one-sided: nothing looks there. It is beside pixels without
// colour, too.
template <bool kLacking>
void OutlineRefiner::convert(ImageView<const Rgb> rgb, const Half& half) noexcept {
  const int w = box_.width, h = box_.height;
  const auto each_run = [&](int v, auto&& fn) {
    const std::uint8_t* wanted = &wanted_[half.in_box(0, v / 2)];
    for (int x = 0; x < half.width;) {
      while (x < half.width && wanted[x] == 0) ++x;
      const int first = x;
      while (x < half.width && wanted[x] != 0) ++x;
      if (x > first) fn(2 * first, 2 * (x - first));
    }
  };
  const auto known_at = [&](int u, int v) -> const std::uint8_t* {
    return kLacking ? known_.data() + static_cast<std::ptrdiff_t>(v) * w + u : nullptr;
  };
  for (int v = 0; v < h; ++v) {
    each_run(v, [&](int u, int n) {
      lab_row(rgb.row(v) + u, n, raw_[0].data(), raw_[1].data(), raw_[2].data());
      for (std::size_t k = 0; k < 3; ++k)
        smooth_along<kLacking>(raw_[k].data(), known_at(u, v), n,
                               lab_[k].data() + static_cast<std::ptrdiff_t>(v) * w + u);
    });
  }
  for (int v = 0; v < h; ++v) {
    each_run(v, [&](int u, int n) {
      const KnownRows known{known_at(u, std::max(v - 1, 0)), known_at(u, std::min(v + 1, h - 1))};
      for (std::size_t k = 0; k < 3; ++k) {
        float* row = lab_[k].data() + static_cast<std::ptrdiff_t>(v) * w + u;
        float* above = above_[k].data() + u;
        if (v == 0) std::copy_n(row, n, above);
        smooth_across<kLacking>({above, row, v + 1 < h ? row + w : row}, known, n);
      }
    });
  }
}

void OutlineRefiner::mark(const SurfacePatches& patches, const SupportPlane& plane,
                          const ObjectGraphConfig& graph, std::span<const std::uint8_t> inside,
                          const Half& half, const OutlineConfig& config) noexcept {
  int deepest = 0;
  for (int y = 0; y < half.height; ++y)
    for (int x = 0; x < half.width; ++x)
      if (inside[half.in_window(x, y)] != 0)
        deepest = std::max<int>(deepest, to_out_[half.in_box(x, y)]);
  // A thin object keeps its core.
  const int core = std::max(1, std::min(config.inside_px + 1, (deepest + 1) / 2 + 1));
  for (int y = 0; y < half.height; ++y) {
    std::uint8_t* row = &label_[static_cast<std::size_t>(2 * y * box_.width)];
    for (int x = 0; x < half.width; ++x) {
      const std::size_t i = half.in_window(x, y), b = half.in_box(x, y);
      std::uint8_t label = kOpen;
      if (inside[i]) {
        bool sure = to_out_[b] >= core;
        if (sure && plane.valid() && patches.z_m()[i] > 0) {
          const float z = patches.z_m()[i];
          sure = plane.height(patches.point(half.u0 + x, half.v0 + y)) >
                 config.sure_heights * (graph.support_m + graph.support_per_m2 * z * z);
        }
        label = sure ? kIn : kOpen;
      } else if (to_in_[b] > config.outside_px) {
        label = kOut;
      }
      row[2 * x] = row[2 * x + 1] = label;
      row[box_.width + 2 * x] = row[box_.width + 2 * x + 1] = label;
    }
  }
}

int OutlineRefiner::cost(int i, int j, const OutlineConfig& c) const noexcept {
  const float dL = c.light_weight *
                   (lab_[0][static_cast<std::size_t>(i)] - lab_[0][static_cast<std::size_t>(j)]),
              da = lab_[1][static_cast<std::size_t>(i)] - lab_[1][static_cast<std::size_t>(j)],
              db = lab_[2][static_cast<std::size_t>(i)] - lab_[2][static_cast<std::size_t>(j)];
  float d = std::sqrt(dL * dL + da * da + db * db);
  if (lacking_ && (known_[static_cast<std::size_t>(i)] & known_[static_cast<std::size_t>(j)]) == 0)
    d = 0;
  const float zi = z_[static_cast<std::size_t>(i)], zj = z_[static_cast<std::size_t>(j)];
  if (zi > 0 && zj > 0) {
    const float z = std::min(zi, zj);
    if (std::abs(zi - zj) > c.step_m + c.step_per_m2 * z * z) d += c.step_cost;
  }
  return std::min(kLevels - 1, static_cast<int>(d * 4));
}

// Flooding by priority: of all pixels next to a flooded one, the one behind the lowest pass is
// taken next, first come first served within a level. Each pixel waits once, for its lowest pass so
// far.
void OutlineRefiner::flood(const OutlineConfig& c) noexcept {
  const int w = box_.width, n = w * box_.height;
  int first[kLevels], last[kLevels];
  std::fill_n(first, kLevels, -1);
  std::fill_n(last, kLevels, -1);
  int lowest = kLevels;
  const auto push = [&](int i, int level, std::uint8_t from) {
    const auto k = static_cast<std::size_t>(i);
    if (state_[k] != 0) return;
    state_[k] = from;
    level_[k] = static_cast<std::uint8_t>(level);
    next_[k] = -1;
    if (first[level] < 0) {
      first[level] = i;
    } else {
      next_[static_cast<std::size_t>(last[level])] = i;
    }
    last[level] = i;
    lowest = std::min(lowest, level);
  };
  const auto spread = [&](int i, int u, int level) {
    const int around[4] = {i - w, u > 0 ? i - 1 : -1, u < w - 1 ? i + 1 : -1,
                           i + w < n ? i + w : -1};
    for (const int j : around) {
      if (j < 0 || label_[static_cast<std::size_t>(j)] != kOpen) continue;
      push(j, std::max(level, cost(i, j, c)), label_[static_cast<std::size_t>(i)]);
    }
  };
  std::fill_n(state_.begin(), n, std::uint8_t{0});
  for (int i = 0; i < n; i += w)
    for (int u = 0; u < w; ++u)
      if (label_[static_cast<std::size_t>(i + u)] != kOpen) spread(i + u, u, 0);
  while (lowest < kLevels) {
    const int i = first[lowest];
    if (i < 0) {
      ++lowest;
      continue;
    }
    const auto k = static_cast<std::size_t>(i);
    first[lowest] = next_[k];
    if (label_[k] != kOpen) continue;
    label_[k] = state_[k];
    spread(i, i % w, level_[k]);
  }
}

void OutlineRefiner::refine(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                            float mm_per_unit, const SurfacePatches& patches,
                            const SupportPlane& plane, const ObjectGraphConfig& graph,
                            std::span<const std::uint8_t> inside, int touch_u, int touch_v,
                            const OutlineConfig& config) noexcept {
  const HalfWindow& win = patches.window();
  int u0 = win.width, u1 = -1, v0 = win.height, v1 = -1;
  for (int v = 0; v < win.height; ++v) {
    for (int u = 0; u < win.width; ++u) {
      if (!inside[static_cast<std::size_t>(v * win.width + u)]) continue;
      u0 = std::min(u0, u), u1 = std::max(u1, u), v0 = std::min(v0, v), v1 = std::max(v1, v);
    }
  }
  box_ = {};
  if (u1 < 0) return;
  const int margin = config.outside_px + 2;
  u0 = std::max(0, u0 - margin), v0 = std::max(0, v0 - margin);
  u1 = std::min(win.width - 1, u1 + margin), v1 = std::min(win.height - 1, v1 + margin);
  box_ = {2 * (win.u0 + u0), 2 * (win.v0 + v0), 2 * (u1 - u0 + 1), 2 * (v1 - v0 + 1)};

  const auto part = [&](auto image) {
    image.data += static_cast<std::ptrdiff_t>(box_.v0) * image.stride + box_.u0;
    image.width = box_.width;
    image.height = box_.height;
    return image;
  };
  const auto d = part(depth);
  for (int y = 0; y < box_.height; ++y) {
    const std::uint16_t* readings = d.row(y);
    float* z = z_.data() + static_cast<std::ptrdiff_t>(y) * box_.width;
    for (int x = 0; x < box_.width; ++x)
      z[x] = readings[x] == 65535 ? 0.0F : 1e-3F * mm_per_unit * static_cast<float>(readings[x]);
  }
  const Half half{u0, v0, u1 - u0 + 1, v1 - v0 + 1, win.width};
  distances(inside, half);
  mark(patches, plane, graph, inside, half, config);
  find_wanted(half);
  lacking_ = find_lacking(part(rgb));
  lacking_ ? convert<true>(part(rgb), half) : convert<false>(part(rgb), half);
  const int t = (touch_v - box_.v0) * box_.width + touch_u - box_.u0;
  if (touch_u >= box_.u0 && touch_v >= box_.v0 && touch_u < box_.u0 + box_.width &&
      touch_v < box_.v0 + box_.height) {
    label_[static_cast<std::size_t>(t)] = kIn;
  }
  flood(config);
  for (int i = 0; i < config.grow_px; ++i) grow(patches, plane, graph, inside, config);
}

// Depth images draw objects a little fatter than colour does, or shifted. A pixel next to the
// object that depth gives to it, well above the support and without a step, is taken in.
void OutlineRefiner::grow(const SurfacePatches& patches, const SupportPlane& plane,
                          const ObjectGraphConfig& graph, std::span<const std::uint8_t> inside,
                          const OutlineConfig& c) noexcept {
  const HalfWindow& win = patches.window();
  const int w = box_.width, h = box_.height;
  std::copy_n(label_.begin(), w * h, state_.begin());
  for (int y = 0; y < h; ++y) {
    const int v = (box_.v0 + y) / 2 - win.v0;
    for (int x = 0; x < w; ++x) {
      const auto i = static_cast<std::size_t>(y * w + x);
      if (state_[i] == kIn || !(z_[i] > 0)) continue;
      const int u = (box_.u0 + x) / 2 - win.u0;
      if (!inside[static_cast<std::size_t>(v * win.width + u)]) continue;
      if (plane.valid()) {
        const Vec3f p = Vec3f(patches.x_of(u), patches.y_of(v), 1) * z_[i];
        if (plane.height(p) <
            c.sure_heights * (graph.support_m + graph.support_per_m2 * p.z() * p.z())) {
          continue;
        }
      }
      const auto near = [&](int j) {
        const auto k = static_cast<std::size_t>(j);
        return state_[k] == kIn && z_[k] > 0 &&
               std::abs(z_[k] - z_[i]) <= c.step_m + c.step_per_m2 * z_[i] * z_[i];
      };
      const int k = y * w + x;
      if ((x > 0 && near(k - 1)) || (x + 1 < w && near(k + 1)) || (y > 0 && near(k - w)) ||
          (y + 1 < h && near(k + w))) {
        label_[i] = kIn;
      }
    }
  }
}

}  // namespace perception
