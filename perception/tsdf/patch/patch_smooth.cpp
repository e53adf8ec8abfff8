#include "perception/tsdf/patch/patch_smooth.hpp"

#include <algorithm>
#include <cmath>

namespace perception {
namespace {

// chosen on: stability 1 fused at 45 and 70 degrees; judged on: stability 1 fused at 20 degrees, 13, 10, 7, 6, 5, 2
constexpr float kSlab = 1.25F;  // layers of nodes either side of the surface, at least
constexpr float kNear = 0.4F;   // a cell's diagonal: nodes of cells that the surface goes through
constexpr float kNoise = 0.05F, kShape = 0.1F;  // voxels of RMS residual
constexpr float kSmoothedReach = 0.9F;          // of the truncation: what is farther is cut off
constexpr float kLeastSeen = 0.6F;              // of the neighbours
constexpr float kQuartic =
    0.027F;  // of curvature^3 radius^4: twice what a ball without noise shows
constexpr double kWhole =
    0.65;  // of the reach: the cells round a tip of 4 mm, 12 mm above the hand
constexpr int kPlane = 5, kTerms = 8;  // terms of the fit: of a plane; with curvature
constexpr int kLayers = 3;             // along a ray nodes were told by the same pixels

}  // namespace

// Normal equations in the order 1, t1, t2, h, h^2, t1^2, t1 t2, t2^2: the first five are the
// plane's.
struct PatchSmoother::Fit {
  using Row = Eigen::Array<float, kTerms, 1>;
  std::array<Row, kTerms> m;
  Row b = Row::Zero();
  std::array<float, kTerms> y{};
  float dd = 0, weight = 0, square = 0;

  Fit() noexcept { m.fill(Row::Zero()); }
  void add(const Row& v, float d, float w) noexcept {
    const Row wv = w * v;
    b += d * wv;
    // Whole rows: a vector of them costs less than what half of them saves.
    for (std::size_t r = 0; r < kTerms; ++r) m[r] += wv[static_cast<Eigen::Index>(r)] * v;
    dd += w * d * d, weight += w, square += w * w;
  }
  // Cholesky in place, and y = L^-1 b.
  [[nodiscard]] bool solve() noexcept {
    for (std::size_t r = 0; r < kTerms; ++r) {
      Row& row = m[r];
      for (std::size_t c = 0; c <= r; ++c) {
        const auto at = static_cast<Eigen::Index>(c);
        float s = row[at];
        for (Eigen::Index k = 0; k < at; ++k) s -= row[k] * m[c][k];
        if (c < r) {
          row[at] = s / m[c][at];
        } else {
          if (!(s > 1e-4F * row[at])) return false;  // a direction that nothing says anything of
          row[at] = std::sqrt(s);
        }
      }
      float s = b[static_cast<Eigen::Index>(r)];
      for (std::size_t k = 0; k < r; ++k) s -= row[static_cast<Eigen::Index>(k)] * y[k];
      y[r] = s / row[static_cast<Eigen::Index>(r)];
    }
    return true;
  }
  // Coefficients of the fit by the first `terms` terms.
  [[nodiscard]] std::array<float, kTerms> solution(std::size_t terms) const noexcept {
    std::array<float, kTerms> x{};
    for (std::size_t r = terms; r-- > 0;) {
      float s = y[r];
      const auto at = static_cast<Eigen::Index>(r);
      for (std::size_t k = r + 1; k < terms; ++k) s -= m[k][at] * x[k];
      x[r] = s / m[r][at];
    }
    return x;
  }
};

PatchSmoother::PatchSmoother(rt::NonRealtime&, const SmoothOptions& options)
    : options_(options), margin_(static_cast<int>(std::ceil(options.radius))) {
  edge_ = 2 * (static_cast<int>(std::ceil(options.reach)) + margin_) + 2;
  const double r2 = options.radius * options.radius;
  for (int x = -margin_; x <= margin_; ++x)
    for (int y = -margin_; y <= margin_; ++y)
      for (int z = -margin_; z <= margin_; ++z) {
        const double q = (x * x + y * y + z * z) / r2;
        if (q >= 1) continue;
        offsets_.push_back(
            {Eigen::Vector3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)),
             static_cast<float>((1 - q) * (1 - q)), (x * edge_ + y) * edge_ + z});
      }
  const auto n = static_cast<std::size_t>(edge_);
  field_.resize(n * n * n, std::nanf(""));
  changes_.resize(n * n * n);
}

