#include "perception/segmentation/region_merge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <queue>

#include "perception/segmentation/lab.hpp"

namespace perception {
namespace {

constexpr int kChannels = 4;  // L, a, b, local contrast
constexpr int kBins = 24;
using Histogram = std::array<float, kChannels * kBins>;
using Plane = std::vector<float>;

// Lab in 5-unit bins: L 0..100, a and b -60..60 (beyond is the last bin); contrast in bins of 1.5.
constexpr float kLow[kChannels] = {0, -60, -60, 0};
constexpr float kStep[kChannels] = {5, 5, 5, 1.5F};

void blur(Plane& p, int w, int h, double sigma) {
  const int r = static_cast<int>(std::ceil(3 * sigma));
  if (sigma <= 0 || r < 1) return;
  std::vector<float> k(static_cast<std::size_t>(2 * r + 1));
  double sum = 0;
  for (int i = -r; i <= r; ++i) sum += std::exp(-0.5 * i * i / (sigma * sigma));
  for (int i = -r; i <= r; ++i) {
    k[static_cast<std::size_t>(i + r)] =
        static_cast<float>(std::exp(-0.5 * i * i / (sigma * sigma)) / sum);
  }
  Plane t(p.size());
  Plane line(static_cast<std::size_t>(w + 2 * r));
  for (int v = 0; v < h; ++v) {
    const float* row = &p[static_cast<std::size_t>(v * w)];
    for (int u = -r; u < w + r; ++u)
      line[static_cast<std::size_t>(u + r)] = row[std::clamp(u, 0, w - 1)];
    float* out = &t[static_cast<std::size_t>(v * w)];
    std::fill_n(out, w, 0.0F);
    for (int i = 0; i <= 2 * r; ++i) {
      for (int u = 0; u < w; ++u)
        out[u] += k[static_cast<std::size_t>(i)] * line[static_cast<std::size_t>(u + i)];
    }
  }
  for (int v = 0; v < h; ++v) {
    float* out = &p[static_cast<std::size_t>(v * w)];
    std::fill_n(out, w, 0.0F);
    for (int i = -r; i <= r; ++i) {
      const float* row = &t[static_cast<std::size_t>(std::clamp(v + i, 0, h - 1) * w)];
      for (int u = 0; u < w; ++u) out[u] += k[static_cast<std::size_t>(i + r)] * row[u];
    }
  }
}

// Mean over the (2r+1)^2 box round each pixel, the image continued by its rim.
void box_mean(const Plane& in, Plane& out, int w, int h, int r) {
  Plane t(in.size());
  const float norm = 1.0F / static_cast<float>(2 * r + 1);
  for (int v = 0; v < h; ++v) {
    const float* row = &in[static_cast<std::size_t>(v * w)];
    float* o = &t[static_cast<std::size_t>(v * w)];
    double s = 0;
    for (int i = -r; i <= r; ++i) s += static_cast<double>(row[std::clamp(i, 0, w - 1)]);
    for (int u = 0; u < w; ++u) {
      o[u] = static_cast<float>(s) * norm;
      s += static_cast<double>(row[std::min(u + r + 1, w - 1)]) -
           static_cast<double>(row[std::max(u - r, 0)]);
    }
  }
  std::vector<double> s(static_cast<std::size_t>(w), 0.0);
  for (int i = -r; i <= r; ++i) {
    const float* row = &t[static_cast<std::size_t>(std::clamp(i, 0, h - 1) * w)];
    for (int u = 0; u < w; ++u) s[static_cast<std::size_t>(u)] += static_cast<double>(row[u]);
  }
  out.resize(in.size());
  for (int v = 0; v < h; ++v) {
    float* o = &out[static_cast<std::size_t>(v * w)];
    const float* add = &t[static_cast<std::size_t>(std::min(v + r + 1, h - 1) * w)];
    const float* sub = &t[static_cast<std::size_t>(std::max(v - r, 0) * w)];
    for (int u = 0; u < w; ++u) {
      const auto k = static_cast<std::size_t>(u);
      o[u] = static_cast<float>(s[k]) * norm;
      s[k] += static_cast<double>(add[u]) - static_cast<double>(sub[u]);
    }
  }
}

struct Features {
  int w = 0, h = 0;
  std::array<Plane, kChannels> plane;
  Plane boundary;  // two-sided test, about 0..1
};

// Largest over four directions of |difference of means| / spread, root of the sum over channels.
void add_two_sided(Features& f, int r, double spread, double weight, const WholeImageConfig& c) {
  const auto n = f.plane[0].size();
  std::array<Plane, kChannels> mean;
  Plane var(n, 0), square(n), mean_square(n);
  const float scale[kChannels] = {static_cast<float>(c.light_weight), 1, 1,
                                  static_cast<float>(c.contrast_weight)};
  for (int k = 0; k < kChannels; ++k) {
    box_mean(f.plane[k], mean[k], f.w, f.h, r);
    if (k == 3) continue;
    for (std::size_t i = 0; i < n; ++i) square[i] = f.plane[k][i] * f.plane[k][i];
    box_mean(square, mean_square, f.w, f.h, r);
    for (std::size_t i = 0; i < n; ++i) {
      var[i] += scale[k] * scale[k] * std::max(0.0F, mean_square[i] - mean[k][i] * mean[k][i]);
    }
  }
  const int o = r + 1, diag = (3 * o + 2) / 4;
  const int du[4] = {o, 0, diag, diag}, dv[4] = {0, o, diag, -diag};
  const float floor2 = static_cast<float>(spread * spread);
  for (int v = 0; v < f.h; ++v) {
    for (int u = 0; u < f.w; ++u) {
      float best = 0;
      for (int q = 0; q < 4; ++q) {
        const int i = std::clamp(v + dv[q], 0, f.h - 1) * f.w + std::clamp(u + du[q], 0, f.w - 1);
        const int j = std::clamp(v - dv[q], 0, f.h - 1) * f.w + std::clamp(u - du[q], 0, f.w - 1);
        float d2 = 0;
        for (int k = 0; k < kChannels; ++k) {
          const float e = scale[k] * (mean[k][static_cast<std::size_t>(i)] -
                                      mean[k][static_cast<std::size_t>(j)]);
          d2 += e * e;
        }
        best = std::max(best, d2 / (floor2 + 0.5F * (var[static_cast<std::size_t>(i)] +
                                                     var[static_cast<std::size_t>(j)])));
      }
      f.boundary[static_cast<std::size_t>(v * f.w + u)] +=
          static_cast<float>(weight) * (1 - std::exp(-0.5F * best));
    }
  }
}

Features features_of(ImageView<const Rgb> rgb, const WholeImageConfig& c, LabImage& lab) {
  Features f;
  f.w = rgb.width;
  f.h = rgb.height;
  lab.set(rgb);
  const auto n = static_cast<std::size_t>(f.w * f.h);
  for (int k = 0; k < 3; ++k) f.plane[k].assign(lab.plane(k), lab.plane(k) + n);
  // Local contrast: standard deviation of L in a 7 x 7 box.
  Plane square(n), m, m2;
  for (std::size_t i = 0; i < n; ++i) square[i] = f.plane[0][i] * f.plane[0][i];
  box_mean(f.plane[0], m, f.w, f.h, 3);
  box_mean(square, m2, f.w, f.h, 3);
  f.plane[3].resize(n);
  for (std::size_t i = 0; i < n; ++i)
    f.plane[3][i] = std::sqrt(std::max(0.0F, m2[i] - m[i] * m[i]));
  box_mean(f.plane[3], m, f.w, f.h, 3);
  f.plane[3] = m;
  for (int k = 0; k < 3; ++k) blur(f.plane[k], f.w, f.h, c.smooth_px);
  f.boundary.assign(n, 0);
  add_two_sided(f, 2, c.spread, 0.34, c);
  add_two_sided(f, 5, c.spread, 0.33, c);
  add_two_sided(f, 10, c.spread, 0.33, c);
  return f;
}

struct Edge {
  int other = 0;
  double length = 0, boundary = 0;
};

struct Region {
  double pixels = 0;
  Histogram h{};
  std::vector<Edge> edges;  // sorted by `other`
  int version = 0;
  bool alive = true;
};

struct Pair {
  double weight;
  int a, b, version_a, version_b;
  bool operator<(const Pair& o) const noexcept {  // std::priority_queue takes the largest first
    if (weight != o.weight) return weight > o.weight;
    return a != o.a ? a > o.a : b > o.b;
  }
};

class Merger {
 public:
  Merger(const Features& f, const std::vector<std::int32_t>& labels, int count,
         const WholeImageConfig& c)
      : c_(c),
        regions_(static_cast<std::size_t>(count)),
        parent_(static_cast<std::size_t>(count)),
        alive_(count) {
    for (int i = 0; i < count; ++i) parent_[static_cast<std::size_t>(i)] = i;
    pixels_ = static_cast<double>(f.w) * f.h;
    fill(f, labels);
    for (int a = 0; a < count; ++a) push_all(a, a);
  }
  void run() {
    while (!queue_.empty()) {
      const Pair p = queue_.top();
      if (p.weight > c_.stop) return;
      queue_.pop();
      const auto& a = regions_[static_cast<std::size_t>(p.a)];
      const auto& b = regions_[static_cast<std::size_t>(p.b)];
      if (!a.alive || !b.alive || a.version != p.version_a || b.version != p.version_b) continue;
      if (alive_ <= c_.min_regions && p.weight > c_.same &&
          std::min(a.pixels, b.pixels) > c_.crumb * pixels_)
        continue;
      merge(p.a, p.b);
    }
  }
  // Each region below `min_pixels`, smallest first, joins the neighbour it differs least from; so
  // does a strip that is no more than the blurred border of two others.
  void absorb(double min_pixels) {
    for (;;) {
      int smallest = -1;
      for (int i = 0; i < static_cast<int>(regions_.size()); ++i) {
        const Region& r = regions_[static_cast<std::size_t>(i)];
        if (!r.alive || r.edges.empty() || (r.pixels >= min_pixels && !is_strip(r))) continue;
        if (smallest < 0 || r.pixels < regions_[static_cast<std::size_t>(smallest)].pixels)
          smallest = i;
      }
      if (smallest < 0) return;
      int best = -1;
      double least = 0;
      for (const Edge& e : regions_[static_cast<std::size_t>(smallest)].edges) {
        const double w = difference(smallest, e);
        if (best < 0 || w < least) best = e.other, least = w;
      }
      merge(std::min(smallest, best), std::max(smallest, best));
    }
  }
  int root(int i) {
    while (parent_[static_cast<std::size_t>(i)] != i) i = parent_[static_cast<std::size_t>(i)];
    return i;
  }

