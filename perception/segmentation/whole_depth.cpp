#include "perception/segmentation/whole_depth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "perception/segmentation/lab.hpp"
#include "perception/segmentation/region_grow.hpp"

namespace perception {
namespace {

using Keys = std::vector<std::int32_t>;

struct Size {
  int w = 0, h = 0;
  [[nodiscard]] int pixels() const { return w * h; }
  template <class Visit>
  void around(int i, const Visit& visit) const {
    const int u = i % w;
    if (i >= w) visit(i - w);
    if (u > 0) visit(i - 1);
    if (u + 1 < w) visit(i + 1);
    if (i + w < pixels()) visit(i + w);
  }
};

// Region of each pixel: of the pieces joined over depth, from 0; where there is none of colour,
// below 0.
Keys join(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth, const Intrinsics& k,
          float mm_per_unit, const WholeDepthConfig& c) {
  SurfacePatches patches(rgb.width, rgb.height);
  patches.set(rgb, depth, k, mm_per_unit, {0, 0, rgb.width / 2, rgb.height / 2}, c.patches);
  const int w = patches.window().width, h = patches.window().height;
  ObjectGraph graph(rgb.width, rgb.height);
  const int seen = nearest_reading(patches.z_m().data(), w, h, h / 2 * w + w / 2);
  if (seen >= 0) {
    ObjectGraphConfig everywhere = c.graph;
    everywhere.support_radius_m = c.support_reach_m;
    const SupportPlane plane =
        graph.find_support(patches, patches.point(seen % w, seen / w), everywhere);
    graph.build(patches, plane, c.graph);
  }
  const WholeImage colour = segment_whole(rgb, c.colour);
  Keys keys(static_cast<std::size_t>(rgb.width * rgb.height));
  for (int v = 0; v < rgb.height; ++v) {
    for (int u = 0; u < rgb.width; ++u) {
      const int half = std::min(v / 2, h - 1) * w + std::min(u / 2, w - 1);
      const int region = seen < 0 ? ObjectGraph::kNone
                                  : graph.region(patches.labels()[static_cast<std::size_t>(half)]);
      const auto i = static_cast<std::size_t>(v * rgb.width + u);
      keys[i] = region == ObjectGraph::kNone      ? -1 - colour.labels[i]
                : region == ObjectGraph::kSupport ? 0
                                                  : 1 + region;
    }
  }
  return keys;
}

// What speaks for a region round a pixel.
struct Candidate {
  std::int32_t key = 0;
  float L = 0, a = 0, b = 0, n = 0, coloured = 0, steps = 0;
};

class Border {
 public:
  Border(Size size, const LabImage& lab, ImageView<const std::uint16_t> depth, float mm_per_unit,
         const WholeDepthConfig& c)
      : size_(size), lab_(lab), depth_(depth), m_per_unit_(1e-3F * mm_per_unit), c_(c) {}

  // Every pixel near a border from the same picture of the regions, so the order does not matter.
  [[nodiscard]] Keys settled(const Keys& keys) const {
    Keys out = keys;
    for (int i = 0; i < size_.pixels(); ++i) {
      const int u = i % size_.w, v = i / size_.w;
      bool near = false;
      visit_box(u, v, [&](int j) { near |= key(keys, j) != key(keys, i); });
      if (near) out[static_cast<std::size_t>(i)] = best(keys, i);
    }
    return out;
  }

 private:
  static std::int32_t key(const Keys& keys, int i) { return keys[static_cast<std::size_t>(i)]; }
  template <class Visit>
  void visit_box(int u, int v, const Visit& visit) const {
    const int r = c_.border_px;
    for (int y = std::max(0, v - r); y <= std::min(size_.h - 1, v + r); ++y)
      for (int x = std::max(0, u - r); x <= std::min(size_.w - 1, u + r); ++x)
        visit(y * size_.w + x);
  }
  [[nodiscard]] float z_m(int i) const {
    const std::uint16_t z = depth_.at(i % size_.w, i / size_.w);
    return z == 65535 ? 0.0F : m_per_unit_ * static_cast<float>(z);
  }
  [[nodiscard]] std::int32_t best(const Keys& keys, int i) const {
    std::array<Candidate, 8> all;
    std::size_t n = 0;
    const float z = z_m(i), far = c_.graph.step_m + c_.graph.step_per_m2 * z * z;
    visit_box(i % size_.w, i / size_.w, [&](int j) {
      std::size_t k = 0;
      while (k < n && all[k].key != key(keys, j)) ++k;
      if (k == all.size()) return;
      if (k == n) all[n++].key = key(keys, j);
      if (j == i) return;
      const Lab c = lab_.at(j);
      if (lab_.coloured(j)) all[k].L += c.L, all[k].a += c.a, all[k].b += c.b, all[k].coloured += 1;
      all[k].n += 1;
      const float other = z_m(j);
      all[k].steps += z > 0 && other > 0 && std::abs(other - z) > far ? 1.0F : 0.0F;
    });
    const Lab here = lab_.at(i);
    std::int32_t chosen = key(keys, i);
    float least = 1e30F;
    for (std::size_t k = 0; k < n; ++k) {
      const Candidate& c = all[k];
      if (c.n < 1) continue;
      const bool known = c.coloured > 0 && lab_.coloured(i);
      const float colour = known ? std::hypot(c.L / c.coloured - here.L, c.a / c.coloured - here.a,
                                              c.b / c.coloured - here.b)
                                 : 0.0F;
      const float d = colour + c_.step_cost * c.steps / c.n;
      if (d < least || (d == least && c.key == key(keys, i))) least = d, chosen = c.key;
    }
    return chosen;
  }

