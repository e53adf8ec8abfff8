#include "tasks/haptic/descent.hpp"

namespace tasks {

namespace {

constexpr double kSlopeMin = 0.005;          // below it a gradient gives no direction
constexpr double kHop_vox = 0.025;           // the widest rest before a ridge that is passed over
constexpr double kResampleNear_vox = 0.002;  // a plane from nearer than this is the surface at p
constexpr int kSweepSamples = 512;           // 128 voxels: more than any window

}  // namespace

template <bool kTextured>
Plane Descent<kTextured>::plane(const Vec3& x, const Gap& g, bool fresh) const noexcept {
  const double slope = g.gradient.norm();
  Plane out;
  out.at = x;
  out.fresh = fresh;
  out.known = g.known;
  if (slope < kSlopeMin) {
    out.half.n = state_.normal_W();  // no direction here: the side it is on
    out.half.d = out.half.n.dot(x);
  } else {
    out.half.n = g.gradient / slope;
    out.half.d = out.half.n.dot(x) - g.value / slope;
  }
  return out;
}

// A crease that runs along grid nodes has no gradient on its line: there the tangents of the faces
// are taken from an eighth of a voxel to either side, those that hold for p and bar h the most.
template <bool kTextured>
void Descent<kTextured>::probe(const Vec3& p) noexcept {
  const double reach = 0.125 * field_.voxel();
  std::array<Plane, 3> found{};
  std::size_t n = 0;
  for (int i = 0; i < 6; ++i) {
    Vec3 q = p;
    q[i >> 1] += (i & 1) != 0 ? -reach : reach;
    const Gap g = gap(q);
    if (g.gradient.norm() < kSlopeMin) continue;
    const Plane face = plane(q, g, true);
    if (face.half.distance(p) < -cfg_.tolerance_m || face.half.distance(h_) >= 0) continue;
    std::size_t twin = 0;
    while (twin < n && face.half.n.dot(found[twin].half.n) < 0.9) ++twin;
    if (twin < n) {  // the same face again: keep the tighter one at p
      if (face.half.distance(p) < found[twin].half.distance(p)) found[twin] = face;
    } else if (n < 3) {
      found[n++] = face;
    }
  }
  if (n == 0) return;
  planes_ = found;
  size_ = n;
}

template <bool kTextured>
PlanesResult Descent<kTextured>::solve() const noexcept {
  std::array<HalfSpace, 3> halves{};
  for (std::size_t i = 0; i < size_; ++i) halves[i] = planes_[i].half;
  return nearest_on_planes(halves, size_, h_);
}

// Newton onto the surface, outwards. False: not reached.
template <bool kTextured>
bool Descent<kTextured>::lift(Vec3& p, Gap& g) noexcept {
  for (int i = 0; i < 8 && g.value < -cfg_.tolerance_m; ++i) {
    const double slope = g.gradient.norm();
    if (slope < kSlopeMin) return false;
    const double step = std::min(-g.value / slope, kSweepStep_vox * field_.voxel());
    p += (step / slope) * g.gradient;
    g = gap(p);
  }
  return g.value >= -10 * cfg_.tolerance_m;
}

// The field changed under a proxy in contact: out of the solid along its own side, never through
// it.
template <bool kTextured>
bool Descent<kTextured>::carry(Vec3& p, Gap& g) noexcept {
  if (g.value >= -cfg_.tolerance_m) return true;
  const Vec3 side = state_.normal_W();
  if (g.gradient.dot(side) > 0.5 * g.gradient.norm()) {
    Vec3 q = p;
    Gap gq = g;
    if (lift(q, gq) && (q - p).dot(side) > 0) {
      p = q;
      g = gq;
      return true;
    }
  }
  const double step = kSweepStep_vox * field_.voxel();
  Vec3 inside = p;
  for (double done = step; done <= field_.truncation() + step; done += step) {
    Vec3 q = p + done * side;
    Gap gq = gap(q);
    if (gq.value < 0) {
      inside = q;
      continue;
    }
    for (int i = 0; i < 24 && gq.value > cfg_.tolerance_m; ++i) {
      const Vec3 middle = 0.5 * (inside + q);
      const Gap gm = gap(middle);
      if (gm.value < 0) {
        inside = middle;
      } else {
        q = middle;
        gq = gm;
      }
    }
    p = q;
    g = gq;
    return true;
  }
  return false;
}

// The proxy moved: its tangent comes first; older planes stay while the proxy is on their free side
// (the surface is concave between) and near the place they were sampled at.
template <bool kTextured>
void Descent<kTextured>::accept(const Vec3& p, const Gap& g) noexcept {
  std::array<Plane, 3> kept{};
  kept[0] = plane(p, g, true);
  std::size_t n = 1;
  const double reach = 0.5 * field_.voxel();
  for (std::size_t i = 0; i < size_ && n < 3; ++i) {
    Plane old = planes_[i];
    if (old.half.distance(p) < -cfg_.tolerance_m) continue;
    if ((old.at - p).squaredNorm() > reach * reach) continue;
    if (old.half.n.dot(kept[0].half.n) > 0.9999) continue;
    old.fresh = false;
    kept[n++] = old;
  }
  planes_ = kept;
  size_ = n;
  if (g.gradient.norm() < kSlopeMin) probe(p);
}

template <bool kTextured>
void Descent<kTextured>::add(const Plane& p) noexcept {
  if (size_ < 3) {
    planes_[size_++] = p;
    return;
  }
  // Full: the proxy's own tangent stays; an inactive plane goes first, else the older one.
  const std::size_t victim = (active_ & 2U) == 0 ? 1 : (active_ & 4U) == 0 ? 2 : 1;
  if (victim == 1) planes_[1] = planes_[2];
  planes_[2] = p;
}

template <bool kTextured>
bool Descent<kTextured>::drop_stale(unsigned active) noexcept {
  bool dropped = false;
  std::size_t n = 1;
  for (std::size_t i = 1; i < size_; ++i) {
    if (!planes_[i].fresh && (active & (1U << i)) != 0) {
      dropped = true;
      continue;
    }
    planes_[n++] = planes_[i];
  }
  size_ = n;
  return dropped;
}

// The working set bars every way, but a plane sampled at some distance from p says little of the
// surface at p where that is bent: such planes go, and the next step is short enough to find them
// again from near. False: all of them were near.
template <bool kTextured>
bool Descent<kTextured>::resample(const Vec3& p, unsigned active, double& trust) noexcept {
  const double near2 = kResampleNear_vox * kResampleNear_vox * field_.voxel() * field_.voxel();
  double farthest2 = near2;
  std::size_t n = 1;
  for (std::size_t i = 1; i < size_; ++i) {
    const double d2 = (planes_[i].at - p).squaredNorm();
    if ((active & (1U << i)) != 0 && d2 > near2) {
      farthest2 = std::max(farthest2, d2);
      continue;
    }
    planes_[n++] = planes_[i];
  }
  if (n == size_) return false;
  size_ = n;
  trust = 0.25 * std::sqrt(farthest2);
  return true;
}

// One descent step from p. False: the proxy is where it should be.
template <bool kTextured>
bool Descent<kTextured>::step(Vec3& p, Gap& g, double& trust) noexcept {
  const PlanesResult best = solve();
  active_ = best.active;
  if (!best.solved) return drop_stale(~0U) || resample(p, ~0U, trust);
  const Vec3 d = best.x - p;
  const double length = d.norm();
  if (length < cfg_.step_min_m) {
    return drop_stale(best.active) || resample(p, best.active, trust);
  }
  const double stride = std::min(length, trust);
  Vec3 x = p + (stride / length) * d;
  Gap gx = gap(x);
  if (gx.value < -cfg_.tolerance_m) {
    Plane cut = plane(x, gx, true);
    const double depth = -cut.half.distance(x), at_p = cut.half.distance(p);
    // The tangent there holds for the proxy too: the surface bends towards us. Take it as a
    // constraint, through the proxy where it would shut it in by the rounding of the surface.
    if (depth > 0.02 * stride &&
        at_p >= -std::clamp(0.25 * depth, cfg_.tolerance_m, 10 * cfg_.tolerance_m)) {
      cut.half.d += std::min(at_p, 0.0);
      add(cut);
      return true;
    }
    if (!lift(x, gx)) {
      trust = 0.25 * stride;
      return trust >= cfg_.step_min_m;
    }
  }
  const double before = (p - h_).squaredNorm(), after = (x - h_).squaredNorm();
  const double gain_min = 2e-8 * std::sqrt(before) + 1e-16;
  bool good = after < before - gain_min;
  if (good && stride > 0.125 * field_.voxel()) {
    good = gap(0.5 * (p + x)).value > -0.05 * field_.voxel();
  }
  if (!good) {
    trust = 0.25 * stride;
    return trust >= cfg_.step_min_m;
  }
  accept(x, gx);
  p = x;
  g = gx;
  trust = std::min(2 * std::max(trust, stride), stride_max_);
  return true;
}

// The field is bent only where cells meet. Just before such a ridge the proxy may rest although the
// surface falls away behind it; a rest that ends within a fortieth of a voxel is none. True: the
// other side is nearer to the hand, and the proxy stands there.
template <bool kTextured>
bool Descent<kTextured>::hop(Vec3& p, Gap& g, double& trust) noexcept {
  const double reach = kHop_vox * field_.voxel();
  const double before = (p - h_).squaredNorm();
  const Vec3 n = planes_[0].half.n;
  for (int axis = 0; axis < 3; ++axis) {
    const double cell = p[axis] / field_.voxel(), into = cell - std::floor(cell);
    if (into > kHop_vox && into < 1 - kHop_vox) continue;
    Vec3 way = -n[axis] * n;
    way[axis] += 1;
    const double length = way.norm();
    if (length < 0.2) continue;
    Vec3 x = p + ((into < 0.5 ? -reach : reach) / length) * way;
    Gap gx = gap(x);
    const double slope = gx.gradient.norm();
    if (!gx.known || gx.value < 0 || slope < kSlopeMin) continue;
    x -= (std::min(gx.value / slope, reach) / slope) * gx.gradient;
    gx = gap(x);
    if (gx.value < -cfg_.tolerance_m && !lift(x, gx)) continue;
    if ((x - h_).squaredNorm() >= before - 2e-8 * std::sqrt(before)) continue;
    accept(x, gx);
    p = x;
    g = gx;
    trust = stride_max_;
    return true;
  }
  return false;
}

template <bool kTextured>
void Descent<kTextured>::contact(Vec3 p) noexcept {
  Gap g = gap(p);
  if (!carry(p, g)) {
    hold();
    return;
  }
  size_ = 0;
  accept(p, g);
  double trust = stride_max_;
  for (int i = 0; i < cfg_.iterations_max; ++i) {
    if (!step(p, g, trust) && !hop(p, g, trust)) break;
  }
  finish(p, g);
}

template <bool kTextured>
void Descent<kTextured>::finish(const Vec3& p, const Gap& g) noexcept {
  if ((p - h_).squaredNorm() <= cfg_.step_min_m * cfg_.step_min_m && g.value >= 0) {
    leave(h_, g.known);
    return;
  }
  state_.phase = ProxyState::Phase::kContact;
  state_.held = !g.known;
  state_.set_p(p);
  std::size_t n = 0;
  unsigned used = active_;
  if (used == 0) used = 1;
  bool all_known = true;
  for (std::size_t i = 0; i < size_; ++i) {
    if ((used & (1U << i)) == 0) continue;
    all_known = all_known && planes_[i].known;
    ++n;
  }
  state_.contacts = active_ == 0 && g.value > 1e-4 ? 0 : static_cast<std::int32_t>(n);
  const Vec3 out = p - h_;
  const double length = out.norm();
  state_.set_normal(length > 1e-5 ? Vec3(out / length) : planes_[0].half.n);
  if (!all_known) {
    state_.held = true;
    return;
  }
  n = 0;
  for (std::size_t i = 0; i < size_; ++i) {
    if ((used & (1U << i)) == 0) continue;
    const HalfSpace& f = planes_[i].half;
    state_.frame[n++] = {f.n.x(), f.n.y(), f.n.z(), f.d};
  }
  state_.frame_size = static_cast<std::int32_t>(n);
}

template <bool kTextured>
void Descent<kTextured>::leave(const Vec3& p, bool free) noexcept {
  state_.phase = free ? ProxyState::Phase::kFree : ProxyState::Phase::kUnknown;
  state_.set_p(p);
  state_.set_normal(Vec3::Zero());
  state_.frame_size = 0;
  state_.contacts = 0;
}

// No field to go by: the last contact planes alone.
template <bool kTextured>
void Descent<kTextured>::hold() noexcept {
  const PlanesResult best = nearest_on_planes(frame_, frame_size_, h_);
  if (!best.solved) {  // opposed planes: stay
    state_.held = true;
    state_.contacts = state_.frame_size;
    return;
  }
  if (best.active == 0) {
    leave(h_, false);
    return;
  }
  state_.held = true;
  state_.set_p(best.x);
  const Vec3 out = best.x - h_;
  if (out.norm() > 1e-5) state_.set_normal(out.normalized());
  state_.contacts = static_cast<std::int32_t>((best.active & 1U) + ((best.active >> 1U) & 1U) +
                                              ((best.active >> 2U) & 1U));
}

// First tick: in free space the proxy is the hand; inside, the nearest surface point, if what lies
// before it was seen free (the right side).
template <bool kTextured>
void Descent<kTextured>::place() noexcept {
  state_.set_p(h_);
  const FieldSample s = field_.sample(h_);
  if (!s.known) {
    state_.phase = ProxyState::Phase::kUnknown;
    return;
  }
  if (s.value > radius_) {
    state_.phase = ProxyState::Phase::kFree;
    return;
  }
  state_.phase = ProxyState::Phase::kUnknown;
  Vec3 p = h_;
  Gap g = gap(p);
  double gone = 0;
  for (int i = 0; i < 32 && g.known && g.value < -cfg_.tolerance_m; ++i) {
    const double slope = g.gradient.norm();
    if (slope < kSlopeMin) return;
    const double step = std::min(-g.value / slope, 0.5 * field_.voxel());
    p += (step / slope) * g.gradient;
    gone += step;
    if (gone > 1.5 * field_.truncation()) return;
    g = gap(p);
  }
  if (!g.known || g.value < -10 * cfg_.tolerance_m || g.gradient.norm() < kSlopeMin) return;
  const Vec3 n = g.gradient.normalized();
  if (!field_.seen_free(p + 0.5 * field_.voxel() * n)) return;
  state_.set_normal(n);
  state_.started_inside = true;
  contact(p);
}

// Free or unknown: from the last place to the hand, looking for the crossing from seen-free to
// solid.
template <bool kTextured>
void Descent<kTextured>::sweep() noexcept {
  using Phase = ProxyState::Phase;
  if (field_.near_edge(h_)) {
    leave(h_, false);
    return;
  }
  const Vec3 from = state_.p_WP();
  const Vec3 way = h_ - from;
  const double length = way.norm(), stride = kSweepStep_vox * field_.voxel();
  int n = std::max(1, static_cast<int>(std::min(std::ceil(length / stride), 1e6)));
  int i = 0;
  if (n > kSweepSamples) {  // another place altogether: nothing is known of the way
    state_.phase = Phase::kUnknown;
    n = i = 1;
  }
  bool free = state_.phase == Phase::kFree;
  Vec3 last = from;
  double last_value = 0;
  for (; i <= n; ++i) {
    const Vec3 x = i == n ? h_ : Vec3(from + (static_cast<double>(i) / n) * way);
    const FieldSample s = field_.sample(x);
    if (!s.known) {
      free = false;
    } else if (s.value > radius_) {
      free = true;
    } else if (free) {
      Vec3 out = last, in = x;
      if (i == 0) {  // the surface came to the hand
        const double slope = s.gradient.norm();
        if (slope < kSlopeMin) {
          free = false;
          continue;
        }
        out = x;
      } else {  // regula falsi with bisection, keeping `out` on the free side
        double value_in = s.value - radius_;
        for (int k = 0; k < 24 && last_value > cfg_.tolerance_m; ++k) {
          double t = (k & 1) != 0 ? 0.5 : last_value / (last_value - value_in);
          t = std::clamp(t, 0.01, 0.99);
          const Vec3 middle = out + t * (in - out);
          const FieldSample m = field_.sample(middle);
          if (m.known && m.value > radius_) {
            out = middle;
            last_value = m.value - radius_;
          } else {
            in = middle;
            value_in = m.known ? m.value - radius_ : value_in;
          }
        }
      }
      const Vec3 gradient = field_.sample(out).gradient;
      const double slope = gradient.norm();
      state_.set_normal(slope > kSlopeMin ? Vec3(gradient / slope)
                        : length > 0      ? Vec3(-way / length)
                                          : Vec3::UnitZ());
      contact(out);
      return;
    }
    last = x;
    last_value = s.value - radius_;
  }
  leave(h_, free);
}

template class Descent<false>;
template class Descent<true>;

}  // namespace tasks
