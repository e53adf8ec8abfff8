#include "tasks/haptic/descent.hpp"

namespace tasks {

namespace {

constexpr double kSlopeMin = 0.005;   // below it a gradient gives no direction
constexpr double kOnWall_vox = 1e-9;  // as CellFlow::run takes it
constexpr int kSweepSamples = 512;    // 128 voxels: more than any window

}  // namespace

// Newton onto the surface, outwards. False: not reached.
bool Descent::lift(Vec3& p, Gap& g) noexcept {
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
bool Descent::carry(Vec3& p, Gap& g) noexcept {
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

// One of the cells that meet at p is unknown.
bool Descent::meets_unknown(const Vec3& p) const noexcept {
  const Vec3 q = p / field_.voxel();
  if (!(q.cwiseAbs().maxCoeff() < 1e9)) return true;
  std::array<std::int32_t, 3> at{};
  unsigned walls = 0;
  for (std::size_t a = 0; a < 3; ++a) {
    const double x = q[static_cast<Eigen::Index>(a)], node = std::round(x);
    const bool on = std::abs(x - node) < kOnWall_vox;
    at[a] = static_cast<std::int32_t>(on ? node : std::floor(x));
    if (on) walls |= 1U << a;
  }
  for (unsigned below = 0; below < 8; ++below) {
    if ((below & ~walls) != 0) continue;
    std::array<std::int32_t, 3> cell = at;
    for (std::size_t a = 0; a < 3; ++a) cell[a] -= static_cast<std::int32_t>((below >> a) & 1U);
    CellSample s;
    if (!field_.sample_in(cell, Vec3::Zero(), s)) return true;
  }
  return false;
}

// In unknown space the held surface goes on from where the proxy is: nothing moves it there.
Gap Descent::gap_at_proxy(const Vec3& p) noexcept {
  Gap g = gap(p);
  if (g.known) return g;
  for (std::size_t i = 0; i < frame_size_; ++i) {
    frame_[i].d = std::min(frame_[i].d, frame_[i].n.dot(p));
  }
  return held_gap(p);
}

void Descent::contact(Vec3 p) noexcept {
  Gap g = gap_at_proxy(p);
  if (!carry(p, g)) {
    hold();
    return;
  }
  if (frame_size_ == 0 && g.known && g.gradient.norm() > kSlopeMin) {
    const Vec3 n = g.gradient.normalized();  // what the unknown beside the first touch is taken for
    frame_[frame_size_++] = {n, n.dot(p)};
  }
  CellFlow flow(field_, cfg_, radius_, h_, frame_, frame_size_);
  p = flow.run(p);
  if (cfg_.tip_radius_m > 0) {  // round there, not where it was in the last tick
    radius_ = radius_at(p);
    g = gap_at_proxy(p);
    if (!carry(p, g)) {
      hold();
      return;
    }
    flow.set_radius(radius_);
    (void)flow.run(p);
  }
  const Vec3 shift = cfg_.shade ? flow.shade() : Vec3(Vec3::Zero());
  p = flow.place();
  std::array<Tangent, 3> tangents;
  const std::size_t count = flow.tangents(tangents);
  finish(p, tangents, count);
  if (state_.phase == ProxyState::Phase::kContact) state_.set_shift(shift);
}

void Descent::finish(const Vec3& p, const std::array<Tangent, 3>& tangents,
                     std::size_t count) noexcept {
  const Gap g = gap(p);
  if ((p - h_).squaredNorm() <= cfg_.step_min_m * cfg_.step_min_m && gap(h_).value > 0) {
    leave(h_, g.known);
    return;
  }
  state_.phase = ProxyState::Phase::kContact;
  state_.held = !g.known;
  state_.set_p(p);
  state_.contacts = static_cast<std::int32_t>(count);
  const Vec3 out = p - h_;
  const double length = out.norm();
  if (length > 1e-5) {
    state_.set_normal(out / length);
  } else if (count > 0) {
    state_.set_normal(tangents[0].half.n);
  }
  // The held frame goes on where nothing else bears; beside it, what is known here is the newest
  // there is of it.
  bool known = false;
  for (std::size_t i = 0; i < count; ++i) {
    state_.held = state_.held || !tangents[i].known;
    known = known || tangents[i].known;
  }
  if (!known) return;
  for (std::size_t i = 0; i < count; ++i) {
    const HalfSpace& f = tangents[i].half;
    state_.frame[i] = {f.n.x(), f.n.y(), f.n.z(), f.d};
  }
  state_.frame_size = static_cast<std::int32_t>(count);
}

void Descent::leave(const Vec3& p, bool free) noexcept {
  state_.phase = free ? ProxyState::Phase::kFree : ProxyState::Phase::kUnknown;
  state_.set_p(p);
  state_.set_normal(Vec3::Zero());
  state_.frame_size = 0;
  state_.contacts = 0;
}

// No field to go by: the last contact planes alone.
void Descent::hold() noexcept {
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
void Descent::place() noexcept {
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

// Where the way from `out`, which is free, to `in` goes into the solid: regula falsi with
// bisection. The answer is on the free side.
Vec3 Descent::crossing(Vec3 out, double value_out, Vec3 in, double value_in) const noexcept {
  for (int k = 0; k < 24 && value_out > cfg_.tolerance_m; ++k) {
    double t = (k & 1) != 0 ? 0.5 : value_out / (value_out - value_in);
    t = std::clamp(t, 0.01, 0.99);
    const Vec3 middle = out + t * (in - out);
    const FieldSample m = field_.sample(middle);
    if (m.known && m.value > radius_) {
      out = middle;
      value_out = m.value - radius_;
    } else {
      in = middle;
      value_in = m.known ? m.value - radius_ : value_in;
    }
  }
  return out;
}

// Free or unknown: from the last place to the hand, looking for the crossing from seen-free to
// solid.
void Descent::sweep() noexcept {
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
  bool free = state_.phase == Phase::kFree || TouchRules::unknown_is_free();
  Vec3 last = from;
  double last_value = 0;
  for (; i <= n; ++i) {
    const Vec3 x = i == n ? h_ : Vec3(from + (static_cast<double>(i) / n) * way);
    const FieldSample s = field_.sample(x);
    if (!s.known) {
      free = TouchRules::unknown_is_free();
    } else if (s.value > radius_) {
      free = true;
    } else if (free) {
      Vec3 out = x;
      if (i == 0) {  // the surface came to the hand
        const double slope = s.gradient.norm();
        if (slope < kSlopeMin) {
          free = false;
          continue;
        }
      } else {
        out = crossing(last, last_value, x, s.value - radius_);
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

}  // namespace tasks