 private:
  [[nodiscard]] bool is_strip(const Region& r) const noexcept {
    double border = 0;
    for (const Edge& e : r.edges) border += e.length;
    return 2 * r.pixels < c_.strip_px * border;
  }
  void fill(const Features& f, const std::vector<std::int32_t>& labels) {
    for (int v = 0; v < f.h; ++v) {
      for (int u = 0; u < f.w; ++u) {
        const auto i = static_cast<std::size_t>(v * f.w + u);
        Region& r = regions_[static_cast<std::size_t>(labels[i])];
        r.pixels += 1;
        for (int k = 0; k < kChannels; ++k) {
          const float x = std::clamp((f.plane[k][i] - kLow[k]) / kStep[k], 0.0F, kBins - 1.001F);
          const int bin = static_cast<int>(x);
          const float t = x - static_cast<float>(bin);
          r.h[static_cast<std::size_t>(k * kBins + bin)] += 1 - t;
          r.h[static_cast<std::size_t>(k * kBins + bin + 1)] += t;
        }
        if (u + 1 < f.w) touch(f, labels, i, i + 1);
        if (v + 1 < f.h) touch(f, labels, i, i + static_cast<std::size_t>(f.w));
      }
    }
  }
  void touch(const Features& f, const std::vector<std::int32_t>& labels, std::size_t i,
             std::size_t j) {
    const int a = labels[i], b = labels[j];
    if (a == b) return;
    const double s = 0.5 * static_cast<double>(f.boundary[i] + f.boundary[j]);
    add_edge(a, b, 1, s);
    add_edge(b, a, 1, s);
  }
  void add_edge(int a, int b, double length, double boundary) {
    auto& edges = regions_[static_cast<std::size_t>(a)].edges;
    auto it = std::lower_bound(edges.begin(), edges.end(), b,
                               [](const Edge& e, int x) { return e.other < x; });
    if (it == edges.end() || it->other != b) it = edges.insert(it, Edge{b, 0, 0});
    it->length += length;
    it->boundary += boundary;
  }
  void remove_edge(int a, int b) {
    auto& edges = regions_[static_cast<std::size_t>(a)].edges;
    auto it = std::lower_bound(edges.begin(), edges.end(), b,
                               [](const Edge& e, int x) { return e.other < x; });
    if (it != edges.end() && it->other == b) edges.erase(it);
  }
  [[nodiscard]] double region_difference(const Region& a, const Region& b) const {
    const float na = static_cast<float>(1 / a.pixels), nb = static_cast<float>(1 / b.pixels);
    double d2 = 0;
    const double scale[kChannels] = {c_.light_weight, 1, 1, c_.contrast_weight};
    for (int k = 0; k < kChannels; ++k) {
      float carried = 0, work = 0;
      for (int i = 0; i < kBins; ++i) {
        const auto j = static_cast<std::size_t>(k * kBins + i);
        carried += a.h[j] * na - b.h[j] * nb;
        work += std::abs(carried);
      }
      const double d = scale[k] * static_cast<double>(work * kStep[k]);
      d2 += d * d;
    }
    return std::sqrt(d2);
  }
  [[nodiscard]] double difference(int i, const Edge& e) const {
    const Region &a = regions_[static_cast<std::size_t>(i)],
                 &b = regions_[static_cast<std::size_t>(e.other)];
    const double r = region_difference(a, b) / c_.region_saturation;
    return 1 - std::exp(-r) + e.boundary / e.length;
  }
  [[nodiscard]] double weight(int i, const Edge& e) const {
    const double a = regions_[static_cast<std::size_t>(i)].pixels,
                 b = regions_[static_cast<std::size_t>(e.other)].pixels;
    const double ward = 2 * a * b / (a + b) / (0.01 * pixels_);
    return difference(i, e) * std::pow(ward, c_.size_power);
  }
  void push_all(int a, int above) {
    const Region& r = regions_[static_cast<std::size_t>(a)];
    for (const Edge& e : r.edges) {
      if (e.other < above) continue;
      const int lo = std::min(a, e.other), hi = std::max(a, e.other);
      queue_.push({weight(a, e), lo, hi, regions_[static_cast<std::size_t>(lo)].version,
                   regions_[static_cast<std::size_t>(hi)].version});
    }
  }
  void merge(int a, int b) {
    Region &ra = regions_[static_cast<std::size_t>(a)], &rb = regions_[static_cast<std::size_t>(b)];
    ra.pixels += rb.pixels;
    for (std::size_t i = 0; i < ra.h.size(); ++i) ra.h[i] += rb.h[i];
    remove_edge(a, b);
    const std::vector<Edge> moved = std::move(rb.edges);
    rb.edges.clear();
    for (const Edge& e : moved) {
      if (e.other == a) continue;
      remove_edge(e.other, b);
      add_edge(a, e.other, e.length, e.boundary);
      add_edge(e.other, a, e.length, e.boundary);
    }
    rb.alive = false;
    --alive_;
    ++ra.version;
    parent_[static_cast<std::size_t>(b)] = a;
    push_all(a, 0);
  }

