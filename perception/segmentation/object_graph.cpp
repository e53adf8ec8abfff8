#include "perception/segmentation/object_graph.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "perception/segmentation/colour_shares.hpp"
#include "rt/random.hpp"

namespace perception {
namespace {

constexpr float kDegree = 0.017453292F;

}  // namespace

ObjectGraph::ObjectGraph(int max_width, int max_height) {
  const auto n = static_cast<std::size_t>((max_width + 1) / 2 * ((max_height + 1) / 2));
  edges_.resize(2 * n);
  next_.resize(2 * n);
  sums_.resize(n);
  parent_.resize(n);
  region_.resize(n);
  best_.resize(n);
  support_.resize(n);
  outlines_.resize(n);
  between_.resize(2 * n);
  sample_.reserve(n);
}

int ObjectGraph::root(int i) noexcept {
  while (parent_[static_cast<std::size_t>(i)] != i) {
    int& p = parent_[static_cast<std::size_t>(i)];
    p = parent_[static_cast<std::size_t>(p)];
    i = p;
  }
  return i;
}

// Hypotheses are the planes of the pieces themselves, drawn in a fixed order; each is judged by the
// area of the pieces that lie on it, less that of those behind it: what carries is not seen
// through.
SupportPlane ObjectGraph::find_support(const SurfacePatches& patches, const Vec3f& p_touch,
                                       const ObjectGraphConfig& c) noexcept {
  sample_.clear();
  float total = 0;
  for (int i = 0; i < patches.count(); ++i) {
    const SurfacePiece& p = patches.piece(i);
    if (!p.has_plane() || (p.centre - p_touch).norm() > c.support_radius_m) continue;
    const float z = p.centre.z(), tilt = std::max(0.15F, -p.normal.dot(p.centre) / p.centre.norm());
    sample_.push_back({p.centre, p.normal, static_cast<float>(p.readings) * z * z / tilt,
                       height_noise(c.support_m, c.support_per_m2, z)});
    total += sample_.back().area;
  }
  SupportPlane best;
  if (sample_.size() < 8) return best;
  const auto count = static_cast<std::int64_t>(sample_.size());
  const std::size_t stride = 1 + sample_.size() / static_cast<std::size_t>(c.support_samples);
  const float aligned = std::cos(c.support_tilt_deg * kDegree);
  rt::Random random(c.seed);
  float best_score = 0;
  for (int draw = 0; draw < c.support_draws; ++draw) {
    // Three pieces fix a plane better than the one's own slope does.
    const Vec3f& p = sample_[static_cast<std::size_t>(random.integer(0, count - 1))].p;
    const Vec3f& q = sample_[static_cast<std::size_t>(random.integer(0, count - 1))].p;
    const Vec3f& r = sample_[static_cast<std::size_t>(random.integer(0, count - 1))].p;
    Vec3f n = (q - p).cross(r - p);
    const float length = n.norm();
    if (!(length > 1e-3F)) continue;
    n /= length;
    if (n.dot(p) > 0) n = -n;
    const float d = n.dot(p);
    float score = 0;
    for (std::size_t k = 0; k < sample_.size(); k += stride) {
      const Sample& s = sample_[k];
      const float height = n.dot(s.p) - d;
      if (std::abs(height) < s.tolerance) {
        if (s.n.dot(n) > aligned) score += s.area;
      } else if (height < -3 * s.tolerance) {
        score -= 0.5F * s.area;
      }
    }
    if (score > best_score) {
      best_score = score;
      best.n = n;
      best.d = d;
    }
  }
  if (!best.valid()) return best;
  best.share = std::min(1.0F, best_score * static_cast<float>(stride) / total);
  for (int round = 0; round < 3; ++round) {
    if (!fit_support(best, aligned)) return {};
  }
  return best;
}

// Least squares over the pieces on the plane.
bool ObjectGraph::fit_support(SupportPlane& plane, float aligned) const noexcept {
  const auto on = [&](const Sample& s) {
    return std::abs(plane.height(s.p)) <= s.tolerance && s.n.dot(plane.n) >= aligned;
  };
  Vec3 mean = Vec3::Zero();
  Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
  double weight = 0;
  for (const Sample& s : sample_) {
    if (!on(s)) continue;
    mean += static_cast<double>(s.area) * s.p.cast<double>();
    weight += static_cast<double>(s.area);
  }
  if (!(weight > 0)) return false;
  mean /= weight;
  for (const Sample& s : sample_) {
    if (!on(s)) continue;
    const Vec3 e = s.p.cast<double>() - mean;
    moment += static_cast<double>(s.area) * e * e.transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(moment);
  Vec3 n = solver.eigenvectors().col(0);
  if (n.dot(mean) > 0) n = -n;
  plane.n = n.cast<float>();
  plane.d = static_cast<float>(n.dot(mean));
  return true;
}

void ObjectGraph::mark_support(const SurfacePatches& patches, const SupportPlane& plane,
                               const ObjectGraphConfig& c) noexcept {
  const float aligned = std::cos(c.support_tilt_deg * kDegree);
  for (int i = 0; i < patches.count(); ++i) {
    const SurfacePiece& p = patches.piece(i);
    bool on = false;
    if (plane.valid() && p.has_plane()) {
      const float tolerance = height_noise(c.support_m, c.support_per_m2, p.centre.z());
      const float height = plane.height(p.centre);
      on = height < tolerance && (p.normal.dot(plane.n) > aligned || height < 0.3F * tolerance);
    }
    support_[static_cast<std::size_t>(i)] = on ? 1 : 0;
  }
}

// The bottom of a bowl is as high as the table. Support of another colour than the large rest, not
// connected to it by likeness, is given back to the objects. A colour that much of the support has
// is the support's own, as on a floor of two colours.
void ObjectGraph::free_coloured_support(const SurfacePatches& patches,
                                        const ObjectGraphConfig& c) noexcept {
  double L = 0, a = 0, b = 0, n = 0;
  ColourShares shares;
  for (int i = 0; i < patches.count(); ++i) {
    if (!support_[static_cast<std::size_t>(i)]) continue;
    const SurfacePiece& p = patches.piece(i);
    shares.add(p);
    L += static_cast<double>(p.L) * p.coloured;
    a += static_cast<double>(p.a) * p.coloured;
    b += static_cast<double>(p.b) * p.coloured;
    n += p.coloured;
  }
  support_has_colour_ = n > 0;
  if (!(n > 0)) return;
  const auto ma = static_cast<float>(a / n), mb = static_cast<float>(b / n);
  support_colour_ = {static_cast<float>(L / n), ma, mb};
  for (int i = 0; i < patches.count(); ++i) {
    const SurfacePiece& p = patches.piece(i);
    if (p.coloured > 0 && std::hypot(p.a - ma, p.b - mb) > c.flat_colour &&
        shares.like(p, c.flat_colour) <= c.common_share)
      support_[static_cast<std::size_t>(i)] = 0;
  }
}

// One edge between two pieces, over all pairs of pixels along it.
ObjectGraph::Edge& ObjectGraph::edge_between(int a, int b) noexcept {
  int* at = &best_[static_cast<std::size_t>(a)];
  while (*at >= 0) {
    Edge& e = edges_[static_cast<std::size_t>(*at)];
    if (e.b == b) return e;
    at = &next_[static_cast<std::size_t>(*at)];
  }
  *at = edge_count_;
  next_[static_cast<std::size_t>(edge_count_)] = -1;
  Edge& e = edges_[static_cast<std::size_t>(edge_count_++)];
  e = {a, b, 0, 0, 0, kNotKnown};
  return e;
}

// How much of a valley lies between two pieces, 0 to 1.
float ObjectGraph::valley_of(const SurfacePiece& p, const SurfacePiece& q,
                             const ObjectGraphConfig& c) noexcept {
  const float side = (p.normal - q.normal).dot(p.centre - q.centre);
  if (!(side < 0)) return 0;
  const float angle = std::acos(std::clamp(p.normal.dot(q.normal), -1.0F, 1.0F)) / kDegree;
  return std::clamp((angle - c.smooth_deg) / (c.crease_deg - c.smooth_deg), 0.0F, 1.0F);
}

void ObjectGraph::collect(const SurfacePatches& patches, const ObjectGraphConfig& c) noexcept {
  const int w = patches.window().width, h = patches.window().height;
  const auto& labels = patches.labels();
  edge_count_ = 0;
  std::fill_n(best_.begin(), pieces_, -1);
  const auto usable = [&](int i) {
    return patches.piece(i).has_plane() && !support_[static_cast<std::size_t>(i)];
  };
  const auto gap = [&](const SurfacePiece& p, int u, int v, float z) {
    const float q = p.w.x() * patches.x_of(u) + p.w.y() * patches.y_of(v) + p.w.z();
    return q > 1e-3F ? std::abs(1 / q - z) : 1e3F;
  };
  const auto pair = [&](int u, int v, int u2, int v2) {
    const int i = v * w + u, j = v2 * w + u2;
    const int a = labels[static_cast<std::size_t>(i)], b = labels[static_cast<std::size_t>(j)];
    if (a == b || !usable(a) || !usable(b)) return;
    const float zi = patches.z_m()[static_cast<std::size_t>(i)];
    const float zj = patches.z_m()[static_cast<std::size_t>(j)];
    if (!(zi > 0) || !(zj > 0)) return;
    const SurfacePiece &pa = patches.piece(a), &pb = patches.piece(b);
    Edge& e = edge_between(std::min(a, b), std::max(a, b));
    e.length += 1;
    const float limit = height_noise(c.step_m, c.step_per_m2, std::min(zi, zj));
    const bool step =
        std::abs(zi - zj) > limit && std::min(gap(pb, u, v, zi), gap(pa, u2, v2, zj)) > limit;
    if (step) {
      e.step += std::abs(zi - zj) > c.far_m ? 20.0F : 1.0F;
      return;
    }
    if (e.cost < 0) e.cost = valley_of(pa, pb, c);  // the same for all pairs of the edge
    e.concave += e.cost;
  };
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      if (u + 1 < w) pair(u, v, u + 1, v);
      if (v + 1 < h) pair(u, v, u, v + 1);
    }
  }
}