  Size size_;
  const LabImage& lab_;
  ImageView<const std::uint16_t> depth_;
  float m_per_unit_;
  const WholeDepthConfig& c_;
};

// 4-connected parts of equal key, 0.. in raster order; returns how many.
int connected(Size size, const Keys& keys, Keys& part) {
  part.assign(keys.size(), -1);
  std::vector<int> queue;
  int parts = 0;
  for (int first = 0; first < size.pixels(); ++first) {
    if (part[static_cast<std::size_t>(first)] >= 0) continue;
    queue.assign(1, first);
    part[static_cast<std::size_t>(first)] = parts;
    while (!queue.empty()) {
      const int i = queue.back();
      queue.pop_back();
      size.around(i, [&](int j) {
        if (part[static_cast<std::size_t>(j)] >= 0 ||
            keys[static_cast<std::size_t>(j)] != keys[static_cast<std::size_t>(i)])
          return;
        part[static_cast<std::size_t>(j)] = parts;
        queue.push_back(j);
      });
    }
    ++parts;
  }
  return parts;
}

// Parts below `least` pixels, smallest first, join the neighbour they have the longest border with.
void absorb(Size size, Keys& part, int parts, double least) {
  std::vector<int> pixels(static_cast<std::size_t>(parts), 0);
  std::vector<std::map<int, int>> border(static_cast<std::size_t>(parts));
  std::vector<int> into(static_cast<std::size_t>(parts));
  for (int i = 0; i < parts; ++i) into[static_cast<std::size_t>(i)] = i;
  for (int i = 0; i < size.pixels(); ++i) {
    const int a = part[static_cast<std::size_t>(i)];
    ++pixels[static_cast<std::size_t>(a)];
    size.around(i, [&](int j) {
      const int b = part[static_cast<std::size_t>(j)];
      if (b != a) ++border[static_cast<std::size_t>(a)][b];
    });
  }
  std::set<std::pair<int, int>> small;  // by size, then number
  for (int i = 0; i < parts; ++i) small.insert({pixels[static_cast<std::size_t>(i)], i});
  while (!small.empty() && small.begin()->first < least) {
    const int a = small.begin()->second;
    small.erase(small.begin());
    auto& mine = border[static_cast<std::size_t>(a)];
    const auto best = std::max_element(mine.begin(), mine.end(), [](const auto& x, const auto& y) {
      return x.second < y.second;  // the first of equals: the lower number
    });
    if (best == mine.end()) continue;  // it is all of the image
    const int b = best->first;
    into[static_cast<std::size_t>(a)] = b;
    small.erase({pixels[static_cast<std::size_t>(b)], b});
    pixels[static_cast<std::size_t>(b)] += pixels[static_cast<std::size_t>(a)];
    small.insert({pixels[static_cast<std::size_t>(b)], b});
    for (const auto& [c, length] : mine) {
      border[static_cast<std::size_t>(c)].erase(a);
      if (c == b) continue;
      border[static_cast<std::size_t>(b)][c] += length;
      border[static_cast<std::size_t>(c)][b] += length;
    }
    mine.clear();
  }
  for (std::int32_t& p : part)
    while (into[static_cast<std::size_t>(p)] != p) p = into[static_cast<std::size_t>(p)];
}

}  // namespace

WholeImage segment_whole(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                         const Intrinsics& k, float mm_per_unit, const WholeDepthConfig& config) {
  const Size size{rgb.width, rgb.height};
  LabImage lab(rgb.width, rgb.height);
  lab.set(rgb);
  const Keys joined = join(rgb, depth, k, mm_per_unit, config);
  const Keys settled = Border(size, lab, depth, mm_per_unit, config).settled(joined);
  Keys part;
  const int parts = connected(size, settled, part);
  absorb(size, part, parts, config.min_share * size.pixels());
  // Numbers in raster order.
  WholeImage out;
  std::vector<std::uint16_t> name(static_cast<std::size_t>(parts), 0);
  out.labels.resize(part.size());
  for (std::size_t i = 0; i < part.size(); ++i) {
    std::uint16_t& id = name[static_cast<std::size_t>(part[i])];
    if (id == 0) id = static_cast<std::uint16_t>(++out.regions);
    out.labels[i] = id;
  }
  return out;
}

}  // namespace perception
