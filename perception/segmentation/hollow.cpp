// The inside of a hollow thing joins its outside (object_graph.hpp).
#include <algorithm>
#include <cmath>
#include <utility>

#include "perception/segmentation/object_graph.hpp"

namespace perception {

float ObjectGraph::Heights::deviation() const noexcept {
  return std::sqrt(std::max(0.0F, square / n - mean() * mean()));
}

// Null where no edge is between them. After the last combine(): edges are between regions, and
// sorted.
ObjectGraph::Between* ObjectGraph::between(int a, int b) noexcept {
  const auto end = edges_.begin() + edge_count_;
  const std::pair wanted(std::min(a, b), std::max(a, b));
  const auto at = std::lower_bound(
      edges_.begin(), end, wanted,
      [](const Edge& e, const std::pair<int, int>& x) { return std::pair(e.a, e.b) < x; });
  if (at == end || std::pair(at->a, at->b) != wanted) return nullptr;
  return &between_[static_cast<std::size_t>(at - edges_.begin())];
}

void ObjectGraph::measure_outlines(const SurfacePatches& patches, const SupportPlane& plane,
                                   const ObjectGraphConfig& c) noexcept {
  const int w = patches.window().width, h = patches.window().height;
  std::fill_n(outlines_.begin(), pieces_, Outline{});
  std::fill_n(between_.begin(), edge_count_, Between{});
  for (int i = 0; i < pieces_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const SurfacePiece& p = patches.piece(i);
    if (region_[k] < 0) continue;
    outlines_[static_cast<std::size_t>(region_[k])].all.add(plane.height(p.centre),
                                                            static_cast<float>(p.readings));
  }
  const auto hides = [&](int front, int u, int v, int behind, float gap) {
    const float height = plane.height(patches.point(u, v));
    outlines_[static_cast<std::size_t>(front)].open.add(height);
    Between* const edge = behind < 0 || gap > c.hollow_gap_m ? nullptr : between(front, behind);
    if (edge != nullptr) edge->rim[front < behind ? 0 : 1].add(height);
  };
  const auto pair = [&](int u, int v, int u2, int v2) {
    const auto i = static_cast<std::size_t>(v * w + u), j = static_cast<std::size_t>(v2 * w + u2);
    const int pi = patches.labels()[i], pj = patches.labels()[j];
    if (pi == pj) return;
    const int a = region_[static_cast<std::size_t>(pi)], b = region_[static_cast<std::size_t>(pj)];
    if (a == b || (a < 0 && b < 0)) return;
    const float za = patches.z_m()[i], zb = patches.z_m()[j];
    if (!(za > 0) || !(zb > 0)) return;
    if (a >= 0) outlines_[static_cast<std::size_t>(a)].pairs += 1;
    if (b >= 0) outlines_[static_cast<std::size_t>(b)].pairs += 1;
    const float limit = height_noise(c.step_m, c.step_per_m2, std::min(za, zb));
    if (a >= 0 && zb - za > limit) hides(a, u, v, b, zb - za);
    if (b >= 0 && za - zb > limit) hides(b, u2, v2, a, za - zb);
    if (a < 0 || b < 0 || std::abs(za - zb) > limit) return;
    if (Between* const edge = between(a, b); edge != nullptr) edge->touching += 1;
  };
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      if (u + 1 < w) pair(u, v, u + 1, v);
      if (v + 1 < h) pair(u, v, u, v + 1);
    }
  }
}

bool ObjectGraph::is_inside_of(int inside, const Heights& rim, float z,
                               const ObjectGraphConfig& c) const noexcept {
  constexpr float kLeast = 4;  // pairs of pixels
  const Outline& o = outlines_[static_cast<std::size_t>(inside)];
  const float noise = height_noise(c.rim_m, c.rim_per_m2, z);
  if (rim.n < std::max(kLeast, c.rim_share * o.pairs) || o.open.n < kLeast || !(o.all.n > 0))
    return false;
  return o.open.deviation() < noise && std::abs(o.open.mean() - rim.mean()) < noise &&
         o.open.mean() - o.all.mean() > noise;
}

// What hides something itself lies in the hollow thing and is none of it.
bool ObjectGraph::is_bottom_of(int bottom, int inside, const Between& edge,
                               const ObjectGraphConfig& c) const noexcept {
  const Outline &o = outlines_[static_cast<std::size_t>(bottom)],
                &in = outlines_[static_cast<std::size_t>(inside)];
  return o.open.n == 0 && o.all.n > 0 && edge.touching > c.bottom_share * o.pairs &&
         o.all.mean() < in.all.mean();
}

void ObjectGraph::join(int a, int b) noexcept {
  const int lo = std::min(root(a), root(b)), hi = std::max(root(a), root(b));
  if (lo == hi) return;
  parent_[static_cast<std::size_t>(hi)] = lo;
  Region &to = sums_[static_cast<std::size_t>(lo)], &from = sums_[static_cast<std::size_t>(hi)];
  to.L += from.L, to.a += from.a, to.b += from.b, to.n += from.n, to.area_cm2 += from.area_cm2;
}

void ObjectGraph::join_hollow(const SurfacePatches& patches, const SupportPlane& plane,
                              const ObjectGraphConfig& c) noexcept {
  if (!plane.valid()) return;
  measure_outlines(patches, plane, c);
  const auto hollow = [&](int inside) { return best_[static_cast<std::size_t>(inside)] >= 0; };
  std::fill_n(best_.begin(), pieces_, -1);
  for (int k = 0; k < edge_count_; ++k) {
    const Edge& e = edges_[static_cast<std::size_t>(k)];
    const auto& rim = between_[static_cast<std::size_t>(k)].rim;
    const float z = patches.piece(e.a).centre.z();
    for (const auto& [inside, front] : {std::pair(e.b, 0U), std::pair(e.a, 1U)}) {
      if (!is_inside_of(inside, rim[front], z, c)) continue;
      best_[static_cast<std::size_t>(inside)] = k;
      join(e.a, e.b);
    }
  }
  for (int k = 0; k < edge_count_; ++k) {
    const Edge& e = edges_[static_cast<std::size_t>(k)];
    const Between& both = between_[static_cast<std::size_t>(k)];
    if ((hollow(e.a) && is_bottom_of(e.b, e.a, both, c)) ||
        (hollow(e.b) && is_bottom_of(e.a, e.b, both, c)))
      join(e.a, e.b);
  }
}

}  // namespace perception