// Edges between the same two regions become one.
void ObjectGraph::combine() noexcept {
  int kept = 0;
  for (int k = 0; k < edge_count_; ++k) {
    Edge e = edges_[static_cast<std::size_t>(k)];
    const int a = root(e.a), b = root(e.b);
    if (a == b) continue;
    e.a = std::min(a, b);
    e.b = std::max(a, b);
    edges_[static_cast<std::size_t>(kept++)] = e;
  }
  // stable order is not needed: every sum is of integers or of values that depend on the pair alone
  std::sort(edges_.begin(), edges_.begin() + kept, [](const Edge& x, const Edge& y) {
    return x.a != y.a ? x.a < y.a : x.b != y.b ? x.b < y.b : x.concave < y.concave;
  });
  edge_count_ = 0;
  for (int k = 0; k < kept; ++k) {
    const Edge& e = edges_[static_cast<std::size_t>(k)];
    if (edge_count_ > 0) {
      Edge& last = edges_[static_cast<std::size_t>(edge_count_ - 1)];
      if (last.a == e.a && last.b == e.b) {
        last.length += e.length;
        last.step += e.step;
        last.concave += e.concave;
        continue;
      }
    }
    edges_[static_cast<std::size_t>(edge_count_++)] = e;
  }
}

float ObjectGraph::colour_difference(const Region& a, const Region& b) noexcept {
  if (!(a.n > 0) || !(b.n > 0)) return kNotKnown;
  const float dL = 0.5F * (a.L / a.n - b.L / b.n), da = a.a / a.n - b.a / b.n,
              db = a.b / a.n - b.b / b.n;
  return std::sqrt(dL * dL + da * da + db * db);
}

