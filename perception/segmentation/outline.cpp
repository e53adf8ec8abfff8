#include "perception/segmentation/outline.hpp"

#include <algorithm>
#include <cmath>

namespace perception {

OutlineRefiner::OutlineRefiner(int max_width, int max_height) : lab_(max_width, max_height) {
  const auto n = static_cast<std::size_t>(max_width * max_height);
  z_.resize(n);
  line_.resize(static_cast<std::size_t>(std::max(max_width, max_height)));
  const auto half = static_cast<std::size_t>((max_width + 1) / 2 * ((max_height + 1) / 2));
  to_out_.resize(half);
  to_in_.resize(half);
  label_.resize(n);
  state_.resize(n);
  level_.resize(n);
  next_.resize(n);
}

void OutlineRefiner::distances(std::span<const std::uint8_t> inside, int w, int h) noexcept {
  constexpr std::int16_t kFar = 10000;
  for (int i = 0; i < w * h; ++i) {
    const auto k = static_cast<std::size_t>(i);
    to_out_[k] = inside[k] ? kFar : std::int16_t{0};
    to_in_[k] = inside[k] ? std::int16_t{0} : kFar;
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

// 1-2-1 in both directions, so that sensor noise makes no ridges.
void OutlineRefiner::smooth() noexcept {
  const int w = box_.width, h = box_.height;
  for (int k = 0; k < 3; ++k) {
    float* p = lab_.plane(k);
    for (int v = 0; v < h; ++v) {
      float* row = p + v * w;
      float before = row[0];
      for (int u = 0; u < w; ++u) {
        const float here = row[u], after = row[std::min(u + 1, w - 1)];
        row[u] = 0.25F * (before + after) + 0.5F * here;
        before = here;
      }
    }
    std::copy_n(p, w, line_.data());
    for (int v = 0; v < h; ++v) {
      float* row = p + v * w;
      const float* after = p + std::min(v + 1, h - 1) * w;
      for (int u = 0; u < w; ++u) {
        const float here = row[u];
        row[u] = 0.25F * (line_[static_cast<std::size_t>(u)] + after[u]) + 0.5F * here;
        line_[static_cast<std::size_t>(u)] = here;
      }
    }
  }
}

void OutlineRefiner::mark(const SurfacePatches& patches, const SupportPlane& plane,
                          const ObjectGraphConfig& graph, std::span<const std::uint8_t> inside,
                          const OutlineConfig& config) noexcept {
  const HalfWindow& win = patches.window();
  int deepest = 0;
  for (int i = 0; i < win.width * win.height; ++i) {
    if (inside[static_cast<std::size_t>(i)]) {
      deepest = std::max<int>(deepest, to_out_[static_cast<std::size_t>(i)]);
    }
  }
  // A thin object keeps its core.
  const int core = std::max(1, std::min(config.inside_px + 1, (deepest + 1) / 2 + 1));
  for (int y = 0; y < box_.height; ++y) {
    for (int x = 0; x < box_.width; ++x) {
      const int u = (box_.u0 + x) / 2 - win.u0, v = (box_.v0 + y) / 2 - win.v0;
      const auto i = static_cast<std::size_t>(v * win.width + u);
      std::uint8_t label = kOpen;
      if (inside[i]) {
        bool sure = to_out_[i] >= core;
        if (sure && plane.valid() && patches.z_m()[i] > 0) {
          const float z = patches.z_m()[i];
          sure = plane.height(patches.point(u, v)) >
                 config.sure_heights * (graph.support_m + graph.support_per_m2 * z * z);
        }
        label = sure ? kIn : kOpen;
      } else if (to_in_[i] > config.outside_px) {
        label = kOut;
      }
      label_[static_cast<std::size_t>(y * box_.width + x)] = label;
    }
  }
}

int OutlineRefiner::cost(int i, int j, const OutlineConfig& c) const noexcept {
  const Lab p = lab_.at(i), q = lab_.at(j);
  const float dL = c.light_weight * (p.L - q.L), da = p.a - q.a, db = p.b - q.b;
  float d = std::sqrt(dL * dL + da * da + db * db);
  const float zi = z_[static_cast<std::size_t>(i)], zj = z_[static_cast<std::size_t>(j)];
  if (zi > 0 && zj > 0) {
    const float z = std::min(zi, zj);
    if (std::abs(zi - zj) > c.step_m + c.step_per_m2 * z * z) d += c.step_cost;
  }
  return std::min(kLevels - 1, static_cast<int>(d * 4));
}

// Flooding by priority: of all pixels next to a flooded one, the one behind the lowest pass is taken
// next, first come first served within a level. Each pixel waits once, for its lowest pass so far.
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
  const auto spread = [&](int i, int level) {
    const int u = i % w;
    const int around[4] = {i - w, u > 0 ? i - 1 : -1, u < w - 1 ? i + 1 : -1,
                           i + w < n ? i + w : -1};
    for (const int j : around) {
      if (j < 0 || label_[static_cast<std::size_t>(j)] != kOpen) continue;
      push(j, std::max(level, cost(i, j, c)), label_[static_cast<std::size_t>(i)]);
    }
  };
  std::fill_n(state_.begin(), n, std::uint8_t{0});
  for (int i = 0; i < n; ++i) {
    if (label_[static_cast<std::size_t>(i)] != kOpen) spread(i, 0);
  }
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
    spread(i, level_[k]);
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
  lab_.set(part(rgb));
  smooth();
  const auto d = part(depth);
  for (int y = 0; y < box_.height; ++y) {
    for (int x = 0; x < box_.width; ++x) {
      const std::uint16_t r = d.at(x, y);
      z_[static_cast<std::size_t>(y * box_.width + x)] =
          r == 65535 ? 0.0F : 1e-3F * mm_per_unit * static_cast<float>(r);
    }
  }
  distances(inside, win.width, win.height);
  mark(patches, plane, graph, inside, config);
  const int t = (touch_v - box_.v0) * box_.width + touch_u - box_.u0;
  if (touch_u >= box_.u0 && touch_v >= box_.v0 && touch_u < box_.u0 + box_.width &&
      touch_v < box_.v0 + box_.height) {
    label_[static_cast<std::size_t>(t)] = kIn;
  }
  flood(config);
  for (int i = 0; i < config.grow_px; ++i) grow(patches, plane, graph, inside, config);
}

// Depth images draw objects a little fatter than colour does, or shifted. A pixel next to the object
// that depth gives to it, well above the support and without a step, is taken in.
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