void PatchSmoother::take(const SurfacePatch& p, const std::array<int, 3>& first,
                         int edge) noexcept {
  const float scale = p.metres_per_unit / static_cast<float>(p.voxel_size);
  const float none = std::nanf("");
  for (int x = 0; x < edge; ++x)
    for (int y = 0; y < edge; ++y) {
      const int i = first[0] + x, j = first[1] + y;
      float* row = field_.data() + (x * edge_ + y) * edge_;
      const bool inside = std::min(i, j) >= 0 && std::max(i, j) < p.nodes;
      for (int z = 0; z < edge; ++z) {
        const int k = first[2] + z;
        row[z] = none;
        if (!inside || k < 0 || k >= p.nodes) continue;
        const std::size_t at = p.index(i, j, k);
        const auto d = static_cast<float>(p.distance[at]);
        if (p.material[at] != 0 && std::abs(d) < kSmoothedReach * 32767.0F) row[z] = d * scale;
      }
    }
}

// In voxels a voxel. From both sides, or the one that was seen.
bool PatchSmoother::gradient(std::ptrdiff_t at, Eigen::Vector3f& g) const noexcept {
  std::ptrdiff_t step = static_cast<std::ptrdiff_t>(edge_) * edge_;
  for (Eigen::Index a = 0; a < 3; ++a, step /= edge_) {
    const float here = field_[static_cast<std::size_t>(at)],
                lo = field_[static_cast<std::size_t>(at - step)],
                hi = field_[static_cast<std::size_t>(at + step)];
    const bool low = !std::isnan(lo), high = !std::isnan(hi);
    if (!low && !high) return false;
    g[a] = ((high ? hi : here) - (low ? lo : here)) / (low && high ? 2.0F : 1.0F);
  }
  return true;
}

// Of a node in field_, in voxels.
float PatchSmoother::smoothed(std::ptrdiff_t at) const noexcept {
  const float was = field_[static_cast<std::size_t>(at)];
  Eigen::Vector3f g;
  if (std::isnan(was) || !gradient(at, g)) return was;
  const float slope = g.norm();
  if (!(slope > 0.3F) || std::abs(was) > g.lpNorm<1>() + kNear * slope) return was;
  const Eigen::Vector3f h = g / slope, t1 = h.unitOrthogonal(), t2 = h.cross(t1);
  // With the node's own layer: beyond the last one a fit only guesses.
  const float height = was / slope, slab = std::max(kSlab, std::abs(height) + 0.01F);
  Fit fit;
  int seen = 0, all = 0;
  for (const Offset& o : offsets_) {
    const float across = h.dot(o.at);
    if (std::abs(height + across) > slab) continue;
    ++all;
    const float d = field_[static_cast<std::size_t>(at + o.step)];
    if (std::isnan(d)) continue;
    ++seen;
    const float a = t1.dot(o.at), b = t2.dot(o.at);
    Fit::Row v;
    v << 1, a, b, across, across * across, a * a, a * b, b * b;
    fit.add(v, d, o.weight);
  }
  if (static_cast<float>(seen) < kLeastSeen * static_cast<float>(all) || !fit.solve()) return was;
  float plane = fit.dd, curved = 0;
  for (std::size_t k = 0; k < kPlane; ++k) plane -= fit.y[k] * fit.y[k];
  for (std::size_t k = kPlane; k < kTerms; ++k) curved += fit.y[k] * fit.y[k];
  const float left = std::max(0.0F, plane - curved);
  const float rms = std::sqrt(left / fit.weight) / slope;
  const float t = std::clamp((rms - kNoise) / (kShape - kNoise), 0.0F, 1.0F);
  const float taken = 1 - t * t * (3 - 2 * t);
  if (taken <= 0) return was;
  // Of three terms by noise alone: 3 x its variance x the mean weight of a column of nodes.
  const float noise = 3 * kLayers * (left / fit.weight) * (fit.square / fit.weight);
  const float counts = curved > 2 * noise ? 1 - 2 * noise / curved : 0.0F;
  const float flat = fit.solution(kPlane)[0];
  const auto bent = fit.solution(kTerms);
  // What the fourth order of a ball's face leaves in the fit, against the noise that the fit takes
  // out.
  const auto radius = static_cast<float>(options_.radius);
  const float bend =
      counts * (2 * std::max(std::abs(bent[5]), std::abs(bent[7])) + std::abs(bent[6])) / slope;
  const float bias = kQuartic * bend * bend * bend * radius * radius * radius * radius;
  const float kept = rms * rms / (rms * rms + bias * bias + 1e-12F);
  const float now = flat + counts * (bent[0] - flat);
  return was + taken * kept * (now - was);
}