bool ObjectGraph::merge_round(const ObjectGraphConfig& c) noexcept {
  std::fill_n(best_.begin(), pieces_, -1);
  for (int k = 0; k < edge_count_; ++k) {
    Edge& e = edges_[static_cast<std::size_t>(k)];
    const Region &a = sums_[static_cast<std::size_t>(e.a)],
                 &b = sums_[static_cast<std::size_t>(e.b)];
    // Colours that nobody knows speak neither for one object nor for two.
    const float colour = colour_difference(a, b);
    const float alike = colour < 0 ? 0.0F : std::exp(-colour / c.colour_scale);
    const float unlike = colour < 0 ? 0.0F : 1 - alike;
    const float area = std::min(a.area_cm2, b.area_cm2);
    const float valley = c.concave_weight * e.concave / e.length * (1 - c.same_colour * alike) +
                         c.colour_weight * unlike;
    const float step = c.step_weight * e.step / e.length * (1 - c.same_colour_step * alike);
    e.cost = 2 * area * (valley / (area + c.area_cm2) + step / (area + c.step_area_cm2));
    for (const int r : {e.a, e.b}) {
      int& best = best_[static_cast<std::size_t>(r)];
      if (best < 0 || e.cost < edges_[static_cast<std::size_t>(best)].cost) best = k;
    }
  }
  bool merged = false;
  for (int k = 0; k < edge_count_; ++k) {
    const Edge& e = edges_[static_cast<std::size_t>(k)];
    if (e.cost > c.stop || best_[static_cast<std::size_t>(e.a)] != k ||
        best_[static_cast<std::size_t>(e.b)] != k) {
      continue;
    }
    parent_[static_cast<std::size_t>(e.b)] = e.a;
    Region &a = sums_[static_cast<std::size_t>(e.a)], &b = sums_[static_cast<std::size_t>(e.b)];
    a.L += b.L;
    a.a += b.a;
    a.b += b.b;
    a.n += b.n;
    a.area_cm2 += b.area_cm2;
    merged = true;
  }
  return merged;
}