  const WholeImageConfig& c_;
  std::vector<Region> regions_;
  std::vector<int> parent_;
  int alive_ = 0;
  double pixels_ = 0;
  std::priority_queue<Pair> queue_;
};

}  // namespace

WholeImage segment_whole(ImageView<const Rgb> rgb, const WholeImageConfig& c) {
  LabImage lab(rgb.width, rgb.height);
  const Features f = features_of(rgb, c, lab);
  Superpixels pieces(rgb.width, rgb.height);
  const float* const planes[] = {f.plane[0].data(), f.plane[1].data(), f.plane[2].data()};
  pieces.run(planes, f.w, f.h, c.superpixels);

  Merger merger(f, pieces.labels(), pieces.count(), c);
  merger.run();
  merger.absorb(c.min_share * f.w * f.h);

  WholeImage out;
  std::vector<std::uint16_t> name(static_cast<std::size_t>(pieces.count()), 0);
  out.labels.resize(static_cast<std::size_t>(f.w * f.h));
  for (std::size_t i = 0; i < out.labels.size(); ++i) {
    std::uint16_t& id = name[static_cast<std::size_t>(merger.root(pieces.labels()[i]))];
    if (id == 0) id = static_cast<std::uint16_t>(++out.regions);
    out.labels[i] = id;
  }
  return out;
}

}  // namespace perception