float PatchSmoother::node(const SurfacePatch& p, int ix, int iy, int iz) noexcept {
  const std::size_t at = p.index(ix, iy, iz);
  if (p.material[at] == 0) return 0;
  take(p, {ix - margin_, iy - margin_, iz - margin_}, 2 * margin_ + 1);
  const std::ptrdiff_t middle =
      (static_cast<std::ptrdiff_t>(margin_) * edge_ + margin_) * edge_ + margin_;
  const float was = field_[static_cast<std::size_t>(middle)], now = smoothed(middle);
  if (std::isnan(was) || now == was) return static_cast<float>(p.distance[at]);
  return now * static_cast<float>(p.voxel_size) / p.metres_per_unit;
}

SmoothStats PatchSmoother::smooth(const Vec3& hand_W, SurfacePatch& p) noexcept {
  SmoothStats stats;
  if (!(p.voxel_size > 0) || p.nodes < 8 || p.nodes > SurfacePatch::kMaxNodes ||
      !hand_W.allFinite())
    return stats;
  const Vec3 hand =
      hand_W / p.voxel_size - Vec3(p.origin_node[0], p.origin_node[1], p.origin_node[2]);
  if (!(hand.cwiseAbs().maxCoeff() < 1e4)) return stats;
  const double reach = options_.reach;
  std::array<int, 3> first{};
  for (int a = 0; a < 3; ++a)
    first[static_cast<std::size_t>(a)] = static_cast<int>(std::ceil(hand[a] - reach)) - margin_;
  take(p, first, edge_);
  const float unit = static_cast<float>(p.voxel_size) / p.metres_per_unit;
  const int inner = edge_ - 2 * margin_;
  std::size_t n = 0;
  for (int x = margin_; x < margin_ + inner; ++x)
    for (int y = margin_; y < margin_ + inner; ++y)
      for (int z = margin_; z < margin_ + inner; ++z) {
        const int i = first[0] + x, j = first[1] + y, k = first[2] + z;
        const double r = (Vec3(i, j, k) - hand).norm() / reach;
        const std::ptrdiff_t at = (static_cast<std::ptrdiff_t>(x) * edge_ + y) * edge_ + z;
        const float was = field_[static_cast<std::size_t>(at)];
        if (r >= 1 || std::isnan(was)) continue;
        const float now = smoothed(at);
        if (now == was) continue;
        ++stats.nodes;
        const double s = std::clamp((r - kWhole) / (1 - kWhole), 0.0, 1.0),
                     part = 1 - s * s * (3 - 2 * s);
        const float to = (was + static_cast<float>(part) * (now - was)) * unit;
        const auto d = static_cast<std::int16_t>(std::lround(std::clamp(to, -32767.0F, 32767.0F)));
        const std::size_t node = p.index(i, j, k);
        if (d != p.distance[node]) changes_[n++] = {node, d};
      }
  for (std::size_t k = 0; k < n; ++k) {
    p.distance[changes_[k].at] = changes_[k].distance;
    p.set_free(changes_[k].at, changes_[k].distance > 0);
  }
  stats.changed = static_cast<std::int32_t>(n);
  return stats;
}

}  // namespace perception