ObjectGraph::Face ObjectGraph::largest_face(const SurfacePatches& patches, int region) noexcept {
  constexpr float kAligned = 0.906F, kThick = 0.012F;  // 25 degrees
  constexpr std::size_t kTried = 64;
  std::size_t count = 0;
  for (int i = 0; i < pieces_; ++i)
    if (region_[static_cast<std::size_t>(i)] == region) best_[count++] = i;
  const std::span<const int> members(best_.data(), count);
  Face best;
  for (const int i : members.first(std::min(count, kTried))) {
    const SurfacePiece& p = patches.piece(i);
    float area = 0;
    for (const int j : members) {
      const SurfacePiece& q = patches.piece(j);
      if (q.normal.dot(p.normal) > kAligned &&
          std::abs(p.normal.dot(q.centre - p.centre)) < kThick) {
        area += static_cast<float>(q.readings) * q.centre.z() * q.centre.z();
      }
    }
    if (area > best.area) best = {p.normal, p.centre, area};
  }
  if (!(best.area > 0)) return best;
  for (int round = 0; round < 2; ++round) {
    Vec3 mean = Vec3::Zero();
    Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
    double weight = 0;
    for (int pass = 0; pass < 2; ++pass) {
      for (const int j : members) {
        const SurfacePiece& q = patches.piece(j);
        if (q.normal.dot(best.n) < kAligned ||
            std::abs(best.n.dot(q.centre - best.centre)) > kThick) {
          continue;
        }
        if (pass == 0) {
          mean += double(q.readings) * q.centre.cast<double>();
          weight += q.readings;
        } else {
          const Vec3 e = q.centre.cast<double>() - mean;
          moment += double(q.readings) * e * e.transpose();
        }
      }
      if (pass == 0) {
        if (!(weight > 0)) return {};
        mean /= weight;
      }
    }
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(moment);
    Vec3 n = solver.eigenvectors().col(0);
    if (n.dot(mean) > 0) n = -n;
    best.n = n.cast<float>();
    best.centre = mean.cast<float>();
  }
  return best;
}

bool ObjectGraph::same_behind_occluder(const SurfacePatches& patches, int region_a, int region_b,
                                       const ObjectGraphConfig& c) noexcept {
  if (colour_difference(sums_[static_cast<std::size_t>(region_a)],
                        sums_[static_cast<std::size_t>(region_b)]) > c.occluded_colour)
    return false;
  if (region_a != asked_region_) {
    asked_face_ = largest_face(patches, region_a);
    asked_region_ = region_a;
  }
  const Face &a = asked_face_, b = largest_face(patches, region_b);
  if (!(a.area > 0) || !(b.area > 0)) return false;
  const Vec3f apart = b.centre - a.centre;
  const float z = std::max(a.centre.z(), b.centre.z());
  const float thick = 1.5F * height_noise(c.step_m, c.step_per_m2, z);
  if (a.n.dot(b.n) < 0.97F || std::abs(a.n.dot(apart)) > thick ||
      std::abs(b.n.dot(apart)) > thick || apart.norm() > 0.35F) {
    return false;
  }
  const int w = patches.window().width, h = patches.window().height;
  const float du = patches.x_step(), dv = patches.y_step();
  int hidden = 0;
  constexpr int kSamples = 24;
  for (int k = 1; k < kSamples; ++k) {
    const Vec3f p = a.centre + apart * (static_cast<float>(k) / kSamples);
    const int u = static_cast<int>((p.x() / p.z() - patches.x_of(0)) / du + 0.5F);
    const int v = static_cast<int>((p.y() / p.z() - patches.y_of(0)) / dv + 0.5F);
    if (u < 0 || v < 0 || u >= w || v >= h) return false;
    const float seen = patches.z_m()[static_cast<std::size_t>(v * w + u)];
    if (!(seen > 0)) continue;
    if (seen > p.z() + 2 * thick) return false;
    hidden += seen < p.z() - thick ? 1 : 0;
  }
  return hidden >= 2;
}

void ObjectGraph::build(const SurfacePatches& patches, const SupportPlane& plane,
                        const ObjectGraphConfig& c) noexcept {
  pieces_ = patches.count();
  asked_region_ = kNone;
  mark_support(patches, plane, c);
  free_coloured_support(patches, c);
  const float pixel = patches.x_step();
  for (int i = 0; i < pieces_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const SurfacePiece& p = patches.piece(i);
    const auto n = static_cast<float>(p.coloured);
    const float side_m = p.centre.z() * pixel;
    sums_[k] = {n * p.L, n * p.a, n * p.b, n,
                1e4F * static_cast<float>(p.readings) * side_m * side_m};
    parent_[k] = i;
  }
  collect(patches, c);
  combine();
  while (merge_round(c)) combine();
  const auto name = [&] {
    for (int i = 0; i < pieces_; ++i) {
      const auto k = static_cast<std::size_t>(i);
      region_[k] = support_[k] != 0 ? kSupport : patches.piece(i).has_plane() ? root(i) : kNone;
    }
  };
  name();
  join_hollow(patches, plane, c);
  name();
}

}  // namespace perception
